"""The arguments of `warpopt solve`, `rules` and `limit`: one view frustum and one light direction each."""

import dataclasses
from pathlib import Path

import tyro

from ..common.command import Plain
from ..common.jax_settings import prepare_jax
from ..common.output import TABLE_ENDINGS, check_files_replaceable
from ..common.settings import ConfigError, validated
from .settings import Problem


@dataclasses.dataclass(frozen=True)
class _OneView(Plain):
    near: float
    """Distance of the near plane."""
    far: float
    """Distance of the far plane."""
    half_fov_deg: float
    """Half the field of view, in degrees."""
    theta_deg: float
    """Angle between light and view direction, in degrees, 0 to 180."""
    norm: str = "inf"
    """inf, l1, l2 or a real order >= 1."""
    measure: str = "screen"
    """volume, screen, log_depth, ground or axis."""

    def problem(self) -> Problem:
        """The problem, validated; the next step may use JAX."""
        fields = {name: value for name, value in vars(self).items() if name in Problem.model_fields}
        problem = validated(Problem, fields, "command line")
        prepare_jax()
        return problem


@dataclasses.dataclass(frozen=True)
class _OneProblem(_OneView):
    metric: str = "p"
    """p, q or pxq."""
    json: bool = False
    """Print JSON."""


@dataclasses.dataclass(frozen=True)
class Solve(_OneProblem):
    """The optimal warp of one view and light direction."""

    def run(self) -> int:
        problem = self.problem()
        from .run import solve

        return solve(problem, self.json)


@dataclasses.dataclass(frozen=True)
class Rules(_OneProblem):
    """Every rule's lambda, published or from an engine, and its error as a multiple of the optimum's."""

    def run(self) -> int:
        problem = self.problem()
        from .run import rules

        return rules(problem, self.json)


@dataclasses.dataclass(frozen=True)
class Limit(_OneView):
    """The map s(delta) of E_p that attains the lower bound of any map, as a table: data (docs/engines.md reads it in
    C); over a scene's receivers, use `warpopt.lower_bound_map` in Python."""

    files: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Output files, for example limit.csv limit.json: each ends in .npz, .csv or .json."""

    def run(self) -> int:
        wrong = [file for file in self.files if file.suffix not in TABLE_ENDINGS]
        if wrong or not self.files:
            got = wrong[0] if wrong else "none"
            raise ConfigError(
                f"files: got {got}, expected files such as limit.csv, ending in {', '.join(TABLE_ENDINGS)}"
            )
        check_files_replaceable(self.files)
        problem = self.problem()
        from .run import write_limit_map

        return write_limit_map(problem, self.files)

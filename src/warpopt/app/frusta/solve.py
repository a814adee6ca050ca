"""Every optimum and every rule over frusta and light directions, as plain arrays."""

import dataclasses
from collections.abc import Callable, Iterable

import jax
import numpy as np

from warpopt.objective import Objective
from warpopt.rules.registry import PUBLISHED
from warpopt.solve.outcome import failed_on_host

from ..common.command import Failed
from ..common.of_objective import OfObjective
from .block_files import Block, BlockFiles
from .block_solver import BlockSolver, solve_blocks
from .problem import SweepProblem, View


@dataclasses.dataclass(frozen=True)
class Curves:
    """A warp for every view and direction: arrays of shape (views, directions)."""

    eta: np.ndarray
    lam_over_mu: np.ndarray
    lam: np.ndarray


@dataclasses.dataclass(frozen=True)
class RuleCurves(Curves):
    """A published rule's warps; `defined` is False where the rule yields no lambda > 0 (eta is 1 there)."""

    defined: np.ndarray


@dataclasses.dataclass(frozen=True)
class OptimumCurves(OfObjective, Curves):
    """The optimum of one objective, every rule's norm over the minimal one, and the limit: NaN where none is known."""

    objective: Objective
    value: np.ndarray
    result: np.ndarray
    residual: np.ndarray
    ratios: dict[str, np.ndarray]
    limit: np.ndarray

    @property
    def over_limit(self) -> np.ndarray:
        """The minimal norm as a multiple of the limit; NaN where there is none, or it is 0 (receivers at one depth)."""
        return self.value / np.where(self.limit > 0, self.limit, np.nan)

    @property
    def failed(self) -> np.ndarray:
        """Where no optimum was found."""
        return failed_on_host(self.result)

    @property
    def no_limit_because(self) -> str | None:
        """Why there is no limit, as text; None if there is one."""
        return self.objective.no_bound_because


@dataclasses.dataclass(frozen=True)
class Sweep:
    """All results of a run. `views` are the config's; `context` adds more f/n for the figures, listed after them."""

    views: tuple[View, ...]
    context: tuple[View, ...]
    theta_deg: np.ndarray
    rules: dict[str, RuleCurves]
    optima: tuple[OptimumCurves, ...]

    @property
    def measure(self) -> str:
        """The measure of every objective."""
        return self.optima[0].objective.measure

    @property
    def all_views(self) -> tuple[View, ...]:
        return self.views + self.context


def compute_sweep(
    views: tuple[View, ...],
    context: tuple[View, ...],
    theta_deg: np.ndarray,
    objectives: Iterable[Objective],
    progress: Callable[[str], None] = lambda name: None,
) -> Sweep:
    """Solve everything in this process; `progress` receives each finished objective of each block."""
    problem = SweepProblem(views, context, np.asarray(theta_deg, float), tuple(objectives))
    return sweep_of(problem, None, progress)


class Incomplete(Failed):
    """Expected blocks are missing."""


def sweep_of(
    problem: SweepProblem,
    files: BlockFiles | None,
    progress: Callable[[str], None] = lambda name: None,
    all_there: bool = False,
) -> Sweep:
    """The blocks of `files`; missing ones are computed by this process's devices (and kept there).

    Raises:
        Incomplete: a block is not in `files`, with `all_there`.
    """
    whole = _Whole(problem)
    missing = []
    for block in range(problem.tiling.count):
        arrays = files.read(block) if files else None
        if arrays is None:
            missing.append(block)
        else:
            whole.place(block, arrays)
    if missing and all_there:
        raise Incomplete(f"{len(missing)} of {problem.tiling.count} blocks are missing, the first is {missing[0]}")

    def done(block: int, arrays: Block) -> None:
        if files:
            files.write(block, arrays)
        whole.place(block, arrays)

    if missing:
        solve_blocks(BlockSolver(problem), missing, jax.devices(), done, progress)
    return whole.sweep()


class _Whole:
    """The whole rectangle, filled block by block, each exactly once."""

    def __init__(self, problem: SweepProblem):
        self._problem = problem
        self._arrays: Block = {}
        self._seen = np.zeros(problem.tiling.count, int)

    def place(self, block: int, arrays: Block) -> None:
        for name, array in arrays.items():
            if name not in self._arrays:
                shape = (*array.shape[:-2], self._problem.tiling.views, self._problem.tiling.directions)
                self._arrays.setdefault(name, np.empty(shape, array.dtype))  # the first device thread allocates
            self._arrays[name][(..., *self._problem.tiling.extent(block))] = array
        self._seen[block] += 1

    def sweep(self) -> Sweep:
        if not (self._seen == 1).all():
            block = int(np.argmax(self._seen != 1))
            raise Incomplete(f"block {block}: got {self._seen[block]} of it, expected one")
        problem, a = self._problem, self._arrays
        rules = {
            name: RuleCurves(*(a[f"rule_{field}"][r] for field in ("eta", "lam_over_mu", "lam", "defined")))
            for r, name in enumerate(PUBLISHED)
        }
        optima = tuple(
            OptimumCurves(
                **{
                    field: a[field][o]
                    for field in ("eta", "lam_over_mu", "lam", "value", "result", "residual", "limit")
                },
                objective=objective,
                ratios={name: a["ratio"][o, r] for r, name in enumerate(PUBLISHED)},
            )
            for o, objective in enumerate(problem.objectives)
        )
        return Sweep(problem.views, problem.context, problem.theta_deg, rules, optima)

"""The command line. Nothing here imports JAX before the input is known to be good."""

import dataclasses
import importlib.metadata
import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any, Literal, NoReturn

import pydantic
import tyro

from .config import ConfigError, Problem, RunConfig, read_config, validated
from .launcher import ProcessDied
from .writing import check_files_replaceable, check_replaceable


@dataclasses.dataclass(frozen=True)
class _Configured:
    config: tyro.conf.Positional[Path]
    """TOML file; configs/ has examples. Any key can be overridden after it: --view.far 500 --light.theta_deg.count 31
    --objective.metrics '["p"]' --output.directory DIR. `warpopt schema --of COMMAND` lists the keys."""

    def read(self, model: type[pydantic.BaseModel], overrides: list[str]) -> Any:
        """The configuration, whose output folder may be written."""
        return _writable(read_config(self.config, overrides, model))


@dataclasses.dataclass(frozen=True)
class Run(_Configured):
    """Solve a configuration and write its table, figures and report."""

    def answer(self, overrides: list[str]) -> int:
        config = self.read(RunConfig, overrides)
        compute = config.compute
        prepare_jax(compute.devices_per_process)
        if compute.process_id is not None:
            from .worker import work

            return work(config)
        if compute.processes > 1:
            from .job import job_of
            from .launcher import free_address, launch, worker_command
            from .parts import count_of, folder_of

            address = compute.coordinator or free_address()
            arguments = [str(self.config), *overrides]
            commands = [worker_command(arguments, process, address) for process in range(compute.processes)]
            job = job_of(config)
            folder = folder_of(config.output.directory, job)
            try:
                launch(commands, folder, compute.timeout_s, print)
            except ProcessDied as death:
                kept = f"{count_of(folder)} of {job.tiling.count} blocks are finished and kept"
                raise ProcessDied(f"{death}\n{kept}; the same command resumes") from None
        from .run import run
        from .sweep import Incomplete

        try:
            return run(config)
        except Incomplete as flaw:
            print(f"warpopt: {flaw}", file=sys.stderr)
            return 1


@dataclasses.dataclass(frozen=True)
class Scene(_Configured):
    """Solve a scene: cameras, lights and what is seen, to matrices, tables and error maps."""

    def answer(self, overrides: list[str]) -> int:
        from .scene_config import SceneConfig
        from .scene_input import read_scene

        config = self.read(SceneConfig, overrides)
        scene = read_scene(config, self.config.parent)
        prepare_jax()
        from .scene import run_scene

        return run_scene(config, scene)


@dataclasses.dataclass(frozen=True)
class Table(_Configured):
    """Build a table of the optimal warp over theta that keeps a promise, for `export`."""

    def answer(self, overrides: list[str]) -> int:
        from .table_config import TableConfig

        config = read_config(self.config, overrides, TableConfig)
        check_files_replaceable([config.output.file])
        prepare_jax()
        from .table import run_table

        return run_table(config)


@dataclasses.dataclass(frozen=True)
class Compare(_Configured):
    """Compare rules (published, engines', yours) with the optimum and the limit, over a frustum or a scene."""

    def answer(self, overrides: list[str]) -> int:
        from .compare_config import SceneCompareConfig, check_modules, own_rules, read_compare_config
        from .scene_input import read_scene

        config, folder = _writable(read_compare_config(self.config, overrides)), self.config.parent
        check_modules(config.rules, folder)
        scene = read_scene(config, folder) if isinstance(config, SceneCompareConfig) else None
        prepare_jax()
        own = own_rules(config.rules, folder)
        from .compare import run_compare

        return run_compare(config, own, scene)


def _writable(config: Any) -> Any:
    check_replaceable(config.output.directory)
    return config


class _Plain:
    """A command without a configuration, hence without overrides."""

    def answer(self, overrides: list[str]) -> int | None:
        if overrides:
            raise ConfigError(f"unknown argument(s): {' '.join(overrides)}")
        return self.run()


@dataclasses.dataclass(frozen=True)
class Export(_Plain):
    """Source code for engines, from a table or of the closed form."""

    table: tyro.conf.Positional[str]
    """A table (.npz, .csv, .json), or `closed-form`: the exact L-inf optimum of any view frustum, no table."""
    to: str
    """Which, separated by commas: c, cpp, glsl, hlsl, wgsl; of a table also csv, json, npz."""
    directory: Path = Path(".")
    """Where the files go, named as the table."""
    metric: str | None = None
    """Of the closed form: p (if not given), q or pxq."""
    prefix: str = "warpopt"
    """What the names in code begin with; for several tables in one program."""

    def run(self) -> int:
        from .export_config import ExportRequest

        request = ExportRequest.of(self.table, self.to, self.directory, self.metric, self.prefix)
        prepare_jax()
        from .export import export

        return export(request)


@dataclasses.dataclass(frozen=True)
class _OneView(_Plain):
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
        from .single import solve

        return solve(problem, self.json)


@dataclasses.dataclass(frozen=True)
class Rules(_OneProblem):
    """Every rule's lambda, published or an engine's, and its error as a multiple of the optimum's."""

    def run(self) -> int:
        problem = self.problem()
        from .single import rules

        return rules(problem, self.json)


@dataclasses.dataclass(frozen=True)
class Limit(_OneView):
    """The map s(delta) of E_p that no map of the depth can better, as a table: data (docs/engines.md reads it in C);
    over a scene's receivers, `warpopt.scene_limit_map` in Python."""

    files: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Where to, for example limit.csv limit.json: each ends in .npz, .csv or .json."""

    def run(self) -> int:
        from .table_config import ENDINGS

        wrong = [file for file in self.files if file.suffix not in ENDINGS]
        if wrong or not self.files:
            got = wrong[0] if wrong else "none"
            raise ConfigError(f"files: got {got}, expected files such as limit.csv, ending in {', '.join(ENDINGS)}")
        check_files_replaceable(self.files)
        problem = self.problem()
        from .single import write_limit_map

        return write_limit_map(problem, self.files)


@dataclasses.dataclass(frozen=True)
class Schema(_Plain):
    """A configuration's JSON schema."""

    of: Literal["run", "scene", "table", "compare"] = "run"
    """The command that reads the configuration."""

    def run(self) -> None:
        from .compare_config import CompareConfig, SceneCompareConfig
        from .scene_config import SceneConfig
        from .table_config import TableConfig

        compare = CompareConfig | SceneCompareConfig
        model = {"run": RunConfig, "scene": SceneConfig, "table": TableConfig, "compare": compare}[self.of]
        print(json.dumps(pydantic.TypeAdapter(model).json_schema(), indent=2))


Command = Run | Scene | Table | Compare | Export | Solve | Rules | Limit | Schema


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 2 with a few lines on bad input, 1 if a solve failed, 130 if interrupted."""
    command, rest = tyro.cli(
        Command,
        prog="warpopt",
        description="Optimal perspective warps for shadow maps.",
        args=arguments,
        return_unknown_args=True,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )
    # A batch system's request to end is treated as Ctrl-C: clean up, then go.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        _dispatch(command, rest)
    except ConfigError as error:
        _exit(2, f"{error}")
    except ProcessDied as error:
        _exit(1, f"{error}")
    except OSError as error:
        _exit(1, f"{error}; no result was written, an earlier one is as it was")
    except KeyboardInterrupt:
        _exit(130, "interrupted")


def _dispatch(command: Command, rest: list[str]) -> None:
    code = command.answer(rest)
    if code is not None:
        raise SystemExit(code)


def _exit(code: int, words: str) -> NoReturn:
    print(f"warpopt: {words}", file=sys.stderr)
    raise SystemExit(code) from None


def prepare_jax(devices: int | None = None) -> None:
    """Double precision, on the user's own settings where there are any."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    # Tables are small: compiling is most of the time, and code of level 0 halves it.
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_backend_optimization_level" not in flags:
        flags += " --xla_backend_optimization_level=0"
        # So does the older of two emitters. An unknown flag ends the process, so only where it is known.
        if importlib.metadata.version("jaxlib") == "0.10.1":
            flags += " --xla_cpu_use_fusion_emitters=false"
        os.environ["XLA_FLAGS"] = flags.strip()
    if devices is not None:
        os.environ["JAX_NUM_CPU_DEVICES"] = str(devices)


if __name__ == "__main__":
    main()

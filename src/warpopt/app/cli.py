"""The command line. Nothing here imports JAX before the input is known to be good."""

import dataclasses
import importlib.metadata
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .config import ConfigError, Problem, RunConfig, read_config, validated
from .launcher import ProcessDied


@dataclasses.dataclass(frozen=True)
class Run:
    """Solve a configuration and write its table, figures and report.

    Any key of the configuration can be overridden after it: --view.far 500 --light.theta_deg.count 31
    --objective.metrics '["p"]' --output.directory DIR. `warpopt schema` lists the keys.
    """

    config: tyro.conf.Positional[Path]
    """TOML file, for example configs/paper.toml."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """Solve a scene: cameras, lights and what is seen, to matrices, tables and error maps.

    Any key can be overridden after it, as for `run`. `warpopt schema --of scene` lists the keys.
    """

    config: tyro.conf.Positional[Path]
    """TOML file, for example configs/landscape.toml."""


@dataclasses.dataclass(frozen=True)
class Table:
    """Build a table of the optimal warp over theta that keeps a promise, for `export`.

    Any key can be overridden after it, as for `run`. `warpopt schema --of table` lists the keys.
    """

    config: tyro.conf.Positional[Path]
    """TOML file, for example configs/table.toml."""


@dataclasses.dataclass(frozen=True)
class Compare:
    """Compare rules for lambda (published, engines', yours) with the optimum and the limit, over a frustum or a scene.

    Any key can be overridden after it, as for `run`. `warpopt schema --of compare` lists the keys.
    """

    config: tyro.conf.Positional[Path]
    """TOML file, for example configs/compare.toml."""


@dataclasses.dataclass(frozen=True)
class Export:
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


@dataclasses.dataclass(frozen=True)
class _OneProblem:
    near: float
    """Distance of the near plane."""
    far: float
    """Distance of the far plane."""
    half_fov_deg: float
    """Half the field of view, in degrees."""
    theta_deg: float
    """Angle between light and view direction, in degrees, 0 to 180."""
    metric: str = "p"
    """p, q or pxq."""
    norm: str = "inf"
    """inf, l1, l2 or a real order >= 1."""
    measure: str = "screen"
    """volume, screen, log_depth, ground or axis."""
    json: bool = False
    """Print JSON."""


@dataclasses.dataclass(frozen=True)
class Solve(_OneProblem):
    """The optimal warp of one view and light direction."""


@dataclasses.dataclass(frozen=True)
class Rules(_OneProblem):
    """Every published rule's lambda, and its error as a multiple of the optimum's."""


@dataclasses.dataclass(frozen=True)
class Schema:
    """A configuration's JSON schema."""

    of: Literal["run", "scene", "table", "compare"] = "run"
    """The command that reads the configuration."""


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 2 with a few lines on bad input, 1 if a solve failed, 130 if interrupted."""
    command, rest = tyro.cli(
        Annotated[Run, tyro.conf.subcommand("run")]
        | Annotated[Scene, tyro.conf.subcommand("scene")]
        | Annotated[Table, tyro.conf.subcommand("table")]
        | Annotated[Compare, tyro.conf.subcommand("compare")]
        | Annotated[Export, tyro.conf.subcommand("export")]
        | Annotated[Solve, tyro.conf.subcommand("solve")]
        | Annotated[Rules, tyro.conf.subcommand("rules")]
        | Annotated[Schema, tyro.conf.subcommand("schema")],
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
        if rest and not isinstance(command, Run | Scene | Table | Compare):
            raise ConfigError(f"unknown argument(s): {' '.join(rest)}")
        _dispatch(command, rest)
    except ConfigError as error:
        print(f"warpopt: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except ProcessDied as error:
        print(f"warpopt: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:
        print(f"warpopt: {error}; no result was written, an earlier one is as it was", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("warpopt: interrupted", file=sys.stderr)
        raise SystemExit(130) from None


def _dispatch(command: Run | Scene | Table | Compare | Export | Solve | Rules | Schema, rest: list[str]) -> None:
    if isinstance(command, Schema):
        import json

        import pydantic

        from .compare_config import CompareConfig, SceneCompareConfig
        from .scene_config import SceneConfig
        from .table_config import TableConfig

        compare = CompareConfig | SceneCompareConfig
        model = {"run": RunConfig, "scene": SceneConfig, "table": TableConfig, "compare": compare}[command.of]
        print(json.dumps(pydantic.TypeAdapter(model).json_schema(), indent=2))
    elif isinstance(command, Table):
        raise SystemExit(_table(command.config, rest))
    elif isinstance(command, Compare):
        raise SystemExit(_compare(command.config, rest))
    elif isinstance(command, Export):
        from .export_config import ExportRequest

        request = ExportRequest.of(command.table, command.to, command.directory, command.metric, command.prefix)
        prepare_jax()
        from .export import export

        raise SystemExit(export(request))
    elif isinstance(command, Scene):
        raise SystemExit(_scene(command.config, rest))
    elif isinstance(command, Run):
        config = read_config(command.config, rest)
        from .writing import check_replaceable

        check_replaceable(config.output.directory)
        raise SystemExit(_run(config, [str(command.config), *rest]))
    else:
        fields = dataclasses.asdict(command)
        as_json = fields.pop("json")
        problem = validated(Problem, fields, "command line")
        prepare_jax()
        from . import single

        raise SystemExit((single.solve if isinstance(command, Solve) else single.rules)(problem, as_json))


def _run(config: RunConfig, arguments: list[str]) -> int:
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
        commands = [worker_command(arguments, process, address) for process in range(compute.processes)]
        job = job_of(config)
        folder = folder_of(config.output.directory, job)
        try:
            launch(commands, folder, compute.timeout_s, print)
        except ProcessDied as death:
            kept = f"{count_of(folder)} of {job.tiling.count} blocks are finished and kept; the same command resumes"
            raise ProcessDied(f"{death}\n{kept}") from None
    from .run import run
    from .sweep import Incomplete

    try:
        return run(config)
    except Incomplete as flaw:
        print(f"warpopt: {flaw}", file=sys.stderr)
        return 1


def _scene(path: Path, overrides: list[str]) -> int:
    from .scene_config import SceneConfig
    from .scene_input import read_scene
    from .writing import check_replaceable

    config = read_config(path, overrides, SceneConfig)
    check_replaceable(config.output.directory)
    scene = read_scene(config, path.parent)
    prepare_jax()
    from .scene import run_scene

    return run_scene(config, scene)


def _table(path: Path, overrides: list[str]) -> int:
    from .table_config import TableConfig
    from .writing import check_files_replaceable

    config = read_config(path, overrides, TableConfig)
    check_files_replaceable([config.output.file])
    prepare_jax()
    from .table import run_table

    return run_table(config)


def _compare(path: Path, overrides: list[str]) -> int:
    from .compare_config import SceneCompareConfig, check_modules, own_rules, read_compare_config
    from .scene_input import read_scene
    from .writing import check_replaceable

    config = read_compare_config(path, overrides)
    check_replaceable(config.output.directory)
    check_modules(config.rules, path.parent)
    scene = read_scene(config, path.parent) if isinstance(config, SceneCompareConfig) else None
    prepare_jax()
    own = own_rules(config.rules, path.parent)
    from .compare import run_compare

    return run_compare(config, own, scene)


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

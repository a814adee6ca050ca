"""The command line: nothing but the commands, put together. None of them imports JAX before its input is good."""

import dataclasses
import json
import signal
import sys
import threading
from typing import Literal, NoReturn

import pydantic
import tyro

from .common.command import Failed, Plain
from .common.settings import ConfigError
from .compare.command import Compare
from .export.command import Export
from .one_view.command import Limit, Rules, Solve
from .scene.command import Scene
from .sweep.command import Run
from .table.command import Table


@dataclasses.dataclass(frozen=True)
class Schema(Plain):
    """A configuration's JSON schema."""

    of: Literal["run", "scene", "table", "compare"] = "run"
    """The command that reads the configuration."""

    def run(self) -> int:
        command = {"run": Run, "scene": Scene, "table": Table, "compare": Compare}[self.of]
        print(json.dumps(pydantic.TypeAdapter(command.model()).json_schema(), indent=2))
        return 0


Command = Run | Scene | Table | Compare | Export | Solve | Rules | Limit | Schema


def parsed(arguments: list[str] | None = None) -> tuple[Command, list[str]]:
    """The command, and the words that are left for its configuration's keys."""
    return tyro.cli(
        Command,
        prog="warpopt",
        description="Optimal perspective warps for shadow maps.",
        args=arguments,
        return_unknown_args=True,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 2 with a few lines on bad input, 1 if a solve failed, 130 if interrupted."""
    command, overrides = parsed(arguments)
    # A batch system's request to end is treated as Ctrl-C: clean up, then go.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = command.answer(overrides)
    except ConfigError as error:
        _exit(2, f"{error}")
    except Failed as error:
        _exit(1, f"{error}")
    except OSError as error:
        _exit(1, f"{error}; no result was written, an earlier one is as it was")
    except KeyboardInterrupt:
        _exit(130, "interrupted")
    raise SystemExit(code)


def _exit(code: int, words: str) -> NoReturn:
    print(f"warpopt: {words}", file=sys.stderr)
    raise SystemExit(code) from None


if __name__ == "__main__":
    main()

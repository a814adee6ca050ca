"""The command line: assembles the commands. No command imports JAX before its input is valid."""

import atexit
import contextlib
import dataclasses
import difflib
import gc
import json
import os
import signal
import sys
import threading
import typing
from collections.abc import Iterator
from typing import Literal, NoReturn

import pydantic
import tyro

from .cascades.command import Cascades
from .common.call_stack import with_room_for_calls
from .common.command import Failed, Plain
from .common.jax_settings import CACHE_VARIABLE
from .common.settings import ConfigError
from .compare.command import Compare
from .export.command import Export
from .frames.command import Frames
from .one_view.command import Limit, Rules, Solve
from .scene.command import Scene
from .sweep.command import Run
from .table.command import Table


@dataclasses.dataclass(frozen=True)
class Schema(Plain):
    """A configuration's JSON schema."""

    of: Literal["run", "scene", "frames", "table", "compare", "cascades"] = "run"
    """The command that reads the configuration."""

    def run(self) -> int:
        commands = {
            "run": Run, "scene": Scene, "frames": Frames, "table": Table, "compare": Compare, "cascades": Cascades,
        }  # fmt: skip
        command = commands[self.of]
        print(json.dumps(pydantic.TypeAdapter(command.model()).json_schema(), indent=2))
        return 0


Command = Run | Scene | Frames | Table | Compare | Cascades | Export | Solve | Rules | Limit | Schema


def parsed(arguments: list[str] | None = None) -> tuple[Command, list[str]]:
    """The command, and the remaining words, which override its configuration."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "--no-cache" in words:
        words.remove("--no-cache")
        os.environ[CACHE_VARIABLE] = "0"
    _refuse_unknown(words)
    return tyro.cli(
        Command,
        prog="warpopt",
        description="Optimal perspective warps for shadow maps. Compiled programs are kept in your cache folder; "
        f"--no-cache, or {CACHE_VARIABLE}=0, disables the cache.",
        args=words,
        return_unknown_args=True,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )


def _refuse_unknown(words: list[str]) -> None:
    """Refuse a first word that is not a command; suggests the nearest one."""
    names = [command.__name__.lower() for command in typing.get_args(Command)]
    if words and not words[0].startswith("-") and words[0] not in names:
        near = difflib.get_close_matches(words[0], names, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        _exit(2, f"got {words[0]!r}, expected one of {', '.join(names)}{hint}")


@contextlib.contextmanager
def _garbage_collected_seldom() -> Iterator[None]:
    """Tracing and drawing keep many objects and leave few cycles: collecting as often as Python does by default takes
    an eighth of a run (3.11, every 700 objects)."""
    before = gc.get_threshold()
    gc.set_threshold(1_000_000)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@with_room_for_calls
@_garbage_collected_seldom()
def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 2 with a few lines on bad input, 1 if a solve failed, 130 if interrupted."""
    # A process that is the command's alone: looking for garbage at its end would take a twentieth of a run.
    if arguments is None:
        atexit.register(gc.freeze)
    command, overrides = parsed(arguments)
    # A batch system's termination signal is treated as Ctrl-C: clean up, then exit.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = command.answer(overrides)
    except ConfigError as error:
        _exit(2, f"{error}")
    except Failed as error:
        _exit(1, f"{error}")
    except OSError as error:
        _exit(1, f"{error}; no result was written, an existing one is unchanged")
    except KeyboardInterrupt:
        _exit(130, "interrupted")
    raise SystemExit(code)


def _exit(code: int, words: str) -> NoReturn:
    print(f"warpopt: {words}", file=sys.stderr)
    raise SystemExit(code) from None


if __name__ == "__main__":
    main()

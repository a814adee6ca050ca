"""Folders of results that appear whole or not at all."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .config import ConfigError

MARK = "run.json"  # the file by which a folder is known as a result


def check_replaceable(directory: Path) -> None:
    """Refuse, before any work, a target that is not an earlier result.

    Raises:
        ConfigError: the target is a file, or a folder that holds something else.
    """
    if not directory.exists():
        return
    if not directory.is_dir():
        raise ConfigError(f"output.directory: got {directory}, which is a file; expected a folder")
    strangers = sorted({path.name for path in directory.iterdir()} - _written_before(directory))
    if strangers:
        raise ConfigError(
            f"output.directory: got {directory}, with {strangers[0]!r} in it that no earlier run wrote (its {MARK} "
            "would name it); expected a new or empty folder, or an earlier result to replace"
        )


def _written_before(directory: Path) -> set[str]:
    try:
        return set(json.loads((directory / MARK).read_text(encoding="utf-8"))["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return set()


@contextlib.contextmanager
def whole_folder(directory: Path) -> Iterator[Path]:
    """A temporary folder beside `directory`, put in its place on success; on any failure it leaves no trace.

    An earlier result is moved aside first and removed last, so that at every moment one of the two is complete.

    Raises:
        ConfigError: as `check_replaceable`, or the folder cannot be made.
    """
    check_replaceable(directory)
    directory = directory.resolve()  # through links, so that what they point to is replaced
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{directory.name}.", suffix=".part", dir=directory.parent))
    except OSError as error:
        raise ConfigError(f"output.directory: {directory.parent} cannot be written: {error.strerror}") from None
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        aside = temporary.with_suffix(".old")
        try:
            if directory.exists():
                directory.rename(aside)
            temporary.rename(directory)
        except BaseException:
            if aside.exists() and not directory.exists():
                aside.rename(directory)
            raise
        shutil.rmtree(aside, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

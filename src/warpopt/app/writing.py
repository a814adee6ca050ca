"""Folders of results that appear whole or not at all."""

import contextlib
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
    if any(directory.iterdir()) and not (directory / MARK).is_file():
        raise ConfigError(
            f"output.directory: got {directory}, a folder that holds no {MARK} and so is not an earlier result; "
            "expected a new or empty folder, or one to replace"
        )


@contextlib.contextmanager
def whole_folder(directory: Path) -> Iterator[Path]:
    """A temporary folder beside `directory`, put in its place on success; on any failure it leaves no trace.

    An earlier result is moved aside first and removed last, so that at every moment one of the two is complete.

    Raises:
        ConfigError: as `check_replaceable`, or the folder cannot be made.
    """
    check_replaceable(directory)
    directory = directory.absolute()
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{directory.name}.", suffix=".part", dir=directory.parent))
    except OSError as error:
        raise ConfigError(f"output.directory: {directory.parent} cannot be written: {error.strerror}") from None
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        aside = None
        if directory.exists():
            aside = temporary.with_suffix(".old")
            directory.rename(aside)
        try:
            temporary.rename(directory)
        except BaseException:
            if aside is not None:
                aside.rename(directory)
            raise
        if aside is not None:
            shutil.rmtree(aside, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

"""Result folders and files, written atomically."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from .settings import ConfigError

TABLE_ENDINGS = (".npz", ".csv", ".json")  # extensions of table and map files
MARK = "run.json"  # marks a folder as a result


def check_replaceable(directory: Path) -> None:
    """Refuse, before any work, a target that is not an existing result.

    Raises:
        ConfigError: the target is a file, or a folder with other contents.
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
    """A temporary folder next to `directory`, moved to its place on success and removed on failure.

    An existing result is moved aside first and removed last, so that one complete result exists at every moment.

    Raises:
        ConfigError: as `check_replaceable`, or the folder cannot be made.
    """
    check_replaceable(directory)
    directory = directory.resolve()  # resolves links, so that their target is replaced
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        _clear_away(directory)
        mine = f".{directory.name}.{os.getpid()}-"
        temporary = Path(tempfile.mkdtemp(prefix=mine, suffix=".part", dir=directory.parent))
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


def _clear_away(directory: Path) -> None:
    """Remove what killed runs of the same output left next to it, and restore a result that one had moved aside."""
    for left in directory.parent.glob(f".{directory.name}.*-*"):
        process = left.name.removeprefix(f".{directory.name}.").partition("-")[0]
        if left.suffix not in (".part", ".old") or not process.isdigit() or _alive(int(process)):
            continue
        if left.suffix == ".old" and not directory.exists():
            left.rename(directory)
        else:
            shutil.rmtree(left, ignore_errors=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's process
        return True
    return True


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_files_replaceable(paths: Iterable[Path]) -> None:
    """Refuse, before any work, to replace files that warpopt did not write.

    Raises:
        ConfigError: a target is a folder, or a file whose beginning does not name warpopt.
    """
    for path in paths:
        if path.is_dir():
            raise ConfigError(f"{path}: got a folder, expected a file or a new name")
        if path.exists():
            with path.open("rb") as file:
                head = file.read(4096).replace(b"\0", b"")  # npz keeps text as UTF-32
            if b"warpopt" not in head:
                raise ConfigError(
                    f"{path}: got a file that warpopt did not write, expected one that it wrote or a new name"
                )


def whole_files(contents: Mapping[Path, bytes]) -> None:
    """Write several files, all or none: each next to its place first, then moved; on failure all are restored.

    Raises:
        ConfigError: as `check_files_replaceable`, or a folder cannot be made.
        OSError: a file cannot be written; all are left unchanged.
    """
    check_files_replaceable(contents)
    for folder in {path.parent for path in contents}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be made: {error.strerror}") from None
    with contextlib.ExitStack() as stack:
        staged = []
        for path, content in contents.items():
            target = path.resolve()  # resolves links, so that their target is replaced
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=".warpopt.", dir=target.parent)))
            (folder / "new").write_bytes(content)
            staged.append((target, folder / "new", folder / "old"))
        moved = []
        try:
            for target, new, old in staged:
                if target.exists():
                    shutil.copy2(target, old)
                moved.append((target, old))
                new.replace(target)
        except BaseException:
            for target, old in moved:
                if old.exists():
                    old.replace(target)
                else:
                    target.unlink(missing_ok=True)
            raise

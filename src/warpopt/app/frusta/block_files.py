"""Finished blocks on disk: each file is written atomically, checked when read, and belongs to one problem."""

import hashlib
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .problem import SweepProblem

Block = dict[str, np.ndarray]


class BadBlock(Exception):
    """The reason why a file is not the expected block."""


def folder_of(directory: Path, problem: SweepProblem) -> Path:
    """The working folder next to the output folder; its name depends on the problem."""
    directory = directory.absolute()
    return directory.parent / f".{directory.name}.{problem.identity()[:16]}.parts"


class BlockFiles:
    """The blocks of one problem in its working folder.

    Args:
        folder: created if missing.
        problem: the problem of the blocks.
        platform: the kind of device that computes ("cpu", "gpu"); blocks from another kind are rejected.
        shapes: leading shape of each field, before (views, directions).
        say: receives a message about every rejected file.
    """

    def __init__(
        self,
        folder: Path,
        problem: SweepProblem,
        platform: str,
        shapes: dict[str, tuple[int, ...]],
        say: Callable[[str], None],
    ):
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._tiling = problem.tiling
        self._identity = f"{problem.identity()} {platform}"
        self._shapes = shapes
        self._say = say

    def path(self, block: int) -> Path:
        return block_path(self.folder, block)

    def read(self, block: int) -> Block | None:
        """The block, or None if it is missing or invalid (it is then computed again)."""
        path = self.path(block)
        if not path.exists():
            return None
        try:
            return self._checked(path, block)
        except BadBlock as flaw:
            self._say(f"{path.name}: {flaw}; computed again")
            return None

    def _checked(self, path: Path, block: int) -> Block:
        try:
            # opened here: np.load leaves a file open that is not an archive
            with path.open("rb") as stream, np.load(stream) as file:
                arrays = {name: file[name] for name in file.files}
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
            raise BadBlock("truncated or not a part") from None
        told = [str(arrays.pop(name, "missing")) for name in ("identity", "block", "digest")]
        if told[0] != self._identity:
            raise BadBlock("a part of another job")
        if told[1] != str(block):
            raise BadBlock(f"got block {told[1]}, expected {block}")
        if set(arrays) != set(self._shapes):
            raise BadBlock(f"got fields {sorted(arrays)}, expected {sorted(self._shapes)}")
        views, directions = self._tiling.extent(block)
        inner = (views.stop - views.start, directions.stop - directions.start)
        for name, outer in self._shapes.items():
            if arrays[name].shape != outer + inner:
                raise BadBlock(f"{name}: got shape {arrays[name].shape}, expected {outer + inner}")
        if told[2] != _digest(arrays):
            raise BadBlock("its numbers are not those that were written")
        return arrays

    def write(self, block: int, arrays: Block) -> None:
        """The block's file, under a temporary name until complete."""
        path = self.path(block)
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        with temporary.open("wb") as file:
            told = {"identity": self._identity, "block": block, "digest": _digest(arrays)}
            np.savez(file, allow_pickle=False, **told, **arrays)
        temporary.rename(path)

    def delete(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def block_path(folder: Path, block: int) -> Path:
    return folder / f"block-{block:09d}.npz"


def count_of(folder: Path) -> int:
    """The number of blocks in a folder, unchecked."""
    return sum(1 for _ in folder.glob("block-*.npz"))


def _digest(arrays: Block) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()

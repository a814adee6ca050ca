"""The problem over view frusta, and its division into blocks. Does not know JAX, devices or processes."""

import dataclasses
import hashlib
import importlib.metadata
import json
import math
import os
from pathlib import Path

import numpy as np

import warpopt
from warpopt.objective import Objective

BLOCK_MULTIPLE = 64  # directions per block: whole unrolled SIMD vectors on every processor
BLOCK_SIZE = 32_768  # default maximum number of problems in a block


@dataclasses.dataclass(frozen=True)
class View:
    """One view frustum, in the units of the config."""

    near: float
    far: float
    half_fov_deg: float


@dataclasses.dataclass(frozen=True)
class Tiling:
    """The rectangle of views x directions in tiles of one shape, padded at its ends; a block is one tile.

    Every block is computed by the same program, compiled for `tile`, on any device: a program of another shape may add,
    fuse and vectorise in another way, and then rounds differently. So the tile depends only on the problem and the
    block size, not on the number of devices. Tiles are used instead of ranges of the flattened rectangle because a
    tile's directions share the views' depth integrals.
    """

    views: int
    directions: int
    tile: tuple[int, int]

    @classmethod
    def of(cls, views: int, directions: int, block_size: int) -> "Tiling":
        """Tiles of at most `block_size` problems, as equal as whole `BLOCK_MULTIPLE`s of directions allow."""
        strips = -(-directions // block_size)
        width = -(-directions // (strips * BLOCK_MULTIPLE)) * BLOCK_MULTIPLE
        rows = -(-views // max(1, block_size // width))
        return cls(views, directions, (-(-views // rows), width))

    @property
    def grid(self) -> tuple[int, int]:
        return -(-self.views // self.tile[0]), -(-self.directions // self.tile[1])

    @property
    def count(self) -> int:
        """The number of blocks."""
        return math.prod(self.grid)

    def extent(self, block: int) -> tuple[slice, slice]:
        """The views and the directions of a block, without its padding."""
        row, column = divmod(block, self.grid[1])
        (height, width) = self.tile
        return (
            slice(row * height, min((row + 1) * height, self.views)),
            slice(column * width, min((column + 1) * width, self.directions)),
        )

    def padded(self, block: int) -> tuple[np.ndarray, np.ndarray]:
        """Indices of a block's views and directions, the last one repeated up to the tile's shape."""
        views, directions = self.extent(block)
        return (
            np.minimum(np.arange(views.start, views.start + self.tile[0]), self.views - 1),
            np.minimum(np.arange(directions.start, directions.start + self.tile[1]), self.directions - 1),
        )


@dataclasses.dataclass(frozen=True, eq=False)
class SweepProblem:
    """Every optimum and every rule over views + context and directions, for each objective."""

    views: tuple[View, ...]
    context: tuple[View, ...]
    theta_deg: np.ndarray
    objectives: tuple[Objective, ...]
    block_size: int = BLOCK_SIZE

    @property
    def all_views(self) -> tuple[View, ...]:
        return self.views + self.context

    @property
    def tiling(self) -> Tiling:
        return Tiling.of(len(self.all_views), len(self.theta_deg), self.block_size)

    def identity(self) -> str:
        """A digest of everything that determines a block's bits: the problem, the tile, the code and its compiler."""
        flags = [f for f in os.environ.get("XLA_FLAGS", "").split() if "host_platform_device_count" not in f]
        told = {
            "views": [dataclasses.astuple(view) for view in self.all_views],
            "theta_deg": hashlib.sha256(np.ascontiguousarray(self.theta_deg, np.float64).tobytes()).hexdigest(),
            "objectives": [(objective.title, objective.measure) for objective in self.objectives],
            "tile": self.tiling.tile,
            "versions": [importlib.metadata.version(package) for package in ("jax", "jaxlib", "equinox", "optimistix")],
            "code": _code(),
            "xla_flags": sorted(flags),
            "x64": os.environ.get("JAX_ENABLE_X64", ""),
        }
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def _code() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(warpopt.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()

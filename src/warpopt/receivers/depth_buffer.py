"""Receivers as a renderer has them: the depth buffer of the frame."""

import dataclasses
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import checked, float_arrays
from ..theory.camera import Camera
from ..theory.error_norm import ErrorNorm
from ..theory.light_frame import LightFrame
from ..theory.light_space import Depth
from .footprint import Footprint
from .points import BINS, Groups, bin_of, from_groups, with_moments

Encoding = Literal["linear", "standard", "reversed"]
# Sorting into bins costs about as much for one value as all else for ten, so large buffers are first reduced to this
# many cells, runs of pixels in a row, along which depth varies least.
_CELLS = 131_072


class DepthBuffer(eqx.Module):
    """The pixels of a depth buffer, made by the camera that `scene_warp` is given; row 0 is the top of the screen.

    Each pixel's centre is one receiver of equal weight: L_P norms are over what is seen. Background is no receiver.

    Args:
        depth: (H, W).
        encoding: "linear", eye depth, with background at or beyond the far plane, or at 0; "standard", in [0, 1] with
            0 at the near plane and background at 1; "reversed", in [0, 1] with 1 at the near plane and background at 0.

    Raises:
        ValueError: for a wrong shape, NaN, infinity, or values outside the encoding's range.

    Example:
        >>> import numpy as np, warpopt
        >>> depth = np.full((4, 6), 20.0)
        >>> depth[:2] = 0.0  # sky
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4, aspect=1.5)
        >>> solution = warpopt.scene_warp(camera, warpopt.DirectionalLight((0, -1, 0)), warpopt.DepthBuffer(depth))
        >>> warpopt.Outcome(int(solution.result)).name   # a wall across the view is at one depth for this light
        'flat'
    """

    depth: Float[Array, "H W"]
    encoding: Encoding = eqx.field(static=True, default="linear")

    def __init__(self, depth: ArrayLike, encoding: Encoding = "linear"):
        (depth,) = float_arrays(depth=depth)
        if depth.ndim != 2 or 0 in depth.shape:
            raise ValueError(f"depth: got shape {depth.shape}, expected (height, width)")
        if encoding not in ("linear", "standard", "reversed"):
            raise ValueError(f"encoding: got {encoding!r}, expected 'linear', 'standard' or 'reversed'")
        if encoding == "linear":
            self.depth = checked("depth", depth, lambda d: jnp.isfinite(d) & (d >= 0), "finite eye depths >= 0")
        else:
            self.depth = checked("depth", depth, lambda d: (d >= 0) & (d <= 1), "numbers in [0, 1]")
        self.encoding = encoding

    def eye_depth(self, camera: Camera) -> Float[Array, "H W"]:
        """Eye depth of each pixel; inf for background."""
        n, f, value = camera.near, camera.far, self.depth
        if self.encoding == "linear":
            return jnp.where((value > 0) & (value < f), jnp.maximum(value, n), jnp.inf)
        if self.encoding == "standard":
            return jnp.where(value < 1, n * f / (f - value * (f - n)), jnp.inf)
        return jnp.where(value > 0, n * f / (n + value * (f - n)), jnp.inf)

    def footprint(self, camera: Camera, frame: LightFrame, norm: ErrorNorm) -> Footprint:
        """See `Receivers`. One pass for extents, cell by cell, and one for moments."""
        z = self.eye_depth(camera)
        d, x, h = (_along(axis, z, camera) for axis in (frame.z_axis, frame.x_axis, frame.light))
        cells = Groups(*(_by_cells(v, least) for v in (d, x, h) for least in (True, False)), _by_cells(z, True))
        there = jnp.isfinite(cells.z)
        start = jnp.where(there, cells.least_depth, jnp.inf).min()
        end = jnp.where(there, cells.largest_depth, -jnp.inf).max()
        share = (cells.least_depth - start) / jnp.where(end > start, end - start, 1)
        footprint = from_groups(_joined(cells, bin_of(jnp.where(there, share, 0))), camera.near)
        if norm.supremum:
            return footprint
        unit = jnp.where(footprint.empty, 1, cells.z.min())
        across, up = _slopes(z, camera)

        def receivers_of(row: tuple[Array, Array]) -> tuple[Depth, Array, Array]:
            z, up = row
            seen = jnp.isfinite(z)
            z = jnp.where(seen, z, unit)
            d = z * (frame.z_axis[0] * across + (frame.z_axis[1] * up + frame.z_axis[2]))
            return footprint.share(d), z / unit, seen.astype(z.dtype)

        return with_moments(footprint, (z, up), receivers_of, unit, norm)


def eye_points(buffer: DepthBuffer, camera: Camera) -> tuple[Float[Array, "H W 3"], Bool[Array, "H W"]]:
    """(the pixels' receivers in eye coordinates, whether there is one)."""
    z = buffer.eye_depth(camera)
    seen = jnp.isfinite(z)
    z = jnp.where(seen, z, 1)
    across, up = _slopes(z, camera)
    return jnp.stack([z * across, z * up[:, None], z], -1), seen


def _slopes(z: Array, camera: Camera) -> tuple[Array, Array]:
    """(x/z of each column, y/z of each row) at the pixels' centres."""
    left, right, bottom, top = camera.window
    height, width = z.shape
    columns, rows = ((np.arange(size) + 0.5) / size for size in (width, height))
    return left + (right - left) * columns.astype(z.dtype), top - (top - bottom) * rows.astype(z.dtype)


def _along(axis: Array, z: Array, camera: Camera) -> Array:
    """axis . c for every pixel; NaN for background."""
    across, up = _slopes(z, camera)
    slopes = axis[0] * across + (axis[1] * up + axis[2])[:, None]
    return jnp.where(jnp.isfinite(z), slopes * jnp.where(jnp.isfinite(z), z, 0), jnp.nan)


def _by_cells(values: Array, least: bool) -> Array:
    """Least or largest of each cell, NaN (background) aside."""
    edge = jnp.inf if least else -jnp.inf
    values = jnp.where(jnp.isnan(values), edge, values)
    size = max(1, round(values.size / _CELLS))
    values = jnp.pad(values, ((0, 0), (0, -values.shape[1] % size)), constant_values=edge)
    cells = values.reshape(-1, size)
    return cells.min(1) if least else cells.max(1)


def _joined(cells: Groups, which: Array) -> Groups:
    """The cells' bounds gathered into bins. Empty cells bound nothing: their least is inf, their largest -inf."""

    def join(values: Array, least: bool) -> Array:
        return jax.ops.segment_min(values, which, BINS) if least else jax.ops.segment_max(values, which, BINS)

    return Groups(*(join(getattr(cells, f.name), not f.name.startswith("largest")) for f in dataclasses.fields(cells)))

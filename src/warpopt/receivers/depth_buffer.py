"""Receivers as a renderer has them: the depth buffer of the frame."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import checked, float_arrays
from .._numerics import larger
from ..theory.camera import Camera
from ..theory.error_norm import ErrorNorm
from ..theory.light_frame import LightFrame
from .footprint import Footprint
from .groups import BINS, Groups, bin_of, from_groups, with_moments

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
        seen, z = self._decoded(self.depth, camera)
        return jnp.where(seen, z, jnp.inf)

    def _decoded(self, value: Array, camera: Camera) -> tuple[Array, Array]:
        """(which pixels are no background, eye depths, in [near, far] for all)."""
        n, f = camera.near, camera.far
        if self.encoding == "linear":
            seen = (value > 0) & (value < f)
            return seen, jnp.where(seen, larger(value, n), n)
        if self.encoding == "standard":
            return value < 1, n * f / (f - value * (f - n))
        return value > 0, n * f / (n + value * (f - n))

    def footprint(self, camera: Camera, frame: LightFrame, norm: ErrorNorm) -> Footprint:
        """See `Receivers`. One pass for extents, cell by cell, and one for moments; each decodes what it reads."""
        across, up = _slopes(self.depth, camera)
        # What rows share is computed here: inside a sweep every pixel would.
        slope_across, slope_up = frame.z_axis[0] * across, frame.z_axis[1] * up + frame.z_axis[2]
        rows = self.depth, slope_up

        def depths(row: tuple[Array, Array]) -> tuple[Array, Array, Array]:
            value, slope = row
            seen, z = self._decoded(value, camera)
            return seen, z, z * (slope_across + slope)

        start, end, cells = self._cells(rows, depths, across, up, frame)
        share = (cells.least_depth - start) / jnp.where(end > start, end - start, 1)
        which = bin_of(jnp.where(jnp.isfinite(cells.z), share, 0))
        footprint = from_groups(jax.tree.map(lambda v, sign: _joined(v, sign, which), cells, _SIGNS), camera.near)
        if norm.supremum:
            return footprint
        unit = jnp.where(footprint.empty, 1, cells.z.min())

        def receivers_of(row: tuple[Array, Array]) -> tuple[Array, Array, Array]:
            seen, z, d = depths(row)
            return jnp.where(seen, d, start), unit / z, seen.astype(z.dtype)

        return with_moments(footprint, rows, receivers_of, unit, norm)

    def _cells(self, rows, depths, across: Array, up: Array, frame: LightFrame) -> tuple[Array, Array, Groups]:
        """(least and largest Z_w . c of all pixels, bounds of the cells).

        Reducing by cells costs several times what reducing whole rows does, so that only z is: with the slopes at a
        cell's ends it bounds Z_w . c, X_w . c and l . c.
        """
        width = self.depth.shape[1]
        size = max(1, round(self.depth.size / _CELLS))
        pad = -width % size

        def bounds(found: tuple[Array, Array], row: tuple[Array, Array]):
            seen, z, d = depths(row)
            least = jnp.where(seen & (d < found[0]), d, found[0])
            largest = jnp.where(seen & (d > found[1]), d, found[1])
            near, far = (
                jnp.pad(jnp.where(seen, z, edge), (0, pad), constant_values=edge).reshape(-1, size)
                for edge in (jnp.inf, -jnp.inf)
            )
            return (least, largest), (near.min(1), far.max(1))

        edges = (jnp.full(width, edge, self.depth.dtype) for edge in (jnp.inf, -jnp.inf))
        (least, largest), (near, far) = jax.lax.scan(bounds, tuple(edges), rows)
        there = jnp.isfinite(near)
        start, end = (jnp.where(there.any(), v, 0) for v in (least.min(), largest.max()))
        near, far = jnp.where(there, near, 1), jnp.where(there, far, 1)
        first = np.arange(0, width, size)
        ends = across[first], across[np.minimum(first + size, width) - 1]

        def extents(axis: Array) -> tuple[Array, Array, Array, Array]:
            """(least, a least that is reached, a largest that is reached, largest) of axis . c."""
            one, other = (axis[0] * end + (axis[1] * up + axis[2])[:, None] for end in ends)
            low, high = jnp.where(one < other, one, other), jnp.where(one < other, other, one)
            return (
                low * jnp.where(low > 0, near, far), high * jnp.where(high > 0, near, far),
                low * jnp.where(low > 0, far, near), high * jnp.where(high > 0, far, near),
            )  # fmt: skip

        (d_least, *_, d_largest), (x_least, *reached, x_largest), (h_least, *_, h_largest) = (
            extents(axis) for axis in (frame.z_axis, frame.x_axis, frame.light)
        )
        d_least, d_largest = jnp.where(d_least > start, d_least, start), jnp.where(d_largest < end, d_largest, end)
        cells = Groups(d_least, d_largest, x_least, x_largest, h_least, h_largest, near, tuple(reached))
        return start, end, jax.tree.map(lambda v, sign: jnp.where(there, v, sign * jnp.inf).ravel(), cells, _SIGNS)


# Of each bound, whether groups join in the least (1) or the largest (-1), and where empty ones stand.
_SIGNS = Groups(1, -1, 1, -1, 1, -1, 1, (1, -1))


def _joined(values: Array, sign: int, which: Array) -> Array:
    """The cells' bounds gathered into bins."""
    return (jax.ops.segment_min if sign > 0 else jax.ops.segment_max)(values, which, BINS)


def eye_points(buffer: DepthBuffer, camera: Camera) -> tuple[Float[Array, "H W 3"], Bool[Array, "H W"]]:
    """(the pixels' receivers in eye coordinates, whether there is one)."""
    z = buffer.eye_depth(camera)
    seen = jnp.isfinite(z)
    z = jnp.where(seen, z, 1)
    across, up = _slopes(z, camera)
    return jnp.stack([z * across, z * up[:, None], z], -1), seen


def _slopes(depth: Array, camera: Camera) -> tuple[Array, Array]:
    """(x/z of each column, y/z of each row) at the pixels' centres."""
    left, right, bottom, top = camera.window
    height, width = depth.shape
    columns, rows = ((np.arange(size) + 0.5) / size for size in (width, height))
    return left + (right - left) * columns.astype(depth.dtype), top - (top - bottom) * rows.astype(depth.dtype)

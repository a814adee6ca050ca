"""Receivers reduced to a few thousand cells of screen and depth, so that many directions of a warp can be tried.

A cell is a rectangle of slopes (x/z, y/z; x and y under parallel rays) and a range of depths, whatever the direction;
with it go the weight and the centroid of its receivers. All of a map's errors are products of powers of 1/z and
functions of places that are linear in eye coordinates, so the centroid weighted with (1/z)^P stands for a cell to first
order.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._numerics import power
from .._parallel import sweep
from ..objective import Objective
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from .bins import BINS, bin_of, ends, from_groups, grouped, with_moments
from .footprint import Footprint
from .receivers import Receivers
from .samples import Samples

# Tiles of the screen, across and down. For maxima more: what cells add to an extent is first order in their size, what
# centroids lose of a mean is second order.
_FOR_MAXIMA, _FOR_MEANS = (38, 22), (28, 16)
_LEAST_TILE = 2  # pixels along a side: smaller buffers have fewer tiles


class Sums(NamedTuple):
    """For each cell, of w (unit/z)^(r P) times 1 and the eye coordinates; and of w."""

    weight: Float[Array, " C"]
    x: Float[Array, " C"]
    y: Float[Array, " C"]
    z: Float[Array, " C"]
    mass: Float[Array, " C"]


class Sketch(Receivers):
    """Cells of receivers.

    Attributes:
        low, high: least and largest (x/z, y/z); (x, y) under parallel rays.
        near, far: least and largest eye depth; inf and -inf for empty cells.
        sums: for means over weighted receivers; None for maxima.
        unit: of length, for the sums.
        parallel: whether the camera's rays are.
    """

    of_cells: ClassVar[bool] = True

    low: Float[Array, "C 2"]
    high: Float[Array, "C 2"]
    near: Float[Array, " C"]
    far: Float[Array, " C"]
    sums: Sums | None
    unit: Float[Array, ""]
    parallel: bool = eqx.field(static=True)

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. Conservative: of each cell's corners."""
        corners, there = self._corners()
        d, x, h, z = frame.depth(corners), frame.lateral(corners), frame.along_light(corners), frame.eye_depth(corners)
        start, end = ends(there, d)
        share = (d - start) / jnp.where(end > start, end - start, 1)
        footprint = from_groups(grouped(there, d, x, h, z, bin_of(jnp.where(there, share, 0)), BINS), camera.near)
        if self.sums is None:
            return footprint
        sums, mass = self.sums, self.sums.mass.sum()
        filled = sums.weight > 0
        weight = jnp.where(filled, sums.weight, 1)
        centre = jnp.stack([sums.x, sums.y, sums.z], -1) / weight[:, None]
        if objective.kernel is None:
            depth = jnp.where(filled, frame.depth(centre), footprint.start)
            rows = depth[None], jnp.ones_like(depth)[None], sums.weight[None]
            return with_moments(footprint, rows, lambda row: row, self.unit, objective, mass)
        scale = jnp.where(footprint.flat, 0, 1 / footprint.mu)
        delta = jnp.clip((frame.depth(centre) - footprint.start) * scale, 0, 1)
        lateral = jnp.abs(frame.lateral(centre) - footprint.axis) * scale
        samples = Samples(
            LightDepth(jnp.where(filled, delta, 0), jnp.where(filled, 1 - delta, 1)), jnp.where(filled, lateral, 0),
            sums.weight / jnp.where(mass > 0, mass, 1), None,
        )  # fmt: skip
        return eqx.tree_at(lambda f: (f.samples, f.unit), footprint, (samples, self.unit), is_leaf=lambda v: v is None)

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: each cell's corners."""
        corners, there = self._corners()
        return corners, there.astype(corners.dtype)

    def between(self, camera: Camera, near: Float[Array, ""], far: Float[Array, ""]) -> tuple[Camera, Receivers]:
        """See `Receivers`: cells cut there; each one's weight goes with its centroid."""
        near, far = (jnp.asarray(v, camera.near.dtype) for v in (near, far))
        inside = (self.far >= near) & (self.near <= far)
        cut = (
            jnp.where(inside, jnp.maximum(self.near, near), jnp.inf),
            jnp.where(inside, jnp.minimum(self.far, far), -jnp.inf),
        )
        made = eqx.tree_at(lambda s: (s.near, s.far), self, cut)
        if self.sums is None:
            return camera, made
        weight = jnp.where(self.sums.weight > 0, self.sums.weight, 1)
        z = self.sums.z / weight
        mine = inside & (z >= near) & (z <= far)
        sums = jax.tree.map(lambda v: jnp.where(mine, v, 0), self.sums)
        return camera, eqx.tree_at(lambda s: s.sums, made, sums)

    def _corners(self) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
        """(the corners of all cells, which there are): a map that holds them holds the cells, which are convex."""
        there = jnp.isfinite(self.near)
        one = jnp.ones_like(self.near)
        slopes = [jnp.stack([x, y, one], -1) for x in self._ends(0) for y in self._ends(1)]
        depths = [jnp.where(there, z, 1) for z in (self.near, self.far)]
        if self.parallel:
            corners = jnp.concatenate([slope.at[:, 2].set(z) for slope in slopes for z in depths])
        else:
            corners = jnp.concatenate([slope * z[:, None] for slope in slopes for z in depths])
        return corners, jnp.tile(there, 8)

    def _ends(self, i: int) -> tuple[Float[Array, " C"], Float[Array, " C"]]:
        return self.low[:, i], self.high[:, i]


def _tiles(objective: Objective) -> tuple[int, int]:
    return _FOR_MAXIMA if objective.supremum else _FOR_MEANS


def _exponent(objective: Objective) -> float:
    """The power of 1/z in the integrand of a mean."""
    return objective.order * (1 if objective.kernel is not None else sum(t.depth_power for t in objective.terms))


def sketch_of_pixels(
    camera: Camera,
    across: Float[Array, " W"],
    up: Float[Array, " H"],
    z: Float[Array, "H W"],
    seen: Bool[Array, "H W"],
    weights: Float[Array, "H W"] | None,
    objective: Objective,
) -> Sketch:
    """The sketch of an image: tiles of pixels, in two parts where a silhouette crosses them.

    Args:
        across, up: slopes of the columns and rows.
        z: eye depths; anything positive and finite where nothing is seen.
        weights: None for uniform ones.
        objective: gives the order P of the mean.
    """
    height, width = z.shape
    down, aside = (
        max(_LEAST_TILE, -(-size // count))
        for size, count in zip((height, width), reversed(_tiles(objective)), strict=True)
    )
    rows, columns = -(-height // down), -(-width // aside)
    pad = ((0, rows * down - height), (0, columns * aside - width))

    def in_rows(image: Array, fill) -> Array:
        return jnp.pad(image, pad, constant_values=fill).reshape(rows, down, columns * aside)

    def by_tile(values: Array, reduce) -> Array:
        return reduce(values.reshape(*values.shape[:-1], columns, aside), -1)

    z, seen = in_rows(z, 1.0), in_rows(seen, False)

    def ends(_, row):
        z, seen = row
        near = jnp.where(seen, z, jnp.inf).min(0)
        far = jnp.where(seen, z, -jnp.inf).max(0)
        return None, (by_tile(near, jnp.min), by_tile(far, jnp.max))

    _, (near, far) = sweep(ends, None, (z, seen))
    there = jnp.isfinite(near)
    middle = jnp.sqrt(jnp.where(there, near, 1)) * jnp.sqrt(jnp.where(there, far, 1))
    unit = camera.screen_depth(jnp.where(there.any(), jnp.where(there, near, jnp.inf).min(), 1))
    averaged, exponent = not objective.supremum, _exponent(objective)
    padded_up = jnp.pad(up, pad[0]).reshape(rows, down, 1)
    padded_weights = None if weights is None else in_rows(weights, 0.0)

    def parts(_, row):
        z, seen, middle, up, weights = row
        before = z <= jnp.repeat(middle, aside, total_repeat_length=columns * aside)
        found = []
        for part in (seen & before, seen & ~before):
            limits = (
                by_tile(jnp.where(part, z, jnp.inf).min(0), jnp.min),
                by_tile(jnp.where(part, z, -jnp.inf).max(0), jnp.max),
            )
            sums = ()
            if averaged:
                own = part.astype(z.dtype) if weights is None else jnp.where(part, weights, 0)
                size = camera.screen_depth(z)
                share = own * power(unit / size, exponent)
                depth, size = share * z, share * size
                sums = (share.sum(0), depth.sum(0), size.sum(0), (size * up).sum(0), own.sum(0))
            found.append((*limits, *sums))
        return None, jax.tree.map(lambda *v: jnp.stack(v), *found)

    _, (near, far, *sums) = sweep(parts, None, (z, seen, middle, padded_up, padded_weights))
    slopes = jnp.pad(across, pad[1])
    made = None
    if averaged:
        weight, depth, size, rise, mass = sums
        made = Sums(*(by_tile(v, jnp.sum).ravel() for v in (weight, size * slopes, rise, depth, mass)))
    lows, highs = [], []
    first, last = np.arange(columns) * aside, np.minimum(np.arange(1, columns + 1) * aside, width) - 1
    top, bottom = np.arange(rows) * down, np.minimum(np.arange(1, rows + 1) * down, height) - 1
    shape = (rows, 2, columns)
    for slope, ends_of, axis in ((across, (first, last), (1, 1, columns)), (up, (top, bottom), (rows, 1, 1))):
        pair = slope[ends_of[0]], slope[ends_of[1]]
        lows.append(jnp.broadcast_to(jnp.minimum(*pair).reshape(axis), shape).ravel())
        highs.append(jnp.broadcast_to(jnp.maximum(*pair).reshape(axis), shape).ravel())
    ends_of_cells = jnp.stack(lows, -1), jnp.stack(highs, -1), near.ravel(), far.ravel()
    return Sketch(*ends_of_cells, made, unit, camera.is_orthographic)


def sketch_of_points(
    camera: Camera,
    points: Float[Array, "N 3"],
    seen: Bool[Array, " N"],
    weights: Float[Array, " N"],
    objective: Objective,
) -> Sketch:
    """The sketch of many points in eye coordinates, by the tile of the screen that they are in."""
    left, right, bottom, top = camera.window
    z = jnp.where(seen, points[:, 2], 1)
    size = camera.screen_depth(z)
    slopes = jnp.where(seen[:, None], points[:, :2] / size[:, None], 0)
    place = (slopes - jnp.stack([left, bottom])) / jnp.stack([right - left, top - bottom])
    columns, rows = _tiles(objective)
    column, row = (
        jnp.clip((place[:, i] * count).astype(jnp.int32), 0, count - 1) for i, count in ((0, columns), (1, rows))
    )
    tile, count = row * columns + column, columns * rows

    def least(values: Array, which: Array, count: int) -> Array:
        return jax.ops.segment_min(jnp.where(seen, values, jnp.inf), which, count)

    near, far = least(z, tile, count), -least(-z, tile, count)
    there = jnp.isfinite(near)
    middle = jnp.sqrt(jnp.where(there, near, 1)) * jnp.sqrt(jnp.where(there, far, 1))
    cell, count = 2 * tile + (z > middle[tile]), 2 * count
    near, far = least(z, cell, count), -least(-z, cell, count)
    unit = jnp.where(seen.any(), jnp.where(seen, size, jnp.inf).min(), 1)
    filled = jnp.isfinite(near)
    low, high = (jnp.stack([sign * least(sign * slopes[:, i], cell, count) for i in (0, 1)], -1) for sign in (1, -1))
    low, high = (jnp.where(filled[:, None], v, 0) for v in (low, high))
    made = None
    if not objective.supremum:
        share = weights * power(unit / size, _exponent(objective))
        terms = share, *(share * jnp.where(seen, points[:, i], 0) for i in range(3)), weights
        made = Sums(*(jax.ops.segment_sum(term, cell, count) for term in terms))
    return Sketch(low, high, near, far, made, unit, camera.is_orthographic)

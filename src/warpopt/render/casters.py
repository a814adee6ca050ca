"""Shadow casters: what part of them can shadow a receiver, and how near to the light it comes.

A caster shadows a receiver only from the receivers' sweep towards the light, a prism along it. Its base is the hull of
the receivers across the light; here it is the polygon of `_SIDES` sides about that hull, whose sides all touch it. In
the prism the depth along the light over A is extreme at a corner of what is left of a body or a triangle.
"""

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays, is_traced
from .._numerics import largest_of, least_of
from ..receivers import ConvexBody
from ..receivers.bins import BINS, bin_of
from ..receivers.footprint import Footprint
from ..receivers.polytope import vertices_of
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .hull import hull_triangles

_SIDES = 32  # of the base of the sweep: what it holds beyond the receivers is at most 7 % of the depth in 100 scenes
_CHUNK = 2048  # triangles clipped at once
# Directions in which traced points are bounded, up to their sign: those of a box are among them, so that its corners
# are the box itself. Of other points the body between these planes is a hull that is somewhat too large.
_BETWEEN = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], float)

Casters = Float[Array, "T 3 3"] | ConvexBody


def casters_of(casters: "Numbers | ConvexBody | None") -> "Casters | None":
    """Triangles or a convex body; points become their hull's triangles, or if traced the body between planes about
    them. None for none.

    Raises:
        ValueError: anything else, or values that are not finite.
    """
    if casters is None or isinstance(casters, ConvexBody):
        return casters
    (points,) = float_arrays(casters=casters)
    if points.shape[1:] not in ((3,), (3, 3)):
        raise ValueError(
            f"casters: got shape {points.shape}, expected points (N, 3), triangles (T, 3, 3), or a ConvexBody"
        )
    points = checked("casters", points, lambda v: abs(v) < np.inf, "finite numbers")
    if not len(points):
        return None
    if points.ndim == 3:
        return points
    return ConvexBody(_planes_about(points)) if is_traced(points) else jnp.asarray(hull_triangles(np.asarray(points)))


@jax.jit
def _planes_about(points: Float[Array, "N 3"]) -> Float[Array, "K 4"]:
    directions = jnp.asarray(_BETWEEN, points.dtype)
    along = points @ directions.T
    return jnp.concatenate([jnp.c_[-directions, along.max(0)], jnp.c_[directions, -along.min(0)]])


class Prism(NamedTuple):
    """The receivers' sweep, in units in which the receivers' extents are of order 1: (across, along the light, delta).

    Attributes:
        axes: (3, 3) unit vectors X_w, l, Z_w in eye coordinates.
        lengths: the units along them.
        origin: X_w . c, l . c and Z_w . c of (0, 0, 0).
        normals, offsets: of the sides, normal . (across, delta) <= offset, by angle.
    """

    axes: Float[Array, "3 3"]
    lengths: Float[Array, "3"]
    origin: Float[Array, "3"]
    normals: Float[np.ndarray, "K 2"]
    offsets: Float[Array, " K"]

    @classmethod
    def of(cls, footprint: Footprint, frame: LightFrame, reference: Array, height: Array) -> "Prism":
        """About a light depth (`reference`), with a unit of length along the light."""
        sides = footprint.sides
        least, largest = sides.across
        there = (largest >= least) & jnp.isfinite(sides.light_least)
        low, high = (jnp.where(there, v, 0) for v in (least, largest))
        width = largest_of(jnp.maximum(jnp.abs(low), jnp.abs(high)))
        width = jnp.where(width > 0, width, footprint.mu)
        angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
        # Multiples of a right angle exactly, so that delta stays in [0, 1].
        normals = np.round(np.stack([np.cos(angles), np.sin(angles)], 1), 15).astype(width.dtype)
        across, along = normals[:, :1], normals[:, 1:]
        reach = jnp.where(across > 0, high / width, low / width) * across
        reach = reach + jnp.where(along > 0, sides.farthest.delta, sides.depth.delta) * along
        offsets = largest_of(jnp.where(there, reach, -jnp.inf))
        lengths = jnp.stack([width, height, footprint.mu])
        axes = jnp.stack([frame.x_axis, frame.light, frame.z_axis])
        return cls(axes, lengths, jnp.stack([footprint.axis, reference, footprint.start]), normals, offsets)

    def places(self, eye_points: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
        """Points in the prism's units."""
        return (eye_points @ self.axes.T - self.origin) / self.lengths

    @property
    def planes(self) -> Float[Array, "K 4"]:
        """The sides as half-spaces normal . place + offset >= 0."""
        zero = jnp.zeros_like(self.offsets)
        return jnp.stack([-self.normals[:, 0] + zero, zero, -self.normals[:, 1] + zero, self.offsets], 1)

    def corners(self) -> Float[Array, "K 2"]:
        """(across, delta) where consecutive sides meet: the corners of the base, as each side touches the receivers."""
        one, other = self.normals, np.roll(self.normals, -1, 0)
        det = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        first, second = self.offsets, jnp.roll(self.offsets, -1)
        across = (first * other[:, 1] - second * one[:, 1]) / det
        return jnp.stack([across, (second * one[:, 0] - first * other[:, 0]) / det], 1)


class Nearest(NamedTuple):
    """Parts of the casters in the prism: at depths from `low` to `high` along Z_w, nearest to the light at `height`.

    Attributes:
        low, high: delta in [0, 1].
        height: the least l . c, from the prism's origin; inf where there is none, -inf if it is unbounded.
    """

    low: Float[Array, " N"]
    high: Float[Array, " N"]
    height: Float[Array, " N"]

    @classmethod
    def at(cls, places: Float[Array, "... 3"], there: Bool[Array, "..."], prism: Prism) -> "Nearest":
        """Corners of what is left of casters; they are clipped up to rounding."""
        delta = jnp.where(there, jnp.clip(places[..., 2], 0, 1), 0).ravel()
        return cls(delta, delta, jnp.where(there, places[..., 1] * prism.lengths[1], jnp.inf).ravel())

    def binned(self) -> "Nearest":
        """Fewer: of each bin of delta. A differs by 4 % within one."""
        which = bin_of(self.low, BINS)
        there = self.height < jnp.inf
        ends = jnp.where(there, self.low, jnp.inf), jnp.where(there, -self.high, jnp.inf)
        least = jax.ops.segment_min(jnp.stack([self.height, *ends], 1), which, BINS)
        there = least[:, 0] < jnp.inf
        low, high = jnp.where(there, least[:, 1], 0), jnp.where(there, -least[:, 2], 0)
        return Nearest(low, high, jnp.where(there, least[:, 0], jnp.inf))


def nearest_of(casters: Casters, camera: Camera, prism: Prism) -> Nearest:
    """The casters' parts in the prism, exact but for more triangles than are clipped at once, which are binned."""
    if isinstance(casters, ConvexBody):
        return _of_body(casters, camera, prism)
    if len(casters) <= _CHUNK:
        return _of_triangles(casters, camera, prism)
    more = -len(casters) % _CHUNK
    blocks = jnp.pad(casters, ((0, more), (0, 0), (0, 0)), constant_values=jnp.nan).reshape(-1, _CHUNK, 3, 3)
    parts = jax.lax.map(lambda block: _of_triangles(block, camera, prism).binned(), blocks)
    return jax.tree.map(jnp.ravel, parts).binned()


def _of_body(body: ConvexBody, camera: Camera, prism: Prism) -> Nearest:
    planes = body.planes.astype(camera.position.dtype)
    normals = planes[:, :3] @ camera.rotation.T
    offsets = planes[:, 3] + planes[:, :3] @ camera.position
    own = jnp.c_[normals @ prism.axes.T * prism.lengths, offsets + normals @ (prism.axes.T @ prism.origin)]
    size = jnp.sqrt((own[:, :3] ** 2).sum(1, keepdims=True))
    points, valid, endless = vertices_of(jnp.concatenate([prism.planes, own / jnp.where(size > 0, size, 1)]))
    parts = Nearest.at(jnp.where(valid[:, None], points, 0), valid, prism)
    return parts._replace(height=jnp.where(endless, -jnp.inf, parts.height))


def _of_triangles(triangles: Float[Array, "T 3 3"], camera: Camera, prism: Prism) -> Nearest:
    """NaN for no triangle."""
    own = triangles.astype(camera.position.dtype)
    corners = prism.places((own - camera.position) @ camera.rotation.T)
    # What is so large that products of two lengths overflow counts whole, at every depth.
    there = ~jnp.isnan(own).any((1, 2))
    small = (jnp.abs(corners) < 0.1 * jnp.finfo(own.dtype).max ** 0.5).all((1, 2))
    real, large = there & small, there & ~small
    heights = corners[..., 1].min(1) * prism.lengths[1]
    heights = jnp.where(large, jnp.where(jnp.isfinite(heights), heights, -jnp.inf), jnp.inf)
    whole = Nearest(jnp.zeros_like(heights), jnp.ones_like(heights), heights)
    corners = jnp.where(real[:, None, None], corners, 0)
    # Up to rounding: a caster over the outermost receiver is over a corner of the base.
    slack = 16 * jnp.finfo(own.dtype).eps * (jnp.abs(corners).max((1, 2)) + jnp.abs(prism.origin / prism.lengths).max())
    inside = prism.offsets - corners[..., ::2] @ prism.normals.T + slack[:, None, None]  # (T, 3, K), >= 0 inside
    # Edges, clipped by each side: t from their first to their second end.
    first, second = inside, jnp.roll(inside, -1, 1)
    change = second - first
    at = -first / jnp.where(change != 0, change, 1)
    start = jnp.maximum(largest_of(jnp.where(change > 0, at, 0)), 0)
    end = jnp.minimum(least_of(jnp.where(change < 0, at, 1)), 1)
    kept = real[:, None] & (start <= end) & ~((change == 0) & (first < 0)).any(-1)
    step = jnp.roll(corners, -1, 1) - corners
    clipped = [Nearest.at(corners + t[..., None] * step, kept, prism) for t in (start, end)]
    # The prism's edges, where they pass through a triangle: barycentric coordinates of the base's corners.
    base = prism.corners()[:, None]
    a, b, c = (corners[:, i, ::2] for i in range(3))

    def area(p: Array, q: Array, r: Array) -> Array:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    size = area(a, b, c)
    parts = jnp.stack([area(base, b, c), area(base, c, a), area(base, a, b)], -1)
    parts = parts / jnp.where(size != 0, size, 1)[:, None]
    through = real & (size != 0) & (parts >= 0).all(-1)
    heights = (parts * corners[..., 1]).sum(-1)
    places = jnp.stack([heights, heights, base[..., 1] + 0 * heights], -1)
    every = *clipped, Nearest.at(places, through, prism), whole
    return Nearest(*(jnp.concatenate(v) for v in zip(*every, strict=True)))

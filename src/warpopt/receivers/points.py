"""Receivers known one by one: points, and the groups that make a scene of any size a few hundred numbers."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, PyTree

from .._checks import checked, float_arrays
from .._numerics import power
from ..theory.camera import Camera
from ..theory.error_norm import ErrorNorm
from ..theory.light_frame import LightFrame
from ..theory.light_space import Depth
from .convex_body import from_raw
from .footprint import Footprint, Nearest, Sides, axis_inside, range_of

BINS = 256  # in delta; each is a group of the footprint
# Bins are even in log(delta + this), so that A = (1 - delta) eta + delta varies by at most 3.7 % within one for eta
# above it. Even in delta, the first bin alone would double A at eta = 1/256.
_FINEST = 1e-4


def bin_of(share: Float[Array, "..."]) -> Array:
    """The bin of a delta in [0, 1]."""
    position = jnp.log1p(share / _FINEST) / math.log1p(1 / _FINEST)
    return jax.lax.stop_gradient(jnp.clip((position * BINS).astype(int), 0, BINS - 1))


class Groups(eqx.Module):
    """Groups of receivers by what bounds each: Z_w . c, X_w . c, l . c, and the least eye depth. Empty: z = inf."""

    least_depth: Float[Array, " G"]
    largest_depth: Float[Array, " G"]
    least_lateral: Float[Array, " G"]
    largest_lateral: Float[Array, " G"]
    least_light: Float[Array, " G"]
    largest_light: Float[Array, " G"]
    z: Float[Array, " G"]


class PointReceivers(eqx.Module):
    """Points, such as a sample of the visible surfaces.

    Points outside the view frustum are not seen and count for nothing; so do points of weight 0. No points at all are
    an empty scene.

    Args:
        points: (N, 3) in world space.
        weights: (N,), >= 0; equal by default. The measure of an L_P norm; L-inf only asks which are positive.

    Raises:
        ValueError: for a wrong shape, NaN, infinite points, or a negative weight.

    Example:
        >>> import numpy as np, warpopt
        >>> points = np.stack([np.linspace(-3, 3, 50), np.zeros(50), np.linspace(-5, -90, 50)], axis=1)
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4)
        >>> light = warpopt.DirectionalLight((0, -1, -0.2))
        >>> solution = warpopt.scene_warp(camera, light, warpopt.PointReceivers(points), norm="l2")
        >>> bool(solution.value < solution.unwarped)
        True
    """

    points: Float[Array, "N 3"]
    weights: Float[Array, " N"]

    def __init__(self, points: ArrayLike, weights: ArrayLike | None = None):
        (points,) = float_arrays(points=points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points: got shape {points.shape}, expected (N, 3)")
        weights = jnp.ones(len(points), points.dtype) if weights is None else weights
        points, weights = float_arrays(points=points, weights=weights)
        if weights.shape != points.shape[:1]:
            raise ValueError(f"weights: got shape {weights.shape}, expected {points.shape[:1]}, one for each point")
        self.points = checked("points", points, lambda v: jnp.isfinite(v), "finite numbers")
        self.weights = checked("weights", weights, lambda w: jnp.isfinite(w) & (w >= 0), "finite numbers >= 0")

    def footprint(self, camera: Camera, frame: LightFrame, norm: ErrorNorm) -> Footprint:
        """See `Receivers`. Exact for at most `BINS` points, conservative beyond: `Footprint`'s groups."""
        world, weights = self.points, self.weights
        if not len(world):  # one point of no weight: empty
            world, weights = jnp.zeros((1, 3), world.dtype), jnp.zeros((1,), world.dtype)
        points = camera.to_eye(world)
        seen = (weights > 0) & seen_from(camera, points)
        points = jnp.where(seen[:, None], points, jnp.array([0.0, 0.0, 1.0], points.dtype))
        d, x, z = frame.depth(points), frame.lateral(points), points[:, 2]
        h = frame.along_light(points)
        if len(points) <= BINS:
            groups = grouped(seen, d, x, h, z, jnp.arange(len(points)), len(points))
        else:
            start, end = _ends(seen, d)
            share = (d - start) / jnp.where(end > start, end - start, 1)
            groups = grouped(seen, d, x, h, z, bin_of(jnp.where(seen, share, 0)), BINS)
        footprint = from_groups(groups, camera.near, len(points) > BINS)
        if norm.supremum:
            return footprint
        unit = jnp.where(seen.any(), jnp.where(seen, z, jnp.inf).min(), 1)
        weights = jnp.where(seen, weights, 0)
        rows = tuple(_in_rows(v, fill) for v, fill in ((d, footprint.start), (z, unit), (weights, 0)))
        return with_moments(footprint, rows, lambda row: (footprint.share(row[0]), row[1] / unit, row[2]), unit, norm)


def seen_from(camera: Camera, points: Float[Array, "N 3"]) -> Bool[Array, " N"]:
    """Which points in eye coordinates are in the view frustum."""
    planes = camera.planes()
    # On the boundary is seen: a far plane's corner must not be lost to the rounding of its transformation.
    size = jnp.abs(points).max(1) + jnp.abs(camera.position).max()
    slack = 64 * jnp.finfo(points.dtype).eps * size[:, None]
    return (points @ planes[:, :3].T + planes[:, 3] >= -slack).all(1)


def _in_rows(values: Array, fill: ArrayLike) -> Array:
    width = min(values.size, 2048)
    rows = -(-values.size // width)
    return jnp.concatenate([values, jnp.full(rows * width - values.size, fill, values.dtype)]).reshape(rows, width)


def grouped(seen: Array, d: Array, x: Array, h: Array, z: Array, which: Array, count: int) -> Groups:
    """The groups' bounds, by group number."""

    def least(values: Array) -> Array:
        return jax.ops.segment_min(jnp.where(seen, values, jnp.inf), which, count)

    return Groups(*(side for v in (d, x, h) for side in (least(v), -least(-v))), least(z))


def _ends(seen: Bool[Array, "..."], values: Float[Array, "..."]) -> tuple[Array, Array]:
    least, largest = jnp.where(seen, values, jnp.inf).min(), jnp.where(seen, values, -jnp.inf).max()
    there = seen.any()
    return jnp.where(there, least, 0), jnp.where(there, largest, 0)


def from_groups(groups: Groups, near: Array, grouped: bool = True) -> Footprint:
    """The footprint that no receiver of any group exceeds: the fit is conservative, and exact for groups of one."""
    there = jnp.isfinite(groups.z)
    start, _ = _ends(there, groups.least_depth)
    _, end = _ends(there, groups.largest_depth)
    least, _ = _ends(there, groups.least_lateral)
    _, largest = _ends(there, groups.largest_lateral)
    mu, flat = range_of(start, end, jnp.maximum(jnp.abs(start), jnp.abs(end)))
    axis = axis_inside(least, largest)

    def depth(d: Array) -> Depth:
        usable = there & ~flat
        d = jnp.where(usable, d, start)
        return Depth(jnp.where(usable, (d - start) / mu, 0), jnp.where(usable, (end - d) / mu, 1))

    sides = (
        jnp.where(there & (side > 0), jnp.where(there, side, 0), 0)
        for side in (groups.largest_lateral - axis, axis - groups.least_lateral)
    )
    farthest = depth(groups.largest_depth)
    return Footprint(
        start,
        mu,
        axis,
        Nearest(farthest, groups.z),
        Sides(depth(groups.least_depth), farthest, *sides, groups.least_light, groups.largest_light),
        None,
        near,
        ~there.any(),
        flat,
        grouped,
    )


def with_moments(
    footprint: Footprint,
    rows: PyTree,
    receivers_of: Callable[[PyTree], tuple[Depth, Array, Array]],
    unit: Array,
    norm: ErrorNorm,
) -> Footprint:
    """The footprint with the moments of weighted receivers; all terms positive.

    One sweep: row by row, all sums at once, so that nothing but the rows is read and nothing is kept. (Five sums of a
    1920 by 1080 buffer: 7 ms so, 57 ms as five reductions, of which each computes everything anew.)

    Args:
        rows: arrays whose leading axis is the rows'.
        receivers_of: (depth, z in units of `unit`, weight) of one row's receivers.
    """
    M, exponent = round(norm.blend_degree), norm.metric.depth_power * norm.order

    def add(sums: tuple[Array, ...], row: PyTree) -> tuple[tuple[Array, ...], None]:
        depth, z, weight = receivers_of(row)
        weighted = weight * power(1 / z, exponent)
        near, far = (_powers(v, M) for v in (depth.one_minus_delta, depth.delta))
        terms = (weighted * near[M - j] * far[j] for j in range(M + 1))
        return tuple(total + term for total, term in zip(sums, (weight, *terms), strict=True)), None

    first = jax.tree.map(lambda v: v[0], rows)
    shape = jax.eval_shape(lambda row: receivers_of(row)[2], first)
    mass, *raw = jax.lax.scan(add, (jnp.zeros(shape.shape, shape.dtype),) * (M + 2), rows)[0]
    moments = from_raw([math.comb(M, j) * value.sum() for j, value in enumerate(raw)], mass.sum(), norm)
    return eqx.tree_at(lambda f: (f.moments, f.unit), footprint, (moments, unit), is_leaf=lambda v: v is None)


def _powers(base: Array, highest: int) -> list[Array]:
    """base^0 .. base^highest, each from the one before: derivatives at 0 are finite."""
    powers = [jnp.ones_like(base)]
    for _ in range(highest):
        powers.append(powers[-1] * base)
    return powers

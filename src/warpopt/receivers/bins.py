"""Receivers binned by their depth along Z_w: reduces a scene of any size to a few hundred numbers and their sums."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._checks import assembled
from .._numerics import least_and_largest, least_of, power
from .._parallel import extremes, sweep
from ..objective import Objective
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from .footprint import Footprint, Nearest, Sides, axis_inside, range_of
from .moments import binomial_moments

BINS = 256  # in delta; each bin is a group of the footprint
# Bins are even in log(delta + offset), so that A = (1 - delta) eta + delta varies by at most 3.7 % within a bin for eta
# above the offset. With bins even in delta, A would double within the first bin at eta = 1/256.
_FINEST = 1e-4


def bin_of(share: Float[Array, "..."], count: int = BINS) -> Int[Array, "..."]:
    """The bin of a delta in [0, 1]."""
    position = jnp.log1p(share / _FINEST) / math.log1p(1 / _FINEST)
    return jax.lax.stop_gradient(jnp.clip((position * count).astype(jnp.int32), 0, count - 1))


def bin_edges(count: int) -> np.ndarray:
    """(count + 1,) delta at the bin edges."""
    edges = _FINEST * np.expm1(np.linspace(0, np.log1p(1 / _FINEST), count + 1))
    edges[-1] = 1.0
    return edges


class Groups(eqx.Module):
    """Bounds of groups of receivers: Z_w . c, X_w . c, l . c, and the least eye depth. Empty groups: z = inf.

    `z` is attained by a receiver. Where lateral bounds may be wider than any receiver, `reached` has (a least, a
    largest) X_w . c that some receiver attains or exceeds.
    """

    least_depth: Float[Array, "*G"]
    largest_depth: Float[Array, "*G"]
    least_lateral: Float[Array, "*G"]
    largest_lateral: Float[Array, "*G"]
    least_light: Float[Array, "*G"]
    largest_light: Float[Array, "*G"]
    z: Float[Array, "*G"]
    reached: tuple[Float[Array, "*G"], Float[Array, "*G"]] | None = None


# Whether each bound of merged groups is the least (1) or the largest (-1).
SIGNS: Any = assembled(
    Groups, least_depth=1, largest_depth=-1, least_lateral=1, largest_lateral=-1, least_light=1, largest_light=-1, z=1,
    reached=(1, -1),
)  # fmt: skip


def merged(there: Bool[Array, "..."], groups: Groups, which: Int[Array, "..."], count: int) -> Groups:
    """Groups that contain all of the given groups that belong to each."""
    signs = SIGNS if groups.reached is not None else eqx.tree_at(lambda g: g.reached, SIGNS, None)

    def alone(values: Array, sign: int) -> Array:
        return jnp.where(there, values, sign * jnp.inf).ravel()

    return extremes(jax.tree.map(alone, groups, signs), signs, which.ravel(), count)


def grouped(seen: Array, d: Array, x: Array, h: Array, z: Array, which: Array, count: int) -> Groups:
    """The groups' bounds, by group number."""
    return merged(seen, Groups(d, d, x, x, h, h, z), which, count)


def ends(seen: Bool[Array, "..."], values: Float[Array, "..."]) -> tuple[Array, Array]:
    """The least and the largest of the visible values; 0 if none are visible."""
    there = seen.any()
    least, largest = (jnp.where(there, end, 0) for end in extent_of(values, seen))
    return least, largest


def extent_of(z: Float[Array, "..."], seen: Bool[Array, "..."]) -> tuple[Array, Array]:
    """(least, largest) eye depth of the visible receivers; (inf, -inf) if there are none."""
    return least_and_largest(jnp.where(seen, z, jnp.inf), jnp.where(seen, z, -jnp.inf))


def singles(valid: Bool[Array, " N"], points: Float[Array, "N 3"], frame: LightFrame) -> Groups:
    """A few points in eye coordinates, each its own group."""
    points = jnp.where(valid[:, None], points, 0)
    d, x, h = frame.depth(points), frame.lateral(points), frame.along_light(points)
    return each_alone(valid, d, x, h, frame.eye_depth(points))


def each_alone(seen: Array, d: Array, x: Array, h: Array, z: Array) -> Groups:
    """The bounds of groups of one."""
    low, high = ((lambda v, edge=edge: jnp.where(seen, v, edge)) for edge in (jnp.inf, -jnp.inf))
    return Groups(low(d), high(d), low(x), high(x), low(h), high(h), low(z))


def from_groups(groups: Groups, near: Array, grouped: bool = True) -> Footprint:
    """A footprint whose bounds no receiver of any group exceeds: conservative, and exact for groups of one."""
    there = jnp.isfinite(groups.z)
    # One reduction: each is a kernel of its own, which takes longer to compile or to start than its work.
    bounds = groups.least_depth, -groups.largest_depth, groups.least_lateral, -groups.largest_lateral
    *found, none = least_of(jnp.where(there, jnp.stack([*bounds, jnp.zeros_like(groups.z)]), jnp.inf))
    empty = jnp.isinf(none)
    start, end, least, largest = (jnp.where(empty, 0, sign * v) for sign, v in zip((1, -1, 1, -1), found, strict=True))
    mu, flat = range_of(start, end, jnp.maximum(jnp.abs(start), jnp.abs(end)))
    axis = axis_inside(least, largest)

    def depth(d: Array) -> LightDepth:
        usable = there & ~flat
        d = jnp.where(usable, d, start)
        return LightDepth(jnp.where(usable, (d - start) / mu, 0), jnp.where(usable, (end - d) / mu, 1))

    def sides(least: Array, largest: Array) -> tuple[Array, Array]:
        right, left = (
            jnp.where(there & (side > 0), jnp.where(there, side, 0), 0) for side in (largest - axis, axis - least)
        )
        return right, left

    right, left = sides(groups.least_lateral, groups.largest_lateral)
    reached = (right, left) if groups.reached is None else sides(*groups.reached)
    farthest = depth(groups.largest_depth)
    return Footprint(
        start,
        mu,
        axis,
        Nearest(farthest, groups.z),
        Sides(
            depth(groups.least_depth),
            farthest,
            right,
            left,
            groups.least_light,
            groups.largest_light,
            reached if grouped else None,
            (
                jnp.where(there, groups.least_lateral - axis, jnp.inf),
                jnp.where(there, groups.largest_lateral - axis, -jnp.inf),
            ),
        ),
        None,
        near,
        empty,
        flat,
        grouped,
    )


def with_moments(
    footprint: Footprint,
    rows: PyTree,
    receivers_of: Callable[[PyTree], tuple[Array, Array, Array]],
    unit: Array,
    objective: Objective,
    mass: Array | None = None,
) -> Footprint:
    """The footprint with the moments of weighted receivers; all terms are positive.

    One sweep, row by row with all sums at once, stores nothing but the sums. (Five sums of a 1920 by 1080 buffer: 7 ms
    this way, 57 ms as five reductions, each of which recomputes everything.)

    Args:
        rows: arrays whose leading axis is the row.
        receivers_of: gives (Z_w . c, `unit` over z, weight) of one row's receivers.
        mass: what means are over; the sum of the weights if None.
    """
    M, exponent = round(objective.blend_degree), objective.metric.depth_power * objective.order
    # Few inputs: LLVM vectorises a sweep less the more it reads (one more input halves the speed). 1 - delta is as
    # exact as delta here, as both have the error of Z_w . c.
    start, scale = footprint.start, jnp.where(footprint.flat, 0, 1 / footprint.mu)

    def add(sums: tuple[Array, ...], row: PyTree) -> tuple[tuple[Array, ...], None]:
        d, nearness, weight = receivers_of(row)
        delta = (d - start) * scale
        weighted = weight * power(nearness, exponent)
        near, far = (_powers(v, M) for v in (1 - delta, delta))
        terms = (weighted * near[M - j] * far[j] for j in range(M + 1))
        return tuple(old + term for old, term in zip(sums, (weight, *terms), strict=True)), None

    first = jax.tree.map(lambda v: v[0], rows)
    shape = jax.eval_shape(lambda row: receivers_of(row)[2], first)
    weighed, *raw = sweep(add, (jnp.zeros(shape.shape, shape.dtype),) * (M + 2), rows)[0]
    # A receiver at an end may have delta = -eps, so the sums are clamped. (Clamping each receiver costs more than the
    # rest of the sweep.)
    sums = [value.sum() for value in raw]
    sums = [jnp.where(value < 0, 0, value) for value in sums]  # NaN stays: it must not look like a sum
    return footprint.with_moments(binomial_moments(sums, weighed.sum() if mass is None else mass, objective), unit)


def _powers(base: Array, highest: int) -> list[Array]:
    """base^0 .. base^highest, each from the one before, which keeps derivatives at 0 finite."""
    powers = [jnp.ones_like(base)]
    for _ in range(highest):
        powers.append(powers[-1] * base)
    return powers

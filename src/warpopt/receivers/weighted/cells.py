"""Samples of any number of receivers: one by one where they are few, else in cells.

Depths are binned by the leading bits of delta + 1e-4 as a floating-point number, which is logarithmic to within a
factor of 2 and costs a shift where a logarithm would take longer than all the rest of the sweep. Across, cells are even
in the slope at which the eye sees them, x over the distance from the eye.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from ..._numerics import power, staged
from ...objective import Objective
from ...theory.light_space import LightDepth
from ..footprint import Footprint, Sides
from ..samples import Corners, Samples

EXACT = 4096
"""At most this many points are taken one by one."""
_OFFSET = 1e-4
_FINE_BITS, _CELL_BITS = 10, 4  # of the mantissa: depths per octave, as powers of 2, for sides and for cells
_SLOPES = 32
_LEAST_START = 0.02  # of mu: where slopes are measured from if the receivers begin at the eye's depth or behind it


def _key(delta: Array) -> Int[Array, "..."]:
    """The leading bits of delta + 1e-4."""
    shifted = jax.lax.stop_gradient(delta + _OFFSET).astype(jnp.float32)
    return jax.lax.bitcast_convert_type(shifted, jnp.int32) >> (23 - _FINE_BITS)


_LEAST_KEY, _LARGEST_KEY = (
    int(np.float32(value).view(np.int32)) >> (23 - _FINE_BITS) for value in (_OFFSET, 1 + _OFFSET)
)
_COARSER = _FINE_BITS - _CELL_BITS
_FIRST_CELL = _LEAST_KEY >> _COARSER
_SIDES = _LARGEST_KEY - _LEAST_KEY + 1
_DEPTHS = (_LARGEST_KEY >> _COARSER) - _FIRST_CELL + 1
_DEPTHS += _DEPTHS % 2  # even, so that cells can be merged in pairs


def _edges(first: int, count: int, bits: int, dtype) -> np.ndarray:
    """(count + 1,) delta at the bins' edges, lowered by the rounding of `_key`."""
    shifted = (np.arange(first, first + count + 1, dtype=np.int32) << (23 - bits)).view(np.float32).astype(float)
    return np.clip(shifted * (1 - 2.0**-23) - _OFFSET, 0, 1).astype(dtype)


def with_samples(
    footprint: Footprint,
    rows: PyTree,
    receivers_of: Callable[[PyTree], tuple[Array, Array, Array, Array, Array]],
    unit: Float[Array, ""],
    objective: Objective,
    own_sides: bool = False,
) -> Footprint:
    """The footprint with its samples.

    Args:
        footprint: of all receivers that must fit into the map.
        rows: arrays whose leading axis is the row.
        receivers_of: gives (Z_w . c, X_w . c, z, weight, whether it must fit into the map) of one row's receivers; for
            those that need not, anything finite with z > 0 and weight 0.
        unit: the least eye depth of all.
        objective: gives the order P of the mean.
        own_sides: whether the footprint's sides bound more than these receivers, and are kept.
    """
    shape = jax.eval_shape(jax.vmap(receivers_of), rows)[0]
    if shape.size <= EXACT:
        samples = _one_by_one(footprint, jax.vmap(receivers_of)(rows), unit, objective)
    else:
        samples, sides = _in_cells(footprint, rows, receivers_of, unit, objective)
        if not own_sides:
            footprint = eqx.tree_at(lambda f: f.sides, footprint, sides)
    return eqx.tree_at(lambda f: (f.samples, f.unit), footprint, (samples, unit), is_leaf=lambda leaf: leaf is None)


def _one_by_one(footprint: Footprint, receivers: tuple[Array, ...], unit: Array, objective: Objective) -> Samples:
    d, x, z, weight, seen = (value.ravel() for value in receivers)
    scale = _scale(footprint)
    before, beyond = (d - footprint.start) * scale, (footprint.start + footprint.mu - d) * scale
    beyond = jnp.where(footprint.flat, 1, beyond)
    # Rounding may put the first or the last receiver outside of [0, 1] by eps.
    delta = jnp.where(seen & (before > 0), before, 0)
    rest = jnp.where(seen, jnp.where(beyond > 0, beyond, 0), 1)
    lateral = jnp.where(seen, jnp.abs(x - footprint.axis) * scale, 0)
    share = weight * power(unit / z, objective.order) / _positive(weight.sum())
    return Samples(LightDepth(delta, rest), lateral, share, None)


def _in_cells(
    footprint: Footprint, rows: PyTree, receivers_of: Callable, unit: Array, objective: Objective
) -> tuple[Samples, Sides]:
    """(the cells' centroids, the sides by narrow ranges of depth), in one sweep that stores nothing but sums."""
    scale, start, axis = _scale(footprint), footprint.start, footprint.axis
    offset = jax.lax.stop_gradient(jnp.where(start * scale > _LEAST_START, start * scale, _LEAST_START))
    old = footprint.sides
    widest = jnp.where(old.right > old.left, old.right, old.left) * scale / (old.depth.delta + offset)
    pitch = _positive(jax.lax.stop_gradient(widest.max())) / _SLOPES

    def add(found: tuple[Array, Array, Array], row: PyTree) -> tuple[tuple[Array, Array, Array], None]:
        sums, widths, mass = found
        d, x, z, weight, seen = receivers_of(row)
        # Products with 0 instead of selections, which would double the time of the sweep.
        across = (x - axis) * seen.astype(x.dtype)
        delta = jnp.maximum((d - start) * scale, 0)
        lateral = jnp.abs(across) * scale
        key = jnp.clip(_key(delta), _LEAST_KEY, _LARGEST_KEY)
        slope = jax.lax.stop_gradient(lateral * (1 / pitch) / (delta + offset)).astype(jnp.int32)
        cell = ((key >> _COARSER) - _FIRST_CELL) * _SLOPES + jnp.minimum(slope, _SLOPES - 1)
        share = weight * power(unit / z, objective.order)
        # Without the stage the compiler repeats all of this for each of the sums, which takes twice as long.
        share, delta, lateral, cell, key, across = staged(lambda *v: v, share, delta, lateral, cell, key, across)
        moments = share, share * delta, share * lateral, share * delta * lateral
        sums = sums.at[cell].add(jnp.stack(moments, -1), mode="promise_in_bounds")
        both = jnp.stack([across, -across], -1)
        return (sums, widths.at[key - _LEAST_KEY].max(both, mode="promise_in_bounds"), mass + weight), None

    first = jax.eval_shape(receivers_of, jax.tree.map(lambda v: v[0], rows))[0]
    dtype = first.dtype
    nothing = jnp.zeros((_DEPTHS * _SLOPES, 4), dtype), jnp.zeros((_SIDES, 2), dtype), jnp.zeros(first.shape, dtype)
    (sums, widths, mass), _ = jax.lax.scan(add, nothing, rows)
    sums = (sums / _positive(mass.sum())).reshape(_DEPTHS, _SLOPES, 4)
    samples = _centroids(sums, offset, pitch)
    return samples, _finer(old, *widths.T)


def _centroids(sums: Float[Array, "D C 4"], offset: Array, pitch: Array) -> Samples:
    """The occupied cells; where more than half are, cells twice as deep."""
    edges = jnp.asarray(_edges(_FIRST_CELL, _DEPTHS, _CELL_BITS, sums.dtype))
    room = sums.shape[0] // 2 * sums.shape[1]

    def occupied() -> Samples:
        full = _of_cells(sums, edges, offset, pitch)
        first = jnp.argsort(~(full.weight > 0), stable=True)[:room]
        return jax.tree.map(lambda v: v[first], full)

    def merged() -> Samples:
        return _of_cells(sums.reshape(-1, 2, *sums.shape[1:]).sum(1), edges[::2], offset, pitch)

    return jax.lax.cond((sums[..., 0] > 0).sum() <= room, occupied, merged)


def _of_cells(sums: Float[Array, "D C 4"], edges: Array, offset: Array, pitch: Array) -> Samples:
    first, last = edges[:-1, None], edges[1:, None]
    # A cell's receivers lie between two slopes and two depths: a trapezoid, in this rectangle.
    inner = jnp.arange(_SLOPES) * pitch * (first + offset)
    outer = jnp.arange(1, _SLOPES + 1) * pitch * (last + offset)
    depth, width = _positive(last - first), outer - inner  # cells beyond delta = 1 are empty
    total = sums[..., 0]
    delta, lateral, both = (sums[..., i] / _positive(total) for i in (1, 2, 3))
    u, v = (delta - first) / depth, (lateral - inner) / width
    uv = (both - first * lateral - inner * delta + first * inner) / (depth * width)
    u, v, uv = (jnp.where(total > 0, jnp.clip(place, 0, 1), 0.5) for place in (u, v, uv))  # rounding
    delta = jnp.where(total > 0, delta, (first + last) / 2)
    lateral = jnp.where(total > 0, lateral, (inner + outer) / 2)

    def at(delta: Array) -> LightDepth:
        flat = jnp.broadcast_to(delta, total.shape).ravel()
        return LightDepth(flat, 1 - flat)

    places = (value.ravel() for value in (inner, outer, u, v, uv))
    return Samples(at(delta), lateral.ravel(), total.ravel(), Corners(at(first), at(last), *places))


def _finer(old: Sides, right: Float[Array, " K"], left: Float[Array, " K"]) -> Sides:
    """Sides by narrow ranges of depth, after the footprint's own, which keep only the extents along the light."""
    edges = _edges(_LEAST_KEY, _SIDES, _FINE_BITS, right.dtype)
    first, last = (LightDepth(jnp.asarray(e), 1 - jnp.asarray(e)) for e in (edges[:-1], edges[1:]))
    none, infinite = jnp.zeros_like(old.right), jnp.full_like(right, jnp.inf)
    finer = Sides(first, last, right, left, infinite, -infinite, (right, left))
    kept = Sides(old.depth, old.farthest, none, none, old.light_least, old.light_largest, (none, none))
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), kept, finer)


def _scale(footprint: Footprint) -> Array:
    return jnp.where(footprint.flat, 0, 1 / footprint.mu)


def _positive(value: Array) -> Array:
    """The value, or 1 where it is 0: a divisor."""
    return jnp.where(value > 0, value, 1)

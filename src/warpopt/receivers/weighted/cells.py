"""Samples of any number of receivers: one by one where they are few, else in cells.

Depths are binned by the leading bits of delta + 1e-4 as a floating-point number, which is logarithmic to within a
factor of 2 and costs a shift where a logarithm would take longer than all the rest of the sweep. Across, cells are even
in the slope at which the eye sees them, x over the distance from the eye.
"""

import functools
import itertools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int, PyTree

from ..._numerics import positive, power, staged
from ..._parallel import raised, sweep_points, wide
from ...objective import Objective
from ...theory.light_space import LightDepth
from ..footprint import Footprint, Sides
from ..samples import Corners, Normal, Samples, Spread

EXACT = 4096
"""At most this many points are taken one by one."""
_OFFSET = 1e-4
_FINE_BITS, _CELL_BITS = 10, 4  # of the mantissa: depths per octave, as powers of 2, for sides and for cells
_SLOPES = 32
_FINER = 4  # cells of the upper bound, which is needed at one eta only, to a cell of the samples, on either side
_DIRECTIONS = 16  # of edges, in the half circle: as many as a mask tells apart
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
    receivers_of: Callable[[PyTree], tuple[Array, Array, Array, Array, Array, Normal | None]],
    unit: Float[Array, ""],
    objective: Objective,
    own_sides: bool = False,
) -> Footprint:
    """The footprint with its samples.

    Args:
        footprint: of all receivers that must fit into the map.
        rows: arrays whose leading axis is the row.
        receivers_of: gives (Z_w . c, X_w . c, z, weight, whether it must fit into the map, the normal of the edge
            beside it) of one row's receivers; for those that need not fit, anything finite with z > 0 and weight 0. The
            normal is 0 where it is unknown, and None if it is for all.
        unit: the least eye depth of all.
        objective: gives the order P of the mean.
        own_sides: whether the footprint's sides bound more than these receivers, and are kept.
    """
    shape = jax.eval_shape(jax.vmap(receivers_of), rows)[0]
    if shape.size <= EXACT:
        samples, directed = _one_by_one(footprint, jax.vmap(receivers_of)(rows), unit, objective)
    else:
        samples, directed, sides = _in_cells(footprint, rows, receivers_of, unit, objective)
        if not own_sides:
            footprint = eqx.tree_at(lambda f: f.sides, footprint, sides)
    parts = samples, directed, unit
    return eqx.tree_at(lambda f: (f.samples, f.directed, f.unit), footprint, parts, is_leaf=lambda leaf: leaf is None)


def _one_by_one(
    footprint: Footprint, receivers: tuple, unit: Array, objective: Objective
) -> tuple[Samples, Samples | None]:
    d, x, z, weight, seen, normal = jax.tree.map(jnp.ravel, receivers)
    scale = _scale(footprint)
    before, beyond = (d - footprint.start) * scale, (footprint.start + footprint.mu - d) * scale
    beyond = jnp.where(footprint.flat, 1, beyond)
    # Rounding may put the first or the last receiver outside of [0, 1] by eps.
    delta = jnp.where(seen & (before > 0), before, 0)
    rest = jnp.where(seen, jnp.where(beyond > 0, beyond, 0), 1)
    across = x - footprint.axis
    lateral = jnp.where(seen, jnp.abs(across) * scale, 0)
    share = weight * power(unit / z, objective.order) / positive(weight.sum())
    depth = LightDepth(delta, rest)
    if normal is None:
        return Samples(depth, lateral, share), None
    known = (normal[0] != 0) | (normal[1] != 0)
    directed = Samples(depth, lateral, jnp.where(known, share, 0), _folded(normal, across))
    return Samples(depth, lateral, jnp.where(known, 0, share)), directed


def _folded(normal: Normal, across: Array) -> Normal:
    """A normal as seen where x is positive: a texel and its mirror image are equal, and so are n and -n."""
    along, beside = normal
    return jnp.abs(along), jnp.where((along < 0) ^ (across < 0), -beside, beside)


def _direction(normal: Normal) -> tuple[Int[Array, "..."], Float[Array, "..."]]:
    """(the layer of a folded normal, `_DIRECTIONS` for none; its length), without a trigonometric function.

    The screen images of Z_w and X_w are not perpendicular where pixels are not square: there its length is not 1.
    """
    along, beside = normal
    size = along + jnp.abs(beside)
    place = (beside / positive(size) + 1) * (_DIRECTIONS / 2)
    layer = jnp.where(size > 0, jnp.minimum(place.astype(jnp.int32), _DIRECTIONS - 1), _DIRECTIONS)
    square = along * along + beside * beside
    return layer, jnp.where(size > 0, jnp.sqrt(positive(square)), 1)


def _normals(layer: Float[Array, " N"], count: int, dtype) -> Normal:
    """The normals that layers stand for, of `count` in all; those between two for two together."""
    beside = ((layer + 0.5) / (count / 2) - 1).astype(dtype)
    along = 1 - jnp.abs(beside)
    length = jnp.sqrt(along * along + beside * beside)
    return along / length, beside / length


def _in_cells(
    footprint: Footprint, rows: PyTree, receivers_of: Callable, unit: Array, objective: Objective
) -> tuple[Samples, Samples | None, Sides]:
    """(the cells' centroids, those with a direction, the sides by narrow ranges of depth), in one sweep that stores
    nothing but sums."""
    shapes = jax.eval_shape(receivers_of, jax.tree.map(lambda v: v[0], rows))
    directed, dtype = shapes[-1] is not None, shapes[0].dtype
    layers, finer = (_DIRECTIONS + 1, 1) if directed else (1, _FINER)
    depths, slopes, coarser = _DEPTHS * finer, _SLOPES * finer, _COARSER - finer.bit_length() + 1
    scale, start, axis = _scale(footprint), footprint.start, footprint.axis
    offset = jax.lax.stop_gradient(jnp.where(start * scale > _LEAST_START, start * scale, _LEAST_START))
    old = footprint.sides
    widest = jnp.where(old.right > old.left, old.right, old.left) * scale / (old.depth.delta + offset)
    widest = positive(jax.lax.stop_gradient(widest.max()))

    def add(found: tuple[Array, Array, Array], receivers: tuple) -> tuple[tuple[Array, Array, Array], None]:
        sums, widths, mass = found
        d, x, z, weight, seen, normal = receivers
        # Products with 0 instead of selections, which would double the time of the sweep.
        across = (x - axis) * seen.astype(x.dtype)
        delta = jnp.maximum((d - start) * scale, 0)
        lateral = jnp.abs(across) * scale
        key = jnp.clip(_key(delta), _LEAST_KEY, _LARGEST_KEY)
        slope = jax.lax.stop_gradient(lateral * (slopes / widest) / (delta + offset)).astype(jnp.int32)
        cell = ((key >> coarser) - _FIRST_CELL * finer) * slopes + jnp.minimum(slope, slopes - 1)
        share = weight * power(unit / z, objective.order)
        if normal is not None:
            layer, length = _direction(_folded(normal, across))
            cell, share = cell * layers + layer, share * power(length, objective.order)
        # Without the stage the compiler repeats all of this for each of the sums, which takes twice as long.
        share, delta, lateral, cell, key, across = staged(lambda *v: v, share, delta, lateral, cell, key, across)
        moments = share, share * delta, share * lateral, share * delta * lateral
        sums = sums.at[cell].add(jnp.stack(moments, -1), mode="promise_in_bounds")
        return (sums, _raised_sides(widths, key - _LEAST_KEY, across), mass + weight), None

    def nothing(shape: tuple[int, ...]) -> tuple[Array, Array, Array]:
        return (
            jnp.zeros((depths * slopes * layers, 4), dtype), jnp.zeros((_SIDES, 2), dtype), jnp.zeros(shape, dtype)
        )  # fmt: skip

    sums, widths, mass = sweep_points(add, nothing, receivers_of, rows)
    sums = (sums / positive(mass.sum())).reshape(depths, slopes, layers, 4)
    grid = _Grid(_edges(_FIRST_CELL * finer, depths, _FINE_BITS - coarser, dtype), offset, widest)
    sides = _finer(old, *widths.T)
    if directed:
        without, known = sums[:, :, _DIRECTIONS:], sums[:, :, :_DIRECTIONS]
        samples, of_known = _occupied([(without, ((1, 1, 1), (2, 1, 1))), (known, ((1, 1, 1), (2, 2, 2)))], grid)
        return samples, of_known, sides
    finest = (1, 1, 1), (2, 2, 1)
    samples, smaller = _occupied([(sums, (*finest, (4, 4, 1), (8, 4, 1))), (sums, finest)], grid)
    return eqx.tree_at(lambda s: s.corners, samples, smaller.corners), None, sides


def _raised_sides(widths: Float[Array, "G 2"], which: Int[Array, " N"], across: Float[Array, " N"]) -> Array:
    """The largest x and -x of each group, at least what they were, which is 0 or more."""
    if not wide():
        return raised(widths, which, jnp.stack([across, -across], -1))
    # One of the two is never above 0: half as many atomic operations.
    return raised(widths.reshape(-1, 1), 2 * which + (across < 0), jnp.abs(across)[:, None]).reshape(-1, 2)


class _Grid(NamedTuple):
    """The edges of cells in delta; where slopes are measured from, in units of mu, and the largest."""

    edges: np.ndarray
    offset: Array
    widest: Array


class _Occupied(NamedTuple):
    """Some cells: from which of several lists, which of it, and their sums; sums of 0 beyond the last one."""

    chosen: Int[Array, ""]
    which: Int[Array, " N"]
    sums: Float[Array, "N 4"]


def _occupied(
    wanted: list[tuple[Float[Array, "D C L 4"], tuple[tuple[int, int, int], ...]]], grid: _Grid
) -> list[Samples]:
    """For each of the wanted, the occupied cells of the first of its sizes of which there are no more than of the last
    in all.

    Args:
        wanted: sums of a grid's cells; sizes, numbers of depths, slopes and layers that a cell joins.
        grid: the same for all.
    """
    joined = [[_joined(sums, size) for size in sizes] for sums, sizes in wanted]
    lists = [[each.reshape(-1, 4) for each in of_one] for of_one in joined]
    compacted = _compacted_at_once(lists) if wide() else [_compacted(of_one) for of_one in lists]
    found = []
    for (sums, sizes), of_one, cells in zip(wanted, joined, compacted, strict=True):
        size = tuple(jnp.array(sizes)[cells.chosen])
        across, layers = jnp.array([each.shape[1:3] for each in of_one])[cells.chosen]
        place = cells.which // (across * layers), cells.which // layers % across, cells.which % layers
        place = tuple(i * by for i, by in zip(place, size, strict=True))
        found.append(_of_cells(cells.sums, place, sums.shape[:3], grid, size))
    return found


def _compacted(lists: list[Float[Array, "_ 4"]]) -> _Occupied:
    """Of the first list of which no more cells are occupied than the last one has, those; of the last one all."""
    room = len(lists[-1])
    there = [each[:, 0] > 0 for each in lists]
    counts = jnp.stack([each.sum() for each in there])
    chosen = jnp.argmax(counts <= room)

    def of_list(k: int) -> tuple[Array, Array]:
        if k == len(lists) - 1:
            return jnp.arange(room), lists[k]
        (which,) = jnp.nonzero(there[k], size=room, fill_value=0)
        return which, jnp.where((jnp.arange(room) < counts[k])[:, None], lists[k][which], 0)

    return _Occupied(chosen, *jax.lax.switch(chosen, [functools.partial(of_list, k) for k in range(len(lists))]))


def _compacted_at_once(groups: list[list[Float[Array, "_ 4"]]]) -> list[_Occupied]:
    """`_compacted` of several groups of lists as one: counted and moved once, where each list would take a dozen
    kernels. Of a last list too only the occupied cells come back."""
    cells = jnp.concatenate([each for group in groups for each in group])
    there = cells[:, 0] > 0
    number = jnp.cumsum(there)
    rooms = [len(group[-1]) for group in groups]
    places, choices, end = [], [], 0
    for group, room, start in zip(groups, rooms, np.cumsum([0, *rooms[:-1]]), strict=True):
        ends = end + np.cumsum([0, *(len(each) for each in group)])
        upto = [number[at - 1] if at else 0 for at in ends]
        counts = [after - before for before, after in itertools.pairwise(upto)]
        chosen = jnp.asarray(len(group) - 1)
        for k in reversed(range(len(group))):  # an argmax would be a kernel
            chosen = jnp.where(counts[k] <= room, k, chosen)
        for k, (begin, stop) in enumerate(itertools.pairwise(ends)):
            place = start + number[begin:stop] - upto[k] - 1
            places.append(jnp.where(there[begin:stop] & (chosen == k), place, sum(rooms)))
        end = ends[-1]
        choices.append((chosen, jnp.stack(counts)[chosen], jnp.asarray(ends)[chosen]))
    moved = jnp.zeros(sum(rooms), jnp.int32)
    moved = moved.at[jnp.concatenate(places)].set(jnp.arange(len(cells), dtype=jnp.int32), mode="drop")
    found = []
    of_groups = jnp.split(moved, np.cumsum(rooms)[:-1])
    for room, (chosen, count, first), which in zip(rooms, choices, of_groups, strict=True):
        filled = jnp.arange(room) < count
        sums = jnp.where(filled[:, None], cells[which], 0)
        found.append(_Occupied(chosen, jnp.where(filled, which - first, 0), sums))
    return found


def _joined(sums: Float[Array, "D C L 4"], size: tuple[int, int, int]) -> Float[Array, "d c l 4"]:
    """Sums over neighbouring cells."""
    D, C, L = (count // by for count, by in zip(sums.shape[:3], size, strict=True))
    return sums.reshape(D, size[0], C, size[1], L, size[2], 4).sum((1, 3, 5))


def _of_cells(
    sums: Float[Array, "N 4"],
    place: tuple[Int[Array, " N"], ...],
    shape: tuple[int, ...],
    grid: _Grid,
    size: tuple[ArrayLike, ...],
) -> Samples:
    """The centroids of some cells of a grid, with their corners; with normals where there are several layers.

    Args:
        sums: of each cell.
        place: depth, slope and layer of its first.
        shape: of the grid.
        size: numbers of depths, slopes and layers of a cell.
    """
    i, j, layer = place
    edges, pitch, offset = jnp.asarray(grid.edges), grid.widest / shape[1], grid.offset
    first, last = edges[i], edges[i + size[0]]
    # A cell's receivers lie between two slopes and two depths: a trapezoid, in this rectangle.
    inner, outer = j * pitch * (first + offset), (j + size[1]) * pitch * (last + offset)
    depth, width = positive(last - first), outer - inner  # cells beyond delta = 1 are empty
    total = sums[:, 0]
    delta, lateral, both = (sums[:, i] / positive(total) for i in (1, 2, 3))
    u, v = (delta - first) / depth, (lateral - inner) / width
    uv = (both - first * lateral - inner * delta + first * inner) / (depth * width)
    u, v, uv = (jnp.where(total > 0, jnp.clip(place, 0, 1), 0.5) for place in (u, v, uv))  # rounding
    delta = jnp.where(total > 0, delta, (first + last) / 2)
    lateral = jnp.where(total > 0, lateral, (inner + outer) / 2)
    normal = None if shape[2] == 1 else _normals(layer + (size[2] - 1) / 2, shape[2], sums.dtype)

    def at(delta: Array) -> LightDepth:
        return LightDepth(delta, 1 - delta)

    spread = Spread((uv - u * v) * depth * width, u * (1 - u) * depth * depth, depth, width)
    corners = Corners(at(first), at(last), inner, outer, u, v, uv, total, normal)
    return Samples(at(delta), lateral, total, normal, spread, corners)


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

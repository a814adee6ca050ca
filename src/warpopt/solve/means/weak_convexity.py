"""The global minimum of a function of eta that curves bound from below, and the bound that proves it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..._parallel import wide
from .sample_norm import Touch

NODES = 16  # even in log(eta): E_p and E_q change by a factor of at most 1.9 between two for min_eta = 1e-4
_TOGETHER = 4  # nodes added in one step
_STEPS = 80
# On devices of many threads: nodes to begin with, of which a tolerance as coarse as this needs half and no more; then
# intervals that are divided, and into how many parts.
_AT_ONCE, _COARSE, _DIVIDED, _PARTS = 128, 5e-6, 8, 32
TOLERANCE = 1e-6


class Minimum(NamedTuple):
    """The best of the nodes, its neighbours (0 and inf at the ends), and lower bounds between nodes.

    Attributes:
        eta, value, slope: of the best node.
        below, above: its neighbours, 0 and inf at the ends.
        starts, ends, bounds: of each interval between nodes, and a lower bound of the function there; inf for none.
    """

    eta: Float[Array, ""]
    value: Float[Array, ""]
    slope: Float[Array, ""]
    below: Float[Array, ""]
    above: Float[Array, ""]
    starts: Float[Array, " I"]
    ends: Float[Array, " I"]
    bounds: Float[Array, " I"]


def least(
    touch: Callable[[Float[Array, ""]], Touch],
    floor: Float[Array, ""],
    ceiling: Float[Array, ""] | float = 1.0,
    *,
    count: int = NODES,
    tolerance: float = TOLERANCE,
) -> Minimum:
    """The least value over [floor, ceiling]: nodes are added where the bound is lowest, until that is near the best.

    Args:
        touch: at eta, a curve value + slope (e - eta) - (bend + pole / e) (e - eta)^2 that the function exceeds for
            every e.
        floor, ceiling: in (0, 1].
        count: number of nodes to begin with, even in log(eta).
        tolerance: best value over bound, minus 1, at most; in single precision its rounding at least. Where the search
            is by a fixed number of rounds it may be more, and the bounds say so.
    """
    dtype = floor.dtype
    tolerance = max(tolerance, 32 * float(jnp.finfo(dtype).eps))
    touches = jax.vmap(touch)
    if wide():
        return _least_by_rounds(touches, floor, jnp.asarray(ceiling, dtype), tolerance)
    begin = -(-count // _TOGETHER)  # the first steps, whose nodes are given
    count = begin * _TOGETHER
    room, high = count + _TOGETHER * _STEPS, jnp.asarray(ceiling, dtype)
    first = even_nodes(floor, high, count)
    nodes = jnp.full(room, jnp.inf, dtype)
    found = Touch(*(jnp.zeros(room, dtype) for _ in Touch._fields))

    def values_of(nodes: Array, found: Touch) -> Array:
        return jnp.where(jnp.isfinite(nodes), found.value, jnp.inf)

    def unproved(state) -> Array:
        nodes, found, lower, _, step = state
        proved = lower.min() >= values_of(nodes, found).min() * (1 - tolerance)
        return (step < begin) | (~proved & (step < begin + _STEPS))

    def refined(state):
        nodes, found, lower, meeting, step = state
        _, worst = jax.lax.top_k(-lower, _TOGETHER)
        given = jax.lax.dynamic_slice(first, (jnp.minimum(step, begin - 1) * _TOGETHER,), (_TOGETHER,))
        new = jnp.where(step < begin, given, jnp.where(jnp.isfinite(lower[worst]), meeting[worst], jnp.inf))
        values = touches(jnp.where(jnp.isfinite(new), new, 1))
        place = _TOGETHER * step + jnp.arange(_TOGETHER)
        nodes = nodes.at[place].set(new)
        found = jax.tree.map(lambda all_of, some: all_of.at[place].set(some), found, values)
        order = jnp.argsort(nodes)
        nodes, found = nodes[order], jax.tree.map(lambda v: v[order], found)
        left, right = (jax.tree.map(lambda v, at=at: v[at], found) for at in (slice(None, -1), slice(1, None)))
        return nodes, found, *_bounds(nodes[:-1], nodes[1:], left, right), step + 1

    none = jnp.full(room - 1, jnp.inf, dtype)  # bounds and where they are attained, of no intervals
    state = nodes, found, none, none, jnp.zeros((), jnp.int32)
    nodes, found, lower, _, _ = jax.lax.while_loop(unproved, refined, state)
    values = values_of(nodes, found)
    i = jnp.argmin(values)
    below = jnp.where(i > 0, nodes[i - 1], 0)
    above = nodes[jnp.minimum(i + 1, room - 1)]
    return Minimum(nodes[i], values[i], found.slope[i], below, above, nodes[:-1], nodes[1:], lower)


def _bounds(start: Array, end: Array, left: Touch, right: Touch) -> tuple[Array, Array]:
    """(each interval's lower bound, where it is attained) from the curves that touch at its ends; inf where it ends
    nowhere, -inf where the curves have no numbers."""
    inside = jnp.isfinite(end)
    width = jnp.where(inside, end - jnp.where(inside, start, 0), 1)
    # 1/e is largest at the start, and a concave parabola lies above its chord.
    nearness = 1 / jnp.where(start > 0, start, 1)
    falling = left.slope - (left.bend + left.pole * nearness) * width
    rising = right.slope + (right.bend + right.pole * nearness) * width
    meeting = (right.value - rising * width - left.value) / jnp.where(falling < rising, falling - rising, -1)
    meeting = jnp.clip(jnp.where(falling < rising, meeting, 0), 0, width)

    def at(t: Array) -> Array:
        return jnp.maximum(left.value + falling * t, right.value + rising * (t - width))

    lower = jnp.minimum(at(meeting), jnp.minimum(at(jnp.zeros_like(width)), at(width)))
    lower = jnp.where(jnp.isnan(lower), -jnp.inf, lower)
    return jnp.where(inside, lower, jnp.inf), start + jnp.clip(meeting, 0.1 * width, 0.9 * width)


class _Intervals(NamedTuple):
    """Intervals between nodes, with the curves that touch at their ends."""

    start: Array
    end: Array
    left: Touch
    right: Touch


def _least_by_rounds(touches: Callable[[Array], Touch], floor: Array, ceiling: Array, tolerance: float) -> Minimum:
    """As `least`: many even nodes at once; then the intervals with the lowest bounds are divided, also at once."""
    nodes = even_nodes(floor, ceiling, _AT_ONCE if tolerance < _COARSE else _AT_ONCE // 2)
    found = touches(nodes)
    left, right = (jax.tree.map(lambda v, at=at: v[at], found) for at in (slice(None, -1), slice(1, None)))
    between = _Intervals(nodes[:-1], nodes[1:], left, right)
    lower = _bounds(*between)[0]
    if tolerance < _COARSE:
        order = jnp.arange(len(lower))
        # Those beside the best node always: the root finder's bracket is two of their parts.
        best = _least_of(found)
        beside = (order == best) | (order == best - 1)
        first = jnp.where(beside, -jnp.inf, jnp.maximum(lower, jnp.finfo(lower.dtype).min))
        before = (first < first[:, None]) | ((first == first[:, None]) & (order < order[:, None]))
        rank = before.sum(1)
        worst = jnp.argmax(rank == jnp.arange(_DIVIDED)[:, None], 1)
        chosen: _Intervals = jax.tree.map(lambda v: v[worst], between)
        share = jnp.asarray(np.arange(1, _PARTS) / _PARTS, floor.dtype)
        inner = chosen.start[:, None] + (chosen.end - chosen.start)[:, None] * share
        within = touches(inner.ravel())

        def parts(first: PyTree, rest: PyTree, last: PyTree, at: slice) -> PyTree:
            def joined(first: Array, rest: Array, last: Array) -> Array:
                row = jnp.concatenate([first[:, None], rest.reshape(_DIVIDED, -1), last[:, None]], 1)
                return row[:, at].ravel()

            return jax.tree.map(joined, first, rest, last)

        ends = (chosen.start, chosen.left), (inner, within), (chosen.end, chosen.right)
        (starts, lefts), (stops, rights) = (parts(*ends, at) for at in (slice(None, -1), slice(1, None)))
        divided = _Intervals(starts, stops, lefts, rights)
        lower = jnp.concatenate([jnp.where(rank < _DIVIDED, jnp.inf, lower), _bounds(*divided)[0]])
        between, nodes, found = (
            jax.tree.map(lambda *v: jnp.concatenate(v), one, other)
            for one, other in ((between, divided), (nodes, inner.ravel()), (found, within))
        )
    i = _least_of(found)
    eta, live = nodes[i], lower < jnp.inf
    start, end = between.start, between.end
    below = jnp.where(live & (end == eta) & (start < eta), start, 0).max()
    above = jnp.where(live & (start == eta) & (end > eta), end, jnp.inf).min()
    return Minimum(eta, found.value[i], found.slope[i], below, above, start, end, lower)


def _least_of(found: Touch) -> Array:
    """The index of the least value that is a number."""
    return jnp.argmin(jnp.where(jnp.isnan(found.value), jnp.inf, found.value))


def longest_interval(dtype: Any) -> float:
    """At most this is log(above / below) of a `Minimum` of the usual tolerance, where the search is by rounds.

    For a floor of some of the dtype's least normal numbers: below, widths are 0.
    """
    ratio = float(jnp.finfo(dtype).tiny) ** (-1 / (_AT_ONCE - 1))
    return 2 * math.log1p((ratio - 1) / _PARTS)  # parts are of equal length: the first has the largest ratio


def even_nodes(floor: Float[Array, ""], ceiling: Float[Array, ""], count: int) -> Float[Array, " count"]:
    """From floor to ceiling, even in the logarithm."""
    nodes = floor * jnp.exp(jnp.linspace(0, 1, count, dtype=floor.dtype) * jnp.log(ceiling / floor))
    return jnp.where(nodes < ceiling, nodes, ceiling).at[-1].set(ceiling)

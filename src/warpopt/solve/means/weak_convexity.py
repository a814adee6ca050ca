"""The global minimum of a function of eta that parabolas bound from below, and the bound that proves it."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .sample_norm import Touch

NODES = 17  # even in log(eta): E_p and E_q change by a factor of at most 1.8 between two for min_eta = 1e-4
_TOGETHER = 4  # nodes added in one step
_STEPS = 80
TOLERANCE = 1e-6


class Minimum(NamedTuple):
    """The best of the nodes, its neighbours (0 and inf at the ends), and lower bounds between nodes.

    Attributes:
        eta, value: of the best node.
        below, above: its neighbours, 0 and inf at the ends.
        starts, ends, bounds: of each interval between nodes, and a lower bound of the function there; inf for none.
    """

    eta: Float[Array, ""]
    value: Float[Array, ""]
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
        touch: at eta, a parabola value + slope (e - eta) - bend (e - eta)^2 that the function exceeds for every e.
        floor, ceiling: in (0, 1].
        count: number of nodes to begin with, even in log(eta).
        tolerance: best value over bound, minus 1, at most; in single precision its rounding at least.
    """
    dtype = floor.dtype
    tolerance = max(tolerance, 32 * float(jnp.finfo(dtype).eps))
    touches = jax.vmap(touch)
    room, high = count + _TOGETHER * _STEPS, jnp.asarray(ceiling, dtype)
    first = floor * jnp.exp(jnp.linspace(0, 1, count, dtype=dtype) * jnp.log(high / floor))
    first = jnp.where(first < high, first, high).at[-1].set(high)
    nodes = jnp.full(room, jnp.inf, dtype).at[:count].set(first)
    found = jax.tree.map(lambda v: jnp.zeros(room, dtype).at[:count].set(v), touches(first))

    def bounds(nodes: Array, found: Touch) -> tuple[Array, Array]:
        """(each interval's lower bound, where it is attained); inf beyond the last node."""
        inside = jnp.isfinite(nodes[1:])
        left, right = (jax.tree.map(lambda v, at=at: v[at], found) for at in (slice(None, -1), slice(1, None)))
        start, width = nodes[:-1], jnp.where(inside, nodes[1:] - jnp.where(inside, nodes[:-1], 0), 1)
        # A concave parabola lies above its chord.
        falling, rising = left.slope - left.bend * width, right.slope + right.bend * width
        meeting = (right.value - rising * width - left.value) / jnp.where(falling < rising, falling - rising, -1)
        meeting = jnp.clip(jnp.where(falling < rising, meeting, 0), 0, width)

        def at(t: Array) -> Array:
            return jnp.maximum(left.value + falling * t, right.value + rising * (t - width))

        lower = jnp.minimum(at(meeting), jnp.minimum(at(jnp.zeros_like(width)), at(width)))
        return jnp.where(inside, lower, jnp.inf), start + jnp.clip(meeting, 0.1 * width, 0.9 * width)

    def best(nodes: Array, found: Touch) -> Array:
        return jnp.where(jnp.isfinite(nodes), found.value, jnp.inf).min()

    def unproved(state) -> Array:
        nodes, found, step = state
        return (bounds(nodes, found)[0].min() < best(nodes, found) * (1 - tolerance)) & (step < _STEPS)

    def refined(state):
        nodes, found, step = state
        lower, meeting = bounds(nodes, found)
        _, worst = jax.lax.top_k(-lower, _TOGETHER)
        new = jnp.where(jnp.isfinite(lower[worst]), meeting[worst], jnp.inf)
        values = touches(jnp.where(jnp.isfinite(new), new, 1))
        place = count + _TOGETHER * step + jnp.arange(_TOGETHER)
        nodes = nodes.at[place].set(new)
        found = jax.tree.map(lambda all_of, some: all_of.at[place].set(some), found, values)
        order = jnp.argsort(nodes)
        return nodes[order], jax.tree.map(lambda v: v[order], found), step + 1

    nodes, found, _ = jax.lax.while_loop(unproved, refined, (nodes, found, jnp.zeros((), jnp.int32)))
    values = jnp.where(jnp.isfinite(nodes), found.value, jnp.inf)
    i = jnp.argmin(values)
    below = jnp.where(i > 0, nodes[i - 1], 0)
    above = nodes[jnp.minimum(i + 1, room - 1)]
    return Minimum(nodes[i], values[i], below, above, nodes[:-1], nodes[1:], bounds(nodes, found)[0])

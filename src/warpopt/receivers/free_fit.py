"""The free fit of a map across the warp: (T62) of docs/theory.md.

The axis of a map may be any line x = m0 + m1 delta, not only one through the eye. The width is then

    w(eta) = max over delta of chord(delta)/A(delta)

with the chord of the receivers' convex hull in (delta, x), at a vertex of the hull. So 1/w is a minimum of lines again,
and everything that holds for a map about the eye's axis holds for it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..theory.light_space import LightDepth
from .footprint import Footprint, FreeFit, Sides


def freed(footprint: Footprint) -> Footprint:
    """The footprint for a map whose axis may lie anywhere.

    The sides are the hull's chords, each a one-sided width at a vertex's depth. The groups themselves keep their
    extents along the light alone.
    """
    sides = footprint.sides
    least, largest = sides.across
    there = largest >= least
    # A group is a rectangle in (delta, x): both its ends count.
    depth = LightDepth(*(jnp.concatenate(pair) for pair in zip(sides.depth, sides.farthest, strict=True)))
    there, least, largest = (jnp.concatenate([v, v]) for v in (there, least, largest))
    delta = jnp.where(there, depth.delta, 0)
    upper = _majorant(delta, jnp.where(there, largest, -jnp.inf), there)
    lower = -_majorant(delta, jnp.where(there, -least, -jnp.inf), there)
    fit = FreeFit(
        LightDepth(delta, jnp.where(there, depth.one_minus_delta, 1)),
        jnp.where(there, upper, -jnp.inf), jnp.where(there, lower, jnp.inf),
    )  # fmt: skip
    chord = jnp.where(there, upper - lower, 0)
    none, nothing, infinite = jnp.zeros_like(sides.right), jnp.zeros_like(chord), jnp.full_like(chord, jnp.inf)
    kept = Sides(sides.depth, sides.farthest, none, none, sides.light_least, sides.light_largest)
    chords = Sides(fit.depth, fit.depth, chord, nothing, infinite, -infinite)
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), kept, chords)
    return eqx.tree_at(lambda f: (f.sides, f.free), footprint, (both, fit), is_leaf=lambda v: v is None)


def _majorant(delta: Float[Array, " K"], x: Float[Array, " K"], there: Bool[Array, " K"]) -> Float[Array, " K"]:
    """The least concave function above points, at each point's delta.

    A point is a vertex iff no slope to a point after it is above a slope from a point before it: a matrix of slopes,
    instead of a loop along the hull, which would be slow under `jax.vmap`. Between vertices it is linear.
    """
    x = jnp.where(there, x, 0)
    run = delta - delta[:, None]  # from row to column
    slope = (x - x[:, None]) / jnp.where(run != 0, run, 1)
    after = jnp.where(there & (run > 0), slope, -jnp.inf).max(1)
    before = jnp.where(there & (run < 0), slope, jnp.inf).min(1)
    index = jnp.arange(len(x))
    beneath = there & (run == 0) & ((x > x[:, None]) | ((x == x[:, None]) & (index < index[:, None])))
    vertex = there & (after <= before) & ~beneath.any(1)
    order = jnp.argsort(jnp.where(there, delta, jnp.inf), stable=True)
    at, height, is_vertex = delta[order], x[order], vertex[order]
    place = jnp.arange(len(x))
    last = jax.lax.cummax(jnp.where(is_vertex, place, -1))
    following = jax.lax.cummin(jnp.where(is_vertex, place, len(x)), reverse=True)
    # Of several points at a vertex's delta, those before it in this order have no vertex behind them.
    left, right = jnp.where(last < 0, following, last), jnp.where(following == len(x), last, following)
    left, right = jnp.clip(left, 0, len(x) - 1), jnp.clip(right, 0, len(x) - 1)
    # Points at the delta of the vertex before or after them lie on it.
    left = jnp.where(at[right] == at, right, left)
    right = jnp.where(at[left] == at, left, right)
    span = at[right] - at[left]
    share = jnp.where(span > 0, (at - at[left]) / jnp.where(span > 0, span, 1), 0)
    value = height[left] + share * (height[right] - height[left])
    return jnp.zeros_like(x).at[order].set(value)

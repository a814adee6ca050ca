"""The chain of splits with the least sum of costs, by a dynamic programme over depths to choose from."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

Cost = Callable[[Array, Array, Array], Array]
"""The cost of cascades from where they are split, where they end, and their numbers."""


def best_chain(
    near: Float[Array, "..."], far: Float[Array, "..."], grid: Float[Array, "... C N"], cost: Cost
) -> tuple[Float[Array, "... C"], Float[Array, "... C"], Float[Array, "... C"]]:
    """(the best chain of C splits, the depths of the grids below them, those above).

    Args:
        near, far: where the first cascade begins and the last one ends.
        grid: the depths that each split may have, increasing.
        cost: of cascades from a to b, given (a, b, k) of one shape (..., M), k the cascade's number; inf for b < a.
            Called once, so that it is compiled once.
    """
    *batch, count, points = grid.shape
    begin, end = (jnp.broadcast_to(v[..., None], (*batch, 1)) for v in (near, far))
    pairs = [_pairs(begin, grid[..., 0, :])]
    pairs += [_pairs(grid[..., k - 1, :], grid[..., k, :]) for k in range(1, count)]
    pairs.append(_pairs(grid[..., -1, :], end))
    a, b = (jnp.concatenate([pair[i] for pair in pairs], -1) for i in (0, 1))
    number = jnp.concatenate([jnp.full(pair[0].shape[-1], k) for k, pair in enumerate(pairs)])
    every = cost(a, b, jnp.broadcast_to(number, a.shape))
    places = [0]
    for pair in pairs:
        places.append(places[-1] + pair[0].shape[-1])
    # best: the least cost of the first cascades that end at each depth
    best, choices = every[..., : places[1]], []
    for k in range(1, count):
        each = every[..., places[k] : places[k + 1]].reshape(*batch, points, points)
        total = best[..., :, None] + each
        choices.append(jnp.argmin(total, -2))
        best = total.min(-2)
    at = [jnp.argmin(best + every[..., places[count] :], -1)]
    for choice in reversed(choices):
        at.append(jnp.take_along_axis(choice, at[-1][..., None], -1)[..., 0])
    at = jnp.stack(at[::-1], -1)[..., None]
    found, below, above = (
        jnp.take_along_axis(grid, jnp.clip(at + step, 0, points - 1), -1)[..., 0] for step in (0, -1, 1)
    )
    return found, below, above


def between(low: Float[Array, "... C"], high: Float[Array, "... C"], points: int) -> Float[Array, "... C N"]:
    """Depths from low to high, even in the logarithm."""
    share = jnp.linspace(0, 1, points, dtype=low.dtype)
    return low[..., None] * jnp.exp(jnp.log(high / low)[..., None] * share)


def _pairs(a: Array, b: Array) -> tuple[Array, Array]:
    shape = (*a.shape, b.shape[-1])
    flat = (*a.shape[:-1], -1)
    return jnp.broadcast_to(a[..., None], shape).reshape(flat), jnp.broadcast_to(b[..., None, :], shape).reshape(flat)

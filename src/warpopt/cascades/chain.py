"""The chain of splits with the least sum of costs, by a dynamic programme over depths to choose from.

First over pairs of depths that are even in the logarithm, or lie between receivers; then again over finer ones about
each split, and the pairs of neighbours' alone.
"""

import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .splits import even_in_the_logarithm

_FINER = 9  # depths about a split: from the one before it to the one after


def refined(
    chain: Callable[[Array, np.ndarray], Array], near: Float[Array, "..."], far: Float[Array, "..."], splits: int,
    count: int, zooms: int,
) -> Float[Array, "... C"]:  # fmt: skip
    """The best chain among so many depths that are even in the logarithm, then among finer ones about each split.

    Args:
        chain: the best one, given depths and the pairs of their numbers where a cascade may begin and end.
        splits: cascades less one.
        zooms: by a factor of four each.
    """
    found = chain(even_in_the_logarithm(near, far, np.linspace(0, 1, count)), pairs_of(count, splits))
    step = jnp.log(far / near) / (count - 1)
    for _ in range(zooms):
        found = chain(_depths_about(found, near, far, step), _pairs_about(splits))
        step = 2 * step / (_FINER - 1)
    return found


def pairs_of(count: int, splits: int) -> Int[np.ndarray, "M 2"]:
    """Numbers of depths where a cascade may begin and end, the second no nearer; with two, each has one end."""
    pairs = np.stack(np.triu_indices(count), 1)
    return pairs if splits > 1 else pairs[(pairs[:, 0] == 0) | (pairs[:, 1] == count - 1)]


def _pairs_about(splits: int) -> Int[np.ndarray, "M 2"]:
    """Numbers among `_depths_about` of those of one split and of the next, and of the ends."""
    groups = [np.zeros(1, int), *np.split(np.arange(1, splits * _FINER + 1), splits), np.full(1, splits * _FINER + 1)]
    return np.concatenate([np.stack(np.meshgrid(*two), -1).reshape(-1, 2) for two in itertools.pairwise(groups)])


@jax.jit
def _depths_about(
    found: Float[Array, "... C"], near: Float[Array, "..."], far: Float[Array, "..."], step: Float[Array, "..."]
) -> Float[Array, "... N"]:
    """`_FINER` depths about each split, within a step in the logarithm, between the ends."""
    ends = near[..., None], far[..., None]
    about = found[..., None] * jnp.exp(step[..., None, None] * np.linspace(-1, 1, _FINER))
    about = jnp.clip(about.reshape(*found.shape[:-1], -1), *ends)
    return jnp.concatenate([ends[0], about, ends[1]], -1).astype(found.dtype)


@jax.jit
def best_chain(
    depths: Float[Array, "... N"], pairs: Int[Array, "M 2"], costs: Float[Array, "... M"], weights: Float[Array, " K"],
) -> Float[Array, "... C"]:  # fmt: skip
    """Where all cascades but the last end, from the first depth to the last: the least sum of costs times weights.

    Args:
        depths: to choose from.
        pairs: where a cascade may begin and end, by number.
        costs: of those; inf or NaN for none, which those of all other pairs are too.
        weights: of each cascade's costs.
    """
    count = depths.shape[-1]
    table = jnp.full((*costs.shape[:-1], count, count), jnp.inf, costs.dtype)
    table = table.at[..., pairs[:, 0], pairs[:, 1]].set(jnp.where(jnp.isnan(costs), jnp.inf, costs))
    # best: the least sum of the first cascades that end at each depth
    best, choices = weights[0] * table[..., 0, :], []
    for k in range(1, len(weights)):
        total = best[..., :, None] + weights[k] * table
        choices.append(jnp.argmin(total, -2))
        best = total.min(-2)
    at = [jnp.full(best.shape[:-1], count - 1)]
    for choice in reversed(choices):
        at.append(jnp.take_along_axis(choice, at[-1][..., None], -1)[..., 0])
    return jnp.take_along_axis(depths, jnp.stack(at[:0:-1], -1), -1)

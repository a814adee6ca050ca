"""The optimal warp for a mean over weighted receivers: found and proved by bounds from below, then settled."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..outcome import Outcome
from ..pieces import Optimum, settled, zero_of_slope
from .sample_norm import SampleNorm
from .weak_convexity import Minimum, least, longest_interval


class SampleOptimum(NamedTuple):
    """The optimum, J and the norm there, the norm of no warp, the lower bound of the norm over [min_eta, 1], and the
    search that proves it."""

    optimum: Optimum
    mean: Float[Array, ""]
    value: Float[Array, ""]
    unwarped: Float[Array, ""]
    lower: Float[Array, ""]
    search: Minimum


def minimise_mean(norm: SampleNorm, min_eta: Float[Array, ""]) -> SampleOptimum:
    """The global minimiser over [min_eta, 1].

    The margin is d log(norm) / d log(eta) just below eta = 1; where it is positive a warp helps, but one may also help
    where it is not, as the norm may have several local minima.
    """
    fixed = jax.lax.stop_gradient(norm)
    dtype = fixed.footprint.mu.dtype
    eps = float(jnp.finfo(dtype).eps)
    floor = min_eta.astype(dtype)
    found = least(fixed.touch, floor)
    nothing = fixed.footprint.flat | fixed.footprint.empty | (found.value <= 0)

    noise = 16 * eps
    last = jnp.asarray(-4 * eps**0.5, dtype)
    start = jnp.log(jnp.where(found.below > 0, found.below, floor))
    end = jnp.where(jnp.isfinite(found.above), jnp.log(jnp.where(jnp.isfinite(found.above), found.above, 1)), last)
    end = jnp.where(end > last, last, end)

    def placed(slopes: Array) -> tuple[Array, Array]:
        """(whether the norm still falls towards the lower end, whether the minimum is inside)."""
        no_warp = (~jnp.isfinite(found.above) & ~(slopes[0] > noise)) | nothing
        unbounded = (found.below == 0) & ~(found.slope < 0) & ~no_warp
        return unbounded, ~no_warp & ~unbounded

    middle = jnp.clip(jnp.log(found.eta), start, end)
    root, _, slopes = zero_of_slope(
        fixed, last[None], lambda found: placed(found)[1], middle, start, end, noise, longest_interval(dtype)
    )
    margin, (unbounded, inside) = slopes[0], placed(slopes)
    u, outcome, residual = settled(norm, root, eps)
    node = jnp.where(unbounded, jnp.log(floor), jnp.log(found.eta))
    # In one map: the norm is compiled once.
    places = jnp.stack([u, node, jnp.zeros_like(u)])
    means = jax.vmap(lambda u: norm.mean(u, jax.lax.stop_gradient(norm.active(u))))(places)
    values = norm.of_mean(means)
    # Between its neighbours the best node may have a local minimum on either side of it: the node, which is within the
    # tolerance of the global minimum, is kept if the one that the root finder came to is the worse.
    positive = jnp.where(found.value > 0, found.value, 1)
    better = values[0] <= fixed.of_mean(positive) * (1 + noise)
    outcome = jnp.where(better, outcome, Outcome.stationary)
    residual = jnp.where(better, residual, jnp.abs(found.slope * found.eta / positive) / norm.order)
    u, mean, value = (
        jnp.where(inside & better, own, jnp.where(inside | unbounded, other, none))
        for own, other, none in (places, means, values)
    )
    outcome = jnp.where(inside, outcome, jnp.where(unbounded, Outcome.unbounded, Outcome.no_warp))
    least_sum = found.bounds.min()
    # Curves without numbers, whose squares of eta underflow, prove nothing, and the search may have missed anything.
    outcome = jnp.where(jnp.isfinite(least_sum) | nothing, outcome, Outcome.inaccurate)
    outcome = jnp.where(fixed.footprint.flat, Outcome.flat, outcome)
    outcome = jnp.where(fixed.footprint.empty, Outcome.empty, outcome).astype(jnp.int32)
    residual, margin = jnp.where(inside, residual, 0), jnp.where(nothing, 0, margin)
    lower = fixed.of_mean(jnp.where(least_sum > 0, least_sum, 0))
    return SampleOptimum(Optimum(u, outcome, residual, margin), mean, value, values[2], lower, found)

"""The tolerance band: the interval of eta around the optimum in which the regret keeps a promise."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ...objective import Objective
from ...solve.frusta import Method, norms_of_eta, solve_frusta
from ...theory.view_frustum import ViewFrustum

_STEPS = 56  # bisections: a bracket of width 16 in log(eta) to the last bit


class ToleranceBand(NamedTuple):
    """The optimum's eta, and the bounds between which value/minimum - 1 stays below the promise.

    `upper` is inf where eta = 1 (no warp) keeps the promise, since a lookup clamps at eta = 1.
    """

    eta: Float[np.ndarray, "..."]
    lower: Float[np.ndarray, "..."]
    upper: Float[np.ndarray, "..."]

    @property
    def bounded(self) -> Bool[np.ndarray, "..."]:
        """Where there is an upper bound."""
        return np.isfinite(self.upper)

    @property
    def widths(self) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
        """Distances from the optimum to the lower and the upper bound; 0 without an upper bound."""
        return self.eta - self.lower, np.where(self.bounded, self.upper - self.eta, 0)

    def depth(self, eta: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Relative depth in the band: 1 at the optimum, 0 on a bound, below 0 outside."""
        below, above = (width + np.finfo(float).tiny for width in self.widths)
        return np.minimum((eta - self.lower) / below, (self.upper - eta) / above)


@functools.partial(jax.jit, static_argnames="objective")
def regret(frustum: ViewFrustum, theta: ArrayLike, eta: ArrayLike, objective: Objective) -> Float[Array, "..."]:
    """value/minimum - 1 of min(1, eta)."""
    theta, eta = jnp.asarray(theta), jnp.where(jnp.asarray(eta) < 1, eta, 1)
    best = solve_frusta(frustum, theta, objective, Method()).value
    return norms_of_eta(frustum, theta, eta, objective) / best - 1


def tolerance_band(frustum: ViewFrustum, theta: ArrayLike, objective: Objective, max_regret: float) -> ToleranceBand:
    """The tolerance bands of frusta and directions, which broadcast.

    The norm is pseudo-convex in eta, so bisection in log(eta) from the optimum outwards finds them.
    """
    return ToleranceBand(*(np.asarray(v) for v in _tolerance_band(frustum, theta, objective, max_regret)))


@functools.partial(jax.jit, static_argnames="objective")
def _tolerance_band(frustum: ViewFrustum, theta: ArrayLike, objective: Objective, max_regret: ArrayLike) -> tuple:
    theta = jnp.asarray(theta)
    solution = solve_frusta(frustum, theta, objective, Method())
    best = jnp.log(solution.warp.eta)

    def keeps(log_eta: Array) -> Array:
        return norms_of_eta(frustum, theta, jnp.exp(log_eta), objective) <= solution.value * (1 + max_regret)

    def edge(outside: Array) -> Array:
        def halve(_, ends):
            good, bad = ends
            middle = (good + bad) / 2
            fine = keeps(middle)
            return jnp.where(fine, middle, good), jnp.where(fine, bad, middle)

        return jax.lax.fori_loop(0, _STEPS, halve, (best, outside))[0]

    open_end = keeps(jnp.zeros_like(best))
    upper = jnp.where(open_end, jnp.inf, jnp.exp(edge(jnp.zeros_like(best))))
    return solution.warp.eta, jnp.exp(edge(best - 16)), upper

"""How far eta may be from the optimum: the tube of log(eta) in which the regret keeps a promise."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from ..solve.optimal_warp import error_norm, optimal_warp
from ..theory.error_norm import Metric
from ..theory.frustum import ViewFrustum
from ..theory.warp import Warp

_STEPS = 52  # bisections: a bracket of width 1 to the last bit


class Objective(NamedTuple):
    """What a table is optimal for."""

    metric: str | Metric
    norm: str | float
    measure: str


class Tube(NamedTuple):
    """log(eta) of the optimum, and between which bounds value/minimum - 1 stays below the promise.

    `upper` is inf where no warp at all (eta = 1) keeps it: a look-up clamps at eta = 1.
    """

    log_eta: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def regret(frustum: ViewFrustum, theta: ArrayLike, log_eta: ArrayLike, objective: Objective) -> np.ndarray:
    """value/minimum - 1 of eta = min(1, exp(log_eta))."""
    eta = jnp.exp(jnp.minimum(jnp.asarray(log_eta, float), 0))
    warp = Warp(eta, 1 - eta, jnp.zeros_like(eta), jnp.ones((), bool))
    best = optimal_warp(frustum, theta, *objective).value
    return np.asarray(error_norm(frustum, theta, warp, *objective) / best - 1)


def tube(frustum: ViewFrustum, theta: ArrayLike, objective: Objective, max_regret: float) -> Tube:
    """The tube of each direction. The norm is pseudo-convex in log(eta): bisection from the optimum outwards finds it.

    Raises:
        ValueError: for bad arguments, as `optimal_warp`.
    """
    solution = optimal_warp(frustum, theta, *objective)
    best, value = jnp.log(solution.warp.eta), solution.value
    lower, _ = _edge(frustum, theta, objective, best, best - 1, value, max_regret)
    upper, open_end = _edge(frustum, theta, objective, best, jnp.zeros_like(best), value, max_regret)
    return Tube(np.asarray(best), np.asarray(lower), np.where(open_end, np.inf, upper))


def _edge(frustum, theta, objective: Objective, inside, outside, value, max_regret: float):
    """(the last log(eta) from `inside` to `outside` that keeps the promise, whether `outside` itself does)."""

    @jax.jit
    def keeps(log_eta):
        eta = jnp.exp(log_eta)
        warp = Warp(eta, 1 - eta, jnp.zeros_like(eta), jnp.ones((), bool))
        return error_norm(frustum, theta, warp, *objective) <= value * (1 + max_regret)

    whole = keeps(outside)

    def halve(_, ends):
        good, bad = ends
        middle = (good + bad) / 2
        fine = keeps(middle)
        return jnp.where(fine, middle, good), jnp.where(fine, bad, middle)

    good, _ = jax.lax.fori_loop(0, _STEPS, halve, (inside, outside))
    return jnp.where(whole, outside, good), whole

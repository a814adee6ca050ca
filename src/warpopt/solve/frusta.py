"""Many view frusta at once: light space, moments, eta and its certificate, in one compiled call."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._numerics import over, power, staged
from ..objective import Objective
from ..receivers.bodies.frustum_moments import moments
from ..receivers.moments import Moments
from ..theory.light_space import LightSpace
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from .chunks import in_chunks
from .closed_form import by_segments, closed_form, in_units_of_error, supremum_norm
from .outcome import Outcome, failed
from .power_mean import minimise_power_mean
from .quadrature import QuadratureMean, default_nodes, has_moments
from .solution import Solution


class Method(NamedTuple):
    """How frusta are solved; static.

    Attributes:
        iterative: whether to use the root finder even where there is a closed form.
        nodes: quadrature nodes over the depth, then used for every L_P norm; None uses moments where possible.
    """

    iterative: bool = False
    nodes: int | None = None


@functools.partial(jax.jit, static_argnames=("objective", "method"))
def solve_frusta(frustum: ViewFrustum, theta: Array, objective: Objective, method: Method) -> Solution:
    """The optimum of every frustum and direction, which broadcast."""
    return in_chunks(solve_chunk, (frustum, theta), objective, method, few_numbers=objective.supremum)


@functools.partial(jax.jit, static_argnames=("objective", "method"))
def norms_over_frusta(
    frustum: ViewFrustum, theta: Array, warp: Warp, objective: Objective, method: Method
) -> tuple[Array, Array]:
    """(the norm for every frustum, direction and warp, which broadcast; whether the apex is not before V: NaN)."""
    return in_chunks(_norm_of_chunk, (frustum, theta, warp), objective, method, few_numbers=objective.supremum)


@functools.partial(jax.jit, static_argnames=("objective",))
def norms_of_eta(frustum: ViewFrustum, theta: Array, eta: Array, objective: Objective) -> Array:
    """The norm for every frustum, direction and eta over V, which broadcast."""
    return in_chunks(_norm_of_eta_chunk, (frustum, theta, eta), objective, few_numbers=objective.supremum)


@functools.partial(jax.jit, static_argnames=("objective",))
def solve_and_compare(
    frustum: ViewFrustum, theta: Array, etas: list[Float[Array, "..."]], objective: Objective
) -> tuple[Solution, list[Float[Array, "..."]]]:
    """The optima, and the norms over V of other warps, given by eta, in one call that shares their common work."""
    return in_chunks(_compare_chunk, (frustum, theta, etas), objective, few_numbers=objective.supremum)


def solve_chunk(frustum: ViewFrustum, theta: Array, objective: Objective, method: Method) -> Solution:
    """One chunk's optima: L-inf in closed form, L_P as the root of a polynomial from moments."""
    space, mean = _few_numbers(frustum, theta, objective, method)
    return _solution(space, mean, objective, method)


def _solution(space: LightSpace, mean: Any, objective: Objective, method: Method) -> Solution:
    if objective.supremum:
        special = method.iterative or objective.measure == "axis"
        optimum = by_segments(space, objective, method.iterative) if special else closed_form(space, objective)
    elif isinstance(mean, QuadratureMean):
        optimum = mean.minimise()
    else:
        optimum = minimise_power_mean(space, mean, objective, method.iterative)
    value = _norm(space, mean, optimum.eta, objective)
    finite = jnp.isfinite(value) & jnp.isfinite(optimum.eta)
    none = (optimum.eta >= 1) & ~failed(optimum.outcome)
    outcome = jnp.where(finite, jnp.where(none, Outcome.no_warp, optimum.outcome), Outcome.not_finite)
    # Numbers below the normal ones have few digits, or are 0: devices flush them.
    least, mu = jnp.finfo(value.dtype).tiny, space.mu
    held = (optimum.eta >= least) & (value >= least) & (mu >= least) & jnp.isfinite(mu)
    outcome = jnp.where(finite & ~held, Outcome.out_of_range, outcome)
    # A failure must not look like "no warp", nor a number of few digits like the optimum.
    good = finite & held
    eta, one_minus_eta, value = (jnp.where(good, v, jnp.nan) for v in (optimum.eta, optimum.one_minus_eta, value))
    warp = Warp(eta, one_minus_eta, space.start, space.mu, jnp.ones((), bool))
    return Solution(warp, value, outcome.astype(jnp.int32), optimum.residual)


def _norm_of_chunk(
    frustum: ViewFrustum, theta: Array, warp: Warp, objective: Objective, method: Method
) -> tuple[Array, Array]:
    space, mean = _few_numbers(frustum, theta, objective, method)
    own = warp.over(space)
    return _norm(space, mean, own.eta, objective), warp.lost_over(own)


def _norm_of_eta_chunk(frustum: ViewFrustum, theta: Array, eta: Array, objective: Objective) -> Array:
    space, mean = _few_numbers(frustum, theta, objective, Method())
    return _norm(space, mean, eta, objective)


def _compare_chunk(frustum: ViewFrustum, theta: Array, etas: list[Array], objective: Objective):
    space, mean = _few_numbers(frustum, theta, objective, Method())
    values = _norm(space, mean, jnp.stack(jnp.broadcast_arrays(*etas)), objective)
    return _solution(space, mean, objective, Method()), list(values)


def _few_numbers(
    frustum: ViewFrustum, theta: Array, objective: Objective, method: Method
) -> tuple[LightSpace, Moments | QuadratureMean | None]:
    """The light space, and the moments or quadrature of an L_P norm."""
    space = staged(LightSpace, frustum, theta)
    if objective.supremum:
        return space, None
    if has_moments(objective) and method.nodes is None:
        return space, staged(lambda space: moments(space, objective), space)
    return space, QuadratureMean(space, objective, method.nodes or default_nodes(objective))


def _norm(space: LightSpace, mean: Any, eta: Array, objective: Objective) -> Array:
    """The norm; `mean` is from `_few_numbers`."""
    if objective.supremum:
        return supremum_norm(space, eta, objective)
    unscaled = over(mean.power_mean(eta, objective), power(eta, objective.metric.alpha))
    return in_units_of_error(space, eta, unscaled, objective)

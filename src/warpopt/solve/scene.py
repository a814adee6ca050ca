"""One scene view: the receivers' footprint, eta and its certificate, in one compiled call."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..objective import MOST_MOMENTS, Metric, Objective
from ..receivers.footprint import Footprint
from ..theory.light_frame import LightFrame
from ..theory.warp import Warp
from ..views import SceneView, one_light
from .footprint_optimum import LogNorm, Term, minimise, value_at
from .outcome import Outcome
from .solution import SceneSolution


def refuse_scene(view: SceneView, objective: Objective) -> None:
    """Refuse a scene that cannot be solved.

    Raises:
        ValueError: several lights, a measure that the receivers do not support, an order without moments.
    """
    one_light(view).receivers.check(view.camera, view.light, objective)
    if not (objective.supremum or objective.blend_degree == round(objective.blend_degree)):
        raise ValueError(
            f"norm: got order {objective.order:g} over receivers, expected one with (2 alpha + beta) order an integer"
        )
    if not objective.supremum and objective.blend_degree > MOST_MOMENTS:
        raise ValueError(
            f"norm: got order {objective.order:g} over receivers, expected (2 alpha + beta) order at most "
            f"{MOST_MOMENTS}, or inf"
        )


@functools.partial(jax.jit, static_argnames=("objective",))
def solve_scene(view: SceneView, objective: Objective, min_eta: Float[Array, ""]) -> SceneSolution:
    """The optimum of one view."""
    frame = view.frame()
    footprint = view.receivers.footprint(view.camera, frame, objective)
    log_norm = _log_norm(footprint, frame, objective)
    # For an L_P norm of E_p the moments come from the individual receivers: grouping loses nothing.
    if not (footprint.grouped and (objective.supremum or objective.has_beta)):
        optimum = minimise(log_norm, min_eta)
        value, unwarped = _with_unwarped(log_norm, optimum.log_eta)
        excess = jnp.zeros_like(value)
    else:
        best_case = eqx.tree_at(lambda n: n.footprint, log_norm, footprint.at_best())
        # Both in one map: the search is compiled once.
        both = jax.tree.map(lambda *v: jnp.stack(v), log_norm, best_case)
        optima = jax.vmap(minimise, (0, None))(both, min_eta)
        optimum = jax.tree.map(lambda v: v[0], optima)
        (value, least), (unwarped, _) = jax.vmap(_with_unwarped)(both, optima.log_eta)
        excess = jnp.where(least > 0, value / jnp.where(least > 0, least, 1) - 1, 0)
        excess = jnp.where(excess > 0, excess, 0)
    value, unwarped, excess = (jnp.where(footprint.empty, 0, v) for v in (value, unwarped, excess))
    finite = jnp.isfinite(value) & jnp.isfinite(optimum.log_eta)
    outcome = jnp.where(finite, optimum.outcome, Outcome.not_finite)
    log_eta = jnp.where(finite, optimum.log_eta, jnp.nan)
    warp = Warp(jnp.exp(log_eta), -jnp.expm1(log_eta), footprint.start, footprint.mu, jnp.ones((), bool))
    return SceneSolution(warp, value, outcome, optimum.residual, optimum.margin, unwarped, excess, frame, footprint)


def _with_unwarped(log_norm: LogNorm, log_eta: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The norm at the optimum, and without a warp."""
    value, unwarped = jax.vmap(lambda u: value_at(log_norm, u))(jnp.stack([log_eta, jnp.zeros_like(log_eta)]))
    return value, unwarped


@functools.partial(jax.jit, static_argnames=("objective",))
def norms_over_scene(
    view: SceneView, warp: Warp, objective: Objective
) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """(the norm of every warp over one view's receivers, whether the apex is not before them: NaN)."""
    frame = view.frame()
    footprint = view.receivers.footprint(view.camera, frame, objective)
    own = warp.over(footprint)
    return norms_at(footprint, frame, objective, own.eta), warp.lost_over(own)


def norms_at(
    footprint: Footprint, frame: LightFrame, objective: Objective, eta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The norm for every eta over a footprint made for the objective; 0 for no receivers."""
    log_norm = _log_norm(footprint, frame, objective)
    values = jax.vmap(lambda u: value_at(log_norm, u))(jnp.log(eta).ravel())
    return jnp.where(footprint.empty, 0, values).reshape(eta.shape)


def _log_norm(footprint: Footprint, frame: LightFrame, objective: Objective) -> LogNorm:
    terms = tuple(_term(footprint, frame, metric, objective.supremum) for metric in objective.terms)
    return LogNorm(footprint, terms, None if objective.supremum else objective)


def _term(footprint: Footprint, frame: LightFrame, metric: Metric, supremum: bool) -> Term:
    """E_p = density_p mu A^2 / (z eta) and E_q = density_q width A / z: the factors independent of eta."""
    factor = metric.alpha * jnp.log(footprint.mu * frame.density_p) + metric.beta * jnp.log(frame.density_q)
    if metric.alpha:  # receivers at one depth have no texels along Z_w
        factor = jnp.where(footprint.flat, -jnp.inf, factor)
    if not supremum:
        factor = factor - metric.depth_power * jnp.log(footprint.unit)
    return Term(factor, metric.alpha, metric.beta)

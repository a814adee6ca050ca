"""The norm over a scene's footprint as a function of log(eta), for any objective."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..objective import Metric, Objective
from ..receivers.footprint import Footprint
from ..theory.light_frame import LightFrame
from .footprint_optimum import LogNorm, Term
from .means.sample_norm import SampleNorm


def log_norm_of(footprint: Footprint, frame: LightFrame, objective: Objective) -> LogNorm | SampleNorm:
    """The norm as a function of log(eta)."""
    if objective.kernel is not None:
        size = footprint.mu / footprint.unit
        along, across = jnp.where(footprint.flat, 0, size) * frame.density_p, size * frame.density_q
        footprint = _with_shares(footprint)
        # In units of the larger error without a warp, whose powers stay in range; the norm does not depend on them.
        reach = across * sum(footprint.half_widths(jnp.ones_like(along)))
        scale = jnp.where(along > reach, along, reach)
        scale = jax.lax.stop_gradient(jnp.where(scale > 0, scale, 1))
        parts = along / scale, across / scale, jnp.log(scale), frame.pixel_ratio
        return SampleNorm(footprint, *parts, objective.kernel, objective.order)
    return product_norm(footprint, frame, objective)


def _with_shares(footprint: Footprint) -> Footprint:
    """Its sides in units of mu: in those of length, widths may leave the dtype's range at a small eta."""
    sides, mu = footprint.sides, footprint.mu
    shares = jax.tree.map(lambda width: width / mu, (sides.right, sides.left, sides.reached))
    return eqx.tree_at(
        lambda f: (f.sides.right, f.sides.left, f.sides.reached), footprint, shares, is_leaf=lambda v: v is None
    )


def product_norm(footprint: Footprint, frame: LightFrame, objective: Objective) -> LogNorm:
    """The same for products of E_p and E_q."""
    terms = tuple(_term(footprint, frame, metric, objective.supremum) for metric in objective.terms)
    return LogNorm(_with_shares(footprint), terms, None if objective.supremum else objective, objective.storage)


def _term(footprint: Footprint, frame: LightFrame, metric: Metric, supremum: bool) -> Term:
    """E_p = density_p mu A^2 / (z eta) and E_q = density_q mu (width / mu) A / z: the factors independent of eta."""
    across, along = (jnp.log(footprint.mu) + jnp.log(density) for density in (frame.density_q, frame.density_p))
    factor = metric.alpha * along + metric.beta * across
    if metric.alpha:  # receivers at one depth have no texels along Z_w
        factor = jnp.where(footprint.flat, -jnp.inf, factor)
    if not supremum:
        factor = factor - metric.depth_power * jnp.log(footprint.unit)
    return Term(factor, metric.alpha, metric.beta)

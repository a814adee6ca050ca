"""The norm over a scene's footprint as a function of log(eta), for any objective."""

import jax.numpy as jnp

from ..objective import Metric, Objective
from ..receivers.footprint import Footprint
from ..theory.light_frame import LightFrame
from .footprint_optimum import LogNorm, Term
from .means.sample_norm import SampleNorm


def log_norm_of(footprint: Footprint, frame: LightFrame, objective: Objective) -> LogNorm | SampleNorm:
    """The norm as a function of log(eta)."""
    if objective.kernel is not None:
        along = jnp.where(footprint.flat, 0, footprint.mu) * frame.density_p / footprint.unit
        across = frame.density_q / footprint.unit * jnp.ones_like(along)
        scale = jnp.where(along > across, along, across)
        parts = along / scale, across / scale, jnp.log(scale), frame.pixel_ratio
        return SampleNorm(footprint, *parts, objective.kernel, objective.order)
    return product_norm(footprint, frame, objective)


def product_norm(footprint: Footprint, frame: LightFrame, objective: Objective) -> LogNorm:
    """The same for products of E_p and E_q."""
    terms = tuple(_term(footprint, frame, metric, objective.supremum) for metric in objective.terms)
    return LogNorm(footprint, terms, None if objective.supremum else objective, objective.storage)


def _term(footprint: Footprint, frame: LightFrame, metric: Metric, supremum: bool) -> Term:
    """E_p = density_p mu A^2 / (z eta) and E_q = density_q width A / z: the factors independent of eta."""
    factor = metric.alpha * jnp.log(footprint.mu * frame.density_p) + metric.beta * jnp.log(frame.density_q)
    if metric.alpha:  # receivers at one depth have no texels along Z_w
        factor = jnp.where(footprint.flat, -jnp.inf, factor)
    if not supremum:
        factor = factor - metric.depth_power * jnp.log(footprint.unit)
    return Term(factor, metric.alpha, metric.beta)

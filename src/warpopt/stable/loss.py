"""The objective of any map of the receivers' pencil, wherever its apex is and however much of it the receivers fill."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._numerics import power
from ..objective import Objective
from ..solve.footprint_optimum import Term
from ..solve.pieces import value_at
from ..solve.scene_norm import product_norm
from ..theory.light_frame import LightFrame
from ..theory.texel import KERNELS, lean, offset_across
from ..views import SceneView
from .pencil import Placed


def error_of(view: SceneView, frame: LightFrame, placed: Placed, objective: Objective) -> Float[Array, ""]:
    """The objective of a map over a view's receivers; 0 for none.

    Args:
        view: its direction, aspect and lateral fit do not count.
        frame: axes of the map, with its texels' shares.
        placed: the map in that frame.
    """
    if objective.kernel is None:
        return _of_products(view, frame, placed, objective)
    points, weights, normals = view.receivers.counted(view.camera, objective)
    there = weights > 0
    z = jnp.where(there, frame.eye_depth(points), 1)
    d, x = (jnp.where(there, v, 0) for v in (frame.depth(points), frame.lateral(points)))
    _, _, blend = placed.texture(d, x)
    e_p = frame.density_p * blend * blend / (placed.along * placed.eta * z)
    e_q = frame.density_q * blend / (placed.across * z)
    sigma = placed.shear(d, x) * frame.pixel_ratio
    size = KERNELS[objective.kernel](e_p, jnp.abs(sigma), e_q)
    if normals is not None:
        normal = frame.across_edges(*normals)
        known = (normal[0] != 0) | (normal[1] != 0)
        size = jnp.where(known, offset_across(lean(e_p, sigma, normal), e_q * normal[1]), size)
    total = jnp.where(there, weights, 0).sum()
    mean = jnp.where(there, weights * power(size, objective.order), 0).sum() / jnp.where(total > 0, total, 1)
    return jnp.where(total > 0, power(jnp.where(total > 0, mean, 1), 1 / objective.order), 0)


def _of_products(view: SceneView, frame: LightFrame, placed: Placed, objective: Objective) -> Array:
    """From the receivers' own map of the same apex: at each of them both errors differ by one factor."""
    footprint = view.footprint_in(frame, objective)
    eta = placed.warp.over(footprint).eta
    fit = footprint.lateral_fit(eta)
    _, _, end = placed.texture(footprint.start + footprint.mu, jnp.zeros_like(footprint.mu))  # A where theirs is 1
    longer = jnp.log(end) * 2 + jnp.log(eta / (placed.along * placed.eta * footprint.mu))
    wider = jnp.log(end / (placed.across * (fit.left + fit.right)))
    norm = product_norm(footprint, frame, objective)
    terms = tuple(
        Term(term.log_factor + term.alpha * longer + term.beta * wider, term.alpha, term.beta) for term in norm.terms
    )
    value = value_at(eqx.tree_at(lambda n: n.terms, norm, terms), jnp.log(eta))
    return jnp.where(footprint.empty, 0, value)

"""What cells lose: bounds of the mean over the individual receivers by that over the cells' centroids.

At a given eta a receiver's size is A kappa(A, x), with kappa convex in both, A linear in delta and x the distance from
W's axis (a receiver's z is part of its weight). Hence a cell's mean of size^P is at least

    A^P kappa^P at the centroid + (d kappa^P/dx) Cov(A^P, x) + (d kappa^P/dA) Cov(A^P, A),

and at most what is interpolated between the corners of a cell, of which there are four to one of the centroids'.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._numerics import larger, power, smaller
from ..._parallel import mapped
from ...receivers.samples import Corners, Samples
from ...theory.light_space import LightDepth
from ...theory.texel import KERNELS, offset_across
from .sample_norm import SampleNorm
from .weak_convexity import NODES, TOLERANCE, Minimum, even_nodes, least

_STEEPEST = 0.25  # an edge's offset changes by at most this times a texel's extent across it: the mean of |u|
_NEAR = 4  # nodes to begin with around the optimum


def corner_mean(norm: SampleNorm, eta: Float[Array, ""]) -> Float[Array, ""]:
    """An upper bound on J for the individual receivers: the size interpolated between the cells' corners.

    It is convex in x at a given delta and in delta at a given x, but where a texel leans beyond its edge: there its
    second derivative in A is at least -2 |d kappa/dA|.
    """
    return sum((_corner_mean(norm, part, eta) for part in norm.parts), start=jnp.zeros_like(eta))


def _corner_mean(norm: SampleNorm, part: Samples, eta: Array) -> Array:
    corners, width = part.corners, norm.width(eta)
    if corners is None:
        errors = norm.errors(part.depth, part.lateral, eta, width)
        return (part.weight * power(norm.size(errors, part.normal), norm.order)).sum()
    u, v, uv = corners.u, corners.v, corners.uv
    depth = LightDepth(*(jnp.stack(ends)[:, None] for ends in zip(corners.near, corners.far, strict=True)))
    lateral = jnp.stack([corners.inner, corners.outer])
    share = jnp.stack([jnp.stack([1 - u - v + uv, v - uv]), jnp.stack([u - uv, uv])])
    size = norm.size(norm.errors(depth, lateral, eta, width), corners.normal)
    if corners.normal is not None:
        deep = (1 - eta) * (corners.far.delta - corners.near.delta)
        sagging = norm.along / eta * corners.normal[0] * deep * deep * (_STEEPEST / 4)
        size = size + jnp.where(_leans(norm, corners, eta), sagging, 0)
    return (corners.weight * jnp.where(share > 0, share, 0) * power(size, norm.order)).sum()


def _leans(norm: SampleNorm, corners: Corners, eta: Array) -> Array:
    """Whether, in some part of a cell and at this eta or a larger one, a texel's column leans beyond its edge."""
    c, s = corners.normal if corners.normal is not None else (1.0, 0.0)
    return c * corners.near.blend(eta) < -s * corners.outer * norm.pixel_ratio * (1 - eta)


def covariance_loss(norm: SampleNorm, low: Float[Array, ""], high: Float[Array, ""]) -> Float[Array, ""]:
    """How far J of the individual receivers may lie below the centroids' for any eta in [low, high]."""
    losses = [_loss(norm, part, low, high) for part in norm.parts if part.spread is not None and norm.kernel != "max"]
    return sum(losses, start=jnp.zeros_like(low))


def _loss(norm: SampleNorm, part: Samples, low: Array, high: Array) -> Array:
    spread, corners, P = part.spread, part.corners, norm.order
    if spread is None or corners is None:
        return jnp.zeros_like(low)
    # Sizes at most over the range: E_p and sigma E_p are convex in eta, A rises and the width falls.
    width = norm.width(low)
    (e_p, sigma, _), (e_p_high, sigma_high, e_q) = (
        norm.errors(part.depth, part.lateral, eta, width) for eta in (low, high)
    )
    shear = larger(e_p * sigma, e_p_high * sigma_high)
    e_p = larger(e_p, e_p_high)
    tilt = shear / jnp.where(e_p > 0, e_p, 1)
    # All that follows falls as eta rises. A^P is its tangent and a rest of at most P (P - 1)/2 A^(P - 2) (a range)^2.
    blend, deep = part.depth.blend(low), (1 - low) * spread.depth
    first = deep + blend if P >= 2 else smaller(blend, larger(blend - deep, low))
    rest = P * (P - 1) / 8 * power(first / blend, P - 2) * (deep / blend) ** 2 * spread.lateral if P != 1 else 0.0
    falling = jnp.where(spread.covariance < 0, -spread.covariance, 0) * ((1 - low) * P / blend)
    if part.normal is None:
        # d kappa/dx is at most kappa/x, and at most that of a texel without a row.
        size = KERNELS[norm.kernel](e_p, tilt, e_q)
        steep = norm.pixel_ratio * (1 - low) / blend
        steep = jnp.where(part.lateral * steep > 1, 1 / jnp.where(part.lateral > 0, part.lateral, 1), steep)
        return (part.weight * power(size, P) * (P * steep) * (falling + rest)).sum()
    c, s = part.normal
    size = offset_across(e_p * (c + tilt * jnp.abs(s)), e_q * s)
    leans = _leans(norm, corners, low)
    factor = norm.along / low * _STEEPEST
    either = jnp.abs(spread.covariance) * ((1 - low) * P / blend)
    one_way = jnp.where(spread.covariance * s < 0, either, 0)
    by_x = factor * norm.pixel_ratio * (1 - low) * jnp.abs(s) * (jnp.where(leans, either, one_way) + rest)
    by_blend = factor * c * P * power(1 + deep / blend, P - 1) * (1 - low) ** 2 * spread.variance / blend
    lost = blend * (by_x + jnp.where(leans, by_blend, 0))
    return (part.weight * P * power(size, P - 1) * lost).sum()


def excess_of_cells(
    norm: SampleNorm, best_case: SampleNorm, search: Minimum, u: Array, mean: Array, min_eta: Array
) -> Float[Array, ""]:
    """Bound on the regret due to cells and grouped sides: the most that the individual receivers' norm may be at u over
    the least that it may be anywhere, minus 1.

    Args:
        norm: what was minimised.
        best_case: the same with the most favourable sides.
        search: of `norm`.
        u: log of the eta that was found.
        mean: J there.
        min_eta: the least eta that counts.
    """
    eta, floor = jnp.exp(u), min_eta.astype(u.dtype)
    most = corner_mean(norm, eta)
    most = larger(most, mean)  # so that the individual receivers' mean is that of the cells within it
    # A width narrower by a factor leaves at least that factor of a size, and within each of the first intervals one
    # loss is enough where the search's bound is high. In the rest, around the optimum, the best case is searched.
    nodes = even_nodes(floor, jnp.ones_like(floor), NODES)
    losses = mapped(lambda ends: covariance_loss(norm, *ends), (nodes[:-1], nodes[1:]))
    # One by one: on a GPU a reduction would be a kernel.
    which = sum(((search.starts >= node).astype(jnp.int32) for node in nodes[1:-1]), start=jnp.asarray(0, jnp.int32))
    rough = search.bounds - losses[which]
    rough = jnp.where(rough > 0, rough, 0) * _narrowing(norm, best_case, floor) ** norm.order
    around = jnp.isfinite(search.bounds) & (rough < search.value)
    low, high = jnp.where(around, search.starts, jnp.inf).min(), jnp.where(around, search.ends, 0).max()
    low, high = (jnp.where(around.any(), v, eta) for v in (low, high))
    near = least(best_case.touch, low, high, count=_NEAR, tolerance=10 * TOLERANCE)
    fewest = jnp.minimum(jnp.where(around, jnp.inf, rough).min(), near.bounds.min() - covariance_loss(norm, low, high))
    fewest = jnp.where(jnp.isfinite(fewest), fewest, search.value)
    ratio = jnp.where(fewest > 0, most / jnp.where(fewest > 0, fewest, 1), jnp.inf)
    ratio = jnp.where(most > 0, ratio, 1)
    return jnp.where(ratio > 1, ratio, 1) ** (1 / norm.order) - 1


def _narrowing(norm: SampleNorm, best_case: SampleNorm, eta: Array) -> Array:
    """The least factor between a side's most favourable width and its own, at this eta and all larger ones."""
    sides, best = norm.footprint.sides, best_case.footprint.sides
    own, other = (jnp.stack([of.right, of.left]) for of in (sides, best))
    shrunk = sides.depth.blend(eta) / best.depth.blend(eta)
    return jnp.where(own > 0, other / jnp.where(own > 0, own, 1) * shrunk, 1).min()

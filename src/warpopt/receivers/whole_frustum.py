"""The whole view frustum as receivers: its extreme points for L-inf, its moments for L_P."""

import functools
import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._numerics import horner, over, power, staged
from ..theory.error_norm import ErrorNorm
from ..theory.light_space import Depth, LightSpace
from .depth_integrals import depth_integrals


def extreme_height(norm: ErrorNorm) -> float:
    """Height fraction u of the edge on which the maximum error lies: the lower plane, or the view axis."""
    return 0.5 if norm.measure == "axis" else 1.0


def extreme_receivers(space: LightSpace, norm: ErrorNorm) -> tuple[Depth, Depth]:
    """The receivers (at z = n, at z = f) of which one attains the maximum error, for every warp.

    The error grows with delta at equal z and is quasi-convex in space, so over V it is a lower corner's; on the axis
    an end's.
    """
    return space.edge(extreme_height(norm))


class Moments(eqx.Module):
    """All that an L_P norm of even a large scene is, for integer M = kP: M + 1 non-negative numbers.

    integral of A^M z^-Q over the measure, over the measure's mass and in units of near
        = amplitude (scale eta')^M ... with eta = scale eta':  amplitude * sum_j coefficients[j] eta'^(M - j)

    The scale balances the two ends (coefficients[0] = coefficients[M] = 1). Moment sequences are log-convex, so the
    others stay below binomials, and neither they nor their powers leave the range of float32.
    """

    coefficients: tuple[Float[Array, "..."], ...]
    scale: Float[Array, "..."]
    root_amplitude: Float[Array, "..."]  # amplitude^(1/P) = (norm of A z^-r over mass / eta'-polynomial)^(1/P)

    def power_mean(self, eta: Float[Array, "..."], norm: ErrorNorm) -> Float[Array, "..."]:
        """(integral of A^M (z/n)^-rP dm / integral of dm)^(1/P)."""
        ratio = eta / self.scale
        # Horner in whichever of eta', 1/eta' is below 1: powers cannot overflow.
        flip = ratio > 1
        at = jnp.where(flip, 1 / jnp.where(flip, ratio, 1), ratio)
        up = horner(self.coefficients, jnp.where(flip, 1, at))
        down = horner(self.coefficients[::-1], jnp.where(flip, at, 1))
        largest = jnp.where(flip, eta, self.scale)
        return (
            self.root_amplitude
            * power(largest, norm.metric.blend_power)
            * power(jnp.where(flip, down, up), 1 / norm.order)
        )


def binomial_moments(sums: list[Array], mass: Array, norm: ErrorNorm) -> Moments:
    """Moments from the sums of (1 - delta)^(M-j) delta^j z^-rP, j = 0..M, and of the measure; ones where it is 0."""
    M = len(sums) - 1
    raw = [math.comb(M, j) * value for j, value in enumerate(sums)]
    largest = jax.lax.stop_gradient(functools.reduce(jnp.maximum, raw))
    there = (largest > 0) & jnp.isfinite(largest) & (mass > 0)
    largest, mass = jnp.where(there, largest, 1), jnp.where(there, mass, 1)
    coefficients = tuple(jnp.where(there, b / largest, 1) for b in raw)
    return Moments(coefficients, jnp.ones_like(mass), (largest / mass) ** (1 / norm.order))


def moments(space: LightSpace, norm: ErrorNorm) -> Moments:
    """The moments of the whole frustum under `norm`, whose M must be an integer.

    Over depth they are the theta-free `depth_integrals`; over the height u, Gauss-Legendre with floor(M/2) + 1 nodes,
    exact for the polynomial. A is linear in depth along each height's segment, so that a moment is the polar form of
    the depth integrals at the segment's end values: repeated contraction, all terms positive.
    """
    M, x = round(norm.blend_degree), space.depth_range
    if norm.measure == "axis":
        heights, weights = np.array([0.5], x.dtype), np.array([1.0], x.dtype)
    else:
        heights, weights = unit_nodes(M // 2 + 1, x.dtype)
    # The heights are a leading axis: one contraction for all.
    batch = (-1,) + (1,) * jnp.ndim(space.edge(1.0)[0].delta + x)
    near, far = space.edge(heights.reshape(batch))
    return segment_moments(near, far, weights.reshape(batch), space.edge(1.0)[0].delta, x, space.log_ratio, norm)


def unit_nodes(count: int, dtype) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return ((1 + nodes) / 2).astype(dtype), (weights / 2).astype(dtype)


def segment_moments(
    near: Depth, far: Depth, weights: Array, nearest: Array, x: Array, L: Array, norm: ErrorNorm
) -> Moments:
    """Moments over segments from the near to the far plane, along each of which delta is linear in z.

    Args:
        near, far: depths at the segments' ends, shape (segments, ...).
        weights: of the segments, summing to 1, of a shape that broadcasts with the ends'.
        nearest: largest delta on the near plane.
        x, L: (f - n)/n and log(f/n).
        norm: the norm, whose M must be an integer.
    """
    M, Q = round(norm.blend_degree), norm.depth_exponent
    # A first scale, free of the data: about where the optimum is, and never below the nearest receivers' delta. It
    # keeps the integrals (which span (n/f)^Q) and the corner values in range.
    e = norm.metric.depth_power / norm.metric.blend_power
    sigma = jax.lax.stop_gradient(jnp.maximum(jnp.exp(-e * L), nearest))
    rise = [min(i + 1, Q) - min(1, Q) for i in range(M + 1)]
    centre = math.floor(max(i - m for i, m in enumerate(rise)) / 2)
    ratio = 1 / ((1 + x) * sigma)
    integrals = [
        value * power(ratio, m) * power(sigma, centre - (i - m))
        for i, (m, value) in enumerate(zip(rise, staged(functools.partial(depth_integrals, M, Q), L), strict=True))
    ]
    polar = _polar_forms(
        integrals, (near.delta / sigma, far.delta), (near.one_minus_delta, far.one_minus_delta * sigma)
    )
    raw = [math.comb(M, j) * (weights * value).sum(0) for j, value in enumerate(polar)]
    return _balanced(raw, sigma, centre, x, L, norm)


def _polar_forms(integrals: list[Array], delta: tuple[Array, Array], complement: tuple[Array, Array]) -> list[Array]:
    """Polar form of the depth integrals at j copies of `delta` and M - j of `complement`, j = 0..M.

    Entry i of a form with m arguments left is the integral against t^i (1-t)^(m-i); contracting one argument (near
    value, far value) is near * form[i] + far * form[i + 1].
    """

    def contract(form: list[Array], ends: tuple[Array, Array]) -> list[Array]:
        return [ends[0] * p + ends[1] * q for p, q in itertools.pairwise(form)]

    forms = [integrals]
    for _ in range(len(integrals) - 1):
        forms = [contract(forms[0], complement)] + [contract(form, delta) for form in forms]
    return [form[0] for form in forms]


def _balanced(raw: list[Array], sigma: Array, centre: int, x: Array, L: Array, norm: ErrorNorm) -> Moments:
    M, Q, P = len(raw) - 1, norm.depth_exponent, norm.order
    first = raw[0]
    # Any scale near the balance serves, so that its own rounding does not matter.
    inverse = jax.lax.stop_gradient(jnp.exp(jnp.log(first / raw[-1]) / M))
    balanced = [over(value, first) for value in raw]
    for j in range(1, M + 1):  # one factor at a time: inverse^M alone may overflow
        balanced[j:] = [value * inverse for value in balanced[j:]]
    # The roots of the factors, not of their product, which may lie below float32's normal numbers.
    factors = first * power(sigma, -centre), power(1 + x, min(1, Q)), measure_mass(norm.volume_exponent, x, L)
    top, bottom, mass = (power(factor, 1 / P) for factor in factors)
    return Moments(tuple(balanced), sigma / inverse, top / bottom / mass)


def measure_mass(exponent: float, x: Array, L: Array) -> Array:
    """integral over t in [0, 1] of (1 + x t)^-q0, the measure's mass in the units of `depth_integrals`."""
    growth = 1 - exponent
    if not growth:
        return L / x
    # expm1 is for thin frusta; for deep ones it would multiply the rounding of L by growth L.
    return jnp.where(x < 1, jnp.expm1(growth * L), power(1 + x, growth) - 1) / (growth * x)

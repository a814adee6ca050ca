"""The view frustum as few numbers: its extreme receivers for L-inf, its moments for L_P."""

import functools
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._numerics import over, power, staged, unit_nodes
from ..._parallel import sums
from ...objective import Objective
from ...theory.light_space import LightDepth, LightSpace
from ..moments import Moments
from .depth_integrals import depth_integrals


def extreme_height(objective: Objective) -> float:
    """Height fraction u of the edge on which the maximum error lies: the lower plane, or the view axis."""
    return 0.5 if objective.measure == "axis" else 1.0


def moments(space: LightSpace, objective: Objective) -> Moments:
    """The moments of the whole frustum under an objective whose M must be an integer.

    Over depth they are the `depth_integrals`, which do not depend on theta; over the height u, Gauss-Legendre with
    floor(M/2) + 1 nodes, exact for the polynomial. A is linear in depth along each height's segment, so that a moment
    is the polar form of the depth integrals at the segment's end values: repeated contraction, all terms positive.
    """
    M, x = round(objective.blend_degree), space.depth_range
    if objective.measure == "axis":
        heights, weights = np.array([0.5], x.dtype), np.array([1.0], x.dtype)
    else:
        heights, weights = unit_nodes(M // 2 + 1, x.dtype)
    # The heights are a leading axis, contracted together.
    batch = (-1,) + (1,) * jnp.ndim(space.edge(1.0)[0].delta + x)
    near, far = space.edge(heights.reshape(batch))
    return segment_moments(near, far, weights.reshape(batch), space.edge(1.0)[0].delta, x, space.log_ratio, objective)


def segment_moments(
    near: LightDepth,
    far: LightDepth,
    weights: Array | np.ndarray,
    nearest: Array,
    x: Array,
    L: Array,
    objective: Objective,
) -> Moments:
    """Moments over segments from the near to the far plane, along each of which delta is linear in z.

    Args:
        near, far: depths at the segments' ends, shape (segments, ...).
        weights: of the segments, summing to 1, of a shape that broadcasts with the ends'.
        nearest: largest delta on the near plane.
        x, L: (f - n)/n and log(f/n).
        objective: an L_P norm, whose M must be an integer.
    """
    M, Q = round(objective.blend_degree), objective.depth_exponent
    # A first scale, independent of the data: near the optimum, and never below the nearest receivers' delta. It keeps
    # the integrals (which span (n/f)^Q) and the corner values in range.
    e = objective.metric.depth_power / objective.metric.blend_power
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
    terms = [value * weights for value in polar]
    # On a GPU kernels of five sums or more would read the polar forms that they share from memory.
    totals = sums(terms) if M > 2 else [values.sum(0) for values in terms]
    raw = [math.comb(M, j) * value for j, value in enumerate(totals)]
    return _balanced(raw, sigma, centre, x, L, objective)


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


def _balanced(raw: list[Array], sigma: Array, centre: int, x: Array, L: Array, objective: Objective) -> Moments:
    M, Q, P = len(raw) - 1, objective.depth_exponent, objective.order
    first = raw[0]
    # Any scale near the balance works, so its rounding does not matter.
    inverse = jax.lax.stop_gradient(jnp.exp(jnp.log(first / raw[-1]) / M))
    balanced = [over(value, first) for value in raw]
    for j in range(1, M + 1):  # one factor at a time: inverse^M may overflow
        balanced[j:] = [value * inverse for value in balanced[j:]]
    # Roots of the factors: their product may underflow in float32.
    factors = first * power(sigma, -centre), power(1 + x, min(1, Q)), measure_mass(objective.volume_exponent, x, L)
    top, bottom, mass = (power(factor, 1 / P) for factor in factors)
    return Moments(tuple(balanced), sigma / inverse, top / bottom / mass)


def measure_mass(exponent: float, x: Array, L: Array) -> Array:
    """integral over t in [0, 1] of (1 + x t)^-q0, the measure's mass in the units of `depth_integrals`."""
    growth = 1 - exponent
    if not growth:
        return L / x
    # expm1 is for thin frusta; for deep ones it would multiply the rounding of L by growth L.
    return jnp.where(x < 1, jnp.expm1(growth * L), power(1 + x, growth) - 1) / (growth * x)

"""The positive root of a polynomial whose coefficients change sign once.

The stationarity condition of every norm here is such a polynomial in eta: positive coefficients at the high powers,
negative ones at the low powers. By Descartes' rule it has one positive root. In u = log(eta), log P+ - log P- (log of
the positive part over the negative part) increases; its slope is at least the gap between the two parts' powers and at
most the span of all powers. So one evaluation brackets the root, and the bracketed Newton method cannot fail.
"""

import dataclasses
import functools
import itertools

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._numerics import horner, larger, over, power

# A polynomial, highest power first: static powers, one array of coefficients each.
Polynomial = tuple[tuple[int, ...], tuple[Float[Array, "..."], ...]]


def value_over_leading(polynomial: Polynomial, at: Float[Array, "..."]) -> tuple[Array, Array]:
    """(value, sum of absolute terms) at a positive point, both over max(1, at)^degree so that neither overflows."""
    powers, coefficients = polynomial
    dense = _dense(powers, coefficients)
    large = at > 1
    small = jnp.where(large, 1 / jnp.where(large, at, 1), at)

    def evaluate(terms):
        return jnp.where(large, horner(terms[::-1], small), horner(terms, small))

    return evaluate(dense), evaluate([jnp.abs(c) for c in dense])


def _dense(powers, coefficients) -> list[Array]:
    by_power = dict(zip(powers, coefficients, strict=True))
    zero = jnp.zeros_like(coefficients[0])
    return [by_power.get(p, zero) for p in range(powers[0], -1, -1)]


def has_root(polynomial: Polynomial) -> Bool[Array, "..."]:
    """Whether both signs occur."""
    _, coefficients = polynomial
    some_positive, some_negative = ([c > 0 for c in coefficients], [c < 0 for c in coefficients])
    return functools.reduce(jnp.logical_or, some_positive) & functools.reduce(jnp.logical_or, some_negative)


def on_lanes(lanes: Bool[Array, "..."] | bool, polynomial: Polynomial) -> Polynomial:
    """The polynomial in the given lanes where it has a root; elsewhere x^top - x^bottom, whose root is 1.

    The iteration starts at 1, so that the other lanes converge at once.
    """
    powers, coefficients = polynomial
    if len(powers) == 1:
        return (1, 0), (jnp.ones_like(coefficients[0]), -jnp.ones_like(coefficients[0]))
    lanes = lanes & has_root(polynomial)
    stand_in = [1.0] + [0.0] * (len(powers) - 2) + [-1.0]
    return powers, tuple(jnp.where(lanes, c, v) for c, v in zip(coefficients, stand_in, strict=True))


def log_ratio(u: Float[Array, "..."], polynomial: Polynomial) -> Float[Array, "..."]:
    """log P+(e^u) - log P-(e^u); both signs must occur."""
    at = jnp.exp(u)
    dense = _dense(*polynomial)
    positive = horner([larger(c, 0) for c in dense], at)
    negative = horner([larger(-c, 0) for c in dense], at)
    return jnp.log(positive / negative)


def positive_root(polynomial: Polynomial, iterative: bool) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """The positive root of a polynomial that has one (see `on_lanes`), and whether it was found.

    Two terms, or three equally spaced ones, are solved in closed form unless `iterative`.
    """
    powers, coefficients = polynomial
    coefficients = tuple(jnp.broadcast_arrays(*coefficients))
    highest, *_, lowest = powers
    gaps = {p - q for p, q in itertools.pairwise(powers)}
    if len(gaps) == 1 and len(powers) <= 3 and not iterative:
        root = power(_linear_or_quadratic(coefficients), 1 / gaps.pop())
        return root, jnp.ones(root.shape, bool)
    from .bracketed_newton import increasing_root  # importing optimistix takes 0.1 s, and L-inf does not need it

    condition = _LogRatio(powers)
    at_one = condition(jnp.zeros_like(coefficients[0]), coefficients)
    # The slope of the log-ratio lies between the smallest possible gap between its two parts and the whole span.
    ends = -at_one / min(gaps), -at_one / (highest - lowest)
    u, converged = increasing_root(condition, coefficients, jnp.minimum(*ends), jnp.maximum(*ends))
    return jnp.exp(u), converged


@dataclasses.dataclass(frozen=True)
class _LogRatio:
    """`log_ratio` as a function of u and the coefficients, hashable through its powers."""

    powers: tuple[int, ...]

    def __call__(self, u: Array, coefficients: tuple[Array, ...]) -> Array:
        return log_ratio(u, (self.powers, coefficients))


def _linear_or_quadratic(coefficients: tuple[Array, ...]) -> Array:
    if len(coefficients) == 2:
        return -coefficients[1] / coefficients[0]
    # The larger root of c2 x^2 + c1 x + c0 with c2 >= 0 >= c0, by the form that does not cancel.
    c2, c1, c0 = coefficients
    root = _root_of_discriminant(c2, jnp.where(c1 < 0, -c1, c1), -c0)
    falling = c1 <= 0
    by_difference = over(root - c1, jnp.where(falling, 2 * c2, 1))
    return jnp.where(falling, by_difference, over(-2 * c0, jnp.where(falling, 1, c1 + root)))


def _root_of_discriminant(a: Array, b: Array, c: Array) -> Array:
    """sqrt(b^2 + 4 a c) for a, b, c >= 0, without underflow of squares, and differentiable."""
    geometric = 2 * jnp.sqrt(a) * jnp.sqrt(c)
    mostly_b = b >= geometric
    some_b = jnp.where(mostly_b & (b > 0), b, 1)
    by_b = b * jnp.sqrt(1 + 4 * over(a, some_b) * over(c, some_b))
    p, q = (jnp.where(mostly_b, 1, v) for v in (a, c))
    other = 2 * jnp.sqrt(p) * jnp.sqrt(q)
    ratio = jnp.where(mostly_b, 0, over(b, other))
    return jnp.where(mostly_b, by_b, other * jnp.sqrt(1 + ratio * ratio))

"""The exact minimiser of the L-inf norm over the view frustum.

The maximum over the receivers is attained at one of two points of the extreme edge: the nearest (z = n) or the farthest
(z = f). There, E_p^alpha E_q^beta is A^k z^-r / (eta^alpha L^beta), with A linear in eta and L = 1/xhat piecewise
linear with two pieces. So eta's range has at most three segments, each with a quadratic, and the optimum is a root, the
tie of the two receivers, or the kink of L.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._numerics import larger, over, power, smaller
from ..objective import Objective
from ..receivers.bodies.frustum_moments import extreme_height
from ..theory.aliasing import inverse_width
from ..theory.light_space import LightDepth, LightSpace
from .outcome import Outcome
from .sign_change import has_root, log_ratio, on_lanes, positive_root


class Optimum(NamedTuple):
    """eta, 1 - eta, the `Outcome`, and the residual of the equation that fixed eta (see `Solution.residual`)."""

    eta: Float[Array, "..."]
    one_minus_eta: Float[Array, "..."]
    outcome: Int[Array, "..."]
    residual: Float[Array, "..."]


class Extremes(NamedTuple):
    """The extreme points of V for L-inf, at z = n and z = f each.

    Attributes:
        near, far: of the receivers: for every warp, one of them attains the maximum error. The error grows with delta
            at equal z and is quasi-convex in space, so over V they are lower corners; on the axis, its ends.
        widest: of the upper far corner, which determines the map's width above the `kink`.
    """

    near: LightDepth
    far: LightDepth
    widest: LightDepth

    @classmethod
    def of(cls, space: LightSpace, objective: Objective) -> "Extremes":
        return cls(*space.edge(extreme_height(objective)), space.edge(0.0)[1])


def supremum_norm(space: LightSpace, eta: Float[Array, "..."], objective: Objective) -> Float[Array, "..."]:
    """max of E_p^alpha E_q^beta over the receivers, for any eta in (0, 1].

    Each receiver's two errors are computed whole: A^2/eta and (n/f)^r alone may leave the dtype's range.
    """
    metric, ends = objective.metric, Extremes.of(space, objective)
    along, across = space.mu_over_far / space.tan_phi, 2.0
    if metric.beta:
        across = 2 / inverse_width(space, eta)

    def attained(depth: LightDepth, nearness: Array | float) -> Array:
        # E_p is of order A/eta, up to n/f's powers, and A f/n of order 1/sqrt(n/f): in this order all are in range.
        blend = depth.blend(eta)
        e_p, e_q = along * (blend * nearness) * (blend / eta), across * (blend * nearness)
        # An error that does not count has no part in the derivative, where A/eta^2 may overflow.
        if not metric.alpha:
            return power(e_q, metric.beta)
        return power(e_p, metric.alpha) * power(e_q, metric.beta) if metric.beta else power(e_p, metric.alpha)

    return larger(attained(ends.near, 1 + space.depth_range), attained(ends.far, 1.0))


def in_units_of_error(space: LightSpace, eta: Array, mean: Array, objective: Objective) -> Array:
    """E_p^alpha E_q^beta from the given (A^2/eta)^alpha A^beta (n/z)^r, without the factors of light and width.

    The small number is multiplied by one factor at a time, so that no product of the large ones overflows.
    """
    metric = objective.metric
    error = mean * power(space.mu_over_near / space.tan_phi, metric.alpha)
    if metric.beta:
        error = error * power(2 * (1 + space.depth_range) / inverse_width(space, eta), metric.beta)
    return error


def kink(space: LightSpace) -> Float[Array, "..."]:
    """eta at lambda = n a (apex at the eye): below it the near corners set the map's width, above it the far ones.

    0 if always the far corners do (theta <= phi).
    """
    return over(space.ratio * space.a_plus, space.b)


def _tie(space: LightSpace, objective: Objective, near: LightDepth) -> tuple[Array, Array]:
    """(eta, 1 - eta) at which the two receivers' errors are equal; eta = 0 where the nearest always has the larger.

    eta = (d_f - d_n - e d_n) / (d_f - d_n + e (1 - d_n)), e = (f/n)^q - 1 and q = r/k, with the common terms removed
    from the numerator: for E_q it is x a, lambda = n a, where the direct difference loses all digits as a goes to 0.
    Both parts are over f and over (f/n)^q, so that no power of f/n is above 1.
    """
    T, share, mu = space.slope, space.share, space.mu_over_far
    q = objective.metric.depth_power / objective.metric.blend_power
    u = extreme_height(objective)
    shrunk, growth = power(space.ratio, q), _growth(space, q)
    top = shrunk * share * space.a_plus + (2 * T * u * _growth(space, 1 - q) * shrunk - share * space.a_minus)
    span = share * (space.sin_theta if u == 0.5 else space.b)  # a + 2 T u
    bottom = shrunk * span + growth * near.one_minus_delta * mu
    return over(larger(top, 0), bottom), jnp.where(top > 0, growth * mu / bottom, 1)


def _growth(space: LightSpace, exponent: float) -> Array:
    """1 - (n/f)^exponent. By the logarithm for thin frusta alone: it would multiply the rounding of a large one."""
    thin = space.depth_range < 1
    by_log = -jnp.expm1(-exponent * jnp.where(thin, space.log_ratio, 1))
    return jnp.where(thin, by_log, 1 - power(space.ratio, exponent))


def closed_form(space: LightSpace, objective: Objective) -> Optimum:
    """The global minimiser of `supremum_norm` over V, the largest where minima are flat. Derived for this project.

    In Y = z_w at the lower near corner over mu: lambda = Y - g. The optimum is never below the kink, and the far corner
    is never stationary, so the optimum is the larger of the tie and the near corner's root.
    """
    # notation: g, h, m over mu; k, r, c0, c1, c2 of the quadratic in Y
    metric = objective.metric
    alpha, beta, k, r = metric.alpha, metric.beta, metric.blend_power, metric.depth_power
    share, ratio, s, T = space.share, space.ratio, space.sin_theta, space.slope
    ends = Extremes.of(space, objective)
    (g, h), widest = ends.near, ends.widest.delta
    m = widest - g
    # h - g with the common terms removed: D s + (D - 2 n) T, or 2 (D s - n T) below theta = phi.
    excess = jnp.where(space.a_plus > 0, share * s + (share - 2 * ratio) * T, 2 * (share * s - ratio * T))
    excess = excess / space.mu_over_far
    c2 = alpha * excess + beta * m
    helps = c2 > 0
    tie, one_minus_tie = _tie(space, objective, ends.near)
    root = one_minus_root = jnp.zeros_like(tie)
    if alpha:
        c2 = jnp.where(helps, c2, 1)
        # c1, c0 and the root of the discriminant over the larger of g and |m|: next to theta = phi both are of order
        # n/f, and their squares would be below the least number.
        unit = jax.lax.stop_gradient(jnp.maximum(g, jnp.abs(m)))
        unit = jnp.where(unit > 0, unit, 1)
        g_, m_, widest_ = g / unit, m / unit, widest / unit
        c1 = r * m_ * excess - 2 * alpha * g_ * h
        squares = m_**2 * (r**2 * excess**2 + 4 * k * beta * g * h)
        squares = squares + 4 * alpha**2 * g_ * h * (widest_ * excess + g_ * g)
        spread = jnp.sqrt(jnp.where(helps, squares, 1))
        falling = c1 <= 0
        below = 2 * k * g * h * m_ / jnp.where(falling | ~helps, 1, c1 + spread)
        Y = jnp.where(falling, unit * (spread - c1) / (2 * c2), below)
        root, one_minus_root = (Y - g) / (Y + h), 1 / (Y + h)
    stationary = root > tie
    eta = jnp.where(helps, jnp.where(stationary, root, tie), 1)
    one_minus_eta = jnp.where(helps, jnp.where(stationary, one_minus_root, one_minus_tie), 0)
    outcome = jnp.where(helps, jnp.where(stationary, Outcome.stationary, Outcome.tie), Outcome.no_warp)
    return _with_residual(space, objective, ends, Optimum(eta, one_minus_eta, outcome, residual=eta))


def by_segments(space: LightSpace, objective: Objective, iterative: bool) -> Optimum:
    """The same minimiser for any two receivers (the axis), segment by segment from eta = 1 down.

    Each segment's quadratic is solved by formula, or by iteration.
    """
    ends = Extremes.of(space, objective)
    tie, one_minus_tie = _tie(space, objective, ends.near)
    bend = kink(space) if objective.metric.beta else jnp.zeros_like(tie)
    top, low = _width_lines(ends.widest, objective)
    upper, lower = larger(tie, bend), smaller(tie, bend)
    tie_first = tie >= bend

    def root(depth: LightDepth, line: LightDepth) -> tuple[Array, Array]:
        return _segment_root(objective, depth, line, iterative)

    first, ok = root(ends.near, top)
    middle, ok_middle = root(_choose(tie_first, ends.far, ends.near), _choose(tie_first, top, low))
    last, ok_last = root(ends.far, low)
    bottom = smaller(last, lower)
    eta = jnp.where(first >= upper, first, jnp.where(middle >= lower, smaller(middle, upper), bottom))
    on_corner = (eta == upper) | (eta == lower)
    outcome = jnp.where(on_corner, jnp.where(eta == tie, Outcome.tie, Outcome.kink), Outcome.stationary)
    outcome = jnp.where(eta >= 1, Outcome.no_warp, outcome)
    outcome = jnp.where(ok & ok_middle & ok_last, outcome, Outcome.not_converged)
    eta = smaller(eta, 1)
    one_minus_eta = jnp.where(eta == tie, one_minus_tie, 1 - eta)
    return _with_residual(space, objective, ends, Optimum(eta, one_minus_eta, outcome, residual=eta))


def _width_lines(widest: LightDepth, objective: Objective) -> tuple[LightDepth, LightDepth]:
    """L = one_minus_delta eta + delta above and below the kink, each up to a factor."""
    one, zero = jnp.ones((), widest.delta.dtype), jnp.zeros((), widest.delta.dtype)
    if not objective.metric.beta:
        return LightDepth(one, zero), LightDepth(one, zero)
    return widest, LightDepth(zero, one)


def _choose(first: Array, one: LightDepth, other: LightDepth) -> LightDepth:
    return LightDepth(*(jnp.where(first, p, q) for p, q in zip(one, other, strict=True)))


def _quadratic(objective: Objective, depth: LightDepth, line: LightDepth):
    """Stationarity of A^k / (eta^alpha L^beta) in eta, for one receiver and L = c eta + d."""
    alpha, r = objective.metric.alpha, objective.metric.depth_power
    (delta, rest), (d, c) = depth, line
    return (2, 1, 0), tuple(jnp.broadcast_arrays(alpha * c * rest, r * (d * rest - c * delta), -alpha * d * delta))


def _segment_root(objective: Objective, depth: LightDepth, line: LightDepth, iterative: bool) -> tuple[Array, Array]:
    """eta at which the receiver's error turns from falling to rising: 0 if it only rises, inf if it never does."""
    polynomial = _quadratic(objective, depth, line)
    root, converged = positive_root(on_lanes(True, polynomial), iterative)
    rises = (polynomial[1][0] > 0) | (polynomial[1][1] > 0)
    return jnp.where(has_root(polynomial), root, jnp.where(rises, 0, jnp.inf)), converged


def _with_residual(space: LightSpace, objective: Objective, ends: Extremes, optimum: Optimum) -> Optimum:
    eta, outcome = optimum.eta, optimum.outcome
    ratio = objective.metric.depth_power / objective.metric.blend_power
    # As a ratio: logarithms would have the rounding of log(f/n).
    gap = ends.far.blend(eta) / ends.near.blend(eta) * power(space.ratio, ratio) - 1
    line = _choose(eta > kink(space), *_width_lines(ends.widest, objective))
    near_slope, far_slope = (
        jnp.abs(log_ratio(jnp.log(eta), on_lanes(True, _quadratic(objective, depth, line))))
        for depth in (ends.near, ends.far)
    )
    # Where the two are equal up to rounding (thin frusta), either may be the stationary one.
    alike = jnp.abs(gap) <= 8 * jnp.finfo(gap.dtype).eps
    slope = jnp.where(alike, smaller(near_slope, far_slope), jnp.where(gap > 0, far_slope, near_slope))
    residual = jnp.where(outcome == Outcome.tie, jnp.abs(gap), jnp.where(outcome == Outcome.stationary, slope, 0))
    return optimum._replace(residual=residual)

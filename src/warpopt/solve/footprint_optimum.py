"""The optimal warp over any receivers, from their footprint.

Up to a constant, the logarithm of the norm in u = log(eta) is

    f(u) = top(u) - alpha u + beta log(width(u))

where top is the largest k log A - r log z among a few receivers (L-inf), or the log of a polynomial's P-th root (L_P);
for "storage" it is a sum of two such maxima (T59). It is pseudo-convex: the sign of its slope changes
once, so the root finder needs only the sign. The condition at the root (a stationary point, a tie of two receivers, a
kink of the width) is then settled in `pieces`.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._numerics import horner, picked
from ..objective import Objective
from ..receivers.footprint import Footprint
from ..receivers.moments import Moments
from ..theory.light_space import LightDepth
from .outcome import Outcome
from .pieces import Optimum, settled, slope_at, zero_of_slope


class Term(eqx.Module):
    """One metric's share in a maximum of metrics: log of its factor, and its exponents."""

    log_factor: Float[Array, ""]
    alpha: float = eqx.field(static=True)
    beta: float = eqx.field(static=True)


class Active(NamedTuple):
    """The active candidates at some eta: which metrics decide, each metric's receiver, and those at both edges."""

    ruling: Bool[Array, " T"]
    receivers: Int[Array, " T"]
    right: Int[Array, ""]
    left: Int[Array, ""]

    def same_top(self, other: "Active") -> Bool[Array, ""]:
        same = (self.ruling == other.ruling) & ((self.receivers == other.receivers) | ~self.ruling)
        return same.all()

    def same_sides(self, other: "Active") -> Bool[Array, ""]:
        return (self.right == other.right) & (self.left == other.left)


class LogNorm(eqx.Module):
    """log of the norm as a function of u = log(eta), for one footprint: the maximum over `terms`, or their sum."""

    footprint: Footprint
    terms: tuple[Term, ...]
    objective: Objective | None = eqx.field(static=True)  # the L_P norm; None for L-inf
    summed: bool = eqx.field(static=True, default=False)  # the norm is the product of the terms' maxima

    def active(self, u: Float[Array, ""]) -> Active:
        """The active candidates at u."""
        eta = jnp.exp(u)
        blend = self.footprint.sides.depth.blend(eta)
        right, left = (jnp.argmax(side / blend) for side in (self.footprint.sides.right, self.footprint.sides.left))
        if self.objective is not None:
            return Active(jnp.ones(1, bool), jnp.zeros(1, int), right, left)
        each = [self._receivers(term, eta) for term in self.terms]
        best = jnp.stack([jnp.argmax(values) for values in each])
        if self.summed or len(self.terms) == 1:
            return Active(jnp.ones(best.shape, bool), best, right, left)
        totals = [
            picked(values, i) + self._scale(term, u, right, left)
            for values, i, term in zip(each, best, self.terms, strict=True)
        ]
        return Active(jnp.arange(len(best)) == jnp.argmax(jnp.stack(totals)), best, right, left)

    def value(self, u: Float[Array, ""], active: Active) -> Float[Array, ""]:
        """The logarithm on the smooth piece selected by `active`."""
        if self.objective is not None:
            (term,) = self.terms
            mean = jnp.log(self._moments.power_mean(jnp.exp(u), self.objective))
            return mean + self._scale(term, u, active.right, active.left)
        nearest = self.footprint.nearest
        pieces = [
            self._receiver(term, picked(nearest.z, i), nearest.depth.at(i), jnp.exp(u))
            + self._scale(term, u, active.right, active.left)
            for term, i in zip(self.terms, active.receivers, strict=True)
        ]
        return jnp.where(active.ruling, jnp.stack(pieces), 0).sum()

    def slope(self, u: Float[Array, ""], active: Active) -> Float[Array, ""]:
        """d value / du on that piece, from weights in [0, 1], so that only the result itself can cancel."""
        eta = jnp.exp(u)
        alpha, beta = (
            jnp.where(active.ruling, jnp.array([getattr(t, n) for t in self.terms], eta.dtype), 0)
            for n in ("alpha", "beta")
        )
        if self.objective is not None:
            top = _polynomial_slope(self._moments, eta) / self.objective.order
        else:
            top = ((2 * alpha + beta) * _eta_share(self.footprint.nearest.depth.at(active.receivers), eta)).sum()
        alpha, beta = alpha.sum(), beta.sum()
        if not any(t.beta for t in self.terms):
            return top - alpha
        sides = self.footprint.sides
        depths = [sides.depth.at(i) for i in (active.right, active.left)]
        chosen = picked(sides.right, active.right), picked(sides.left, active.left)
        spans = [side / depth.blend(eta) for side, depth in zip(chosen, depths, strict=True)]
        shares = (_eta_share(depth, eta) for depth in depths)
        width = spans[0] + spans[1]
        # A body without width has no lateral error: its width does not change.
        falling = sum(span * share for span, share in zip(spans, shares, strict=True))
        return top - alpha - beta * jnp.where(width > 0, falling / jnp.where(width > 0, width, 1), 0)

    def value_and_slope(self, u: Float[Array, ""], active: Active) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Both."""
        return self.value(u, active), self.slope(u, active)

    @property
    def _moments(self) -> Moments:
        if self.footprint.moments is None:
            raise ValueError(
                "receivers: got a footprint without moments, expected some for an L_P norm: "
                "warpopt.receivers.bins.with_moments makes them"
            )
        return self.footprint.moments

    def _receivers(self, term: Term, eta: Array) -> Array:
        return self._receiver(term, self.footprint.nearest.z, self.footprint.nearest.depth, eta)

    def _receiver(self, term: Term, z: Array, depth: LightDepth, eta: Array) -> Array:
        k, r = 2 * term.alpha + term.beta, term.alpha + term.beta
        present = jnp.isfinite(z)
        blend = jnp.where(present, depth.blend(eta), 1)
        return jnp.where(present, k * jnp.log(blend) - r * jnp.log(jnp.where(present, z, 1)), -jnp.inf)

    def _scale(self, term: Term, u: Array, right: Array, left: Array) -> Array:
        total = term.log_factor - term.alpha * u
        if not term.beta:
            return total
        sides, eta = self.footprint.sides, jnp.exp(u)
        spans = [picked(sides.right, right), picked(sides.left, left)]
        width = spans[0] / sides.depth.at(right).blend(eta) + spans[1] / sides.depth.at(left).blend(eta)
        return total + term.beta * jnp.where(width > 0, jnp.log(jnp.where(width > 0, width, 1)), -jnp.inf)


def _eta_share(depth: LightDepth, eta: Array) -> Array:
    """d log A / d log eta: the eta part of A over A."""
    part = depth.one_minus_delta * eta
    return part / (part + depth.delta)


def _polynomial_slope(moments: Moments, eta: Array) -> Array:
    """d log(sum of B_j eta^(M-j)) / d log eta: the mean power, in the variable whose powers cannot overflow."""
    B, M = moments.coefficients, len(moments.coefficients) - 1
    ratio = eta / moments.scale
    flip = ratio > 1
    up, down = jnp.where(flip, 1, ratio), jnp.where(flip, 1 / jnp.where(flip, ratio, 1), 1)
    powers = [M - j for j in range(M + 1)]
    rising = horner([p * b for p, b in zip(powers, B, strict=True)], up) / horner(B, up)
    falling = horner([p * b for p, b in zip(powers, B, strict=True)][::-1], down) / horner(B[::-1], down)
    return jnp.where(flip, falling, rising)


def no_warp(log_norm: LogNorm, min_eta: Float[Array, ""]) -> Optimum:
    """No warp, where it is known to be the minimiser: one slope for the margin, and no search."""
    fixed = jax.lax.stop_gradient(log_norm)
    dtype, footprint = fixed.footprint.mu.dtype, fixed.footprint
    margin = slope_at(fixed, jnp.asarray(-4 * float(jnp.finfo(dtype).eps) ** 0.5, dtype))
    outcome = jnp.where(footprint.flat, Outcome.flat, Outcome.no_warp)
    outcome = jnp.where(footprint.empty, Outcome.empty, outcome).astype(jnp.int32)
    zero = jnp.zeros((), dtype)
    return Optimum(zero, outcome, zero, jnp.where(_same_for_all(fixed), 0, margin))


def _same_for_all(log_norm: LogNorm) -> Bool[Array, ""]:
    """Whether every warp has the same norm.

    Receivers all on W's axis have no lateral error: E_q and E_pxq are zero for every warp.
    """
    sides, nothing = log_norm.footprint.sides, log_norm.footprint.flat | log_norm.footprint.empty
    if log_norm.summed or all(term.beta for term in log_norm.terms):
        nothing = nothing | ~(jnp.maximum(sides.right.max(), sides.left.max()) > 0)
    return nothing


def minimise(log_norm: LogNorm, min_eta: Float[Array, ""]) -> Optimum:
    """The global minimiser, the largest where minima are flat.

    The margin is d log(norm) / d log(eta) just below eta = 1, alpha (1 - 2 dbar) + beta (delta_w - dbar). A warp helps
    iff the margin is positive, which is decided before any iteration.
    """
    fixed = jax.lax.stop_gradient(log_norm)
    dtype = fixed.footprint.mu.dtype
    eps = float(jnp.finfo(dtype).eps)
    unbounded_below = all(term.alpha == 0 for term in fixed.terms)
    # Only E_p grows as eta falls, so that its optimum is limited only by the dtype.
    floor = min_eta.astype(dtype) if unbounded_below else jnp.asarray(eps**2, dtype)
    longest = -math.log(float(jnp.finfo(dtype).tiny) if unbounded_below else eps**2)
    lower, upper = jnp.log(floor), jnp.asarray(-4 * eps**0.5, dtype)

    # Slopes are sums of a few terms of order one: below this bound they are rounding, and the minimum is flat.
    noise = 16 * eps
    nothing = _same_for_all(fixed)

    def helped(slopes: Array) -> tuple[Array, Array]:
        margin, at_floor = slopes
        helps = (margin > noise) & ~nothing
        return helps, helps & (at_floor < 0)

    root, converged, slopes = zero_of_slope(
        fixed, jnp.stack([upper, lower]), lambda slopes: helped(slopes)[1], (lower + upper) / 2, lower, upper, noise,
        longest,
    )  # fmt: skip
    margin, (helps, inside) = slopes[0], helped(slopes)
    u, outcome, residual = settled(log_norm, root, eps)
    outcome = jnp.where(converged, outcome, Outcome.not_converged)
    u = jnp.where(inside, u, jnp.where(helps, lower, 0))
    outcome = jnp.where(inside, outcome, jnp.where(helps, Outcome.unbounded, Outcome.no_warp))
    outcome = jnp.where(fixed.footprint.flat, Outcome.flat, outcome)
    outcome = jnp.where(fixed.footprint.empty, Outcome.empty, outcome).astype(jnp.int32)
    margin = jnp.where(nothing, 0, margin)
    return Optimum(u, outcome, jnp.where(inside, residual, 0), margin)

"""L_P norms of any real order, by quadrature: for M = kP that is not an integer (or too large for moments).

Over the height, the substitution A = A_0 e^(l v) turns A^M du into exponentials, which are entire for any small eta;
over the depth, nodes in log z. All values are kept as logarithms, so that large orders neither overflow nor underflow.
The error is estimated by comparison with a coarser rule; the outcome reports an estimate above the tolerance.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..objective import Objective
from ..receivers.bodies.depth_integrals import log_depth_nodes
from ..theory.light_space import LightDepth, LightSpace
from .closed_form import Optimum, kink
from .outcome import Outcome

_LARGEST_MOMENT_DEGREE = 16


def has_moments(objective: Objective) -> bool:
    """Whether the norm's M is an integer, and small enough that its binomials lose no digits."""
    return objective.blend_degree == round(objective.blend_degree) and objective.blend_degree <= _LARGEST_MOMENT_DEGREE


def default_nodes(objective: Objective) -> int:
    """Enough nodes for rounding accuracy up to f/n = 1e12 at small orders; large orders have peaks of width 1/M."""
    return min(64 + round(objective.blend_degree), 256)


class _Line(NamedTuple):
    """L = c eta + d."""

    c: Float[Array, "..."]
    d: Float[Array, "..."]


class QuadratureMean(eqx.Module):
    """The power mean of A z^(-r/k) over the whole frustum, and its minimisation, by tensor quadrature."""

    space: LightSpace
    objective: Objective = eqx.field(static=True)
    nodes: int = eqx.field(static=True)

    def power_mean(self, eta: Float[Array, "..."], objective: Objective) -> Float[Array, "..."]:
        """(integral of A^M (z/n)^-rP dm / integral of dm)^(1/P)."""
        (log_total,) = _log_integrals(self, eta, objective.blend_degree, lambda delta, rest: (1.0,))
        return jnp.exp((log_total - _log_mass(self)) / objective.order)

    def minimise(self) -> Optimum:
        """The global minimiser: signs at eta = 1 and at the kink first, then one bracketed root."""
        from .bracketed_newton import increasing_root  # see `positive_root`

        objective, space = self.objective, self.space
        zero = jnp.zeros_like(space.mu)
        far = space.edge(0.0)[1]
        low = _Line(1 + zero, zero)
        top = _Line(far.one_minus_delta + zero, far.delta + zero) if objective.metric.beta else _Line(zero, 1 + zero)
        bend = kink(space) + zero if objective.metric.beta else zero
        bent = bend > 0
        log_bend = jnp.log(jnp.where(bent, bend, 1))
        # One batched evaluation gives all three signs.
        at_one, above, below = jax.vmap(lambda u, line: _condition(u, (self, line)))(
            jnp.stack([zero, log_bend, log_bend]), jax.tree.map(lambda *a: jnp.stack(a), top, top, low)
        )
        # A rise within rounding of zero is a flat optimum: eta = 1, the largest, is returned. The logarithms of the
        # two sums are good to a few eps each; 64 covers the exponents' range.
        helps = at_one > 64 * jnp.finfo(zero.dtype).eps
        under = bent & (above > 0)
        at_kink = helps & under & (below <= 0)
        searched = helps & ~at_kink
        line = _choose(under, low, top)
        # On a line through the origin, or a constant one, the slope in log(eta) is at least 1.
        rise = jnp.where(under, below, at_one)
        upper = jnp.where(searched & under, log_bend, 0)
        lower = jnp.where(searched, jnp.where(bent & ~under, log_bend, upper - rise), 0)
        u, converged = increasing_root(_condition, (self, line), lower, upper)
        u = jnp.where(searched, u, 0)
        eta = jnp.where(at_kink, bend, jnp.exp(u))
        outcome = jnp.where(searched, jnp.where(converged, Outcome.stationary, Outcome.not_converged), Outcome.no_warp)
        outcome = jnp.where(at_kink, Outcome.kink, outcome)
        condition = jnp.where(searched, _condition(u, (self, line)), 0)
        # Far above rounding, far below a visible difference: 7e-11 in float64, 3e-5 in float32.
        accurate = self._error_estimate(eta, u, line, condition) < float(jnp.finfo(zero.dtype).eps) ** 0.65
        outcome = jnp.where(accurate, outcome, Outcome.inaccurate)
        return Optimum(eta, jnp.where(at_kink, 1 - eta, -jnp.expm1(u)), outcome, jnp.abs(condition))

    def _error_estimate(self, eta: Array, u: Array, line: _Line, condition: Array) -> Array:
        """Change of the norm (relative) and of the stationarity condition with two thirds of the nodes."""
        coarse = QuadratureMean(self.space, self.objective, 2 * self.nodes // 3)
        norms = self.power_mean(eta, self.objective) / coarse.power_mean(eta, self.objective) - 1
        conditions = jnp.where(condition == 0, 0, condition - _condition(u, (coarse, line)))
        return jnp.maximum(jnp.abs(norms), jnp.abs(conditions))


def _choose(first: Array, one: _Line, other: _Line) -> _Line:
    return _Line(*(jnp.where(first, p, q) for p, q in zip(one, other, strict=True)))


def _condition(u: Array, args: tuple[QuadratureMean, _Line]) -> Array:
    """log P+ - log P- of eta L dJ/d eta: increasing through its only zero.

    P+ = (alpha c eta + r d) eta int A^(M-1) (1 - delta), P- = (r c eta + alpha d) int A^(M-1) delta.
    """
    mean, (c, d) = args
    alpha, r = mean.objective.metric.alpha, mean.objective.metric.depth_power
    eta, power = jnp.exp(u), mean.objective.blend_degree - 1
    rest, delta = _log_integrals(mean, eta, power, lambda delta, rest: (rest, delta))
    plus, minus = alpha * c * eta + r * d, r * c * eta + alpha * d
    possible = plus > 0
    ratio = jnp.log(jnp.where(possible, plus, 1) / jnp.where(possible, minus, 1))
    return jnp.where(possible, u + ratio + rest - delta, -jnp.inf)


def _log_integrals(mean: QuadratureMean, eta: Array, power: float, factors) -> list[Array]:
    """log of the integrals of A^power F (z/n)^-Q du dz/(f - n), one for each F of factors(delta, 1 - delta)."""
    space, objective, nodes = mean.space, mean.objective, mean.nodes
    p, q, weight, log_z = log_depth_nodes(nodes, space.log_ratio, jnp)
    eta = jnp.asarray(eta)[..., None]

    def along(u: float) -> LightDepth:
        near, far = space.edge(u)
        return LightDepth(*(a[..., None] * q + b[..., None] * p for a, b in zip(near, far, strict=True)))

    if objective.measure == "axis":
        depth = along(0.5)
        log_terms = power * jnp.log(depth.blend(eta)) + jnp.log(weight) + (1 - objective.depth_exponent) * log_z
        return _log_sums(log_terms, factors(*depth), 1)
    lower, upper = along(0.0), along(1.0)
    blend = lower.blend(eta)
    # A(u = 1)/A(u = 0) - 1 = (1 - eta) 2 z T / (mu A)
    reach = (2 * space.slope / space.mu_over_far)[..., None] * jnp.exp(log_z - space.log_ratio[..., None])
    span = (1 - eta) * reach / blend
    growth = jnp.maximum(jnp.log1p(span), 1e-20)[..., None]  # expm1(g v)/expm1(g) is v to rounding there
    points, heights = np.polynomial.legendre.leggauss(max(nodes // 2, 8))
    v, w, heights = (nodes.astype(growth.dtype) for nodes in ((1 + points) / 2, (1 - points) / 2, heights))
    u = jnp.expm1(growth * v) / jnp.expm1(growth)
    u_rest = jnp.exp(growth * v) * jnp.expm1(growth * w) / jnp.expm1(growth)
    ends = zip(lower, upper, strict=True)
    delta, rest = (a[..., None] * u_rest + b[..., None] * u for a, b in ends)
    jacobian = jnp.exp(growth * v) * growth / jnp.expm1(growth) * (heights / 2)
    log_terms = power * (jnp.log(blend)[..., None] + growth * v)
    log_terms = log_terms + (jnp.log(weight) + (1 - objective.depth_exponent) * log_z)[..., None]
    return _log_sums(log_terms, [jacobian * f for f in factors(delta, rest)], 2)


def _log_sums(log_terms: Array, factors, count: int) -> list[Array]:
    """Logarithms of sums over the last `count` axes."""
    axes = tuple(range(-count, 0))
    largest = jax.lax.stop_gradient(log_terms.max(axes, keepdims=True))
    terms = jnp.exp(log_terms - largest)
    return [jnp.squeeze(largest, axes) + jnp.log((terms * f).sum(axes)) for f in factors]


def _log_mass(mean: QuadratureMean) -> Array:
    _, _, weight, log_z = log_depth_nodes(mean.nodes, mean.space.log_ratio, jnp)
    return jnp.log((weight * jnp.exp((1 - mean.objective.volume_exponent) * log_z)).sum(-1))

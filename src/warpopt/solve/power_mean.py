"""The minimiser of an L_P norm whose M = kP is an integer, from its moments."""

import jax.numpy as jnp
from jaxtyping import Array

from .._numerics import smaller
from ..objective import Objective
from ..receivers.moments import Moments
from ..theory.light_space import LightSpace
from .closed_form import Optimum, kink
from .outcome import Outcome
from .sign_change import Polynomial, log_ratio, on_lanes, positive_root, value_over_leading


def stationarity(moments: Moments, objective: Objective, line: tuple[Array | float, Array | float]) -> Polynomial:
    """eta' L dJ^P/d eta' up to a positive factor, where L = c eta' + d (`line`): one sign change in its coefficients.

    The coefficient of eta'^(M-j+1) is c B_j (alpha P - j) + d B_(j-1) (r P - j + 1); without E_q, L drops out. Equal
    powers are merged before splitting by sign, which makes the log-ratio monotone.
    """
    alpha, r = objective.metric.alpha * objective.order, objective.metric.depth_power * objective.order
    B, M = moments.coefficients, len(moments.coefficients) - 1
    if not objective.metric.beta:
        terms = [(M - j, [(alpha - j) * B[j]]) for j in range(M + 1) if alpha != j]
        return tuple(p for p, _ in terms), tuple(c[0] for _, c in terms)
    c, d = line
    terms = []
    for j in range(M + 2):
        parts = [c * B[j] * (alpha - j)] if j <= M and alpha != j else []
        parts += [d * B[j - 1] * (r - j + 1)] if j >= 1 and r != j - 1 else []
        if parts:
            terms.append((M - j + 1, sum(parts)))
    return tuple(p for p, _ in terms), tuple(c for _, c in terms)


def minimise_power_mean(space: LightSpace, moments: Moments, objective: Objective, iterative: bool) -> Optimum:
    """The global minimiser of the L_P norm, the largest where minima are flat.

    Signs are evaluated first: at eta = 1 they say whether a warp helps, and at the kink on which side the optimum is,
    or that it is the kink itself (common: for E_q L2 in a third to a half of all scenes).
    """
    far = space.edge(0.0)[1]
    top = stationarity(moments, objective, (far.one_minus_delta * moments.scale, far.delta))
    rise, terms = value_over_leading(top, 1 / moments.scale)
    # A rise within rounding of zero is a flat optimum: eta = 1, the largest, is returned. Each term carries a few
    # roundings of its coefficient and one of the sum.
    helps = rise > 4 * len(top[0]) * jnp.finfo(rise.dtype).eps * terms
    chosen, at_kink, bend = top, jnp.zeros(rise.shape, bool), kink(space)
    if objective.metric.beta:
        low = stationarity(moments, objective, (1.0, 0.0))
        above, _ = value_over_leading(top, bend / moments.scale)
        below, _ = value_over_leading(low, bend / moments.scale)
        under = (bend > 0) & (above > 0)
        at_kink = under & (below <= 0)
        chosen = _merged(under, low, top)
    searched = helps & ~at_kink
    chosen = on_lanes(searched, chosen)
    root, converged = positive_root(chosen, iterative)
    eta = jnp.where(searched, root * moments.scale, 1)
    outcome = jnp.where(searched, jnp.where(converged, Outcome.stationary, Outcome.not_converged), Outcome.no_warp)
    if objective.metric.beta:
        at_kink = helps & at_kink
        eta = jnp.where(at_kink, bend, eta)
        outcome = jnp.where(at_kink, Outcome.kink, outcome)
    eta = smaller(eta, 1)
    residual = jnp.where(searched, jnp.abs(log_ratio(jnp.log(root), chosen)), 0)
    return Optimum(eta, 1 - eta, outcome, residual)


def _merged(first: Array, one: Polynomial, other: Polynomial) -> Polynomial:
    """One polynomial or the other in each lane, over the union of their powers."""
    powers = tuple(sorted({*one[0], *other[0]}, reverse=True))
    tables = [dict(zip(*polynomial, strict=True)) for polynomial in (one, other)]
    return powers, tuple(jnp.where(first, *(table.get(p, 0.0) for table in tables)) for p in powers)

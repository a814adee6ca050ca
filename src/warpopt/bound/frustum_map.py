"""The map that attains the lower bound of E_p over one view frustum, as stretches of depth; in float64."""

import math

import numpy as np

from .._numerics import unit_nodes
from ..objective import Objective
from ..theory.light_space import LightSpace


def frustum_stretches(space: LightSpace, objective: Objective, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(lengths, shares of the map) of the stretches of depth between knots, from delta = 0 on; lengths over near."""
    # notation: as in bound.frustum; q is such that rho = rho_max t^q removes the root
    x, T2, a, a_minus, b = (
        float(v) for v in (space.depth_range, 2 * space.slope, space.a_plus, space.a_minus, space.b)
    )
    L, sup = math.log1p(x), objective.supremum
    order = objective.order * objective.metric.alpha
    t = np.linspace(0, 1, count + 1)
    if objective.measure == "axis":
        z = np.exp(L * t)
        s, T = float(space.sin_theta), T2 / 2
        ends = x * a_minus + T, s * x, T + x * T if a > 0 else T2 * (1 + x) - T - s * x - x * a_minus
        part = 0.0 if sup else 1 / (order + 1)
        inner = np.diff(np.log(z)) if sup else np.diff(z**part)
        parts = [ends[0]], s * np.diff(z), [max(ends[2], 0.0)]
        return np.concatenate(parts), np.concatenate([[0.0], inner, [0.0]])
    cut = T2 > x * a
    longest = L if cut else math.log1p(T2 / a)
    q, Q = (1.0, 0.0) if sup else (order + 1, objective.depth_exponent)
    root = 0.0 if sup else 1 / q

    def weight(rho, shortest):  # W^root, up to a factor, of the segment that starts at log depth `shortest`
        if sup:
            return np.exp(-shortest)
        y = Q * rho
        small = np.abs(y) < 1e-8
        mean = np.where(small, 1 - y / 2, -np.expm1(-y) / np.where(small, 1, y))
        return (rho * np.exp(-Q * shortest) * mean) ** root

    def stretches(slope, log_z, shortest, ends, exponent):  # depths slope e^log_z, parametrised by v = ends t^exponent
        edges = ends * t**exponent
        nodes, weights = unit_nodes(12, np.float64)
        at = t[:-1, None] + np.diff(t)[:, None] * nodes
        v = ends * at**exponent
        speed = ends * exponent * at ** (exponent - 1)  # dv/dt
        density = slope * np.exp(log_z(v)) * weight(*shortest(v)) * speed
        return slope * np.abs(np.diff(np.exp(log_z(edges)))), (density * weights).sum(1) * np.diff(t)

    at_far = stretches(1.0, lambda v: L - v, lambda v: (v, L - v), longest, q)
    if a > 0:
        first = stretches(a, lambda v: v, lambda v: (v, 0 * v), longest, q)
    else:
        first = tuple(a_minus * v for v in at_far)
    last = tuple(b * v[::-1] for v in at_far)
    if cut:
        even = np.full(count, (T2 - x * a) / count)
        middle = even, even * weight(np.full(count, longest), 0.0)
    else:
        ell = math.log1p((x * a - T2) / b)
        middle = stretches(b, lambda v: v, lambda v: (np.full_like(v, longest), v), ell, 1.0)
    lengths, shares = (np.concatenate(parts) for parts in zip(first, middle, last, strict=True))
    return lengths, shares

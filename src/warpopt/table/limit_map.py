"""The best map of the depth itself, as a table: what the limit is attained by."""

import math
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._checks import instance
from ..receivers.whole_frustum import unit_nodes
from ..solve.limit import limit, refuse_unknown
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.frustum import ViewFrustum
from ..theory.light_space import LightSpace, checked_theta
from .files import write_table

FORMAT = "warpopt.LimitMap 1"


class LimitMap(eqx.Module):
    """s(delta): where the best monotone map puts each depth along Z_w; both run from 0 to 1. See `warpopt.limit`.

    Attributes:
        delta, s: (N,) knots, neither decreasing. E_p at a depth is mu / (z tan(phi)) over the slope ds/d delta.
        value: the norm of the exact map, the limit. The straight pieces between the knots of these tables are within a
            few per cent of it in L-inf, and much less in L_P.
        near, far, half_fov, theta: the view frustum and the light, as given.
        order: of the norm of E_p; inf for L-inf.
        measure: of the norm.

    Example:
        >>> import warpopt
        >>> best = warpopt.limit_map(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 1.5707963)
        >>> round(best.value, 3), bool((np.diff(best.s) >= 0).all())   # log(f/n) / tan(phi)
        (7.976, True)
    """

    delta: Float[np.ndarray, " N"]
    s: Float[np.ndarray, " N"]
    value: float = eqx.field(static=True)
    near: float = eqx.field(static=True)
    far: float = eqx.field(static=True)
    half_fov: float = eqx.field(static=True)
    theta: float = eqx.field(static=True)
    order: float = eqx.field(static=True)
    measure: str = eqx.field(static=True)

    def __call__(self, delta: np.ndarray) -> np.ndarray:
        """s at any delta in [0, 1], by straight pieces."""
        return np.interp(delta, self.delta, self.s)

    def save(self, path: str | Path) -> None:
        """Write it as .npz, .csv or .json, by the path's ending: whole or not at all, equal files for equal maps.

        Raises:
            ValueError: another ending.
            OSError: the file cannot be written; an earlier one is then as it was.
        """
        fields = {"format": FORMAT, "norm": "inf" if math.isinf(self.order) else f"{self.order:g}"}
        fields |= {name: getattr(self, name) for name in ("measure", "value", "near", "far", "half_fov", "theta")}
        write_table(path, fields, {"delta": self.delta, "s": self.s})


def limit_map(
    frustum: ViewFrustum, theta: float, norm: str | float = "inf", measure: str = "screen", knots: int = 96
) -> LimitMap:
    """The map that attains `warpopt.limit` of E_p, for one frustum and one light; in float64 whatever JAX's dtype is.

    Args:
        frustum, theta: one of each, theta in radians in [0, pi].
        norm, measure: as in `optimal_warp`.
        knots: at least so many on each of the three parts (rows growing, longest, shrinking).

    Raises:
        ValueError: bad arguments; the axis under a light along the view, which is at one depth.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> best = limit_map(frustum, 1.5707963267948966)   # the logarithm of z
        >>> round(float(best(9 / 99)), 4)   # z = 10
        0.5
    """
    instance("frustum", frustum, ViewFrustum)
    if isinstance(knots, bool) or not isinstance(knots, int) or knots < 2:
        raise ValueError(f"knots: got {knots!r}, expected an integer >= 2")
    error_norm = ErrorNorm.of(Metric(1.0, 0.0), norm, measure)
    refuse_unknown(error_norm)
    value, theta_in = limit(frustum, theta, "p", norm, measure), checked_theta(theta, frustum)
    if value.shape:
        raise ValueError(f"frustum, theta: got shape {value.shape}, expected one of each")
    if not value > 0:
        raise ValueError(f"theta: got {theta} with measure 'axis', expected receivers at more than one depth")
    space = LightSpace(frustum, theta_in)
    length, share = _knots(space, error_norm, knots)
    delta, s = (np.concatenate([[0.0], np.cumsum(v) / v.sum()]) for v in (length, share))
    delta[-1] = s[-1] = 1.0
    frustum_numbers = (float(v) for v in (frustum.near, frustum.far, frustum.half_fov))
    return LimitMap(delta, s, float(value), *frustum_numbers, float(theta_in), error_norm.order, measure)


def _knots(space: LightSpace, norm: ErrorNorm, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(extents in mu delta, shares of the map) of the pieces between knots, from delta = 0 on; lengths over near."""
    # notation: as in solve.limit; q such that rho = rho_max t^q leaves no root
    x, T2, a, a_minus, b = (
        float(v) for v in (space.depth_range, 2 * space.slope, space.a_plus, space.a_minus, space.b)
    )
    L, sup = math.log1p(x), norm.supremum
    order = norm.order * norm.metric.alpha
    t = np.linspace(0, 1, count + 1)
    if norm.measure == "axis":
        z = np.exp(L * t)
        s, T = float(space.sin_theta), T2 / 2
        ends = x * a_minus + T, s * x, T + x * T if a > 0 else T2 * (1 + x) - T - s * x - x * a_minus
        part = 0.0 if sup else 1 / (order + 1)
        inner = np.diff(np.log(z)) if sup else np.diff(z**part)
        pieces = [ends[0]], s * np.diff(z), [max(ends[2], 0.0)]
        return np.concatenate(pieces), np.concatenate([[0.0], inner, [0.0]])
    cut = T2 > x * a
    longest = L if cut else math.log1p(T2 / a)
    q, Q = (1.0, 0.0) if sup else (order + 1, norm.depth_exponent)
    root = 0.0 if sup else 1 / q

    def weight(rho, shortest):  # W^root, up to a factor, of the row from log depth `shortest` on
        if sup:
            return np.exp(-shortest)
        y = Q * rho
        small = np.abs(y) < 1e-8
        mean = np.where(small, 1 - y / 2, -np.expm1(-y) / np.where(small, 1, y))
        return (rho * np.exp(-Q * shortest) * mean) ** root

    def pieces(slope, log_z, shortest, ends, exponent):  # depths slope e^log_z, by a parameter v = ends t^exponent
        edges = ends * t**exponent
        nodes, weights = unit_nodes(12, np.float64)
        at = t[:-1, None] + np.diff(t)[:, None] * nodes
        v = ends * at**exponent
        speed = ends * exponent * at ** (exponent - 1)  # dv/dt
        density = slope * np.exp(log_z(v)) * weight(*shortest(v)) * speed
        return slope * np.abs(np.diff(np.exp(log_z(edges)))), (density * weights).sum(1) * np.diff(t)

    at_far = pieces(1.0, lambda v: L - v, lambda v: (v, L - v), longest, q)
    if a > 0:
        first = pieces(a, lambda v: v, lambda v: (v, 0 * v), longest, q)
    else:
        first = tuple(a_minus * v for v in at_far)
    last = tuple(b * v[::-1] for v in at_far)
    if cut:
        even = np.full(count, (T2 - x * a) / count)
        middle = even, even * weight(np.full(count, longest), 0.0)
    else:
        ell = math.log1p((x * a - T2) / b)
        middle = pieces(b, lambda v: v, lambda v: (np.full_like(v, longest), v), ell, 1.0)
    return tuple(np.concatenate(parts) for parts in zip(first, middle, last, strict=True))

"""Verifies a table's promise on inputs that the builder did not use."""

from typing import NamedTuple

import numpy as np

from ...objective import Objective
from ...theory.view_frustum import ViewFrustum
from ..lookup import Rows, lookup
from .tolerance_band import regret

_POINTS = 20_000  # directions for a single row; eight times as many points for several rows
_STARTS, _LOCAL, _ROUNDS = 16, 64, 14  # of the search around the worst


class Ranges(NamedTuple):
    """What a table covers: smallest and largest value of each axis; equal for an axis that the table does not have."""

    theta: tuple[float, float]
    depth_ratio: tuple[float, float]
    half_fov: tuple[float, float]

    @property
    def single(self) -> bool:
        return self.depth_ratio[0] == self.depth_ratio[1] and self.half_fov[0] == self.half_fov[1]

    def frusta(self, depth_ratio: np.ndarray | None = None, half_fov: np.ndarray | None = None) -> ViewFrustum:
        """Frusta of near = 1; by default the smallest of each axis."""
        ratio = self.depth_ratio[0] if depth_ratio is None else depth_ratio
        return ViewFrustum(1.0, ratio, self.half_fov[0] if half_fov is None else half_fov)

    def rows(self, theta: np.ndarray, eta: np.ndarray) -> Rows:
        """A table of one row."""
        depth_ratio, half_fov = (np.array(axis[:1]) for axis in (self.depth_ratio, self.half_fov))
        return Rows(depth_ratio, half_fov, theta[None, None], eta[None, None])


def verify(
    ranges: Ranges, objective: Objective, rows: Rows, promise: float
) -> tuple[float, tuple[float, float, float], np.ndarray]:
    """(largest regret, its (theta, far/near, half_fov), the worst directions that break the promise).

    Evaluates lookups in both precisions at irregular points, which share no grid with the builder, at every row's
    knots and near them; then around the largest regret, on finer and finer scales.
    """
    low = np.array([ranges.theta[0], np.log(ranges.depth_ratio[0]), ranges.half_fov[0]])
    high = np.array([ranges.theta[1], np.log(ranges.depth_ratio[1]), ranges.half_fov[1]])
    # The axes in float32; a lookup beyond them is clamped.
    low[0], high[0] = max(low[0], rows.theta.flat[0]), min(high[0], rows.theta[0, 0, -1])

    def of(points: np.ndarray) -> np.ndarray:
        # Engines compute in float32, Python in float64.
        rounded = points.astype(np.float32).astype(float)
        return np.maximum(in_precision(np.float64, points), in_precision(np.float32, rounded))

    def in_precision(dtype, points: np.ndarray) -> np.ndarray:
        theta, log_ratio, half_fov = np.clip(points, low, high).T
        depth_ratio = np.exp(log_ratio).astype(np.float32).astype(float)
        angle, ratio, fov = (v.astype(dtype) for v in (theta, depth_ratio, half_fov))
        eta = lookup(angle, ratio, fov, rows, np).astype(float)
        # The integrals of a single frustum are computed once.
        frusta = ranges.frusta() if ranges.single else ranges.frusta(depth_ratio, half_fov)
        return np.asarray(regret(frusta, theta, eta, objective))

    points = _points(low, high, rows)
    found = of(points)
    # The local maxima in order of theta; around the worst of these, finer and finer.
    peaks = np.flatnonzero((found >= np.r_[found[1:], 0]) & (found >= np.r_[0, found[:-1]]))
    peaks = peaks[np.argsort(-found[peaks])]
    at, most = points[peaks[:_STARTS]], found[peaks[:_STARTS]]
    width = (high - low) * len(points) ** (-1 / max(1, (high > low).sum()))
    rng = np.random.default_rng(54321)
    for _ in range(_ROUNDS):
        near = np.clip(at[:, None] + width * rng.uniform(-1, 1, (len(at), _LOCAL, 3)), low, high)
        local = of(near.reshape(-1, 3)).reshape(near.shape[:2])
        best = local.argmax(1)[:, None]
        at = np.where(
            local.max(1, keepdims=True) > most[:, None], np.take_along_axis(near, best[..., None], 1)[:, 0], at
        )
        most = np.maximum(most, local.max(1))
        width = width / 3
    worst, at = float(most.max()), at[most.argmax()]
    broken = points[peaks[:200]][found[peaks[:200]] > promise]
    broken = np.concatenate([broken, at[None]]) if worst > promise else broken
    theta, log_ratio, half_fov = np.clip(at, low, high)
    depth_ratio = np.clip(np.exp(log_ratio), *ranges.depth_ratio)  # exp(log(x)) may differ from x by rounding
    return worst, (float(theta), float(depth_ratio), float(half_fov)), broken


def _points(low: np.ndarray, high: np.ndarray, rows: Rows) -> np.ndarray:
    """(P, 3) theta, log(far/near), half_fov."""
    rng = np.random.default_rng(12345)
    single = (low[1:] == high[1:]).all()
    count = _POINTS if single else 8 * _POINTS
    # Jittered in theta, and golden and silver ratios in the others: irregular, without large gaps.
    order = np.arange(count)
    share = np.stack([(order + rng.random(count)) / count, (order * 0.618033988749895) % 1, (order * 0.41421356) % 1])
    spread = low + (high - low) * share.T
    theta = rows.theta.ravel()
    axes = np.log(rows.depth_ratio)[:, None, None], rows.half_fov[:, None]
    log_ratio, half_fov = (np.broadcast_to(axis, rows.theta.shape).ravel() for axis in axes)
    at_knots = [np.stack([v, log_ratio, half_fov], 1) for v in (np.nextafter(theta, 0), theta, np.nextafter(theta, 4))]
    points = np.concatenate([spread, *at_knots])
    return np.clip(points[np.argsort(points[:, 0])], low, high)

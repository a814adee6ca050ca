"""Sampled tolerance bands of many view frusta, from which a table's knots are chosen."""

import copy
import math
from collections.abc import Iterator

import numpy as np

from ...objective import Objective
from ...solve.optimal_warp import optimal_warp
from ...theory.view_frustum import ViewFrustum
from ...views import FrustumView
from .bisection import bisected
from .breakpoints import breakpoints, with_axes
from .heights import best_heights
from .tolerance_band import ToleranceBand, regret, tolerance_band

# Fractions of the way between breakpoints: even, and denser towards both ends.
_NEAR = np.geomspace(1e-5, 0.25, 12)
_FRACTIONS = np.unique(np.concatenate([np.linspace(0, 1, 49), _NEAR, 1 - _NEAR]))


class Samples:
    """For each of G frusta: the breakpoints, directions between them, and the tolerance band there.

    Attributes:
        breakpoints: (G, K).
        theta, band: (G, S): directions, and the tolerance band there.
        max_slope: bound on |d log(eta) / d theta|, or inf.
    """

    def __init__(
        self,
        frusta: ViewFrustum,
        objective: Objective,
        theta_range: tuple[float, float],
        max_regret: float,
        max_slope: float = math.inf,
    ):
        self.max_slope = max_slope
        found = breakpoints(frusta, objective, *theta_range)
        found = _with_jumps(frusta, objective, found, max_regret)
        spans = np.diff(found, axis=1)
        theta = found[:, :-1, None] + spans[..., None] * _FRACTIONS
        self._band_at = lambda theta: tolerance_band(with_axes(frusta, theta.ndim - 1), theta, objective, max_regret)
        around = self._band_at(theta)
        self.breakpoints = found
        # The cumulative share of a span's knots. Knots at even steps of it have equal error: their density is
        # sqrt(|eta''| / width of the tolerance band). A tenth of the knots is spread evenly.
        below, above = around.widths
        mass = _density_mass(theta, around.eta, np.where(around.bounded, (below + above) / 2, below))
        total = mass.sum(-1, keepdims=True)
        share = np.cumsum(mass, -1) / np.where(total > 0, total, 1)
        share = np.concatenate([np.zeros_like(total), np.where(total > 0, share, _FRACTIONS[1:])], -1)
        self._share = 0.9 * share + 0.1 * _FRACTIONS
        # A piece of length h deviates by at most |eta''| h^2 / 16 on either side.
        self.pieces = np.maximum(1, np.ceil(total[..., 0].max(0) / 4).astype(int))
        self.theta, *bounds = (v.reshape(len(found), -1) for v in (theta, *around))
        self.band = ToleranceBand(*bounds)

    def knots(self, pieces: np.ndarray) -> np.ndarray:
        """(G, N) knots: the breakpoints, and `pieces` pieces between neighbours."""
        columns = []
        for j, count in enumerate(pieces):
            even = np.arange(count) / count
            at = np.stack([np.interp(even, share, _FRACTIONS) for share in self._share[:, j]])
            columns.append(self.breakpoints[:, j, None] + at * np.diff(self.breakpoints)[:, j, None])
        return np.concatenate([*columns, self.breakpoints[:, -1:]], 1)

    def at_knots(self, knots: np.ndarray) -> "Samples":
        """The same samples plus the knots (G, N) and their midpoints as directions.

        Otherwise a knot between two samples would be unconstrained.
        """
        more = np.concatenate([knots, (knots[:, 1:] + knots[:, :-1]) / 2], 1)
        both = copy.copy(self)
        both.theta = np.concatenate([self.theta, more], 1)
        both.band = ToleranceBand(
            *(np.concatenate(pair, 1) for pair in zip(self.band, self._band_at(more), strict=True))
        )
        return both

    def heights(self, knots: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(best heights (G, N), least depth in the tolerance band (G,)) of some frusta's knots; see `best_heights`."""
        bands = {g: ToleranceBand(*(v[g] for v in self.band)) for g in which}
        fits = [best_heights(knots[g], self.theta[g], bands[g], self.max_slope) for g in which]
        return np.stack([heights for heights, _ in fits]), np.array([depth for _, depth in fits])

    def finer(self, wanted: float, most: int) -> Iterator[np.ndarray]:
        """Knots (G, N) with which every polyline has the depth `wanted` in its tolerance band; each step adds one knot.

        Starts from the number that the density predicts; a piece is added where it helps the worst frustum most.

        Raises:
            RuntimeError: more than `most` knots would be needed.
        """
        pieces = self.pieces.copy()
        some = evenly(len(self.theta), 24)

        def depth(pieces: np.ndarray, among: np.ndarray) -> np.ndarray:
            return self.heights(self.knots(pieces), among)[1]

        while pieces.sum() < most:
            depths = depth(pieces, some)
            if depths.min() >= wanted:
                yield self.knots(pieces)
            worst = some[[int(np.argmin(depths))]]
            trials = pieces + np.eye(len(pieces), dtype=int)
            pieces = trials[int(np.argmax([depth(trial, worst)[0] for trial in trials]))]
        raise RuntimeError(f"got {most} knots a row that do not yet keep the promise")


def evenly(count: int, number: int) -> np.ndarray:
    """`number` indices of 0 to count - 1, or all, with both ends."""
    return np.unique(np.linspace(0, count - 1, number).round().astype(int))


def _density_mass(theta: np.ndarray, eta: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Integrals of sqrt(|eta''| / width) from sample to sample."""
    step = np.maximum(np.diff(theta), np.finfo(float).tiny ** 0.25)
    bend = np.abs(np.diff(np.diff(eta) / step)) / ((step[..., 1:] + step[..., :-1]) / 2)
    density = np.sqrt(bend / width[..., 1:-1])
    density = np.concatenate([density[..., :1], density, density[..., -1:]], -1)
    return (density[..., 1:] + density[..., :-1]) / 2 * np.diff(theta)


def _with_jumps(frusta: ViewFrustum, objective: Objective, found: np.ndarray, max_regret: float) -> np.ndarray:
    """Breakpoints, plus one before each jump of eta: where the value after the jump begins to keep the promise."""

    def eta(theta: np.ndarray) -> np.ndarray:
        return np.asarray(optimal_warp(FrustumView(frusta, theta), objective, throw=False).warp.eta)

    more = []
    for j in range(1, found.shape[1] - 1):
        at = found[:, j]
        beyond = eta(at * (1 + 1e-9))
        if (np.abs(np.log(eta(at * (1 - 1e-9)) / beyond)) < 1e-3).all():
            continue

        def keeps(theta: np.ndarray, eta: np.ndarray = beyond) -> np.ndarray:
            return np.asarray(regret(frusta, theta, eta, objective)) <= max_regret / 2

        more.append(bisected(keeps, at, found[:, j - 1])[0])
    return np.sort(np.stack([*found.T, *more], 1), 1)

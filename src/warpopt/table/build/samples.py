"""The tube of many view frusta at matching directions: what a table's knots are chosen from."""

import copy
import math
from collections.abc import Iterator

import numpy as np

from ...solve.optimal_warp import optimal_warp
from ...theory.view_frustum import ViewFrustum
from ...views import FrustumView
from .bisection import bisected
from .heights import best_heights
from .landmarks import landmarks, with_axes
from ...objective import Objective
from .tube import Tube, regret, tube

# Fractions of the way between landmarks: even, and closer and closer to either.
_NEAR = np.geomspace(1e-5, 0.25, 12)
_FRACTIONS = np.unique(np.concatenate([np.linspace(0, 1, 49), _NEAR, 1 - _NEAR]))


class Samples:
    """Of each of G frusta: the landmarks, directions between them, and the tube there.

    Attributes:
        landmarks: (G, K).
        theta, tube: (G, S): directions, and the tube there.
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
        found = landmarks(frusta, objective, *theta_range)
        found = _with_jumps(frusta, objective, found, max_regret)
        spans = np.diff(found, axis=1)
        theta = found[:, :-1, None] + spans[..., None] * _FRACTIONS
        self._tube_at = lambda theta: tube(with_axes(frusta, theta.ndim - 1), theta, objective, max_regret)
        around = self._tube_at(theta)
        self.landmarks = found
        # The share of a span's knots on the way: knots at even steps of it err alike, sqrt(|eta''| / width of the tube)
        # being their density; a tenth of them go evenly.
        below, above = around.room
        mass = _density_mass(theta, around.eta, np.where(around.bounded, (below + above) / 2, below))
        total = mass.sum(-1, keepdims=True)
        share = np.cumsum(mass, -1) / np.where(total > 0, total, 1)
        share = np.concatenate([np.zeros_like(total), np.where(total > 0, share, _FRACTIONS[1:])], -1)
        self._share = 0.9 * share + 0.1 * _FRACTIONS
        # A piece of length h leaves |eta''| h^2 / 16 of it to either side.
        self.pieces = np.maximum(1, np.ceil(total[..., 0].max(0) / 4).astype(int))
        self.theta, *bounds = (v.reshape(len(found), -1) for v in (theta, *around))
        self.tube = Tube(*bounds)

    def knots(self, pieces: np.ndarray) -> np.ndarray:
        """(G, N) knots: the landmarks, and so many pieces between each two."""
        columns = []
        for j, count in enumerate(pieces):
            even = np.arange(count) / count
            at = np.stack([np.interp(even, share, _FRACTIONS) for share in self._share[:, j]])
            columns.append(self.landmarks[:, j, None] + at * np.diff(self.landmarks)[:, j, None])
        return np.concatenate([*columns, self.landmarks[:, -1:]], 1)

    def at_knots(self, knots: np.ndarray) -> "Samples":
        """The same with the knots (G, N) and the middles between them as further directions.

        Without them a knot between two samples would be free to stand anywhere.
        """
        more = np.concatenate([knots, (knots[:, 1:] + knots[:, :-1]) / 2], 1)
        both = copy.copy(self)
        both.theta = np.concatenate([self.theta, more], 1)
        both.tube = Tube(*(np.concatenate(pair, 1) for pair in zip(self.tube, self._tube_at(more), strict=True)))
        return both

    def heights(self, knots: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(best heights (G, N), how deep inside the tube (G,)) of some of the frusta's knots; see `best_heights`."""
        tubes = {g: Tube(*(v[g] for v in self.tube)) for g in which}
        fits = [best_heights(knots[g], self.theta[g], tubes[g], self.max_slope) for g in which]
        return np.stack([heights for heights, _ in fits]), np.array([depth for _, depth in fits])

    def finer(self, wanted: float, most: int) -> Iterator[np.ndarray]:
        """Knots (G, N) with which every frustum's polyline is `wanted` deep in its tube: few first, then one more each.

        From what the density asks for, one piece more at a time, where it helps the worst frustum most.

        Raises:
            RuntimeError: when there are no more than `most` left.
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
    """So many of 0 to count - 1, or all, both ends among them."""
    return np.unique(np.linspace(0, count - 1, number).round().astype(int))


def _density_mass(theta: np.ndarray, eta: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Integrals of sqrt(|eta''| / width) from sample to sample."""
    step = np.maximum(np.diff(theta), np.finfo(float).tiny ** 0.25)
    bend = np.abs(np.diff(np.diff(eta) / step)) / ((step[..., 1:] + step[..., :-1]) / 2)
    density = np.sqrt(bend / width[..., 1:-1])
    density = np.concatenate([density[..., :1], density, density[..., -1:]], -1)
    return (density[..., 1:] + density[..., :-1]) / 2 * np.diff(theta)


def _with_jumps(frusta: ViewFrustum, objective: Objective, found: np.ndarray, max_regret: float) -> np.ndarray:
    """Landmarks with one more before each at which eta jumps: where its value beyond begins to keep the promise."""

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

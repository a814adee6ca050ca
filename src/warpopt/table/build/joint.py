"""The fewest rows of a table over one axis: their places, and their heights for all that lies between."""

import math

import numpy as np
import scipy.optimize
import scipy.sparse

from .heights import inside, slope_limits
from ..lookup import Rows, between_fovs, between_ratios, lookup, on_piece
from .samples import Samples, evenly
from .tube import Tube

_STEP = 0.5  # largest relative change of a height in a linear program
_PROGRAMS = 12
_ENOUGH = 0.9  # deep in the tube: no interval gains by more
_FIRST = 20  # of so many samples one is in the first program
_SHORT = 0.02  # of the depth
_MOST_ROWS = 64
_MORE, _FEWER = 12, 4  # moves of rows that may fail: at first, and with fewer than are known to keep to the tube


def fewest_rows(fit: "Fit", knots: np.ndarray, heights: np.ndarray, larger: Rows | None = None) -> Rows | None:
    """A table with as few rows as keep to the tube, at most 64, and smaller than a given one; None where none is found.

    What an interval between rows lacks (1 - depth) goes with the square of its length, so that its root is a density
    of rows: by it rows are moved until all intervals are alike, and their number is foretold.

    Args:
        fit: of heights, at some of G candidate rows.
        knots, heights: (G, N) of the candidates; rows have their knots, and begin with their heights.
        larger: a table that keeps to the tube, whose places to begin with.
    """
    place, kept, slack = fit.place, None, 0.1
    if larger is None:
        which, left = evenly(len(place), max(3, len(place) // 8)), _MORE
    else:
        most = (larger.size - 1) // (1 + 2 * knots.shape[1])
        if most < 2:
            return None
        which, left = np.searchsorted(place, getattr(larger, fit.axis)), _FEWER
        which = _moved(np.log(place), which, np.ones(len(which) - 1), most)
    while left:
        rows, depths = fit(place[which], knots[which], heights[which])
        lack = np.sqrt(1 - depths)
        needed = 1 + math.ceil(lack.sum() / math.sqrt(1 - slack))
        if depths.min() >= 0:
            kept, left = rows, _FEWER
            count = min(len(which) - 1, needed)
        else:
            left -= 1
            count = len(which) if kept or larger else max(len(which), needed)
            slack += 0.01
        if not 2 <= count <= _MOST_ROWS:
            break
        moved = _moved(np.log(place), which, lack, count)
        if np.array_equal(moved, which):
            break
        which = moved
    return kept


def _moved(place: np.ndarray, which: np.ndarray, lack: np.ndarray, count: int) -> np.ndarray:
    """So many rows, among which each interval would lack alike."""
    reached = np.concatenate([[0.0], np.cumsum(lack)])
    at = np.interp(np.linspace(0, reached[-1], count), reached, place[which])
    return np.unique(np.abs(place[:, None] - at).argmin(0))


class Fit:
    """Heights of rows at given places, such that each interval between rows is deep in the tube.

    A look-up between rows is not quite linear in the heights: a few linear programs, each about the last one's heights.
    The sum over intervals of the depth (`Tube.depth`, up to 0.9) of its shallowest sample is largest.

    Args:
        samples: of candidate rows.
        axis: "depth_ratio" or "half_fov": what varies from row to row.
        place: (G,) the candidates' values of it, increasing.
        other: the one value of the other.
    """

    def __init__(self, samples: Samples, axis: str, place: np.ndarray, other: float):
        self.theta, self.tube = samples.theta, Tube(*(v.ravel() for v in samples.tube))
        self.axis, self.place, self.other, self.by_ratio = axis, place, np.array([other]), axis == "depth_ratio"
        self.max_slope = samples.max_slope

    def __call__(self, along: np.ndarray, knots: np.ndarray, heights: np.ndarray) -> tuple[Rows, np.ndarray]:
        """(the rows, the depths (R - 1,)) at places (R,) with knots (R, N), from heights (R, N) to begin with."""
        intervals, size = len(along) - 1, heights.size
        row, t = (between_ratios if self.by_ratio else between_fovs)(self.place, along, np)
        interval = np.repeat(row, self.theta.shape[1])

        def least(deep: np.ndarray) -> np.ndarray:
            found = np.full(intervals, _ENOUGH)
            np.minimum.at(found, interval, deep)
            return found

        rows = self._rows(along, knots, heights)
        depths = least(self._deep(rows))
        slope, value = self._linearised(row, t, knots, heights)
        # Few samples matter: those at which a program fell short of what it promised join the next.
        active = np.arange(len(value)) % _FIRST == 0
        cost = np.concatenate([np.zeros(size), -np.ones(intervals)])
        bounds = [(-_STEP, _STEP)] * size + [(None, _ENOUGH)] * intervals
        # Between rows log(eta) and the knots' distances are blended alike: it is nowhere steeper than on the rows.
        steepness = scipy.sparse.block_diag([slope_limits(row, self.max_slope) for row in knots], "csr")
        for _ in range(_PROGRAMS):
            few = Tube(*(v[active] for v in self.tube))
            program, limits = inside(slope[active], value[active], few, interval[active], intervals)
            steeper = scipy.sparse.hstack([steepness.multiply(heights.ravel()), 0 * steepness[:, :intervals]])
            program = scipy.sparse.vstack([program, steeper])
            limits = np.concatenate([limits, -(steepness @ heights.ravel())])
            found = scipy.optimize.linprog(cost, program, limits, bounds=bounds, method="highs-ipm")
            if not found.success:
                break
            changed = heights * (1 + found.x[:size].reshape(heights.shape))
            tried = self._rows(along, knots, changed)
            deep = self._deep(tried)
            short = ~active & (deep < found.x[size:][interval] - _SHORT)
            gain = np.sum(least(deep) - depths)
            if gain > 0:
                rows, depths, heights = tried, least(deep), changed
                slope, value = self._linearised(row, t, knots, heights)
            if gain < 0.01 * intervals and not short.any():
                break
            active |= short
        return rows, depths

    def _rows(self, along: np.ndarray, knots: np.ndarray, heights: np.ndarray) -> Rows:
        axes, shape = ((along, self.other), (-1, 1)) if self.by_ratio else ((self.other, along), (1, -1))
        return Rows(*axes, *(v.reshape(*shape, v.shape[-1]) for v in (knots, heights)))

    def _deep(self, rows: Rows) -> np.ndarray:
        place = self.place[:, None]
        return self.tube.depth(lookup(self.theta, place, place, rows, np).ravel())

    def _linearised(self, row, t, knots, heights) -> tuple[scipy.sparse.csr_matrix, np.ndarray]:
        """(slope by relative changes of the heights, value) of a look-up at the samples."""
        positions = knots[row] + t[:, None] * (knots[row + 1] - knots[row])
        piece, share = on_piece(self.theta, positions[:, None], np)
        row, t = (v[:, None] for v in (row, t))
        corners = [(row + i) * knots.shape[1] + piece + k for i in (0, 1) for k in (0, 1)]
        low, high, other_low, other_high = (heights.ravel()[corner] for corner in corners)
        one, other = low + share * (high - low), other_low + share * (other_high - other_low)
        value = one ** (1 - t) * other**t
        by_one, by_other = value * (1 - t) / one, value * t / other
        entries = (
            by_one * (1 - share) * low, by_one * share * high,
            by_other * (1 - share) * other_low, by_other * share * other_high,
        )  # fmt: skip
        where = np.tile(np.arange(piece.size), 4), np.concatenate([corner.ravel() for corner in corners])
        entries = np.concatenate([v.ravel() for v in entries])
        return scipy.sparse.csr_matrix((entries, where), (piece.size, heights.size)), value.ravel()

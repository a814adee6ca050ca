"""The fewest rows of a table over one axis: their places, and heights that also serve the lookup between rows."""

import math
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse

from ..lookup import Rows, between_fovs, between_ratios, lookup, on_piece
from .heights import inside, slope_limits
from .samples import Samples, evenly
from .tolerance_band import ToleranceBand

_STEP = 0.5  # largest relative change of a height in a linear program
_PROGRAMS = 12
_ENOUGH = 0.9  # depth in the tolerance band above which an interval gains nothing
_FIRST = 20  # one of this many samples is in the first program
_SHORT = 0.02  # of the depth
_MOST_ROWS = 64
_MORE, _FEWER = 12, 4  # row moves that may fail: at first, and with fewer rows than a known solution has


def fewest_rows(fit: "Fit", knots: np.ndarray, heights: np.ndarray, larger: Rows | None = None) -> Rows | None:
    """A table with the fewest rows found, at most 64 and smaller than `larger`; None if none is found.

    The deficit of an interval between rows (1 - depth) grows with the square of its length, so the number of rows can
    be predicted: the deficit's square root is a row density, by which rows are moved until all deficits are equal.

    Args:
        fit: fits the heights of rows placed at some of G candidates.
        knots, heights: (G, N) of the candidates; rows take their knots, and start from their heights.
        larger: a table that stays in the tolerance band; its places are the start.
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
        deficit = np.sqrt(1 - depths)
        needed = 1 + math.ceil(deficit.sum() / math.sqrt(1 - slack))
        if depths.min() >= 0:
            kept, left = rows, _FEWER
            count = min(len(which) - 1, needed)
        else:
            left -= 1
            count = len(which) if kept or larger else max(len(which), needed)
            slack += 0.01
        if not 2 <= count <= _MOST_ROWS:
            break
        moved = _moved(np.log(place), which, deficit, count)
        if np.array_equal(moved, which):
            break
        which = moved
    return kept


def _moved(place: np.ndarray, which: np.ndarray, deficit: np.ndarray, count: int) -> np.ndarray:
    """`count` rows, placed for equal predicted deficits of the intervals."""
    reached = np.concatenate([[0.0], np.cumsum(deficit)])
    at = np.interp(np.linspace(0, reached[-1], count), reached, place[which])
    return np.unique(np.abs(place[:, None] - at).argmin(0))


class Fit:
    """Heights of rows at given places that keep each interval between rows deep in the tolerance band.

    A lookup between rows is slightly nonlinear in the heights: a few linear programs, each linearised at the last
    one's heights, maximise the sum over intervals of the least depth (`ToleranceBand.depth`, capped at 0.9).

    Args:
        samples: of candidate rows.
        axis: "depth_ratio" or "half_fov", which varies from row to row.
        place: (G,) the candidates' values on this axis, increasing.
        other: the fixed value on the other axis.
    """

    def __init__(self, samples: Samples, axis: str, place: np.ndarray, other: float):
        self.theta, self.band = samples.theta, ToleranceBand(*(v.ravel() for v in samples.band))
        self.axis, self.place, self.other, self.by_ratio = axis, place, np.array([other]), axis == "depth_ratio"
        self.max_slope = samples.max_slope

    def __call__(self, along: np.ndarray, knots: np.ndarray, heights: np.ndarray) -> tuple[Rows, np.ndarray]:
        """(the rows, the depths (R - 1,)) at places (R,) with knots (R, N), starting from heights (R, N)."""
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
        # Few samples matter: those that fall short of the program's prediction join the next program.
        active = np.arange(len(value)) % _FIRST == 0
        cost = np.concatenate([np.zeros(size), -np.ones(intervals)])
        bounds = [(-_STEP, _STEP)] * size + [(None, _ENOUGH)] * intervals
        # Between rows, log(eta) and the knots' distances are blended equally, so no slope exceeds those of the rows.
        limits_of_slopes = [slope_limits(row, self.max_slope) for row in knots]
        steepness = scipy.sparse.csr_matrix(scipy.sparse.block_diag(limits_of_slopes))
        for _ in range(_PROGRAMS):
            few = ToleranceBand(*(v[active] for v in self.band))
            program, limits = inside(slope[active], value[active], few, interval[active], intervals)
            scaled = scipy.sparse.csr_matrix(steepness.multiply(heights.ravel()))
            steeper = scipy.sparse.hstack([scaled, 0 * steepness[:, :intervals]])
            both: Any = scipy.sparse.vstack([program, steeper])  # sparse matrices are missing in linprog's stub
            limits = np.concatenate([limits, -(steepness @ heights.ravel())])
            found = scipy.optimize.linprog(cost, both, limits, bounds=bounds, method="highs-ipm")
            if found.x is None or not found.success:
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
        return self.band.depth(lookup(self.theta, place, place, rows, np).ravel())

    def _linearised(self, row, t, knots, heights) -> tuple[scipy.sparse.csr_matrix, np.ndarray]:
        """(derivative by relative changes of the heights, value) of a lookup at the samples."""
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

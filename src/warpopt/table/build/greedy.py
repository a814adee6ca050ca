"""Rows of a table over far/near and the field of view: each as far from the last as the promise allows."""

import numpy as np

from ..lookup import Rows, lookup
from .samples import Samples, evenly
from .tolerance_band import ToleranceBand

_FOR_ONE_AXIS = 0.4  # depth in the tolerance band that the rows in field of view leave to the rows in far/near


class Grid:
    """Candidate rows: samples over (far/near, half field of view), with the best polyline of each.

    Args:
        samples: of len(depth_ratio) * len(half_fov) frusta, far/near first.
        depth_ratio, half_fov: the candidates' values.
        knots, heights: (G, N) of each.
    """

    def __init__(self, samples: Samples, depth_ratio, half_fov, knots, heights):
        self.axes = depth_ratio, half_fov
        shape = len(depth_ratio), len(half_fov)
        self.band = ToleranceBand(*(v.reshape(*shape, -1) for v in samples.band))
        self.theta, self.knots, self.heights = (v.reshape(*shape, -1) for v in (samples.theta, knots, heights))

    def rows(self, ratios: np.ndarray, fovs: np.ndarray) -> Rows:
        """The table of some of the candidates."""
        at = np.ix_(ratios, fovs)
        return Rows(self.axes[0][ratios], self.axes[1][fovs], self.knots[at], self.heights[at])

    def keeps(self, rows: Rows, ratios: slice, fovs: slice, depth: float) -> bool:
        """Whether a table reaches a depth in the tolerance band at all candidates of a range."""
        at = ratios, fovs
        found = lookup(self.theta[at], self.axes[0][ratios, None, None], self.axes[1][None, fovs, None], rows, np)
        return bool((ToleranceBand(*(v[at] for v in self.band)).depth(found) >= depth).all())

    def chosen(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the rows in far/near and in field of view; the latter are chosen first, at a few of the former."""
        few = evenly(len(self.axes[0]), 7)

        def between_fovs(k: int, m: int) -> bool:
            between = slice(k, m + 1)
            tables = (self.rows(np.array([i]), np.array([k, m])) for i in few)
            return all(self.keeps(t, slice(i, i + 1), between, _FOR_ONE_AXIS) for i, t in zip(few, tables, strict=True))

        fovs = _farthest(len(self.axes[1]), between_fovs)

        def between_ratios(i: int, j: int) -> bool:
            return self.keeps(self.rows(np.array([i, j]), fovs), slice(i, j + 1), slice(None), 0.0)

        return _farthest(len(self.axes[0]), between_ratios), fovs


def _farthest(count: int, keeps) -> np.ndarray:
    """Steps from 0 to count - 1, each the farthest before the first that fails."""
    rows = [0]
    while rows[-1] < count - 1:
        ahead = rows[-1] + 1
        while ahead < count - 1 and keeps(rows[-1], ahead + 1):
            ahead += 1
        rows.append(ahead)
    return np.array(rows)

"""The best heights of all of a table's rows at once, over all that lies between the rows."""

import numpy as np
import scipy.optimize
import scipy.sparse

from .heights import inside
from .look_up import Rows, between_fovs, between_ratios, look_up, on_piece
from .samples import Samples
from .tube import Tube

_STEP = 0.5  # largest relative change of a height in one linear program
_PROGRAMS = 8
_ENOUGH = 0.9  # deep in the tube: no interval gains by more


def joint_heights(
    samples: Samples, axis: str, place: np.ndarray, rows: np.ndarray, knots: np.ndarray, heights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Heights of the rows of a table over one axis, such that each interval between rows is deep in the tube.

    A look-up between rows is not quite linear in the heights: a few linear programs, each about the last one's heights.
    The sum over intervals of the depth (`Tube.depth`, up to 0.9) of its shallowest sample is largest.

    Args:
        samples: at candidate rows.
        axis: "depth_ratio" or "half_fov": what varies from row to row.
        place: (G,) the candidates' values of it, increasing.
        rows: (R,) which candidates are rows, the first and the last among them.
        knots: (R, N) of the rows; heights: (R, N) to begin with.

    Returns:
        heights (R, N), and the depths (R - 1,).
    """
    count, size = knots.shape
    along, by_ratio = place[rows], axis == "depth_ratio"
    row, t = (between_ratios if by_ratio else between_fovs)(place, along, np)
    positions = knots[row] + t[:, None] * (knots[row + 1] - knots[row])
    piece, share = on_piece(samples.theta, positions[:, None], np)
    row, t = (np.broadcast_to(v[:, None], piece.shape) for v in (row, t))
    corners = [(row + i) * size + piece + k for i in (0, 1) for k in (0, 1)]
    around = Tube(*(v.ravel() for v in samples.tube))
    interval = row.ravel()
    total = len(interval)

    def depths_of(heights: np.ndarray) -> np.ndarray:
        polylines = (v.reshape((count, 1, size) if by_ratio else (1, count, size)) for v in (knots, heights))
        table = Rows(*((along, np.ones(1)) if by_ratio else (np.ones(1), along)), *polylines)
        found = look_up(samples.theta, place[:, None], place[:, None], table, np).ravel()
        least = np.full(count - 1, np.inf)
        np.minimum.at(least, interval, around.depth(found))
        return np.minimum(least, _ENOUGH)

    heights = heights.ravel().copy()
    best = heights, depths_of(heights)
    for _ in range(_PROGRAMS):
        one = (1 - share) * heights[corners[0]] + share * heights[corners[1]]
        other = (1 - share) * heights[corners[2]] + share * heights[corners[3]]
        value = one ** (1 - t) * other**t
        weights = [value * (1 - t) / one * v for v in (1 - share, share)]
        weights += [value * t / other * v for v in (1 - share, share)]
        entries = np.concatenate([(w * heights[c]).ravel() for w, c in zip(weights, corners, strict=True)])
        where = np.tile(np.arange(total), 4), np.concatenate([c.ravel() for c in corners])
        slope = scipy.sparse.csr_matrix((entries, where), (total, count * size))
        program, limits = inside(slope, value.ravel(), around, interval, count - 1)
        bounds = [(-_STEP, _STEP)] * (count * size) + [(None, _ENOUGH)] * (count - 1)
        cost = np.concatenate([np.zeros(count * size), -np.ones(count - 1)])
        found = scipy.optimize.linprog(cost, program, limits, bounds=bounds, method="highs-ipm")
        if not found.success:
            break
        heights = heights * (1 + found.x[: count * size])
        depths = depths_of(heights)
        gain = np.sum(depths - best[1])
        if gain > 0:
            best = heights, depths
        if gain < 0.01 * count:
            break
    return best[0].reshape(count, size), best[1]


def moved_rows(place: np.ndarray, rows: np.ndarray, depths: np.ndarray, wanted: float) -> np.ndarray:
    """Rows, more or fewer, among which each interval would be `wanted` deep.

    What an interval lacks (1 - depth) goes with the square of its length, so that its root is a density of rows.
    """
    density = np.sqrt((1 - depths) / (1 - wanted))
    reached = np.concatenate([[0.0], np.cumsum(density)])
    count = max(2, int(np.ceil(reached[-1])) + 1)
    at = np.interp(np.linspace(0, reached[-1], count), reached, place[rows])
    found = np.unique(np.abs(place[:, None] - at).argmin(0))
    return np.unique(np.concatenate([[0], found, [len(place) - 1]]))

"""The best heights of a polyline with given knots: a linear program."""

import numpy as np
import scipy.optimize
import scipy.sparse

from ..lookup import on_piece
from .tolerance_band import ToleranceBand

_HIGHEST = 4.0  # of a knot; a lookup clamps at eta = 1, so pieces may cross 1 anywhere


def best_heights(
    knots: np.ndarray, theta: np.ndarray, around: ToleranceBand, max_slope: float
) -> tuple[np.ndarray, float]:
    """Heights of the polyline that maximise its least depth in the tolerance band (`ToleranceBand.depth`).

    Args:
        knots: (N,), not decreasing.
        theta, around: (S,) directions, and the tolerance band there.
        max_slope: bound on |d log(height) / d theta| of every piece, or inf; linear in the heights, as
            a piece is steepest at its lower end.

    Returns:
        heights (N,) > 0, and the depth.
    """
    count = len(knots)
    piece, share = on_piece(theta, knots, np)
    entries = np.concatenate([1 - share, share])
    where = np.tile(np.arange(len(theta)), 2), np.concatenate([piece, piece + 1])
    polyline = scipy.sparse.csr_matrix((entries, where), (len(theta), count))
    matrix, limit = inside(polyline, np.zeros(len(theta)), around, np.zeros(len(theta), int), 1)
    steepness = scipy.sparse.hstack([slope_limits(knots, max_slope), scipy.sparse.csr_matrix((4 * (count - 1), 1))])
    parts, limits = [matrix, steepness], [limit, np.zeros(4 * (count - 1))]
    cost = np.append(np.zeros(count), -1.0)
    bounds = [(around.lower.min() / 2, _HIGHEST)] * count + [(None, 1.0)]
    found = scipy.optimize.linprog(
        cost, scipy.sparse.vstack(parts), np.concatenate(limits), bounds=bounds, method="highs-ds"
    )
    if found.x is None or not found.success:
        raise RuntimeError(f"best_heights: {found.message}")
    return found.x[:-1], float(found.x[-1])


def slope_limits(knots: np.ndarray, max_slope: float) -> scipy.sparse.csr_matrix:
    """(4 (N - 1), N) A of A heights <= 0: no piece has |d log(height) / d theta| > max_slope at either of its ends."""
    count = len(knots)
    if not np.isfinite(max_slope):
        return scipy.sparse.csr_matrix((4 * (count - 1), count))
    step = max_slope * np.diff(knots)[:, None]
    one, other = np.eye(count)[:-1], np.eye(count)[1:]
    return scipy.sparse.csr_matrix(
        np.concatenate([rising - step * end for rising in (other - one, one - other) for end in (one, other)])
    )


def inside(
    slope: scipy.sparse.csr_matrix, value: np.ndarray, around: ToleranceBand, group: np.ndarray, groups: int
) -> tuple[scipy.sparse.csr_matrix, np.ndarray]:
    """(A, b) of A (change, depths) <= b: value + slope change reaches the depths in the tolerance band.

    Args:
        slope: (S, N).
        value, around: (S,) values, and the tolerance band.
        group: (S,) index of each entry's depth.
    """
    below, above = around.widths
    bounded = around.bounded
    below, above = 1 / below, 1 / above[bounded]  # the program's tolerance is then a depth
    depth = scipy.sparse.csr_matrix((np.ones(len(value)), (np.arange(len(value)), group)), (len(value), groups))
    lower = scipy.sparse.hstack([_times(slope, -below), depth])
    upper = scipy.sparse.hstack([_times(slope[bounded], above), depth[bounded]])
    limits = (value - around.lower) * below, (around.upper - value)[bounded] * above
    return scipy.sparse.csr_matrix(scipy.sparse.vstack([lower, upper])), np.concatenate(limits)


def _times(matrix: scipy.sparse.csr_matrix, factors: np.ndarray) -> scipy.sparse.csr_matrix:
    """Each row times its factor."""
    return scipy.sparse.csr_matrix(matrix.multiply(factors[:, None]))

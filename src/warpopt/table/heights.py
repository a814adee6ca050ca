"""The best heights of a polyline whose knots are given: a linear program."""

import numpy as np
import scipy.optimize
import scipy.sparse

_HIGHEST = 4.0  # of a knot above eta = 1, where a look-up ends: room enough for a piece to cross it anywhere


def best_heights(
    knots: np.ndarray, x: np.ndarray, centre: np.ndarray, lower: np.ndarray, upper: np.ndarray, max_slope: float
) -> tuple[np.ndarray, float]:
    """Heights that keep the polyline as far inside the tube as can be.

    Largest s such that at every x the polyline is between lower + s (centre - lower) and upper - s (upper - centre).
    1: on the centre itself; 0: just inside; below: outside.

    Args:
        knots: (N,), not decreasing.
        x, centre, lower, upper: (S,); upper may be inf.
        max_slope: bound on |d log(height) / dx| of every piece, or inf. Linear: a piece is steepest at its lower end.

    Returns:
        heights (N,) > 0, and s.
    """
    count = len(knots)
    piece = np.clip(np.searchsorted(knots, x, side="left") - 1, 0, count - 2)
    length = knots[piece + 1] - knots[piece]
    share = np.where(length > 0, (x - knots[piece]) / np.where(length > 0, length, 1), 0)
    rows = np.arange(len(x))
    on_piece = scipy.sparse.csr_matrix(
        (np.concatenate([1 - share, share]), (np.tile(rows, 2), np.concatenate([piece, piece + 1]))), (len(x), count)
    )
    bounded = np.isfinite(upper)
    above, below = centre - lower, np.where(bounded, upper - centre, 0)
    parts = [
        scipy.sparse.hstack([-on_piece, above[:, None]]),
        scipy.sparse.hstack([on_piece[bounded], below[bounded, None]]),
    ]
    limits = [-lower, upper[bounded]]
    if np.isfinite(max_slope):
        step = max_slope * np.diff(knots)
        one, other = np.eye(count + 1)[: count - 1], np.eye(count + 1)[1:count]
        for rising in (other - one, one - other):
            for end in (one, other):
                parts.append(scipy.sparse.csr_matrix(rising - step[:, None] * end))
                limits.append(np.zeros(count - 1))
    cost = np.append(np.zeros(count), -1.0)
    bounds = [(lower.min() / 2, _HIGHEST)] * count + [(None, 1.0)]
    found = scipy.optimize.linprog(
        cost, scipy.sparse.vstack(parts), np.concatenate(limits), bounds=bounds, method="highs-ds"
    )
    if not found.success:
        raise RuntimeError(f"best_heights: {found.message}")
    return found.x[:-1], float(found.x[-1])

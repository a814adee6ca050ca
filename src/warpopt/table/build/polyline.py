"""The polyline with the fewest pieces through a tolerance band."""

import numpy as np

_LEVELS = 17  # heights in the tolerance band at which a knot may stand


def fewest_knots(x: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots (indices into x, heights) of a polyline that stays in [lower, upper] at every x, with as few as possible.

    Knots stand at the given x, on one of 17 heights in the tolerance band there. Running bounds on the slopes that
    pass through every band so far say which knots can follow a knot. Breadth-first search from the first x visits each
    pair once, and its first path to the last x has the fewest knots. Among equals, the path nearest to the middle of
    the band is taken.

    Args:
        x: (N,), increasing.
        lower, upper: (N,), lower <= upper, finite.

    Raises:
        ValueError: N < 2, x that does not increase, or a tolerance band that is empty somewhere.
    """
    if len(x) < 2 or not (np.diff(x) > 0).all():
        raise ValueError("x: got values that do not increase, expected at least two that do")
    if not (lower <= upper).all() or not np.isfinite([lower, upper]).all():
        raise ValueError(
            "lower, upper: got a tolerance band that is empty or not finite somewhere, expected lower <= upper"
        )
    share = np.linspace(0, 1, _LEVELS)
    heights = lower[:, None] + share * (upper - lower)[:, None]
    off_middle = np.abs(share - 0.5)
    cost = np.full(heights.shape, np.inf)  # of the best path so far; finite where reached
    cost[0] = off_middle
    before = np.full((*heights.shape, 2), -1)
    frontier = np.argwhere(np.isfinite(cost))
    while not np.isfinite(cost[-1]).any():
        fresh = np.full(heights.shape, np.inf)
        for i, level in frontier:
            ahead, y = x[i + 1 :] - x[i], heights[i, level]
            least = np.maximum.accumulate((lower[i + 1 :] - y) / ahead)
            most = np.minimum.accumulate((upper[i + 1 :] - y) / ahead)
            open_ahead = int(np.argmax(least > most)) if (least > most).any() else len(ahead)
            view = slice(i + 1, i + 1 + open_ahead)
            slopes = (heights[view] - y) / ahead[:open_ahead, None]
            total = cost[i, level] + off_middle
            better = (slopes >= least[:open_ahead, None]) & (slopes <= most[:open_ahead, None])
            better &= np.isinf(cost[view]) & (total < fresh[view])
            fresh[view] = np.where(better, total, fresh[view])
            before[view][better] = i, level
        new = np.isfinite(fresh)
        cost[new] = fresh[new]
        frontier = np.argwhere(new)
    place = len(x) - 1, int(np.argmin(cost[-1]))
    path = [place]
    while before[path[-1]][0] >= 0:
        path.append(tuple(before[path[-1]]))
    path = path[::-1]
    return np.array([i for i, _ in path]), np.array([heights[place] for place in path])

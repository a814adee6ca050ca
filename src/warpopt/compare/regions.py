"""Where along theta something holds, with ends finer than the directions that were looked at."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_HALVINGS = 40  # a step of a degree is then below the rounding of theta in double precision

Interval = tuple[float, float]


def regions(
    theta: NDArray, holds: NDArray[np.bool_], at: Callable[[NDArray], NDArray[np.bool_]]
) -> list[tuple[Interval, ...]]:
    """The intervals of theta in which each of several conditions holds.

    Each change between neighbouring directions is bisected. What begins and ends between two neighbours is not seen.

    Args:
        theta: (T,) increasing.
        holds: (M, T): each condition at theta.
        at: gives the same for other directions, always T of them.
    """
    which, left = np.nonzero(holds[:, 1:] != holds[:, :-1])
    low, high = theta[left].copy(), theta[left + 1].copy()
    before = holds[which, left]
    for start in range(0, len(which), len(theta)):
        part = slice(start, start + len(theta))
        rows = which[part]
        for _ in range(_HALVINGS):
            middle = (low[part] + high[part]) / 2
            # padded to one shape, for which everything is compiled already
            now = at(np.pad(middle, (0, len(theta) - len(rows)), mode="edge"))[rows, np.arange(len(rows))]
            same = now == before[part]
            low[part], high[part] = np.where(same, middle, low[part]), np.where(same, high[part], middle)
    ends = (low + high) / 2
    return [_intervals(theta, row, ends[which == m]) for m, row in enumerate(holds)]


def _intervals(theta: NDArray, holds: NDArray[np.bool_], changes: NDArray) -> tuple[Interval, ...]:
    points = [*theta[:1].tolist() * bool(holds[0]), *changes.tolist(), *theta[-1:].tolist() * bool(holds[-1])]
    return tuple(zip(points[::2], points[1::2], strict=True))

"""The intervals of theta in which a condition holds, with ends finer than the given directions."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_TOGETHER = 64
_HALVINGS = 40  # a step of a degree is then below the rounding of theta in double precision

Interval = tuple[float, float]


def regions(
    theta: NDArray, holds: NDArray[np.bool_], at: Callable[[NDArray], NDArray[np.bool_]]
) -> list[tuple[Interval, ...]]:
    """The intervals of theta in which each of several conditions holds.

    Each change between neighbouring directions is bisected. An interval that begins and ends between two neighbours is
    missed.

    Args:
        theta: (T,) increasing.
        holds: (M, T): each condition at theta.
        at: gives `holds` at other directions, always the same number.
    """
    which, left = np.nonzero(holds[:, 1:] != holds[:, :-1])
    low, high = theta[left], theta[left + 1]
    before = holds[which, left]
    for _ in range(_HALVINGS if len(which) else 0):
        middle = (low + high) / 2
        same = at_points(at, which, middle, len(theta)) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = (low + high) / 2
    return [_intervals(theta, row, ends[which == m]) for m, row in enumerate(holds)]


def at_points(at: Callable[[NDArray], NDArray], rows: NDArray, points: NDArray, given: int) -> NDArray:
    """Row r of `at` at p, for each pair (r, p).

    In calls of as many points as directions were given, a shape that is already compiled; where those are few, of
    more: a call takes milliseconds whatever its size.
    """
    found, count = [], max(given, _TOGETHER)
    for start in range(0, len(points), count):
        part = slice(start, start + count)
        padded = np.pad(points[part], (0, count - len(points[part])), mode="edge")
        found.append(at(padded)[rows[part], np.arange(len(rows[part]))])
    return np.concatenate(found) if found else np.zeros(0)  # a rule may be undefined everywhere


def _intervals(theta: NDArray, holds: NDArray[np.bool_], changes: NDArray) -> tuple[Interval, ...]:
    points = [*theta[:1].tolist() * bool(holds[0]), *changes.tolist(), *theta[-1:].tolist() * bool(holds[-1])]
    return tuple(zip(points[::2], points[1::2], strict=True))

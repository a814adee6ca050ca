"""Finds the maximum along theta, finer than the given directions."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .regions import at_points

_OFFSETS = np.array([-2, -1, 1, 2]) / 3  # of the bracket's halves: each round reduces it to a third
_ROUNDS = 21  # at most; reduces a bracket to 1e-10 of a step
_ROUNDING = 64  # eps of a radian: the least bracket
_LAST, _UNBOUNDED = 6, 10.0  # growth in the last rounds (3^6 of the bracket) that indicates a pole or its root
_FLAT = 1e4  # eps: less is rounding

Peak = tuple[float, float]


def peaks(theta: NDArray, values: NDArray, at: Callable[[NDArray], NDArray]) -> list[Peak]:
    """(the largest value of each row, where it is): inf where the row grows without bound towards that point.

    Searched between the neighbours of the largest given value, and up to wherever a row's domain begins or ends; a peak
    between two other directions is missed. Kinks and jumps are safe: a bracket closes around its best point.

    Args:
        theta: (T,) increasing.
        values: (M, T) at theta; NaN where a row is undefined.
        at: gives `values` at other directions, always the same number.

    Returns:
        M pairs; NaN twice for a row that is defined nowhere.
    """
    which, index, side = _starts(values)
    centre, best = theta[index], values[which, index]
    left, right = centre - theta[np.maximum(index - 1, 0)], theta[np.minimum(index + 1, len(theta) - 1)] - centre
    history = [best] * (_LAST + 1)
    eps = np.finfo(values.dtype).eps
    for _ in range(min(_ROUNDS, _rounds(theta, _ROUNDING * eps))):
        points = np.stack([centre + (left if k < 0 else right) * k for k in _OFFSETS])
        found = at_points(at, np.tile(which, len(_OFFSETS)), points.ravel(), len(theta)).reshape(points.shape)
        # to the best point, or to the end of the row's domain
        score = np.where(side == 0, found / best - 1 - _FLAT * eps, side * _OFFSETS[:, None])
        score = np.where(np.isnan(found), -np.inf, score)
        winner, column = score.argmax(0), np.arange(len(which))
        moves = score[winner, column] > 0
        best, centre = (np.where(moves, new[winner, column], old) for new, old in ((found, best), (points, centre)))
        step = np.where(_OFFSETS[winner] < 0, left, right)
        left, right = (np.where(moves, step, half) / 3 for half in (left, right))
        history.append(best)
    best = np.where(best > _UNBOUNDED * history[-1 - _LAST], np.inf, best)
    found = []
    for row in range(len(values)):
        mine = which == row
        order = np.argsort(centre[mine], kind="stable")
        tops, places = best[mine][order], centre[mine][order]
        top = first_largest(tops) if mine.any() else None
        found.append((np.nan, np.nan) if top is None else (float(tops[top]), float(places[top])))
    return found


def first_largest(values: NDArray) -> NDArray | np.integer:
    """The index of the largest value along the last axis, the first of values equal up to rounding (a plateau).

    NaN is ignored; a row of only NaN has no largest value.
    """
    largest = np.nanmax(values, -1, keepdims=True)
    return (values >= largest * (1 - _FLAT * np.finfo(values.dtype).eps)).argmax(-1)


def _rounds(theta: NDArray, least: float) -> int:
    """Rounds in which the widest step shrinks to `least`."""
    return int(np.log(np.diff(theta).max() / least) / np.log(3)) if len(theta) > 1 else 0


def _starts(values: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """(row, index, side) of each bracket: the largest value (0), or a left (-1) or right (1) end of the domain."""
    defined = ~np.isnan(values)
    largest, first, last = np.zeros((3, *values.shape), bool)
    rows = np.flatnonzero(defined.any(1))
    largest[rows, first_largest(values[rows])] = True
    first[:, 1:] = defined[:, 1:] & ~defined[:, :-1]
    last[:, :-1] = defined[:, :-1] & ~defined[:, 1:]
    kind, row, index = np.nonzero(np.stack([largest, first, last]))
    return row, index, np.array([0, -1, 1])[kind]

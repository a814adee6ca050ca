"""Breakpoints of the optimum: the directions at which a table places knots."""

import jax
import numpy as np

from ...objective import Objective
from ...solve.optimal_warp import optimal_warp
from ...theory.view_frustum import ViewFrustum
from ...views import FrustumView
from .bisection import bisected

_GRID = 1024  # directions, one of which must lie in each zone


def breakpoints(frusta: ViewFrustum, objective: Objective, first: float, last: float) -> np.ndarray:
    """(G, K) directions, not decreasing along K: the ends, theta = phi, and where the outcome changes.

    The outcome (no warp, stationary point, tie, kink; see `optimal_warp`) changes at a kink of eta. Changes that not
    every frustum has exactly once are left out. As far/near or the field of view varies, the others may cross;
    sorted by size they still vary continuously.

    Args:
        frusta: (G,).
        first, last: directions, radians.
    """
    grid = np.linspace(first, last, _GRID)
    outcome = _outcome(with_axes(frusta, 1), grid, objective)
    count = len(outcome)
    changed = outcome[:, 1:] != outcome[:, :-1]
    kinds = {(int(a), int(b)) for a, b in zip(outcome[:, :-1][changed], outcome[:, 1:][changed], strict=True)}
    phi = np.clip(np.asarray(frusta.half_fov), first, last)
    found = [np.full(count, first), phi, np.full(count, last)]
    for before, after in sorted(kinds):
        here = changed & (outcome[:, :-1] == before) & (outcome[:, 1:] == after)
        if not (here.sum(1) == 1).all():
            continue
        at = here.argmax(1)
        _, start = bisected(lambda v, k=before: _outcome(frusta, v, objective) == k, grid[at], grid[at + 1])
        found.append(start)
    return np.sort(np.stack(found, 1), 1)


def with_axes(frusta: ViewFrustum, count: int) -> ViewFrustum:
    """The frusta with `count` axes of length one appended, to broadcast with directions."""
    return jax.tree.map(lambda v: v.reshape(v.shape + (1,) * count), frusta)


def _outcome(frusta: ViewFrustum, theta: np.ndarray, objective: Objective) -> np.ndarray:
    return np.asarray(optimal_warp(FrustumView(frusta, theta), objective, throw=False).result)

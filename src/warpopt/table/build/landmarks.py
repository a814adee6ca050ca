"""Where the optimum changes its nature: the directions that a table's knots keep to."""

import jax
import numpy as np

from ...solve.optimal_warp import optimal_warp
from ...theory.view_frustum import ViewFrustum
from ...views import FrustumView
from .bisection import bisected
from ...objective import Objective

_GRID = 1024  # directions, one of which must lie in each zone


def landmarks(frusta: ViewFrustum, objective: Objective, first: float, last: float) -> np.ndarray:
    """(G, K) directions, not decreasing along K: the ends, theta = phi, where the outcome changes.

    The outcome (no warp, stationary point, tie, kink; theory of `optimal_warp`) changes at a kink of eta. Changes that
    not every frustum has exactly once are left out; as far/near or the field of view varies the others may cross, and
    their order by size varies continuously all the same.

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
    """The same with so many axes of length one at the end, to meet directions."""
    return jax.tree.map(lambda v: v.reshape(v.shape + (1,) * count), frusta)


def _outcome(frusta: ViewFrustum, theta: np.ndarray, objective: Objective) -> np.ndarray:
    return np.asarray(optimal_warp(FrustumView(frusta, theta), objective, throw=False).result)

"""Where the optimum changes its nature: the directions that a table's knots keep to."""

import numpy as np

from ..solve.optimal_warp import optimal_warp
from ..theory.frustum import ViewFrustum
from .tube import Objective

_GRID = 1024  # directions, one of which must lie in each zone
_STEPS = 45  # bisections of a step of the grid, to the last bit


def landmarks(frusta: ViewFrustum, objective: Objective, first: float, last: float) -> np.ndarray:
    """(G, K) directions, not decreasing along K, or (K,) of one: the ends, theta = phi, where the outcome changes.

    The outcome (no warp, stationary point, tie, kink; theory of `optimal_warp`) changes at a kink of eta. Changes that
    not every frustum has exactly once are left out; as far/near or the field of view varies the others may cross, and
    their order by size varies continuously all the same.

    Args:
        frusta: (G,), or one.
        first, last: directions, radians.
    """
    if not frusta.near.shape:
        return landmarks(ViewFrustum(*(v[None] for v in _numbers(frusta))), objective, first, last)[0]
    grid = np.linspace(first, last, _GRID)
    outcome = _outcome(ViewFrustum(*(v[:, None] for v in _numbers(frusta))), grid, objective)
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
        low, high = grid[at], grid[at + 1]
        for _ in range(_STEPS):
            middle = (low + high) / 2
            same = _outcome(frusta, middle, objective) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        found.append(high)
    return np.sort(np.stack(found, 1), 1)


def _numbers(frusta: ViewFrustum) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.asarray(v) for v in (frusta.near, frusta.far, frusta.half_fov))


def _outcome(frusta: ViewFrustum, theta: np.ndarray, objective: Objective) -> np.ndarray:
    return np.asarray(optimal_warp(frusta, theta, *objective, throw=False).result)

"""Tables built to a promise: the fewest knots whose regret stays below it everywhere."""

import math

import numpy as np

import warpopt

from ..theory.error_norm import ErrorNorm
from ..theory.frustum import ViewFrustum
from .lambda_table import LambdaTable, look_up
from .polyline import fewest_knots
from .tube import Objective, regret, tube

_GRID = 400  # directions at which a knot may stand, before refinement
_SHARE = 0.97  # of the promise that the tube keeps at the grid; the rest is for what lies between
_ROUNDS = 12


def build_table(
    frustum: ViewFrustum,
    metric: str = "p",
    norm: str | float = "inf",
    measure: str = "screen",
    *,
    max_regret: float = 1e-3,
    theta_range: tuple[float, float] = (0.0, math.pi / 2),
) -> LambdaTable:
    """The smallest table of log(eta) over theta that keeps value/minimum - 1 <= max_regret for every direction.

    A tube around the optimum is drawn at a grid of directions, and the polyline with the fewest knots is laid through
    it. Where a dense, independent set of directions, and a search around the worst of them, finds the promise broken
    between grid points (a kink), the worst places join the grid.

    Args:
        frustum: one frustum; only its shape (far/near, half_fov) matters.
        metric: "p", "q" or "pxq".
        norm, measure: as in `optimal_warp`.
        max_regret: > 0.
        theta_range: first and last direction, radians, within [0, pi/2].

    Raises:
        ValueError: bad arguments.
        RuntimeError: a promise that rounding does not allow (max_regret below about 1e-12).

    Example:
        >>> import warpopt
        >>> table = build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> len(table.theta) <= 9 and table.achieved <= 1e-2
        True
    """
    if frustum.near.shape:
        raise ValueError(f"frustum: got shape {frustum.near.shape}, expected one frustum")
    if not isinstance(metric, str):
        raise ValueError(f"metric: got {metric!r}, expected 'p', 'q' or 'pxq'")
    if not (isinstance(max_regret, int | float) and 0 < max_regret < math.inf):
        raise ValueError(f"max_regret: got {max_regret!r}, expected a finite number > 0")
    first, last = theta_range
    if not 0 <= first < last <= math.pi / 2:
        raise ValueError(f"theta_range: got {theta_range!r}, expected 0 <= first < last <= pi/2")
    error_norm = ErrorNorm.of(metric, norm, measure)
    objective = Objective(metric, error_norm.order, measure)
    half_fov = float(frustum.half_fov)
    grid = np.linspace(first, last, _GRID)
    kinks = [v for v in (half_fov, half_fov * (1 - 1e-9)) if first < v < last]
    grid = np.unique(np.concatenate([grid, kinks]))
    for _ in range(_ROUNDS):
        around = tube(frustum, grid, objective, _SHARE * max_regret)
        upper = np.where(np.isinf(around.upper), np.maximum(1.0, -around.log_eta), around.upper)
        places, heights = fewest_knots(grid, around.lower, upper)
        # What engines keep: single precision. The promise is kept by these numbers.
        theta, log_eta = (v.astype(np.float32).astype(np.float64) for v in (grid[places], heights))
        worst, at, broken = verify(frustum, objective, theta, log_eta, max_regret)
        if worst <= max_regret:
            name = {math.inf: "inf", 1.0: "l1", 2.0: "l2"}.get(error_norm.order, repr(error_norm.order))
            ratio = float(frustum.depth_ratio)
            return LambdaTable(
                theta, log_eta, ratio, half_fov, metric, name, measure, float(max_regret), worst, at,
                warpopt.__version__,
            )  # fmt: skip
        grid = np.unique(np.concatenate([grid, broken]))
    raise RuntimeError(f"build_table: got a regret of {worst:.3g} at theta = {at!r} for a promise of {max_regret:g}")


def verify(
    frustum: ViewFrustum, objective: Objective, theta: np.ndarray, log_eta: np.ndarray, promise: float
) -> tuple[float, float, np.ndarray]:
    """(largest regret, where, the local worst directions that break the promise) of a polyline.

    Over 20,000 directions, irregular so that they meet no grid, every knot and its neighbours; then around the largest
    found, finer and finer.
    """
    rng = np.random.default_rng(12345)
    first, last = theta[0], min(theta[-1], np.pi / 2)
    spread = (np.arange(20_000) + rng.random(20_000)) / 20_000
    near_knots = np.concatenate([np.nextafter(theta, 0), theta, np.nextafter(theta, 4)])
    dense = np.clip(np.unique(np.concatenate([first + (last - first) * spread, near_knots])), first, last)

    def of(directions: np.ndarray) -> np.ndarray:
        return regret(frustum, directions, np.log(look_up(directions, theta, log_eta, np)), objective)

    found = of(dense)
    width = (last - first) / 20_000
    at = dense[int(np.argmax(found))]
    worst = float(found.max())
    for _ in range(6):  # each time 64 times closer
        near = np.clip(at + width * np.linspace(-1, 1, 129), first, last)
        local = of(near)
        if local.max() > worst:
            worst, at = float(local.max()), near[int(np.argmax(local))]
        width /= 64
    peaks = (found > promise) & (found >= np.r_[found[1:], 0]) & (found >= np.r_[0, found[:-1]])
    broken = np.append(dense[peaks][:200], at) if worst > promise else np.empty(0)
    return worst, float(at), broken

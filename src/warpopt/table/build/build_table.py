"""Builds tables that keep a promise: few knots, with a regret below the promise everywhere."""

import importlib.metadata
import math
from collections.abc import Generator

import jax
import numpy as np

from ..._checks import instance, pair, refuse_traced
from ...objective import Objective, objective_or_default
from ...theory.view_frustum import ViewFrustum
from ..lambda_table import LambdaTable
from ..lookup import Rows
from .breakpoints import breakpoints, with_axes
from .greedy import Grid
from .joint import Fit, fewest_rows
from .polyline import fewest_knots
from .samples import Samples, evenly
from .slope import least_of_all, least_regret
from .tolerance_band import tolerance_band
from .verify import Ranges, verify

_DIRECTIONS = 400  # candidate directions for the knots of a single row, before refinement
_SHARE = 0.97  # of the promise, kept at the samples; the rest is for the directions between them
_ROUNDS = 12
_ALLOWED = 1.25  # times the least regret of any function with the slope bound, for a table of several rows
_JUDGED = 9  # candidates whose least regret under the slope bound is computed
_TRIES = 3  # numbers of knots that may fail to give rows
_DEEP = 0.25  # depth in the tolerance band of rows, so that the lookup between them has slack
_RATIO_STEP = 0.067  # step of the candidate rows, in log(far/near)
_FOV_STEP = math.radians(0.5)
_MOST_KNOTS = 32
_NO_WARP = 2.0  # height of a knot where eta = 1 keeps the promise and there is no upper bound


def build_table(
    frustum: ViewFrustum,
    objective: Objective | None = None,
    *,
    max_regret: float = 1e-3,
    theta_range: tuple[float, float] = (0.0, math.pi / 2),
    depth_ratio_range: tuple[float, float] | None = None,
    half_fov_range: tuple[float, float] | None = None,
    max_slope: float | None = None,
) -> LambdaTable:
    """A small table of eta that keeps value/minimum - 1 <= max_regret for every direction (far/near, field of view).

    The tolerance band around the optimum bounds eta. For one far/near and field of view, the table is the polyline with
    the fewest knots through the tolerance band at a grid of directions. For ranges, each row of the table is a polyline
    whose knots follow the breakpoints of the optimum, which move from row to row. The rows' places and, by linear
    programs, their heights are chosen so that the lookup between rows stays in the tolerance band too. The result is
    verified on dense, independent inputs and by a search around the worst of them; on failure the band is narrowed.

    Args:
        frustum: one frustum; of far/near and half_fov, only those without a range matter.
        objective: of metric "p", "q" or "pxq"; E_p in L-inf if None.
        max_regret: > 0.
        theta_range: first and last direction, radians, within [0, pi/2].
        depth_ratio_range: smallest and largest far/near, > 1, for a table over it.
        half_fov_range: smallest and largest half field of view, radians, within (0, pi/2), likewise.
        max_slope: bound on |d log(eta) / d theta|, per radian, which keeps shadows stable under a moving light. The
            table's largest regret is then max_regret or, if more, within 10 % of the least that the bound allows
            (25 % with a range); `promised` is the regret that it keeps. Allowed with at most one range.

    Returns:
        A `LambdaTable`.

    Raises:
        ValueError: bad arguments.
        RuntimeError: a promise that rounding does not allow (max_regret below about 1e-6, the limit of float32), or
            that needs more than 32 knots a row or 64 rows (E_q in L-inf over far/near: the direction at which its
            optimum jumps moves).

    Example:
        >>> import warpopt
        >>> table = build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> table.theta.shape[-1] <= 6 and table.achieved <= 1e-2
        True
    """
    ranges = _ranges(frustum, theta_range, depth_ratio_range, half_fov_range)
    objective = objective_or_default(objective)
    if objective.name not in ("p", "q", "pxq"):
        raise ValueError(f"metric: got {objective.name!r}, expected 'p', 'q' or 'pxq'")
    if not (isinstance(max_regret, int | float) and 0 < max_regret < math.inf):
        raise ValueError(f"max_regret: got {max_regret!r}, expected a finite number > 0")
    if max_slope is not None and not (isinstance(max_slope, int | float) and 0 < max_slope < math.inf):
        raise ValueError(f"max_slope: got {max_slope!r}, expected a finite number > 0, or None")
    axes = sum(low < high for low, high in (ranges.depth_ratio, ranges.half_fov))
    if max_slope is not None and axes == 2:
        raise ValueError(
            "max_slope: got one with ranges of far/near and of the field of view, expected one range at most"
        )
    if max_slope is not None and axes == 0:
        attempts = _bounded(ranges, objective, max_slope, _SHARE * float(max_regret))
    elif axes == 1:
        attempts = _one_axis(ranges, objective, float(max_regret), math.inf if max_slope is None else float(max_slope))
    else:
        attempts = (_two_axes if axes else _single_row)(ranges, objective, float(max_regret))
    rows, promise = next(attempts)
    worst, at = math.inf, (math.nan,) * 3
    for _ in range(_ROUNDS):
        # The stored float32 numbers, as engines use them, must keep the promise.
        ratios, fovs = (axis if len(axis) == 1 else _single(axis) for axis in (rows.depth_ratio, rows.half_fov))
        rows = Rows(ratios, fovs, _single(rows.theta), _single(rows.eta))
        worst, at, broken = verify(ranges, objective, rows, promise)
        if worst <= promise:
            slope = math.inf if max_slope is None else float(max_slope)
            return LambdaTable(
                *rows, objective, max_slope=slope, promised=promise, achieved=worst, worst=at,
                version=importlib.metadata.version("warpopt"),
            )  # fmt: skip
        rows, promise = attempts.send(broken)
    raise RuntimeError(f"build_table: got a regret of {worst:.3g} at {at} for a promise of {promise:g}")


def _ranges(frustum: ViewFrustum, theta_range, depth_ratio_range, half_fov_range) -> Ranges:
    instance("frustum", frustum, ViewFrustum)
    refuse_traced("build_table", frustum)
    if frustum.near.shape:
        raise ValueError(f"frustum: got shape {frustum.near.shape}, expected one frustum")
    first, last = pair("theta_range", theta_range, math.isfinite, "two angles")
    if not 0 <= first < last <= math.pi / 2:
        raise ValueError(f"theta_range: got {theta_range!r}, expected 0 <= first < last <= pi/2")
    ratio, half_fov = float(frustum.depth_ratio), float(frustum.half_fov)
    ratios, fovs = (ratio, ratio), (half_fov, half_fov)
    if depth_ratio_range is not None:
        ratios = pair("depth_ratio_range", depth_ratio_range, math.isfinite, "two numbers")
    if half_fov_range is not None:
        fovs = pair("half_fov_range", half_fov_range, math.isfinite, "two angles")
    if depth_ratio_range is not None and not 1 < ratios[0] < ratios[1] <= 1e12:
        raise ValueError(f"depth_ratio_range: got {depth_ratio_range!r}, expected 1 < smallest < largest <= 1e12")
    if half_fov_range is not None and not 0 < fovs[0] < fovs[1] < math.pi / 2:
        raise ValueError(f"half_fov_range: got {half_fov_range!r}, expected 0 < smallest < largest < pi/2")
    return Ranges((first, last), ratios, fovs)


# Each yields (rows, promised regret), and is sent the points (P, 3) that broke the promise.
_Attempts = Generator[tuple[Rows, float], np.ndarray, None]


def _single_row(ranges: Ranges, objective: Objective, promise: float) -> _Attempts:
    """The fewest knots through the tolerance band at a grid of directions; points that break the promise are added."""
    first, last = ranges.theta
    kinks = breakpoints(with_axes(ranges.frusta(), 1), objective, first, last)[0]
    # Denser towards breakpoints; neighbours must differ in single precision.
    away = np.geomspace(1e-6, 0.03, 16)
    beside = np.clip(kinks * (1 + np.concatenate([-away, [0], away])[:, None]), first, last)
    grid = np.unique(np.concatenate([np.linspace(first, last, _DIRECTIONS), beside.ravel()]))
    share = _SHARE
    while True:
        around = tolerance_band(ranges.frusta(), grid, objective, share * promise)
        places, heights = fewest_knots(grid, around.lower, np.where(around.bounded, around.upper, _NO_WARP))
        broken = yield ranges.rows(grid[places], heights), promise
        grid = np.unique(np.concatenate([grid, broken[:, 0]]))
        share *= 0.98  # more slack for float32 rounding on steep pieces


def _one_axis(ranges: Ranges, objective: Objective, promise: float, max_slope: float) -> _Attempts:
    """The fewest rows with few knots each, then with more knots while that makes the table smaller."""
    by_ratio = ranges.depth_ratio[0] < ranges.depth_ratio[1]
    axis, place = ("depth_ratio", _ratios(ranges)) if by_ratio else ("half_fov", _fovs(ranges))
    frusta = ranges.frusta(**{axis: place})
    other = (ranges.half_fov if by_ratio else ranges.depth_ratio)[0]
    share = _SHARE
    if max_slope < math.inf:
        each = (jax.tree.map(lambda v, k=k: v[k], frusta) for k in evenly(len(place), _JUDGED))
        promise = max(promise, _ALLOWED * max(least_of_all(ranges, objective, max_slope, one) for one in each))
    while True:
        samples = Samples(frusta, objective, ranges.theta, share * promise, max_slope)
        smallest = None
        for tried, knots in enumerate(samples.finer(_DEEP if max_slope == math.inf else 0.0, _MOST_KNOTS), 1):
            dense = samples.at_knots(knots)
            rows = fewest_rows(Fit(dense, axis, place, other), knots, _best_heights(dense, knots), smallest)
            if rows is None and (smallest is not None or tried == _TRIES):
                break
            smallest = rows
        if smallest is None:
            raise RuntimeError(
                "got a promise for a range that takes more than 64 rows of a table: make the range narrower"
            )
        yield smallest, promise
        share *= 0.98


def _two_axes(ranges: Ranges, objective: Objective, promise: float) -> _Attempts:
    """Each row as far from the last as the tolerance band allows."""
    ratios, fovs = _ratios(ranges), _fovs(ranges)
    frusta = ranges.frusta(*(v.ravel() for v in np.meshgrid(ratios, fovs, indexing="ij")))
    share = _SHARE
    while True:
        samples = Samples(frusta, objective, ranges.theta, share * promise)
        knots = next(samples.finer(_DEEP, _MOST_KNOTS))
        dense = samples.at_knots(knots)
        grid = Grid(dense, ratios, fovs, knots, _best_heights(dense, knots))
        yield grid.rows(*grid.chosen()), promise
        share *= 0.97


def _best_heights(samples: Samples, knots: np.ndarray) -> np.ndarray:
    heights, _ = samples.heights(knots, np.arange(len(knots)))
    return np.minimum(heights, _NO_WARP)


def _ratios(ranges: Ranges) -> np.ndarray:
    first, last = np.log(ranges.depth_ratio)
    return np.exp(_candidates(first, last, _RATIO_STEP))


def _fovs(ranges: Ranges) -> np.ndarray:
    return _candidates(*ranges.half_fov, _FOV_STEP)


def _bounded(ranges: Ranges, objective: Objective, max_slope: float, wanted: float) -> _Attempts:
    """The row of least regret under the slope bound; yields its regret plus slack for unsampled directions."""
    rows, least = least_regret(ranges, objective, max_slope, wanted)
    slack = 1e-3
    while True:
        yield rows, least * (1 + slack)
        slack *= 2


def _single(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(np.float64)


def _candidates(first: float, last: float, step: float) -> np.ndarray:
    return np.linspace(first, last, 1 + max(4, math.ceil((last - first) / step))) if last > first else np.array([first])

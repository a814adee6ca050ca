"""The best table under a bound on its slope."""

import itertools

import numpy as np

from ...objective import Objective
from ...theory.view_frustum import ViewFrustum
from ..lookup import Rows
from .bisection import bisected
from .breakpoints import breakpoints, with_axes
from .heights import best_heights
from .tolerance_band import tolerance_band
from .verify import Ranges

_KNOTS = (65, 129, 257)  # evenly spaced at the start, in addition to the breakpoints
_ALLOWED = 1.1  # times the regret of the best function under the slope bound
_SAMPLES = 1200
_STEPS = 40  # bisections of log(regret)
_LEAST, _MOST = 1e-7, 1e6  # bracket of the regret: the tightest for float32, and one above any


def least_regret(ranges: Ranges, objective: Objective, max_slope: float, wanted: float) -> tuple[Rows, float]:
    """(a row with |d log(eta) / d theta| <= max_slope, its largest regret at the samples).

    The regret is `wanted`, or 1.1 times `least_of_all` if more, and fixes the tolerance band. Whether a polyline with
    given knots fits is a linear program; starting from many even knots, each that is not needed is removed.

    Raises:
        RuntimeError: 257 knots do not fit.
    """
    first, last = ranges.theta
    marks = breakpoints(with_axes(ranges.frusta(), 1), objective, first, last)[0]
    regret = max(wanted, _ALLOWED * least_of_all(ranges, objective, max_slope))
    for count in _KNOTS:
        knots = np.unique(np.concatenate([np.linspace(first, last, count), marks]))
        inner = max(4, _SAMPLES // len(knots))
        theta = np.concatenate([np.linspace(a, b, inner) for a, b in itertools.pairwise(knots)])
        theta = np.unique(np.concatenate([theta, marks * (1 - 1e-9)]).clip(first, last))
        around = tolerance_band(ranges.frusta(), theta, objective, regret)
        heights, depth = best_heights(knots, theta, around, max_slope)
        if depth < 0:
            continue
        k = 1
        while k < len(knots) - 1:
            fewer = np.delete(knots, k)
            found, depth = best_heights(fewer, theta, around, max_slope)
            if depth >= 0:
                knots, heights = fewer, found
            else:
                k += 1
        return ranges.rows(knots, heights), regret
    raise RuntimeError(f"max_slope: got {max_slope:g}, which {_KNOTS[-1]} knots do not keep at a regret of {regret:g}")


def least_of_all(ranges: Ranges, objective: Objective, max_slope: float, frustum: ViewFrustum | None = None) -> float:
    """The least possible maximum regret of a function log(eta) of theta with bounded slope, for one frustum.

    Such a function passes through all tolerance bands exactly if it does through any two (McShane's extension).
    """
    frustum = ranges.frusta() if frustum is None else frustum
    theta = np.linspace(*ranges.theta, _SAMPLES)
    reach = max_slope * np.abs(theta[:, None] - theta)

    def kept(regret: float) -> bool:
        around = tolerance_band(frustum, theta, objective, regret)
        lower, upper = np.log(around.lower), np.minimum(np.log(around.upper), 0)
        return bool((lower[:, None] - upper <= reach).all())

    least, _ = bisected(lambda v: kept(float(np.exp(v))), np.log(_MOST), np.log(_LEAST), _STEPS)
    return float(np.exp(least))

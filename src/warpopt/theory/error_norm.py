"""What is minimised, as static values: a metric, the order of a norm, and the measure it is taken over."""

import dataclasses
import math
import numbers
from typing import Literal, get_args

Measure = Literal["volume", "screen", "log_depth", "ground", "axis"]
# dm = z^-m dx dy dz. volume: uniform over V; screen: uniform over screen and depth; log_depth: over screen and log
# depth; ground: the density of a level ground plane. axis: x = y = 0, dz.
DENSITY_EXPONENT = {"volume": 0.0, "screen": 2.0, "log_depth": 3.0, "ground": 4.0}


@dataclasses.dataclass(frozen=True)
class Metric:
    """E_p^alpha E_q^beta, an aggregate of the aliasing errors of AT09 (13), (14).

    Args:
        alpha: exponent of E_p, the error along the screen's p (vertical) axis, >= 0.
        beta: exponent of E_q, the horizontal one, >= 0; not both zero.

    Raises:
        ValueError: for a negative, infinite or NaN exponent, or two zeros.

    Example:
        >>> Metric.of("pxq") == Metric(1.0, 1.0)
        True
    """

    alpha: float
    beta: float

    def __post_init__(self):
        for name in ("alpha", "beta"):
            value = getattr(self, name)
            if isinstance(value, bool) or not (isinstance(value, numbers.Real) and 0 <= value < math.inf):
                raise ValueError(f"metric: got {name} = {value!r}, expected a finite number >= 0")
            object.__setattr__(self, name, float(value))
        if self.alpha == self.beta == 0:
            raise ValueError("metric: got alpha = beta = 0, expected at least one positive exponent")

    @classmethod
    def of(cls, metric: "str | Metric") -> "Metric":
        """The metric named "p", "q" or "pxq", or the metric itself."""
        named = {"p": cls(1.0, 0.0), "q": cls(0.0, 1.0), "pxq": cls(1.0, 1.0)}
        if isinstance(metric, Metric):
            return metric
        if not isinstance(metric, str) or metric not in named:
            raise ValueError(f"metric: got {metric!r}, expected 'p', 'q', 'pxq' or warpopt.Metric(alpha, beta)")
        return named[metric]

    @property
    def blend_power(self) -> float:
        """k = 2 alpha + beta, the power of A in E_p^alpha E_q^beta."""
        return 2 * self.alpha + self.beta

    @property
    def depth_power(self) -> float:
        """r = alpha + beta, the power of 1/z."""
        return self.alpha + self.beta


@dataclasses.dataclass(frozen=True)
class ErrorNorm:
    """The norm of a metric over a measure; hashable, so that a compiled solver can be specialised to it.

    Raises:
        ValueError: unknown names, an order below 1, or an order so low that a minimum could not be certified.
    """

    metric: Metric
    order: float
    measure: Measure

    @classmethod
    def of(cls, metric: str | Metric, norm: str | float, measure: str) -> "ErrorNorm":
        """The norm in the words of `optimal_warp`; refuses what could not be certified."""
        metric = Metric.of(metric)
        if measure not in get_args(Measure):
            raise ValueError(f"measure: got {measure!r}, expected one of {', '.join(map(repr, get_args(Measure)))}")
        order = {"inf": math.inf, "l1": 1.0, "l2": 2.0}.get(norm, norm) if isinstance(norm, str) else norm
        if isinstance(order, bool) or not (isinstance(order, numbers.Real) and order >= 1):
            raise ValueError(f"norm: got {norm!r}, expected 'inf', 'l1', 'l2' or a real order >= 1")
        if metric.beta > 0 and metric.blend_power * order < 1:
            raise ValueError(
                f"norm: got order {order} with {metric}, expected (2 alpha + beta) order >= 1: below that the "
                "objective may have several local minima and the optimum could not be certified"
            )
        return cls(metric, float(order), measure)

    @property
    def supremum(self) -> bool:
        return math.isinf(self.order)

    @property
    def blend_degree(self) -> float:
        """M = k P: the integrand's degree in A, hence in eta."""
        return self.metric.blend_power * self.order

    @property
    def volume_exponent(self) -> float:
        """q0 such that the measure's weight in (u, z) is z^-q0: the cross-section of V grows as z^2."""
        return 0.0 if self.measure == "axis" else DENSITY_EXPONENT[self.measure] - 2

    @property
    def depth_exponent(self) -> float:
        """Q such that the integrand is A^M z^-Q in (u, z)."""
        return self.metric.depth_power * self.order + self.volume_exponent

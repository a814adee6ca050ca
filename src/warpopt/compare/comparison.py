"""The comparison of rules with the optimum and the lower bound, as arrays."""

import dataclasses
from typing import Literal, NamedTuple

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from ..solve.outcome import failed_on_host
from ..solve.solution import SceneSolution, Solution
from .peaks import Peak, first_largest
from .regions import Interval

Over = Literal["optimum", "bound", "no_warp"]


class Worst(NamedTuple):
    """Where a rule's error is largest.

    Attributes:
        ratio: value over optimum, lower bound, or the norm without a warp; inf if it grows without bound towards theta,
            NaN if defined nowhere.
        theta: angle between light and view, radians.
        nearest: index of the nearest direction in `Comparison.theta`; -1 if defined nowhere.
    """

    ratio: float
    theta: float
    nearest: int


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """Rules compared with the optimum: R rules, T light directions.

    Attributes:
        names: the rules' names.
        theta: (T,) angle between light and view, radians.
        solution: the optima, (T,).
        bound: (T,) the least norm that any map of the depth reaches; None where no lower bound is known.
        no_bound_because: why there is no bound, as text; None if there is one.
        eta: (R, T) of each rule's warp; 1 where it gives no warp, or is undefined.
        defined: (R, T) False where a rule yields no lambda > 0.
        values: (R, T) each rule's norm; NaN where it is undefined, or the optimum failed.
        unwarped: (T,) the norm without a warp.
        regions: for ordered directions, {"worse", "no_warp", "undefined"}: for each rule, the intervals of theta
            (radians, ends bisected) in which it is worse than no warp, gives no warp, or is undefined. None for an
            unordered list of directions.
        peaks: for ordered directions, {"optimum", "bound", "no_warp"}: for each rule (the largest ratio of its norm to
            the optimum, the lower bound and the norm without a warp, and its theta), also searched between the
            directions; see `worst`. None for an unordered list.
        undefined_because: why rules are undefined whatever the light is, as text: an orthographic camera; else None.

    Example:
        >>> import math, warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=math.radians(30.0))
        >>> view = warpopt.FrustumView(frustum, [math.radians(degrees) for degrees in (1.0, 30.0, 60.0, 90.0)])
        >>> comparison = warpopt.compare_rules(view, ["lispsm", "tsm"])
        >>> comparison.ranking(), comparison.complete("tsm"), comparison.ratio.round(2)[0].tolist()
        (['lispsm', 'tsm'], True, [1.0, 1.79, 1.04, 1.0])
    """

    names: tuple[str, ...]
    theta: NDArray
    solution: Solution | SceneSolution
    bound: NDArray | None
    no_bound_because: str | None
    eta: NDArray
    defined: NDArray
    values: NDArray
    unwarped: NDArray
    regions: dict[str, dict[str, tuple[Interval, ...]]] | None
    peaks: dict[Over, dict[str, Peak]] | None
    undefined_because: str | None = None

    @property
    def ratio(self) -> NDArray:
        """(R, T) value / optimum, at least 1 up to rounding."""
        return quotient(self.values, self.solution.value)

    @property
    def over_bound(self) -> NDArray | None:
        """(R, T) value / lower bound."""
        return None if self.bound is None else quotient(self.values, self.bound)

    @property
    def optimum_over_bound(self) -> NDArray:
        """(T,) optimum / lower bound, at least 1 except for bounds over bins; NaN where no bound is known."""
        value = np.asarray(self.solution.value)
        return np.full_like(value, np.nan) if self.bound is None else quotient(value, self.bound)

    @property
    def over_no_warp(self) -> NDArray:
        """(R, T) value / the norm without a warp."""
        return quotient(self.values, self.unwarped)

    @property
    def unwarped_ratio(self) -> NDArray:
        """(T,) the norm without a warp over the optimum."""
        return quotient(self.unwarped, self.solution.value)

    @property
    def worse(self) -> NDArray:
        """(R, T) where a rule is worse than no warp."""
        return worse_than(self.values, self.unwarped)

    @property
    def failed(self) -> NDArray:
        """(T,) where the optimum was not found."""
        return failed_on_host(self.solution.result)

    def worst(self, name: str, over: Over = "optimum") -> Worst:
        """The largest value / optimum, value / bound or value / norm without a warp, where the rule is defined.

        Ordered directions are also searched between: kinks, jumps and poles are found to about 1e-10 of a step if an
        adjacent direction has the largest ratio, or if they are where the rule's domain begins or ends. Of ratios
        equal up to rounding, the first counts.

        Args:
            name: of a rule.
            over: "optimum", "bound" or "no_warp".

        Returns:
            A `Worst`; its ratio is NaN where the rule is nowhere defined or no bound is known.

        Raises:
            ValueError: another `name` or `over`.
        """
        every = {"optimum": self.ratio, "bound": self.over_bound, "no_warp": self.over_no_warp}
        for what, got, known in (("name", name, self.names), ("over", over, tuple(every))):
            if got not in known:
                raise ValueError(f"{what}: got {got!r}, expected one of {', '.join(map(repr, known))}")
        ratios = every[over]
        ratio = np.full(1, np.nan) if ratios is None else ratios[self.names.index(name)]
        if np.isnan(ratio).all():
            return Worst(float("nan"), float("nan"), -1)
        if self.peaks is None:
            at = int(first_largest(ratio))
            return Worst(float(ratio[at]), float(self.theta[at]), at)
        peak, theta = self.peaks[over][name]
        return Worst(peak, theta, int(np.abs(self.theta - theta).argmin()))

    def mean(self, name: str) -> float:
        """The mean of value / optimum over theta (trapezoidal; over the list, if unordered) where the rule is defined.

        NaN where the ratio is unbounded: the mean would depend on the choice of directions.
        """
        if np.isinf(self.worst(name).ratio):
            return float("nan")
        ratio = self.ratio[self.names.index(name)]
        weights = np.ones_like(ratio)
        if self.regions is not None and len(ratio) > 1:
            step = np.diff(self.theta) / 2
            weights = np.r_[step, 0] + np.r_[0, step]
        there = ~np.isnan(ratio)
        return float((weights * np.nan_to_num(ratio)).sum() / weights[there].sum()) if there.any() else float("nan")

    def complete(self, name: str) -> bool:
        """Whether the rule is defined in every direction and bounded between them; only then is it in the ranking."""
        return bool(self.defined[self.names.index(name)].all()) and not np.isinf(self.worst(name).ratio)

    def ranking(self) -> list[str]:
        """The rules that are `complete`, smallest mean first."""
        return sorted(filter(self.complete, self.names), key=self._losses)

    def order(self) -> list[str]:
        """All rules: the ranking, then those that are not `complete`, smallest mean first."""
        ranking = self.ranking()
        return [*ranking, *sorted((name for name in self.names if name not in ranking), key=self._losses)]

    def _losses(self, name: str) -> tuple[float, float]:
        """(mean, worst), inf if missing."""
        return tuple(np.nan_to_num((self.mean(name), self.worst(name).ratio), nan=np.inf).tolist())


def worse_than(values: NDArray, unwarped: NDArray) -> NDArray:
    """Whether norms exceed those without a warp by more than a few hundred eps, their error for extreme frusta."""
    return values > unwarped * (1 + 1e3 * np.finfo(values.dtype).eps)


def quotient(values: NDArray, over: ArrayLike) -> NDArray:
    """values / over; NaN for a zero norm (an empty scene, receivers at one depth)."""
    over = np.asarray(over)
    return np.where(over > 0, values / np.where(over > 0, over, 1), np.nan)

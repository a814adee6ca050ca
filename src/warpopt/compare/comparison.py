"""Every rule beside the optimum and the limit, over the light directions of one view frustum."""

import dataclasses
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from ..solve.limit import limit, unknown_limit
from ..solve.optimal_warp import Solution, compare_warps
from ..solve.outcome import Outcome
from ..solve.scene_warp import SceneSolution
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.frustum import ViewFrustum
from ..theory.light_space import checked_theta
from ..theory.warp import Warp
from .peaks import Peak, first_largest, peaks
from .regions import Interval, regions
from .rule_set import Rules, rule_set, warps_of

Over = Literal["optimum", "limit", "no_warp"]


class Worst(NamedTuple):
    """Where a rule loses most.

    Attributes:
        ratio: value over optimum, limit, or no warp's; inf if it grows without bound towards theta, NaN if nowhere
            defined.
        theta: angle between light and view, radians.
        index: of the direction nearest to it among `Comparison.theta`; -1 if nowhere.
    """

    ratio: float
    theta: float
    index: int


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """Rules beside the optimum: R rules, T light directions.

    Attributes:
        names: of the rules.
        theta: (T,) angle between light and view, radians.
        solution: the optima, (T,).
        limit: (T,) the least norm that any map of the depth reaches; None where no limit is known.
        no_limit_because: in words, why there is none; None if there is.
        eta: (R, T) of each rule's warp; 1 where it gives no warp, or is not defined.
        defined: (R, T) False where a rule yields no lambda > 0.
        values: (R, T) each rule's norm; NaN where it is not defined, or the optimum failed.
        unwarped: (T,) the norm without a warp.
        regions: for directions in order, {"worse", "no_warp", "undefined"}: for each rule the intervals of theta
            (radians, ends bisected) in which it is worse than no warp, gives no warp, or is not defined. None where
            the directions are those of a list.
        peaks: for directions in order, {"optimum", "limit", "no_warp"}: for each rule (the largest of its norm over
            the optimum, the limit and no warp's, where), found between the directions too; see `worst`. None for a
            list.

    Example:
        >>> import math, warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=math.radians(30.0))
        >>> theta = [math.radians(degrees) for degrees in (1.0, 30.0, 60.0, 90.0)]
        >>> comparison = warpopt.compare_rules(frustum, theta, ["lispsm", "tsm"])
        >>> comparison.ranking(), comparison.complete("tsm"), comparison.ratio.round(2)[0].tolist()
        (['lispsm', 'tsm'], True, [1.0, 1.79, 1.04, 1.0])
    """

    names: tuple[str, ...]
    theta: NDArray
    solution: Solution | SceneSolution
    limit: NDArray | None
    no_limit_because: str | None
    eta: NDArray
    defined: NDArray
    values: NDArray
    unwarped: NDArray
    regions: dict[str, dict[str, tuple[Interval, ...]]] | None
    peaks: dict[Over, dict[str, Peak]] | None

    @property
    def ratio(self) -> NDArray:
        """(R, T) value / optimum, at least 1 up to rounding."""
        return _quotient(self.values, self.solution.value)

    @property
    def over_limit(self) -> NDArray | None:
        """(R, T) value / limit."""
        return None if self.limit is None else _quotient(self.values, self.limit)

    @property
    def optimum_over_limit(self) -> NDArray:
        """(T,) optimum / limit, at least 1 but for maps over bins (`scene_limit`); NaN where there is no limit."""
        value = np.asarray(self.solution.value)
        return np.full_like(value, np.nan) if self.limit is None else _quotient(value, self.limit)

    @property
    def over_no_warp(self) -> NDArray:
        """(R, T) value / the norm without a warp."""
        return _quotient(self.values, self.unwarped)

    @property
    def unwarped_ratio(self) -> NDArray:
        """(T,) the norm without a warp over the optimum."""
        return _quotient(self.unwarped, self.solution.value)

    @property
    def worse(self) -> NDArray:
        """(R, T) where a rule is worse than no warp."""
        return _worse(self.values, self.unwarped)

    @property
    def failed(self) -> NDArray:
        """(T,) where the optimum was not found."""
        return np.asarray(self.solution.result) > Outcome.empty

    def worst(self, name: str, over: Over = "optimum") -> Worst:
        """The largest value / optimum, value / limit or value / no warp's, where the rule is defined.

        Of directions in order between them as well: kinks, jumps and poles are found to about 1e-10 of a step if a
        direction beside them has the largest ratio, or if they are where the rule begins or ends to be defined. Of
        places that are alike to rounding the first.
        """
        ratios = {"optimum": self.ratio, "limit": self.over_limit, "no_warp": self.over_no_warp}[over]
        ratio = np.full(1, np.nan) if ratios is None else ratios[self.names.index(name)]
        if np.isnan(ratio).all():
            return Worst(float("nan"), float("nan"), -1)
        if self.peaks is None:
            at = int(first_largest(ratio))
            return Worst(float(ratio[at]), float(self.theta[at]), at)
        peak, theta = self.peaks[over][name]
        return Worst(peak, theta, int(np.abs(self.theta - theta).argmin()))

    def mean(self, name: str) -> float:
        """The mean of value / optimum over theta (trapezia; over the list, if it is one) where the rule is defined.

        NaN where the ratio is unbounded: the directions given would decide it.
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
        """Whether the rule is defined in every direction given and bounded between them: the ranking has it."""
        return bool(self.defined[self.names.index(name)].all()) and not np.isinf(self.worst(name).ratio)

    def ranking(self) -> list[str]:
        """The rules that are `complete`, the least mean first."""
        return sorted(filter(self.complete, self.names), key=self._losses)

    def order(self) -> list[str]:
        """All rules: the ranking, then those that are not `complete`, the least mean first."""
        ranking = self.ranking()
        return [*ranking, *sorted((name for name in self.names if name not in ranking), key=self._losses)]

    def _losses(self, name: str) -> tuple[float, float]:
        """(mean, worst), inf for what has none."""
        return tuple(np.nan_to_num((self.mean(name), self.worst(name).ratio), nan=np.inf).tolist())


def compare_rules(
    frustum: ViewFrustum,
    theta: ArrayLike,
    rules: Rules = None,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    measure: str = "screen",
) -> Comparison:
    """Rules for lambda beside the optimum and the limit, against theta.

    Args:
        frustum: one view frustum.
        theta: (T,) increasing angles between light and view direction, radians in [0, pi].
        rules: a name of `rules.PUBLISHED` or `rules.ENGINES`, a callable (frustum, theta) -> Warp, a list of
            these, or a dict that gives them names; every published and engine rule if None. A callable is given theta
            of shape (T,), or, if it raises a TypeError or a ValueError at that, one angle at a time, which is slower.
        metric, norm, measure: as in `optimal_warp`.

    Raises:
        ValueError: bad arguments; a rule that is unknown, raises, or returns no `Warp` of theta's shape with eta in
            (0, 1] (`RuleError`). Failed solves are told by `solution.result`.

    Example:
        >>> import math, warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=math.radians(30.0))
        >>> theta = [math.radians(degrees) for degrees in (1.0, 30.0, 60.0, 90.0)]
        >>> comparison = compare_rules(frustum, theta, ["lispsm", "tsm"])
        >>> worst = comparison.worst("lispsm")
        >>> round(worst.ratio, 2), round(math.degrees(worst.theta), 1)
        (1.79, 30.0)
        >>> [[round(math.degrees(end), 2) for end in ends] for ends in comparison.regions["worse"]["lispsm"]]
        [[1.0, 7.13]]
    """
    reason = no_limit_because(ErrorNorm.of(metric, norm, measure))
    compared = rule_set(rules)
    if frustum.near.shape:
        raise ValueError(f"frustum: got shape {frustum.near.shape}, expected one")
    theta = checked_theta(theta, frustum)
    if theta.ndim != 1 or not theta.size or (np.diff(theta) <= 0).any():
        raise ValueError(f"theta: got {theta}, expected a list of increasing angles")

    def evaluate(theta):
        theta = jnp.asarray(theta)
        eta, defined = warps_of(compared, frustum, theta)
        every = jnp.concatenate([eta, jnp.ones_like(theta)[None]])
        warps = Warp(every, 1 - every, theta, jnp.ones((), bool))  # norms depend on eta alone
        solution, values = compare_warps(frustum, theta, warps, metric, norm, measure)
        bad = np.asarray(solution.result) > Outcome.empty
        values = np.where(bad, np.nan, values)
        return solution, *map(np.asarray, (eta, defined)), np.where(defined, values[:-1], np.nan), values[-1]

    def least(theta) -> NDArray | None:
        return None if reason else np.asarray(limit(frustum, theta, metric, norm, measure))

    def conditions(theta, evaluated=None) -> NDArray:
        _, eta, defined, values, unwarped = evaluated or evaluate(theta)
        return np.concatenate([_worse(values, unwarped), defined & (eta == 1), ~defined])

    def ratios(theta, evaluated=None) -> NDArray:
        solution, _, _, values, unwarped = evaluated or evaluate(theta)
        over = {"optimum": solution.value, "no_warp": unwarped, "limit": least(theta)}
        return np.concatenate([_quotient(values, over[kind]) for kind in kinds])

    def of_each(kinds, rows) -> dict:
        each = len(compared)
        return {kind: dict(zip(compared, rows[i * each :][:each], strict=True)) for i, kind in enumerate(kinds)}

    at, evaluated = np.asarray(theta), evaluate(theta)
    intervals = of_each(("worse", "no_warp", "undefined"), regions(at, conditions(at, evaluated), conditions))
    kinds = ("optimum", "no_warp") if reason else ("optimum", "no_warp", "limit")
    largest = of_each(kinds, peaks(at, ratios(at, evaluated), ratios))
    solution, eta, defined, values, unwarped = evaluated
    names = tuple(compared)
    return Comparison(names, at, solution, least(at), reason, eta, defined, values, unwarped, intervals, largest)


def no_limit_because(norm: ErrorNorm) -> str | None:
    """In words, why no limit is known for this norm; None if one is."""
    unknown = unknown_limit(norm)
    return unknown and f"No limit is known for {unknown}."


def _worse(values: NDArray, unwarped: NDArray) -> NDArray:
    """Norms are within a few hundred eps of exact (moments of extreme frusta included): less apart is equal."""
    return values > unwarped * (1 + 1e3 * np.finfo(values.dtype).eps)


def _quotient(values: NDArray, over: ArrayLike) -> NDArray:
    """values / over; NaN where there is nothing to compare with (an empty scene, receivers at one depth)."""
    over = np.asarray(over)
    return np.where(over > 0, values / np.where(over > 0, over, 1), np.nan)

"""Compares rules with the optimum and the lower bound, over the light directions of one view frustum."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..bound.lower_bound import lower_bound
from ..objective import Objective
from ..solve.optimal_warp import optimum_and_norms
from ..solve.outcome import failed_on_host
from ..views import FrustumView
from .comparison import Comparison, quotient, worse_than
from .peaks import peaks
from .regions import regions
from .rule_set import Rule, warps_of


def compare_over_frustum(view: FrustumView, rules: dict[str, Rule], objective: Objective) -> Comparison:
    """The comparison, with regions and peaks between the given directions.

    Raises:
        ValueError: several frusta, or directions that do not increase.
    """
    frustum, reason = view.frustum, objective.no_bound_because
    if frustum.near.shape:
        raise ValueError(f"frustum: got shape {frustum.near.shape}, expected one")
    theta = np.atleast_1d(np.asarray(view.theta))
    if theta.ndim != 1 or not theta.size or (np.diff(theta) <= 0).any():
        raise ValueError(f"theta: got {theta}, expected an angle or a list of increasing angles")

    def evaluate(theta: NDArray):
        at = FrustumView(frustum, theta)
        etas, defined = warps_of(rules, at)
        solution, values = optimum_and_norms(at, [*etas, jnp.ones_like(etas[0])], objective)
        eta, defined, values = (np.stack(jax.device_get(each)) for each in (etas, defined, values))
        values = np.where(failed_on_host(solution.result), np.nan, values)
        return solution, eta, defined, np.where(defined, values[:-1], np.nan), values[-1]

    def least(theta: NDArray) -> NDArray | None:
        return None if reason else np.asarray(lower_bound(FrustumView(frustum, theta), objective))

    def conditions(theta: NDArray, evaluated=None) -> NDArray:
        _, eta, defined, values, unwarped = evaluated or evaluate(theta)
        return np.concatenate([worse_than(values, unwarped), defined & (eta == 1), ~defined])

    def ratios(theta: NDArray, evaluated=None) -> NDArray:
        solution, _, _, values, unwarped = evaluated or evaluate(theta)
        over = {"optimum": solution.value, "no_warp": unwarped, "bound": least(theta)}
        return np.concatenate([quotient(values, over[kind]) for kind in kinds])

    def of_each(kinds: tuple[str, ...], rows: list) -> dict:
        each = len(rules)
        return {kind: dict(zip(rules, rows[i * each :][:each], strict=True)) for i, kind in enumerate(kinds)}

    evaluated = evaluate(theta)
    intervals = of_each(("worse", "no_warp", "undefined"), regions(theta, conditions(theta, evaluated), conditions))
    kinds = ("optimum", "no_warp") if reason else ("optimum", "no_warp", "bound")
    largest = of_each(kinds, peaks(theta, ratios(theta, evaluated), ratios))
    solution, eta, defined, values, unwarped = evaluated
    return Comparison(
        tuple(rules), theta, solution, least(theta), reason, eta, defined, values, unwarped, intervals, largest
    )

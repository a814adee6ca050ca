"""`warpopt solve`, `rules` and `limit`: one problem, printed on the terminal."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rich
from jax.typing import ArrayLike
from rich.table import Table

import warpopt
from warpopt.objective import Objective

from ..common.output import whole_files
from ..common.record import finite_or_none
from ..common.settings import ConfigError
from .settings import Problem


def _view(problem: Problem, theta: ArrayLike) -> "warpopt.FrustumView":
    return warpopt.FrustumView(
        warpopt.ViewFrustum(problem.near, problem.far, math.radians(problem.half_fov_deg)), theta
    )  # fmt: skip


def _optimum(problem: Problem) -> dict[str, Any]:
    view, objective = _view(problem, math.radians(problem.theta_deg)), problem.objective_value()
    bound = None if objective.no_bound_because else warpopt.lower_bound(view, objective)
    return _answer(problem, warpopt.optimal_warp(view, objective, throw=False), bound)


def _answer(problem: Problem, solution: "warpopt.Solution", bound: ArrayLike | None) -> dict[str, Any]:
    """One optimum and its lower bound, under the printed keys."""
    objective, warp = problem.objective_value(), solution.warp
    eta, rest, mu, value, residual = (
        np.asarray(v).item() for v in (warp.eta, warp.one_minus_eta, warp.mu, solution.value, solution.residual)
    )
    outcome = warpopt.Outcome(np.asarray(solution.result).item())
    lam_over_mu = eta / rest if rest else math.inf
    limit = math.nan if bound is None else np.asarray(bound).item()
    return {
        **problem.model_dump(),
        "eta": finite_or_none(eta),
        "lambda_over_mu": finite_or_none(lam_over_mu),
        "lambda": finite_or_none(lam_over_mu * mu),
        "no_warp": rest == 0,
        "value": finite_or_none(value),
        "limit": finite_or_none(limit),
        "over_limit": finite_or_none(value / limit) if limit > 0 else None,
        "no_limit_because": _no_limit_because(objective, limit),
        "outcome": outcome.name,
        "outcome_sentence": outcome.sentence,
        "residual": finite_or_none(residual),
    }


def _no_limit_because(objective: Objective, limit: float) -> str | None:
    if objective.no_bound_because or limit > 0:
        return objective.no_bound_because
    return "All receivers are at one depth: the limit is 0." if limit == 0 else "The limit is not finite."


def _objective(problem: Problem) -> str:
    return f"{problem.objective_value().title}, measure {problem.measure}"


def _shown(value: Any, no_warp: bool = False, digits: int = 10) -> str:
    if value is None:
        return "inf (no warp)" if no_warp else "none"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def solve(problem: Problem, as_json: bool) -> int:
    """Print the optimal warp; returns 0 if it was found, otherwise 1."""
    answer = _optimum(problem)
    if as_json:
        print(json.dumps(answer, indent=2, allow_nan=False))
    else:
        table = Table(show_header=False, title=f"Optimal warp: {_objective(problem)}")
        for key in ("eta", "lambda_over_mu", "lambda", "value"):
            table.add_row(key, _shown(answer[key], answer["no_warp"]))
        table.add_row("limit", answer["no_limit_because"] or _shown(answer["limit"]))
        if answer["over_limit"] is not None:
            table.add_row("value / limit", _shown(answer["over_limit"]))
        table.add_row("outcome", answer["outcome_sentence"])
        rich.print(table)
    return 0 if warpopt.Outcome[answer["outcome"]].succeeded else 1


def rules(problem: Problem, as_json: bool) -> int:
    """Print every rule, published or from engines, and the optimum; returns 0 if it was found, otherwise 1."""
    view = _view(problem, np.radians([problem.theta_deg]))
    compared = warpopt.compare_rules(view, None, problem.objective_value())
    assert isinstance(compared.solution, warpopt.Solution)  # not a scene
    answer = _answer(problem, compared.solution, compared.bound)
    warps = warpopt.Warp.from_eta(compared.eta[:, 0], compared.solution.warp)
    over_limit = None if compared.over_bound is None else compared.over_bound[:, 0]
    rows = {
        name: {
            "lambda": finite_or_none(warps.lam[i]) if defined else None,
            "lambda_over_mu": finite_or_none(warps.lam_over_mu[i]) if defined else None,
            "no_warp": bool(defined and warps.no_warp[i]),
            "defined": bool(defined),
            "ratio": finite_or_none(compared.ratio[i, 0]),
            "over_limit": None if over_limit is None else finite_or_none(over_limit[i]),
        }
        for i, (name, defined) in enumerate(zip(compared.names, compared.defined[:, 0], strict=True))
    }
    if as_json:
        print(json.dumps({"optimum": answer, "rules": rows}, indent=2, allow_nan=False))
    else:
        table = Table(title=f"{_objective(problem)}: error over the optimum's", caption="-: not defined here")
        over_limit = [] if answer["no_limit_because"] else ["over_limit"]
        for column in ("rule", "lambda", "lambda/mu", "ratio", *(["over the limit"] if over_limit else [])):
            table.add_column(column, justify="left" if column == "rule" else "right", no_wrap=column == "rule")
        shown = ["lambda", "lambda_over_mu", "ratio", *over_limit]
        for name, row in {"optimum": answer | {"ratio": 1, "defined": True}, **rows}.items():
            cells = (
                _shown(row[key], row["no_warp"] and key.startswith("lambda"), 6) if row["defined"] else "-"
                for key in shown
            )
            table.add_row(name, *cells, style="bold" if name == "optimum" else None)
        rich.print(table)
        if answer["no_limit_because"]:
            rich.print(answer["no_limit_because"])
    return 0 if warpopt.Outcome[answer["outcome"]].succeeded else 1


def write_limit_map(problem: Problem, files: Sequence[Path]) -> int:
    """Write the best map of E_p to each of the files, all or none, and print its norm; returns 0.

    Raises:
        ConfigError: there is no map (receivers at one depth), or a target that warpopt did not write.
        OSError: a file cannot be written; all are left unchanged.
    """
    try:
        objective = warpopt.Objective("p", problem.norm, problem.measure)
        best = warpopt.lower_bound_map(_view(problem, math.radians(problem.theta_deg)), objective)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    whole_files({path: best.encoded(path) for path in files})
    optimum = _optimum(problem)["over_limit"]
    print(f"{len(best.delta)} knots; {_objective(problem)}: {best.value:.6g}")
    print(f"The optimal perspective warp's is {optimum:.4g} times that.")
    for path in files:
        print(f"Written: {path}")
    return 0

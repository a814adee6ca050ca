"""The data files of a run: `table.csv`, `table.npz`, and the rows of `run.json`."""

from pathlib import Path
from typing import Any

import numpy as np

import warpopt
from warpopt.rules.registry import PUBLISHED

from ..common.record import environment, finite_or_none, outcome_counts, write_csv
from ..frusta.solve import OptimumCurves, Sweep
from .settings import RunConfig


def write_table(sweep: Sweep, path: Path) -> None:
    """One row for each view, objective and direction; floats in Python's format, which reads back exactly."""
    head = ["theta_deg", "near", "far", "half_fov_deg", "metric", "norm", "measure", "eta", "lambda_over_mu", "lambda"]
    rows = (
        (theta, view.near, view.far, view.half_fov_deg, o.metric, o.norm, sweep.measure, *row)
        for i, view in enumerate(sweep.views)
        for o in sweep.optima
        for theta, *row in zip(sweep.theta_deg.tolist(), *(array[i].tolist() for array in _columns(o)), strict=True)
    )
    write_csv(path, [*head, "value", "limit", "over_limit", *PUBLISHED], rows)


def _columns(o: OptimumCurves) -> tuple[np.ndarray, ...]:
    return (o.eta, o.lam_over_mu, o.lam, o.value, o.limit, o.over_limit, *o.ratios.values())


def write_arrays(sweep: Sweep, path: Path) -> None:
    """The table as arrays: objectives first, then views, then directions."""
    count = len(sweep.views)

    def stacked(name: str) -> np.ndarray:
        return np.stack([getattr(o, name)[:count] for o in sweep.optima])

    views = {name: np.array([getattr(v, name) for v in sweep.views]) for name in ("near", "far", "half_fov_deg")}
    np.savez(
        path,
        allow_pickle=False,
        theta_deg=sweep.theta_deg,
        **views,
        metric=np.array([o.metric for o in sweep.optima]),
        norm=np.array([o.norm for o in sweep.optima]),
        measure=np.array(sweep.measure),
        eta=stacked("eta"),
        lambda_over_mu=stacked("lam_over_mu"),
        **{"lambda": stacked("lam")},
        value=stacked("value"),
        limit=stacked("limit"),
        over_limit=stacked("over_limit"),
        outcome=stacked("result"),
        residual=stacked("residual"),
        rule=np.array(list(PUBLISHED)),
        ratio=np.stack([np.stack([o.ratios[name][:count] for name in PUBLISHED]) for o in sweep.optima]),
    )


def run_record(config: RunConfig, sweep: Sweep, timings: dict[str, float]) -> dict[str, Any]:
    """The data needed to trust or repeat the run, as strict JSON."""
    return environment(config, sweep.optima[0].eta.dtype, timings) | {
        "objectives": [
            {
                "metric": o.metric,
                "norm": o.norm,
                "measure": sweep.measure,
                "outcomes": outcome_counts(o.result[: len(sweep.views)]),
                "no_limit_because": o.no_limit_because,
                "largest_residual": finite_or_none(o.residual[: len(sweep.views)].max()),
                "tables": [_json_table(sweep, o, i) for i in range(len(sweep.views))],
            }
            for o in sweep.optima
        ],
    }


def _json_table(sweep: Sweep, optimum: OptimumCurves, i: int) -> dict[str, Any]:
    view, over_limit = sweep.views[i], optimum.over_limit[i]
    return {
        "near": view.near,
        "far": view.far,
        "half_fov_deg": view.half_fov_deg,
        "rows": [
            {
                "theta_deg": float(sweep.theta_deg[j]),
                "eta": finite_or_none(optimum.eta[i, j]),
                "lambda_over_mu": finite_or_none(optimum.lam_over_mu[i, j]),
                "lambda": finite_or_none(optimum.lam[i, j]),
                "no_warp": bool(np.isinf(optimum.lam[i, j])),
                "value": finite_or_none(optimum.value[i, j]),
                "limit": finite_or_none(optimum.limit[i, j]),
                "over_limit": finite_or_none(over_limit[j]),
                "outcome": warpopt.Outcome(int(optimum.result[i, j])).name,
            }
            for j in range(len(sweep.theta_deg))
        ],
    }

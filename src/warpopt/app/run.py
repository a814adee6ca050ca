"""`warpopt run`: a configuration in, a folder of results out."""

import concurrent.futures
import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import warpopt

from .blocks import RULES, field_shapes
from .config import RunConfig
from .job import Job, job_of
from .names import rule_title
from .parts import Parts, folder_of
from .record import environment, outcome_counts, progress_bar, timed, write_mark
from .report import Finding, findings, report
from .single import finite_or_none
from .sweep import OptimumCurves, Sweep, sweep_of
from .writing import whole_folder

_SHOWN_RULES = ("ssm", "lispsm", "tsm")  # of the terminal's summary; the report has them all


def run(config: RunConfig, console: Console | None = None) -> int:
    """Solve, write, summarise; 0 if every problem was solved, 1 if the table, written all the same, holds failures.

    With compute.processes > 1 the processes have computed every block before: here they are merged. Finished blocks
    that an earlier run of the same job left are taken; their folder is removed when the results are in place.

    Raises:
        ConfigError: the output folder cannot be written, or is not an earlier result.
        Incomplete: with compute.processes > 1, a block is not there.
    """
    console = console or Console()
    job = job_of(config)
    folder_of_parts = folder_of(config.output.directory, job)
    several = config.compute.processes > 1
    parts = None
    if several or config.compute.keep_blocks or folder_of_parts.is_dir():
        parts = Parts(folder_of_parts, job, jax.default_backend(), field_shapes(job), console.print)
    timings: dict[str, float] = {}
    steps = (1 + len(job.objectives)) * job.tiling.count + 4 * config.output.figures
    with whole_folder(config.output.directory) as folder, progress_bar(console, steps) as progress:
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            drawing = config.output.figures and pool.submit(_view_figures, job, folder, progress)
            with timed(timings, "solve_s"):
                sweep = sweep_of(job, parts, progress, all_there=several)
            drawn = drawing.result() if drawing else {}
        write_table(sweep, folder / "table.csv")
        write_arrays(sweep, folder / "table.npz")
        with timed(timings, "figures_s"):
            figures = _sweep_figures(sweep, folder, progress, drawn) if config.output.figures else []
        found = findings(sweep)
        (folder / "report.md").write_text(report(config, sweep, found, figures), encoding="utf-8")
        write_mark(folder, run_record(config, sweep, timings))
    if parts:
        parts.delete()
    failures = sum(int((~_succeeded(o)).sum()) for o in sweep.optima)
    _summarise(console, found, config.output.directory, failures)
    return 1 if failures else 0


def _view_figures(job: Job, folder: Path, progress: Callable[[str], None]) -> dict[str, str]:
    # Imported here, in the drawing thread: matplotlib's first import on a machine looks through all its fonts.
    from .figures import write_view_figures

    return write_view_figures(job.views, folder, progress)


def _sweep_figures(
    sweep: Sweep, folder: Path, progress: Callable[[str], None], drawn: dict[str, str]
) -> list[tuple[str, str]]:
    from .figures import write_figures

    return write_figures(sweep, folder, progress, drawn)


def _succeeded(optimum: OptimumCurves) -> np.ndarray:
    return optimum.result <= warpopt.Outcome.no_warp


def write_table(sweep: Sweep, path: Path) -> None:
    """One row for each view, objective and direction; floats as Python writes them, which read back the same."""
    head = ["theta_deg", "near", "far", "half_fov_deg", "metric", "norm", "measure", "eta", "lambda_over_mu", "lambda"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*head, "value", "limit", "over_limit", *RULES])
        for i, view in enumerate(sweep.views):
            for o in sweep.optima:
                arrays = (o.eta, o.lam_over_mu, o.lam, o.value, o.limit, o.over_limit, *o.ratios.values())
                columns = zip(*(a[i].tolist() for a in arrays), strict=True)
                for theta, row in zip(sweep.theta_deg.tolist(), columns, strict=True):
                    place = (theta, view.near, view.far, view.half_fov_deg, o.metric, o.norm, sweep.measure)
                    writer.writerow([*place, *row])


def write_arrays(sweep: Sweep, path: Path) -> None:
    """The table as arrays: objectives first, then views, then directions."""
    count = len(sweep.views)

    def stacked(name: str) -> np.ndarray:
        return np.stack([getattr(o, name)[:count] for o in sweep.optima])

    views = {name: np.array([getattr(v, name) for v in sweep.views]) for name in ("near", "far", "half_fov_deg")}
    np.savez(
        path,
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
        rule=np.array(list(RULES)),
        ratio=np.stack([np.stack([o.ratios[name][:count] for name in RULES]) for o in sweep.optima]),
    )


def run_record(config: RunConfig, sweep: Sweep, timings: dict[str, float]) -> dict[str, Any]:
    """What a later reader needs to trust or repeat the run; strict JSON."""
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


def _summarise(console: Console, found: list[Finding], directory: Path, failures: int) -> None:
    table = Table(title="Worst ratio of error to optimal error, over all directions")
    for column in ("f/n", "half fov", "objective", "no warp is optimal for", *map(rule_title, _SHOWN_RULES)):
        table.add_column(column, justify="right")
    for f in found:
        worst = (f"{f.worst[name][0]:.4g}" for name in _SHOWN_RULES)
        table.add_row(f"{f.depth_ratio:g}", f"{f.half_fov_deg:g}", f"E_{f.metric} {f.norm}", f.no_warp, *worst)
    console.print(table)
    if failures:
        console.print(
            f"{failures} problem(s) failed; the outcome column of run.json tells which and why.", style="bold red"
        )
    console.print(f"Written: {directory}{'/' if directory.name else ''}report.md, table.csv, table.npz, run.json")

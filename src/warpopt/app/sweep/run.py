"""`warpopt run`: solves a configuration and writes a folder of results."""

import concurrent.futures
from collections.abc import Callable
from pathlib import Path

import jax
from rich.console import Console
from rich.table import Table

from warpopt.rules.registry import rule_title

from ..common.output import whole_folder
from ..common.record import progress_bar, timed, write_mark
from ..frusta.block_files import BlockFiles, folder_of
from ..frusta.block_solver import field_shapes
from ..frusta.problem import SweepProblem
from ..frusta.solve import Sweep, sweep_of
from .report import Finding, findings, report
from .settings import RunConfig
from .tables import run_record, write_arrays, write_table

_SHOWN_RULES = ("ssm", "lispsm", "tsm")  # shown in the terminal's summary; the report has all


def run(config: RunConfig, console: Console | None = None) -> int:
    """Solve, write, summarise; returns 0 if every problem was solved, 1 if the table, still written, contains failures.

    With compute.processes > 1 the processes have computed every block already: here they are merged. Finished blocks of
    an earlier run of the same problem are reused; their folder is removed when the results are in place.

    Raises:
        ConfigError: the output folder cannot be written, or is not an existing result.
        Incomplete: with compute.processes > 1, a block is missing.
    """
    console = console or Console()
    problem = config.problem()
    kept = folder_of(config.output.directory, problem)
    several = config.compute.processes > 1
    files = None
    if several or config.compute.keep_blocks or kept.is_dir():
        files = BlockFiles(kept, problem, jax.default_backend(), field_shapes(problem), console.print)
    timings: dict[str, float] = {}
    steps = (1 + len(problem.objectives)) * problem.tiling.count + 4 * config.output.figures
    with whole_folder(config.output.directory) as folder, progress_bar(console, steps) as progress:
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            drawing = config.output.figures and pool.submit(_view_figures, problem, folder, progress)
            with timed(timings, "solve_s"):
                sweep = sweep_of(problem, files, progress, all_there=several)
            drawn = drawing.result() if drawing else {}
        write_table(sweep, folder / "table.csv")
        write_arrays(sweep, folder / "table.npz")
        with timed(timings, "figures_s"):
            figures = _sweep_figures(sweep, folder, progress, drawn) if config.output.figures else []
        found = findings(sweep)
        (folder / "report.md").write_text(report(config, sweep, found, figures), encoding="utf-8")
        write_mark(folder, run_record(config, sweep, timings))
    if files:
        files.delete()
    failures = sum(int(o.failed.sum()) for o in sweep.optima)
    _summarise(console, found, config.output.directory, failures)
    return 1 if failures else 0


def _view_figures(problem: SweepProblem, folder: Path, progress: Callable[[str], None]) -> dict[str, str]:
    # Imported here, in the drawing thread: matplotlib's first import on a machine scans all fonts.
    from .figures import write_view_figures

    return write_view_figures(problem.views, folder, progress)


def _sweep_figures(
    sweep: Sweep, folder: Path, progress: Callable[[str], None], drawn: dict[str, str]
) -> list[tuple[str, str]]:
    from .figures import write_figures

    return write_figures(sweep, folder, progress, drawn)


def _summarise(console: Console, found: list[Finding], directory: Path, failures: int) -> None:
    table = Table(title="Worst ratio of error to optimal error, over all directions")
    for column in ("f/n", "half fov", "objective", "eta = 1 minimises for", *map(rule_title, _SHOWN_RULES)):
        table.add_column(column, justify="right")
    for f in found:
        worst = (f"{f.worst[name][0]:.4g}" for name in _SHOWN_RULES)
        table.add_row(f"{f.depth_ratio:g}", f"{f.half_fov_deg:g}", f"E_{f.metric} {f.norm}", f.no_warp, *worst)
    console.print(table)
    if failures:
        console.print(
            f"{failures} problem(s) failed; the outcome column of run.json says which and why.", style="bold red"
        )
    console.print(f"Written: {directory}{'/' if directory.name else ''}report.md, table.csv, table.npz, run.json")

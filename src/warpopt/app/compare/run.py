"""`warpopt compare`: writes a folder with each rule's error compared with the optimum and the limit."""

from collections.abc import Callable, Mapping
from pathlib import Path

import jax
from rich.console import Console
from rich.table import Table

from warpopt.compare.rule_set import RuleError
from warpopt.rules.registry import EVERY, rule_title

from ..common.output import whole_folder
from ..common.record import environment, outcome_counts, progress_bar, timed, write_json, write_mark
from ..common.settings import ConfigError
from ..inputs.scene_files import SceneInput
from .report import compare_report, ratio_text
from .settings import CompareConfig, SceneCompareConfig
from .solve import Compared, compare_over_frustum, compare_over_scene
from .splits import compare_splits
from .tables import compare_record, write_compare_table, write_ranking, write_split_table


def run_compare(
    config: CompareConfig | SceneCompareConfig,
    own: Mapping[str, Callable],
    scene: SceneInput | None,
    console: Console | None = None,
) -> int:
    """Compare, write, summarise; returns 0 if every optimum was found, otherwise 1.

    Args:
        config: of a view frustum, or of a scene, which also needs `scene`.
        scene: the scene as numbers.
        own: the user's rules.

    Raises:
        ConfigError: a user's rule returns no valid warp, or the output folder cannot be written.
    """
    console = console or Console()
    rules = {name: EVERY[name] for name in config.rules.names} | dict(own)
    objective = config.objective
    count = len(objective.objectives()) * (1 if scene is None else len(scene.cameras))
    count += len(objective.objectives()) if config.cascades is not None else 0
    with whole_folder(config.output.directory) as folder, progress_bar(console, count + 1) as progress:
        timings = {}
        try:
            with timed(timings, "solve_s"):
                if isinstance(config, CompareConfig):
                    compared = compare_over_frustum(config, rules, progress)
                else:
                    assert scene is not None  # given with a scene's configuration
                    compared = compare_over_scene(config, scene, rules, progress)
        except RuleError as error:
            raise ConfigError(str(error)) from error
        with timed(timings, "cascades_s"):
            splits = compare_splits(config, scene, progress)
        with timed(timings, "figures_s"):
            figures = []
            if config.output.figures and compared:
                # Imported here: matplotlib's first import on a machine scans all fonts.
                from .figures import write_compare_figures
                from .split_figure import write_split_figure

                figures = write_compare_figures(compared, folder) + write_split_figure(splits, folder)
                progress("figures")
        write_compare_table(compared, folder / "compare.csv")
        write_ranking(compared, folder / "ranking.csv")
        if splits:
            write_split_table(splits, folder / "splits.csv")
        write_json(folder / "compare.json", compare_record(config, compared, splits, scene))
        (folder / "report.md").write_text(compare_report(config, compared, splits, figures), encoding="utf-8")
        outcomes = outcome_counts([c.result.solution.result for c in compared])
        write_mark(folder, environment(config, jax.numpy.zeros(0).dtype, timings) | {"outcomes": outcomes})
    failures = sum(int(c.result.failed.sum()) for c in compared)
    for note in () if scene is None else scene.notes:
        console.print(note, soft_wrap=True, markup=False)
    _summarise(console, config.output.directory, compared, failures)
    return 1 if failures else 0


def _summarise(console: Console, directory: Path, compared: list[Compared], failures: int) -> None:
    table = Table(title="Error over the optimal error: mean, and worst")
    table.add_column("rule")
    for c in compared:
        table.add_column(c.title, justify="right")
    for name in compared[0].result.order() if compared else ():
        cells = (f"{ratio_text(c.result.mean(name))}, {ratio_text(c.result.worst(name).ratio)}" for c in compared)
        table.add_row(rule_title(name), *cells)
    if compared:
        console.print(table)
    else:
        console.print("The sun is below the horizon all the time: there is nothing to compare.")
    if failures:
        console.print(f"{failures} problem(s) failed; compare.json says which and why.", style="bold red")
    console.print(f"Written: {directory}: report.md, ranking.csv, compare.csv, compare.json, run.json", soft_wrap=True)

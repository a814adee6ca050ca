"""`warpopt compare`: rules in, a folder that says what each loses against the optimum and the limit."""

import csv
import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import warpopt
from warpopt.compare.rule_set import KNOWN, RuleError

from .compare_config import CompareConfig, SceneCompareConfig
from .compare_report import compare_report, ratio_text
from .config import ConfigError
from .job import objectives
from .names import rule_title
from .record import environment, outcome_counts, progress_bar, timed, write_json, write_mark
from .scene_input import SceneInput
from .scene_solve import camera_of, receivers_of
from .single import finite_or_none
from .writing import whole_folder

_COLUMNS = (
    "theta_deg",
    "eta",
    "defined",
    "worse_than_no_warp",
    "value",
    "over_optimum",
    "over_limit",
    "optimum",
    "limit",
)
_OVER = ("optimum", "limit", "no_warp")


@dataclasses.dataclass(frozen=True, eq=False)
class Compared:
    """One objective, over a view frustum or a scene's camera.

    Attributes:
        metric, norm: the objective.
        camera: index of the scene's distinct ones; None over a view frustum.
        result: the numbers.
    """

    metric: str
    norm: str
    camera: int | None
    result: "warpopt.Comparison"

    @property
    def title(self) -> str:
        where = "" if self.camera is None else f", camera {self.camera}"
        return f"E_{self.metric}, norm {self.norm}{where}"


def run_compare(
    config: CompareConfig | SceneCompareConfig,
    own: Mapping[str, Callable],
    scene: SceneInput | None,
    console: Console | None = None,
) -> int:
    """Compare, write, summarise; 0 if every optimum was found, 1 if not.

    Args:
        config: of a view frustum, or of a scene, which comes with
        scene: in numbers.
        own: the user's rules.

    Raises:
        ConfigError: a user's rule does not answer as one, or the output folder cannot be written.
    """
    console = console or Console()
    rules = {name: KNOWN[name] for name in config.rules.names} | dict(own)
    objective = config.objective
    count = len(objective.metrics) * len(objective.norms) * (1 if scene is None else len(scene.cameras))
    with whole_folder(config.output.directory) as folder, progress_bar(console, count + 1) as progress:
        timings = {}
        try:
            with timed(timings, "solve_s"):
                compared = (
                    _frustum(config, rules, progress) if scene is None else _scene(config, scene, rules, progress)
                )
        except RuleError as error:
            raise ConfigError(str(error)) from error
        with timed(timings, "figures_s"):
            figures = []
            if config.output.figures and compared:
                # Imported here: matplotlib's first import on a machine looks through all its fonts.
                from .compare_figures import write_compare_figures

                figures = write_compare_figures(compared, folder)
                progress("figures")
        write_compare_table(compared, folder / "compare.csv")
        write_ranking(compared, folder / "ranking.csv")
        write_json(folder / "compare.json", compare_record(config, compared, scene))
        (folder / "report.md").write_text(compare_report(config, compared, figures), encoding="utf-8")
        outcomes = outcome_counts([np.asarray(c.result.solution.result) for c in compared])
        write_mark(folder, environment(config, jax.numpy.zeros(0).dtype, timings) | {"outcomes": outcomes})
    failures = sum(int(c.result.failed.sum()) for c in compared)
    _summarise(console, config.output.directory, compared, failures)
    return 1 if failures else 0


def _frustum(config: CompareConfig, rules: dict[str, Callable], progress: Callable[[str], None]) -> list[Compared]:
    view, objective = config.view, config.objective
    frustum = warpopt.ViewFrustum(view.near, view.far, math.radians(view.half_fov_deg))
    theta = np.deg2rad(config.light.values())
    compared = []
    for metric, norm in objectives(objective.metrics, objective.norms):
        result = warpopt.compare_rules(frustum, theta, rules, metric, norm, objective.measure)
        compared.append(Compared(metric, str(norm), None, result))
        progress(compared[-1].title)
    return compared


def _scene(
    config: SceneCompareConfig, scene: SceneInput, rules: dict[str, Callable], progress: Callable[[str], None]
) -> list[Compared]:
    if not scene.lights:
        return []
    objective = config.objective
    lights = jax.vmap(warpopt.DirectionalLight)(np.array(scene.lights, float))
    compared = []
    for metric, norm in objectives(objective.metrics, objective.norms):
        for i, camera in enumerate(scene.cameras):
            result = warpopt.compare_scene_rules(
                camera_of(camera), lights, receivers_of(config, scene, i), rules, metric, norm,
                screen=objective.screen, shadow_map=objective.shadow_map, min_eta=objective.min_eta,
            )  # fmt: skip
            compared.append(Compared(metric, str(norm), i, result))
            progress(compared[-1].title)
    return compared


def write_compare_table(compared: list[Compared], path: Path) -> None:
    """One row for each objective, rule and direction; empty where there is no number."""
    place = ("camera", "light") if compared and compared[0].camera is not None else ()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["metric", "norm", *place, "rule", *_COLUMNS])
        for c in compared:
            r = c.result
            many = {"eta": r.eta, "defined": r.defined, "worse_than_no_warp": r.worse, "value": r.values}
            many |= {"over_optimum": r.ratio, "over_limit": r.over_limit}
            each = {"theta_deg": np.rad2deg(r.theta), "optimum": np.asarray(r.solution.value), "limit": r.limit}
            for i, name in enumerate(r.names):
                columns = [_column(many[n], i) if n in many else _column(each[n], None) for n in _COLUMNS]
                for k in range(len(r.theta)):
                    where = (c.camera, k) if place else ()
                    writer.writerow([c.metric, c.norm, *where, name, *("" if v is None else v[k] for v in columns)])


def write_ranking(compared: list[Compared], path: Path) -> None:
    """One row for each objective and rule, in the ranking's order; "inf" for what is unbounded, empty for no number."""
    scene = bool(compared) and compared[0].camera is not None
    heads = ["metric", "norm", *(["camera"] if scene else []), "place", "rule", "mean_over_optimum"]
    for over in _OVER:
        heads += [f"worst_over_{over}", f"at_theta_deg_over_{over}", *([f"at_light_over_{over}"] if scene else [])]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        for c in compared:
            ranking = c.result.ranking()
            for place, name in enumerate(c.result.order(), 1):
                row = [place if name in ranking else "", name, _cell(c.result.mean(name))]
                for over in _OVER:
                    ratio, theta, index = c.result.worst(name, over)
                    row += [_cell(ratio), _cell(np.rad2deg(theta)), *([index if index >= 0 else ""] if scene else [])]
                writer.writerow([c.metric, c.norm, *([c.camera] if scene else []), *row])


def _cell(value: float) -> float | str:
    return "" if math.isnan(value) else float(value)


def _column(values: np.ndarray | None, i: int | None) -> list | None:
    if values is None:
        return None
    row = values if i is None else values[i]
    return row.tolist() if row.dtype == bool else [v if math.isfinite(v) else "" for v in row.tolist()]


def compare_record(config: CompareConfig | SceneCompareConfig, compared: list[Compared], scene: SceneInput | None):
    """Everything; strict JSON."""
    lights = {} if scene is None else {"lights": [list(direction) for direction in scene.lights]}
    measure = {"measure": config.objective.measure} if isinstance(config, CompareConfig) else {}
    return {**lights, "objectives": [measure | _objective(c) for c in compared]}


def _objective(c: Compared) -> dict[str, Any]:
    r = c.result
    solution = r.solution
    return {
        "metric": c.metric,
        "norm": c.norm,
        "camera": c.camera,
        "theta_deg": np.rad2deg(r.theta).tolist(),
        "optimum": {
            "eta": _numbers(solution.warp.eta),
            "value": _numbers(solution.value),
            "outcome": [warpopt.Outcome(int(v)).name for v in np.asarray(solution.result)],
        },
        "limit": None if r.limit is None else _numbers(r.limit),
        "no_limit_because": r.no_limit_because,
        "no_warp": _numbers(r.unwarped),
        "ranking": r.ranking(),
        "rules": {name: _rule(r, i, name) for i, name in enumerate(r.names)},
    }


def _rule(r: "warpopt.Comparison", i: int, name: str) -> dict[str, Any]:
    regions = r.regions or {}
    return {
        "eta": _numbers(r.eta[i]),
        "defined": r.defined[i].tolist(),
        "value": _numbers(r.values[i]),
        "over_optimum": _numbers(r.ratio[i]),
        "over_limit": None if r.over_limit is None else _numbers(r.over_limit[i]),
        "worse_than_no_warp": r.worse[i].tolist(),
        "mean_over_optimum": finite_or_none(r.mean(name)),
        **{f"worst_over_{over}": _worst(r, name, over) for over in _OVER},
        "regions_deg": {kind: np.rad2deg(np.array(of[name])).tolist() for kind, of in regions.items()} or None,
    }


def _worst(r: "warpopt.Comparison", name: str, over: str) -> dict[str, Any] | None:
    worst = r.worst(name, over)
    if worst.index < 0:
        return None
    place = {"theta_deg": float(np.rad2deg(worst.theta)), "nearest": worst.index}
    return {"ratio": finite_or_none(worst.ratio), "unbounded": math.isinf(worst.ratio), **place}


def _numbers(values: Any) -> list[float | None]:
    return [finite_or_none(v) for v in np.asarray(values).tolist()]


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
        console.print(f"{failures} problem(s) failed; compare.json tells which and why.", style="bold red")
    console.print(f"Written: {directory}: report.md, ranking.csv, compare.csv, compare.json, run.json", soft_wrap=True)

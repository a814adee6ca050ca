"""`warpopt cascades`: plans and other splits, their errors, a report, tables and figures in a folder."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from ..common.output import whole_folder
from ..common.record import environment, finite_or_none, timed, write_csv, write_json, write_mark
from ..common.settings import ConfigError
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import under_light, views_of
from ..splits.plans import splits_of
from ..splits.settings import BEST
from .numbers import ByNumber, Texels, errors_by_number, frustum_view, texels, texels_of_scene
from .report import HEADS, cascades_report, lines_of
from .rows import Config, Row, objective_of
from .settings import CascadesConfig

COLUMNS = (
    "camera", "light", "splits", "over", "warped", "value", "over_best", "lower", "largest_ratio", "cascade", "start",
    "end", "eta", "error",
)  # fmt: skip


def run_cascades(config: Config, scene: SceneInput | None, console: Console | None = None) -> int:
    """Split, compare, write, summarise; returns 0.

    Raises:
        ConfigError: the output folder cannot be written, or a scene that cannot be split.
    """
    console = console or Console()
    timings: dict[str, float] = {}
    with whole_folder(config.output.directory) as folder:
        with timed(timings, "solve_s"):
            views = _views(config, scene)
            rows = [row for place, view in views.items() for row in _rows(config, scene, *place, view)]
            if isinstance(config, CascadesConfig):
                numbers, totals = errors_by_number(config), texels(config)
            else:
                numbers, totals = [], texels_of_scene(config, views)
        figures: list[tuple[str, str]] = []
        if config.output.figures:
            from .figures import write_figures  # matplotlib's first import on a machine scans all fonts

            with timed(timings, "figures_s"):
                figures = write_figures(config, scene, rows, numbers, totals, folder)
        _write(config, scene, rows, numbers, folder)
        _write_texels(totals, folder)
        report = cascades_report(config, scene, rows, figures, numbers, totals)
        (folder / "report.md").write_text(report, encoding="utf-8")
        write_mark(folder, environment(config, jax.numpy.zeros(0).dtype, timings))
    _summarise(console, config, rows)
    return 0


def _views(config: Config, scene: SceneInput | None) -> dict[tuple[int, int], Any]:
    """By (camera, light)."""
    if isinstance(config, CascadesConfig):
        return {(0, 0): frustum_view(config)}
    assert scene is not None  # read with the configuration
    if not scene.lights:
        raise ConfigError("light: got a sun below the horizon, expected one that shines")
    views = views_of(config, scene)
    return {(i, k): under_light(view, k) for i, view in enumerate(views) for k in range(len(scene.lights))}


def _rows(config: Config, scene: SceneInput | None, camera: int, light: int, view: Any) -> list[Row]:
    asked, seen = config.cascades, None if scene is None else scene.cameras[camera]
    made = splits_of(view, asked, objective_of(config), seen, asked.step)
    best = float(made[0].plan.value)
    return [Row(one.name, one.over, one.warped, one.plan, camera, light, best) for one in made]


def _write(config: Config, scene: SceneInput | None, rows: list[Row], numbers: list[ByNumber], folder: Path) -> None:
    lines = []
    for row in rows:
        plan, same = row.plan, (row.camera, row.light, row.name, row.over, row.warped, float(row.plan.value), row.lost,
                                finite_or_none(row.plan.lower), row.largest_ratio)  # fmt: skip
        for k in range(plan.errors.shape[-1]):
            each = k, plan.starts[k], plan.splits[k + 1], plan.warps.eta[k], plan.errors[k]
            lines.append([*same, *map(finite_or_none, each)])
    write_csv(folder / "cascades.csv", COLUMNS, lines)
    write_json(folder / "cascades.json", [_record(row, scene, config.cascades.warp) for row in rows])
    if numbers:
        lines = [
            (scheme.name, warped, maps, value)
            for scheme in numbers
            for warped, values in ((True, scheme.warped), (False, scheme.plain))
            for maps, value in values.items()
        ]
        write_csv(folder / "counts.csv", ("splits", "warped", "maps", "over_best"), lines)


def _write_texels(totals: list[Texels], folder: Path) -> None:
    if totals:
        lines = [
            (at.theta_deg, at.camera, at.light, warped, maps + 1, value)
            for at in totals
            for warped, values in ((True, at.warped), (False, at.plain))
            for maps, value in enumerate(values.tolist())
        ]
        heads = ("theta_deg", "camera", "light", "warped", "maps", "texels_over_bound")
        write_csv(folder / "texels.csv", heads, lines)


def _record(row: Row, scene: SceneInput | None, warp: bool) -> dict[str, Any]:
    """What JSON has of a row; of the best splits OpenGL's matrices too, with the scene's triangles as casters."""
    plan = row.plan
    told = {
        "camera": row.camera, "light": row.light, "splits_by": row.name, "over": row.over, "warped": row.warped,
        "splits": np.asarray(plan.splits).tolist(), "starts": np.asarray(plan.starts).tolist(),
        "eta": [finite_or_none(v) for v in plan.warps.eta], "errors": [finite_or_none(v) for v in plan.errors],
        "value": finite_or_none(plan.value), "over_best": finite_or_none(np.asarray(row.lost)),
        "lower": finite_or_none(plan.lower), "lower_because": plan.lower_because,
    }  # fmt: skip
    if scene is not None:
        told["direction"] = list(scene.lights[row.light])
    if scene is not None and row.name == BEST and row.warped == warp:
        matrices, _ = plan.matrices(casters=scene.triangles)
        told["matrices"] = [m.tolist() if np.isfinite(m).all() else None for m in np.asarray(matrices)]
    return told


def _summarise(console: Console, config: Config, rows: list[Row]) -> None:
    table = Table(title=f"{config.cascades.count} cascades")
    for head in HEADS:
        table.add_column(head, justify="left" if head in HEADS[:2] else "right")
    for camera in dict.fromkeys(row.camera for row in rows):
        for line in lines_of([row for row in rows if row.camera == camera]):
            table.add_row(*line)
    console.print(table)
    console.print(f"Written: {config.output.directory}: report.md, cascades.csv, cascades.json", soft_wrap=True)

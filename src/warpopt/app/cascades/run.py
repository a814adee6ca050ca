"""`warpopt cascades`: plans and other splits, their errors, a report, tables and figures in a folder."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import warpopt
from warpopt.cascades import splits
from warpopt.cascades.counts import in_world

from ..common.output import whole_folder
from ..common.record import environment, finite_or_none, timed, write_csv, write_json, write_mark
from ..common.settings import ConfigError
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import under_light, views_of
from .report import HEADS, cascades_report, lines_of
from .rows import BEST, Config, Row, objective_of
from .settings import CascadesConfig

COLUMNS = (
    "camera", "splits", "over", "warped", "value", "over_best", "lower", "largest_ratio", "cascade", "start", "end",
    "eta", "error",
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
            rows = [row for k, view in enumerate(_views(config, scene)) for row in _rows(config, scene, k, view)]
        figures: list[tuple[str, str]] = []
        if config.output.figures:
            from .figures import write_figures  # matplotlib's first import on a machine scans all fonts

            with timed(timings, "figures_s"):
                figures = write_figures(config, rows, folder)
        _write(config, scene, rows, figures, folder)
        write_mark(folder, environment(config, jax.numpy.zeros(0).dtype, timings))
    _summarise(console, config, rows)
    return 0


def _views(config: Config, scene: SceneInput | None) -> list[Any]:
    if isinstance(config, CascadesConfig):
        frustum = warpopt.ViewFrustum(config.view.near, config.view.far, np.deg2rad(config.view.half_fov_deg))
        return [warpopt.FrustumView(frustum, np.deg2rad(config.light.theta_deg))]
    assert scene is not None  # read with the configuration
    if not scene.lights:
        raise ConfigError("light: got a sun below the horizon, expected one that shines")
    return [under_light(view, 0) for view in views_of(config, scene)]


def _rows(config: Config, scene: SceneInput | None, camera: int, view: Any) -> list[Row]:
    asked, objective = config.cascades, objective_of(config)
    more = {"overlap": asked.overlap, "shares": asked.shares}
    try:
        best = warpopt.cascades.plan(view, asked.count, objective, warp=asked.warp, **more)
    except ValueError as error:
        raise ConfigError(f"cascades: {error}") from None
    value = float(best.value)
    near, far = float(best.splits[0]), float(best.splits[-1])
    rows = [Row(camera, BEST, "receivers", asked.warp, best, value)]
    if asked.warp:
        plain = warpopt.cascades.plan(view, asked.count, objective, warp=False, **more)
        rows.append(Row(camera, BEST, "receivers", False, plain, value))
    ranges = {"receivers": (near, far)}
    if scene is not None:
        seen = scene.cameras[camera]
        if seen.near < near * (1 - 1e-9) or far * (1 + 1e-9) < seen.far < np.inf:
            ranges["planes"] = seen.near, (seen.far if np.isfinite(seen.far) else far)
    for over, ends in ranges.items():
        for name in asked.beside:
            made = _split(name, *ends, asked.count)
            if made is None or not near < far:
                continue
            for warped in (True, False) if asked.warp else (False,):
                told = warpopt.cascades.errors(view, made, objective, warp=warped, **more)
                rows.append(Row(camera, name, over, warped, told, value))
    return rows


def _split(name: str, near: float, far: float, count: int) -> np.ndarray | None:
    """None where an engine has no default for this number of cascades, or this range."""
    scheme = (splits.SCHEMES | splits.ENGINES)[name]
    try:
        return np.asarray(scheme(near, far, count))
    except ValueError:
        return None


def _write(
    config: Config, scene: SceneInput | None, rows: list[Row], figures: list[tuple[str, str]], folder: Path
) -> None:  # fmt: skip
    lines = []
    for row in rows:
        plan, same = row.plan, (row.camera, row.name, row.over, row.warped, float(row.plan.value), row.lost,
                                finite_or_none(row.plan.lower), row.largest_ratio)  # fmt: skip
        for k in range(plan.errors.shape[-1]):
            each = k, plan.starts[k], plan.splits[k + 1], plan.warps.eta[k], plan.errors[k]
            lines.append([*same, *map(finite_or_none, each)])
    write_csv(folder / "cascades.csv", COLUMNS, lines)
    write_json(folder / "cascades.json", [_record(row) for row in rows])
    report = cascades_report(config, rows, figures, _storage(config, rows))
    (folder / "report.md").write_text(report, encoding="utf-8")


def _record(row: Row) -> dict[str, Any]:
    plan = row.plan
    told = {
        "camera": row.camera, "splits_by": row.name, "over": row.over, "warped": row.warped,
        "splits": np.asarray(plan.splits).tolist(), "starts": np.asarray(plan.starts).tolist(),
        "eta": [finite_or_none(v) for v in plan.warps.eta], "errors": [finite_or_none(v) for v in plan.errors],
        "value": finite_or_none(plan.value), "over_best": finite_or_none(np.asarray(row.lost)),
        "lower": finite_or_none(plan.lower), "lower_because": plan.lower_because,
    }  # fmt: skip
    if plan.views is not None and row.name == BEST and row.warped:
        matrices, _ = plan.matrices()
        told["matrices"] = [m.tolist() if np.isfinite(m).all() else None for m in np.asarray(matrices)]
    return told


def _storage(config: Config, rows: list[Row]) -> dict[str, Any] | None:
    """Texels against the number of maps, over a frustum, and the bound that no maps can better."""
    if not isinstance(config, CascadesConfig):
        return None
    (view,) = _views(config, None)
    bound = float(warpopt.lower_bound(in_world(view), warpopt.Objective("storage")))
    warped, plain = (np.asarray(warpopt.cascades.count(view, warp=warp)[1]) for warp in (True, False))
    return {"bound": bound, "warped": (warped / bound).tolist(), "plain": (plain / bound).tolist()}


def _summarise(console: Console, config: Config, rows: list[Row]) -> None:
    table = Table(title=f"{config.cascades.count} cascades")
    for head in HEADS:
        table.add_column(head, justify="left" if head in HEADS[:2] else "right")
    for camera in dict.fromkeys(row.camera for row in rows):
        for line in lines_of([row for row in rows if row.camera == camera]):
            table.add_row(*line)
    console.print(table)
    console.print(f"Written: {config.output.directory}: report.md, cascades.csv, cascades.json", soft_wrap=True)

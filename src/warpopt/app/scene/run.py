"""`warpopt scene`: solves a scene and writes a folder with warps, matrices and error maps."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from ..common.output import whole_folder
from ..common.record import (
    environment,
    finite_or_none,
    outcome_counts,
    progress_bar,
    timed,
    write_csv,
    write_json,
    write_mark,
)
from ..inputs.scene_files import SceneInput
from ..inputs.scene_settings import BoxReceivers
from .report import scene_report, short, unmapped_words
from .settings import SceneConfig
from .solve import Solved, solve_scene
from .stable import COLUMNS, courses, followed

_COLUMNS = (
    "camera", "light", "x", "y", "z", "theta_deg", "metric", "norm", "eta", "lambda", "lambda_over_mu", "mu", "value",
    "unwarped", "limit", "over_limit", "margin", "excess", "turn_deg", "unturned", "outcome",
)  # fmt: skip
_SHOWN = {
    "camera": "camera",
    "light": "light",
    "metric": "metric",
    "norm": "norm",
    "theta_deg": "theta",
    "lambda_over_mu": "λ/μ",
    "value": "error",
    "unwarped": "no warp",
    "outcome": "outcome",
}
_MOST_SHOWN = 24  # problems shown in the terminal; the report has all


def run_scene(
    config: SceneConfig, scene: SceneInput, casters: np.ndarray | BoxReceivers | None, console: Console | None = None
) -> int:
    """Solve, write, summarise; returns 0 if every problem was solved and has its matrix, otherwise 1.

    Raises:
        ConfigError: the output folder cannot be written, or is not an existing result.
    """
    console = console or Console()
    objective = config.objective
    count = len(scene.cameras) * len(scene.lights) * len(objective.objectives())
    count += sum(map(len, courses(config, scene))) if config.stable is not None else 0
    with whole_folder(config.output.directory) as folder, progress_bar(console, count) as progress:
        timings = {}
        with timed(timings, "solve_s"):
            solved = solve_scene(config, scene, casters, progress)
        with timed(timings, "figures_s"):
            figures = _figures(config, scene, solved, folder) if config.output.figures and solved else []
        rows = []
        if config.stable is not None:
            with timed(timings, "stable_s"):
                rows = followed(config, scene, casters, progress)
            write_csv(folder / "window.csv", COLUMNS, ([row[name] for name in COLUMNS] for row in rows))
        write_json(folder / "scene.json", _scene_record(config, scene, solved, rows))
        write_scene_table(solved, folder / "table.csv")
        (folder / "report.md").write_text(scene_report(config, scene, solved, figures, rows), encoding="utf-8")
        used = ("OpenEXR",) if _exr(config) else ()
        outcomes = outcome_counts([s.outcome for s in solved])
        dtype = jax.numpy.zeros(0).dtype
        write_mark(folder, environment(config, dtype, timings, used) | {"outcomes": outcomes})
    failures = sum(not s.outcome.succeeded for s in solved)
    _summarise(console, config, scene, solved, failures)
    return 1 if failures or any(s.unmapped for s in solved) else 0


def _figures(config: SceneConfig, scene: SceneInput, solved: list[Solved], folder: Path) -> list[tuple[str, str]]:
    # Imported here: matplotlib's first import on a machine scans all fonts.
    from .figures import write_scene_figures

    return write_scene_figures(config, scene, solved, folder)


def write_scene_table(solved: list[Solved], path: Path) -> None:
    """One row for each problem; empty if there is no number, lambda = inf for no warp."""
    rows = []
    for s in solved:
        row = s.row | dict(zip("xyz", s.row["direction"], strict=True))
        if row["no_warp"]:
            row |= {"lambda": "inf", "lambda_over_mu": "inf"}
        rows.append([row[name] for name in _COLUMNS])
    write_csv(path, _COLUMNS, rows)


def _scene_record(
    config: SceneConfig, scene: SceneInput, solved: list[Solved], rows: list[dict[str, Any]]
) -> dict[str, Any]:  # fmt: skip
    """The whole solution, as strict JSON."""
    return {
        "convention": {
            "name": config.output.convention,
            "reversed_z": config.output.reversed_z,
            "vectors": "row" if config.output.convention == "direct3d" else "column",
        },
        "cameras": [
            {
                "position": camera.position.tolist(),
                "right": camera.rotation[0].tolist(),
                "up": camera.rotation[1].tolist(),
                "forward": camera.rotation[2].tolist(),
                "near": camera.near,
                "far": finite_or_none(camera.far),
                "window": list(camera.window),
                "projection": "orthographic" if camera.is_orthographic else "perspective",
            }
            for camera in scene.cameras
        ],
        "camera_of": scene.camera_of,
        "lights": [list(direction) for direction in scene.lights],
        "steps": [dataclasses.asdict(step) for step in scene.steps],
        "notes": scene.notes,
        "problems": [s.row for s in solved],
    } | ({"window": rows} if config.stable is not None else {})


def _exr(config: SceneConfig) -> bool:
    depth = config.receivers.depth
    return depth is not None and any(file.suffix.lower() == ".exr" for file in depth.files)


def _summarise(console: Console, config: SceneConfig, scene: SceneInput, solved: list[Solved], failures: int) -> None:
    table = Table(title="Optimal warps")
    for name, head in _SHOWN.items():
        table.add_column(head, justify="left" if name == "outcome" else "right")
    for s in solved[:_MOST_SHOWN]:
        table.add_row(*(short(s.row, name) for name in _SHOWN))
    if solved:
        console.print(table)
    if len(solved) > _MOST_SHOWN:
        console.print(f"... and {len(solved) - _MOST_SHOWN} more in table.csv")
    for note in scene.notes:
        console.print(note, soft_wrap=True, markup=False)
    if not scene.lights:
        console.print("The sun is below the horizon all the time: there is nothing to solve.")
    if failures:
        console.print(f"{failures} problem(s) failed; scene.json says which and why.", style="bold red")
    for words in unmapped_words(solved):
        console.print(words, style="bold red", soft_wrap=True, markup=False)
    console.print(f"Written: {config.output.directory}: report.md, scene.json, table.csv, run.json", soft_wrap=True)

"""`warpopt frames`: renders and measures every frame, and writes a folder of pictures, a table and a report."""

import csv
import dataclasses
import io
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from warpopt.frames import Frame, LitScene, ShadowMap, measured, see
from warpopt.frames.cascade_fits import Cascaded, fit_cascades, maps_of
from warpopt.frames.cascaded_map import CascadedMap
from warpopt.frames.fits import SCAN, Fitted, Fitting
from warpopt.frames.names import cascades_of, title_of
from warpopt.frames.paths import path

from ...scene_files.scene_camera import SceneCamera
from ..common.output import whole_folder
from ..common.record import environment, progress_bar, timed, write_csv, write_mark
from ..inputs.scene_files import SceneInput
from .parts import Parts
from .report import frames_report, summary
from .settings import FramesConfig

COLUMNS = (
    "frame", "camera", "light", "theta_deg", "warp", "eta", "splits", "wrong", "false", "missing", "filtered", "far",
    "judged", "away", "grazing", "background", "excluded",
)  # fmt: skip


FLICKER = ("method", "static", "flicker", "frames", "compared", "refits", "worst_pop")


@dataclasses.dataclass(frozen=True)
class Place:
    """One frame of the run: its number, camera and light."""

    number: int
    camera: int
    light: int


def run_frames(config: FramesConfig, scene: SceneInput, console: Console | None = None) -> int:
    """Render, measure, write, summarise; returns 0, or 1 if the error of every frame is undefined.

    Finished frames of a killed run of the same problem are reused.

    Raises:
        ConfigError: the output folder cannot be written, or is not an existing result.
    """
    console = console or Console()
    places = [
        Place(i, camera, light)
        for i, (camera, light) in enumerate(
            np.ndindex(1 if config.camera_path else len(scene.cameras), len(scene.lights))
        )
    ]  # fmt: skip
    parts, timings = Parts(config, scene), {}
    asked = config.frames.path
    steps = len(places) + (0 if asked is None else len(scene.camera_of) if config.camera_path else asked.count)
    with whole_folder(config.output.directory) as folder, progress_bar(console, steps) as progress:
        with timed(timings, "frames_s"):
            records = _records(config, scene, places, parts, progress)
        with timed(timings, "path_s"):
            course = _course(config, scene, parts, len(places), progress) if config.frames.path else None
        if course is not None:
            parts.move(course["files"], folder)
            if config.output.figures:
                _flicker_figure(course, folder)
            write_csv(folder / "flicker.csv", FLICKER, ([row[key] for key in FLICKER] for row in course["rows"]))
        for record in records:
            parts.move(record["files"], folder)
        rows = [row for record in records for row in record["rows"]]
        _write_table(rows, folder / "frames.csv")
        report = frames_report(config, scene, records, course)
        (folder / "report.md").write_text(report, encoding="utf-8")
        write_mark(folder, environment(config, jax.numpy.zeros(0).dtype, timings, ("embreex",)))
    parts.delete()
    _summarise(console, config, scene, records)
    if any(row.get("wrong") is not None for row in rows):
        return 0
    why = ", ".join(sorted({row["excluded"] for row in rows}))
    print(
        f"warpopt: frames: got {len(records)} without a defined error ({why}), expected one with a lit and a shadowed "
        "pixel: nothing was measured",
        file=sys.stderr,
    )
    return 1


def _records(
    config: FramesConfig, scene: SceneInput, places: list[Place], parts: Parts, progress: Any
) -> list[dict[str, Any]]:
    records, lit = {}, {}
    # Frames under one light share its rays' tree, which costs as much to build as a frame to judge.
    for place in sorted(places, key=lambda place: place.light):
        record = parts.read(place.number)
        if record is None:
            if place.light not in lit:
                assert scene.triangles is not None
                lit = {place.light: LitScene(scene.triangles, np.array(scene.lights[place.light]))}
            record = _record(config, scene, place, lit[place.light], parts)
            parts.write(place.number, record)
        records[place.number] = record
        progress(f"frame {place.number + 1} of {len(places)}")
    return [records[place.number] for place in places]


def _course(config: FramesConfig, scene: SceneInput, parts: Parts, number: int, progress: Any) -> dict[str, Any]:
    """The path's record, kept like a frame's."""
    record = parts.read(number)
    if record is None:
        from .motion import measured_path

        assert scene.triangles is not None
        record = measured_path(config, scene.triangles, _poses(config, scene), parts.folder, progress)
        parts.write(number, record)
    return record


def _flicker_figure(course: dict[str, Any], folder: Path) -> None:
    from ..common.flicker_figure import flicker_figure

    flicker_figure({"": course["rows"]}).savefig(folder / "flicker.png", dpi=160)


def _poses(config: FramesConfig, scene: SceneInput) -> list[tuple[SceneCamera, np.ndarray]]:
    """(camera, light) of each frame of the path."""
    asked, light = config.frames.path, np.array(scene.lights[0])
    assert asked is not None  # only called with a path
    if asked.kind == "cameras":
        return [(scene.cameras[i], light) for i in scene.camera_of]
    return path(asked.kind, scene.cameras[0], light, asked.count, asked.rate)


def _record(config: FramesConfig, scene: SceneInput, place: Place, lit: LitScene, parts: Parts) -> dict[str, Any]:
    """One frame: its rows, what was excluded, and its pictures' names."""
    frames = config.frames
    width, height = frames.screen
    frame = see(lit, scene.cameras[place.camera], height, width)
    forward = frame.camera.rotation[2]
    theta = float(np.rad2deg(np.arccos(np.clip(forward @ lit.axes[2], -1, 1))))
    same = {
        "frame": place.number, "camera": place.camera, "light": place.light, "theta_deg": theta,
        "judged": int(frame.judged.sum()), "away": int(frame.away.sum()), "grazing": int(frame.grazing.sum()),
        "background": int((~np.isfinite(frame.depth)).sum()), "excluded": excluded_because(frame),
    }  # fmt: skip
    if not np.isfinite(frame.depth).any() or not frame.judged.any():
        rows = [same | {"warp": name} for name in frames.warps]
        return {"rows": rows, "files": [], "pictures": [], "scan": None, "inside": frame.inside}
    fitting, reading = _fitting(config, lit, frame), frames.reading()
    fitted, maps, verdicts, scan = [], [], [], None
    for name in frames.warps:
        if name == "best":
            made, errors = fitting.scan(reading)
            scan = {"eta": list(SCAN), "wrong": [None if np.isnan(v) else float(v) for v in errors]}
        else:
            made = fit_cascades(fitting, name) if cascades_of(name) else fitting.fitted(name)
        fitted.append(made)
        maps.append(maps_of(fitting, made) if isinstance(made, Cascaded) else fitting.map_of(made))
        verdicts.append(measured(frame, maps[-1], reading, frames.seed + 1))
    numbers = ("wrong", "false", "missing", "filtered", "far")
    rows = [
        same | {"warp": made.name} | _told(made) | {
            key: None if np.isnan(getattr(verdict, key)) else getattr(verdict, key) for key in numbers
        } | ({} if made.defined else {"excluded": "the rule gives no warp"})
        for made, verdict in zip(fitted, verdicts, strict=True)
    ]  # fmt: skip
    files = _pictures(config, place, lit, frame, fitted, maps, rows, scan, parts) if config.output.figures else []
    return {
        "rows": rows, "files": [name for name, _ in files], "pictures": files, "scan": scan, "inside": frame.inside,
    }  # fmt: skip


def _told(made: Fitted | Cascaded) -> dict[str, Any]:
    """eta, and cascades' splits; several numbers in one cell, with spaces between them."""
    if isinstance(made, Fitted):
        return {"eta": made.eta}
    return {
        "eta": " ".join("-" if eta is None else f"{eta:.6g}" for eta in made.eta),
        "splits": " ".join(f"{z:.6g}" for z in made.splits),
    }


def _fitting(config: FramesConfig, lit: LitScene, frame: Frame) -> Fitting:
    return Fitting(lit, frame, config.frames.shadow_map, config.frames.fit, config.warp.turn_only_if)


def excluded_because(frame: Frame) -> str:
    """Why a frame's error is undefined, or nothing."""
    if not np.isfinite(frame.depth).any():
        return "only background"
    if not frame.judged.any():
        return "no surface faces the light"
    if not frame.defined:
        return "no shadow" if frame.lit.all() else "no lit pixel"
    return ""


def _pictures(
    config: FramesConfig, place: Place, lit: LitScene, frame: Frame, fitted: list[Fitted | Cascaded],
    maps: list[ShadowMap | CascadedMap], rows: list[dict], scan: dict | None, parts: Parts,
) -> list[tuple[str, str]]:  # fmt: skip
    # Imported here: matplotlib's first import on a machine scans all fonts.
    from .figures import frame_pictures, scan_figure

    stem = f"frame_{place.number:03d}"
    reading = config.frames.reading()
    shown = [each.visibility(frame, reading) for each in maps]
    written = []
    for made, figure in frame_pictures(config.frames.crops, lit, frame, fitted, maps, rows, shown):
        name = f"{stem}_{made.name}.png"
        figure.savefig(parts.folder / name, dpi=100)
        written.append((name, f"Frame {place.number}, {title_of(made.name)}."))
    if scan is not None and frame.defined:
        name = f"{stem}_scan.png"
        scan_figure(scan, rows).savefig(parts.folder / name, dpi=160)
        written.append((name, f"Frame {place.number}: wrong pixels over eta, and where each warp lies."))
    return written


def _write_table(rows: list[dict[str, Any]], path: Path) -> None:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    writer.writerows({key: row.get(key) for key in COLUMNS} for row in rows)
    path.write_text(text.getvalue(), encoding="utf-8", newline="")


def _summarise(console: Console, config: FramesConfig, scene: SceneInput, records: list[dict[str, Any]]) -> None:
    table = Table(title="Wrong pixels")
    heads = ("warp", "mean wrong", "false", "missing", "> 2.5 px off", "times no warp")
    for head in heads[: 6 if "none" in config.frames.warps else 5]:
        table.add_column(head, justify="left" if head == "warp" else "right")
    for line in summary(config, records):
        table.add_row(*line)
    console.print(table)
    for note in scene.notes:
        console.print(note, soft_wrap=True, markup=False)
    console.print(f"Written: {config.output.directory}: report.md, frames.csv, run.json, pictures", soft_wrap=True)

"""What a warp is worth in pixels: wrong pixels of each warp over some hundred frames, against the truth by ray casting.

    python experiments/pixels.py --directory runs/pixels            # measures; a killed run resumes
    python experiments/pixels.py --directory runs/pixels --page docs/pixels.md --images docs/images --readme README.md

A frame is 384 x 240 pixels; errors are means over 8 shifts of the map's grid. Nothing is tuned on these frames: rules
and objectives have no parameter of ours. The measurements are in pixels.json, a row for each frame.
"""

import argparse
import json
import time
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
import pixels_page
from pixels_scenes import SCENES, Drawn, draw

import warpopt
from warpopt import theory
from warpopt.frames import Reading, ShadowMap, measured, predicted_wrong, texel_footprints
from warpopt.frames.fits import SCAN, Fitting

WIDTH, HEIGHT = 384, 240
SIZES = (512, 1024, 2048)
SIZE = 1024
WARPS = ("none", "lispsm", "tsm", "filament", "p-inf", "edge", "band")
ENGINE = ("none", "lispsm", "filament", "ogre", "tsm", "p-inf")
OBJECTIVES = (
    "p-inf", "q-inf", "pxq-inf", "max-inf", "p-l1", "p-l2", "pxq-l1", "pxq-l2", "max-l1", "edge", "band",
)  # fmt: skip
READINGS = {
    "nearest, no bias": Reading(amount=0.0),
    "nearest, half a texel of slope": Reading(amount=0.5),
    "nearest, one texel of slope": Reading(),
    "nearest, two texels of slope": Reading(amount=2.0),
    "nearest, one texel, warped depth": Reading(warped_depth=True),
    "nearest, constant 0.0005 of the range": Reading(bias="constant", amount=0.0005),
    "nearest, constant 0.005 of the range": Reading(bias="constant", amount=0.005),
    "nearest, receiver's plane": Reading(bias="plane"),
    "nearest, second depth": Reading(bias="second_depth"),
    "nearest, back faces": Reading(bias="back_faces"),
    "2x2, one texel of slope": Reading("pcf2", amount=1.0),
    "2x2, 1.5 texels of slope": Reading("pcf2", amount=1.5),
    "2x2, two texels of slope": Reading("pcf2"),
    "3x3, one texel of slope": Reading("pcf3", amount=1.0),
    "3x3, two texels of slope": Reading("pcf3", amount=2.0),
    "3x3, three texels of slope": Reading("pcf3"),
    "2x2, blurred over 3 pixels": Reading("eye_blur"),
    "2x2, blurred over 3 pixels, less with depth": Reading("eye_blur_depth"),
}
READ_WARPS = ("none", "lispsm", "edge")
_FRESH = 7  # seed of the shifts that judge; the scan chooses its eta with others


def footprint_deviation(drawn: Drawn, fitting: Fitting, name: str) -> float:
    """Largest relative difference between texel areas through the matrix and E_p E_q times the projection factor."""
    view, made = fitting.view("depth"), fitting.fitted(name)
    frame, footprint = view.frame(), view.footprint()
    seen, camera = drawn.frame, drawn.frame.camera
    across, up = camera.slopes(*seen.judged.shape)
    z = seen.depth[seen.judged]
    rows, columns = np.nonzero(seen.judged)
    point = np.stack([across[columns] * z, up[rows] * z, z], 1)
    delta = (point @ np.asarray(frame.z_axis) - float(footprint.start)) / float(footprint.mu)
    blend = (1 - delta) * made.eta + delta
    width = float(sum(footprint.half_widths(made.eta)))
    e_p, e_q = theory.errors(
        blend, made.eta, float(frame.density_p) * float(footprint.mu) / z, float(frame.density_q) * width / z
    )
    normal = drawn.lit.normals[seen.triangles] @ (camera.rotation @ drawn.lit.axes.T).T
    factor = np.abs((normal * point).sum(1)) / (z * np.abs(normal @ np.asarray(frame.light)))
    area = np.abs(np.linalg.det(texel_footprints(seen, fitting.map_of(made))))
    return float(np.abs(area / (e_p * e_q * factor) - 1).max())


def record(drawn: Drawn, number: int) -> dict:
    """Everything that is measured on one frame."""
    frame, lit = drawn.frame, drawn.lit
    fitting, reading = Fitting(lit, frame, (SIZE, SIZE)), Reading()
    made = {name: fitting.fitted(name) for name in dict.fromkeys((*WARPS, *OBJECTIVES))}
    best, scan = fitting.scan(reading)
    made["best"] = best
    judged = int(frame.judged.sum())
    numbers = ("wrong", "false", "missing", "far")
    told: dict = {
        "scene": drawn.scene, "class": drawn.theta_class, "theta_deg": drawn.theta_deg, "skipped": drawn.skipped,
        "judged": judged, "edges": int(frame.true_edges.sum()), "scan": scan.tolist(),
        "eta": {name: each.eta for name, each in made.items()}, "error": {}, "sizes": {}, "objective": {},
    }  # fmt: skip
    for name, each in made.items():
        verdict = measured(frame, fitting.map_of(each), reading, _FRESH)
        told["error"][name] = {key: getattr(verdict, key) for key in numbers}
    for size in SIZES:
        told["sizes"][str(size)] = {
            name: measured(frame, ShadowMap(lit, made[name].matrix, (size, size)), reading, _FRESH).wrong
            for name in (*WARPS, "best")
        }
    told["predicted"] = {name: predicted_wrong(frame, fitting.map_of(made[name])) / judged for name in (*WARPS, "best")}
    told["engine"] = {}
    engines = Fitting(lit, frame, (SIZE, SIZE), "engine")
    for name in ENGINE:
        each = engines.fitted(name)
        told["engine"][name] = measured(frame, engines.map_of(each), reading, _FRESH).wrong
    views = {name: fitting.view(name) if name in ("edge", "band") else fitting.uniform() for name in OBJECTIVES}
    footprint = fitting.view("depth").footprint()
    for name in OBJECTIVES:
        metric, _, norm = name.partition("-")
        objective = warpopt.Objective(metric, norm or None)
        norms = warpopt.error_norm(views[name], warpopt.Warp.from_eta(np.array(SCAN), footprint), objective)
        told["objective"][name] = np.asarray(norms).tolist()
    told["footprint"] = max(footprint_deviation(drawn, fitting, name) for name in ("none", "lispsm", "edge"))
    told["fine"] = measured(frame, ShadowMap(lit, made["p-inf"].matrix, (32768, 32768)), reading, _FRESH).wrong
    if number % 6 == 0:
        told["readings"] = {
            words: {
                name: [getattr(measured(frame, fitting.map_of(made[name]), how, _FRESH), key)
                       for key in ("wrong", "filtered", "false", "missing")]
                for name in READ_WARPS
            }
            for words, how in READINGS.items()
        }  # fmt: skip
    return told


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/pixels"))
    parser.add_argument("--count", type=int, default=3, help="frames of each scene in each class of theta")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES, help="some of the scenes only")
    parser.add_argument("--short", action="store_true", help="a small frame of two scenes")
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    parser.add_argument("--images", type=Path, help="write the pictures into this folder")
    parser.add_argument("--readme", type=Path, help="write the headline into this page")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    kept = asked.directory / "pixels.json"
    records = json.loads(kept.read_text()) if kept.exists() else {}
    width, height = (96, 60) if asked.short else (WIDTH, HEIGHT)
    for name in SCENES[-2:] if asked.short else asked.scenes:
        if name in records:
            continue
        start, mine = time.perf_counter(), []
        for drawn in draw(name, 1 if asked.short else asked.count, width, height):
            mine.append(record(drawn, len(mine)))
            if asked.short:
                break
        records[name] = mine
        part = kept.with_suffix(".part")
        part.write_text(json.dumps(records))
        part.replace(kept)
        print(f"{name}: {len(mine)} frames, {time.perf_counter() - start:.0f} s", flush=True)
    frames = [each for name in records for each in records[name]]
    tables = pixels_page.tables(frames, (width, height))
    (asked.directory / "tables.md").write_text(tables, encoding="utf-8")
    if asked.page:
        pixels_page.write_between(asked.page, "pixels", tables)
    if asked.images:
        pixels_page.write_pictures(frames, asked.images)
    if asked.readme:
        pixels_page.write_between(asked.readme, "pixels", pixels_page.headline(frames))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

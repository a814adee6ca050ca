"""What weights and edges' directions are worth in pixels: over a part of the frames of `pixels.py`.

    python experiments/pixels_of_weights.py --directory runs/weights --page docs/pixels.md

Optima over the depth buffer of: the longer edge and the band beside edges, the band beside edges of known directions,
and by eye depth the band and E_p in L1, both over the pixels that face the light and over all. Against the best eta of
a scan.
"""

import argparse
import json
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
import pixels_page
from pixels_scenes import SCENES, draw

import warpopt
from warpopt.frames import Reading, measured
from warpopt.frames.fits import Fitting
from warpopt.receivers import DepthBuffer

WIDTH, HEIGHT, SIZE = 384, 240, 1024
BAND, EDGE, E_P = warpopt.Objective("band"), warpopt.Objective("edge"), warpopt.Objective("p", "l1")
TITLES = {
    "edge": "edge, beside edges", "band of edges": "band, beside edges",
    "band of directions": "band, beside edges of known directions", "band": "band, by depth, lit pixels",
    "band of all": "band, by depth, all pixels", "p": "E_p, norm l1, by depth, lit pixels",
    "p of all": "E_p, norm l1, by depth, all pixels",
}  # fmt: skip
_FRESH = 7  # seed of the shifts that judge, as in `pixels.py`


def record(drawn) -> dict[str, dict[str, float]]:
    """Error and eta of each."""
    frame = drawn.frame
    fitting, reading = Fitting(drawn.lit, frame, (SIZE, SIZE)), Reading()
    edge = fitting.view("edge")
    edges = edge.receivers.weights

    def over(**weights) -> warpopt.SceneView:
        return warpopt.SceneView(
            edge.camera, edge.light, DepthBuffer(frame.depth, **weights), screen=edge.screen, shadow_map=edge.shadow_map
        )

    beside, faces = over(weights=edges.values), over(weights="depth", lit=frame.judged)
    every = over(weights="depth")
    made = {
        "edge": (edge, EDGE), "band of edges": (beside, BAND), "band of directions": (edge, BAND),
        "band": (faces, BAND), "band of all": (every, BAND), "p": (faces, E_P), "p of all": (every, E_P),
    }  # fmt: skip
    fitted = {name: fitting.fitted("edge", float(warpopt.optimal_warp(*each).warp.eta)) for name, each in made.items()}
    fitted["best"], _ = fitting.scan(reading)
    return {
        name: {"wrong": measured(frame, fitting.map_of(each), reading, _FRESH).wrong, "eta": each.eta}
        for name, each in fitted.items()
    }


def tables(records: dict[str, list[dict]]) -> str:
    """The page's part."""
    frames = [each for of_scene in records.values() for each in of_scene]
    wrong = {name: np.array([each[name]["wrong"] for each in frames]) for name in (*TITLES, "best")}
    lines = [
        f"{len(frames)} frames ({', '.join(records)}). Ratios of errors; geometric means with 95 % intervals.",
        "",
        "| objective, weights | over the best eta: mean / median / worst | over edge | better / worse by 5 % |",
        "|---|---|---|---|",
    ]  # fmt: skip
    # A frame without a wrong pixel counts half of one.
    least = 0.5 / (WIDTH * HEIGHT)
    for name, title in TITLES.items():
        best, edge = (np.maximum(wrong[name], least) / np.maximum(wrong[other], least) for other in ("best", "edge"))
        logs = np.log(edge)
        mean, half = np.exp(logs.mean()), 1.96 * logs.std(ddof=1) / np.sqrt(len(logs))
        lines.append(
            f"| {title} | {best.mean():.3f} / {np.median(best):.3f} / {best.max():.2f} | {mean:.3f} "
            f"({mean * np.exp(-half):.3f} to {mean * np.exp(half):.3f}) | {(edge < 0.95).mean():.0%} / "
            f"{(edge > 1.05).mean():.0%} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/weights"))
    parser.add_argument("--count", type=int, default=2, help="frames of each scene in each class of theta")
    parser.add_argument(
        "--scenes", nargs="+", default=["hills 21", "city 21", "corridor 21", "hand.glb"], choices=SCENES
    )
    parser.add_argument("--short", action="store_true", help="one small frame")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    kept = asked.directory / "weights.json"
    records = json.loads(kept.read_text()) if kept.exists() else {}
    width, height = (96, 60) if asked.short else (WIDTH, HEIGHT)
    for name in asked.scenes[:1] if asked.short else asked.scenes:
        if name not in records:
            drawn = list(draw(name, 1 if asked.short else asked.count, width, height))
            records[name] = [record(each) for each in (drawn[:2] if asked.short else drawn)]
            kept.write_text(json.dumps(records))
            print(name, flush=True)
    text = tables(records)
    (asked.directory / "weights.md").write_text(text, encoding="utf-8")
    print(text)
    if asked.page:
        pixels_page.write_between(asked.page, "weights", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Static error and false flicker of ways to fit a shadow map, along walks, turns, looking about, and a moving sun.

    python experiments/flicker.py --directory runs/flicker --page docs/pixels.md --images docs/images

A frame is 256 x 160 pixels, 30 frames a second; maps of 512 x 512 texels, read as they lie. Four scenes from seeds, one
path of each kind in each.
"""

import argparse
import json
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from pixels_page import table, write_between

from warpopt.app.common import figure_style as style
from warpopt.frames import LitScene, Reading, ShadowMap, judge, see
from warpopt.frames.methods import HELD, method_of, method_title
from warpopt.frames.names import STABLE
from warpopt.frames.paths import MOTIONS, Moment, flips, path
from warpopt.frames.pictures import enlarged, painted, worst_places, wrong_pixels
from warpopt.scene_files.made import KINDS, made_scene

WIDTH, HEIGHT, TEXELS, RATE = 256, 160, 512, 30.0
LIGHT = np.array([0.5, -0.8, -0.35])
METHODS = (
    "none", "lispsm", "p-inf", "edge", "band", "held-none", "held-p-inf", "held-edge", "sphere", "sphere-receivers",
)  # fmt: skip
SHOWN = {
    "none": "no warp, fitted each frame", "edge": "edge, fitted each frame", "held-edge": f"edge, every {HELD} frames",
    "sphere": "sphere, snapped",
}  # fmt: skip
"""Of the animation, with their titles."""


def record(kind: str, motion: str, count: int, size: tuple[int, int]) -> tuple[dict, dict]:
    """(numbers of each method over one path, strips of pictures of those shown)."""
    width, height = size
    scene = made_scene(kind, 31)
    methods = {name: method_of(name, TEXELS) for name in METHODS}
    told: dict = {name: {"wrong": [], "flipped": 0, "compared": 0} for name in METHODS}
    before: dict[str, Moment] = {}
    strips: dict[str, list] = {name: [] for name in SHOWN}
    lit, last, place = None, None, None
    camera = next(c for c in (scene.camera(k, width / height) for k in range(64)) if _shadowed(scene, c, size))
    for number, (each, sun) in enumerate(path(motion, camera, LIGHT, count, RATE)):
        if lit is None or not np.array_equal(sun, last):
            lit, last = LitScene(scene.triangles, sun), sun
        frame = see(lit, each, height, width)
        shown = {}
        for name, method in methods.items():
            moment = Moment(lit, frame, ShadowMap(lit, method(number, lit, frame), (TEXELS, TEXELS)))
            shown[name] = moment.shadow_map.visibility(frame, Reading())
            told[name]["wrong"].append(judge(frame, shown[name]).wrong)
            if number:
                flipped, compared = flips(before[name], moment, Reading())
                told[name]["flipped"] += flipped
                told[name]["compared"] += compared
            before[name] = moment
        if place is None:
            side = (height // 2, height // 2)
            ((top, left),) = worst_places(np.sum([wrong_pixels(frame, v) for v in shown.values()], 0), side, 1)
            place = slice(top, top + side[0]), slice(left, left + side[1])
        for name in SHOWN:
            strips[name].append(painted(lit, frame, shown[name], mark=False)[place])
    return told, strips


def _shadowed(scene, camera, size: tuple[int, int]) -> bool:
    frame = see(LitScene(scene.triangles, LIGHT), camera, size[1], size[0])
    return bool(frame.defined and not frame.inside and frame.true_edges.sum() > 100)


def page(records: dict) -> str:
    """For each method and motion: static error and flicker, and the law that relates them."""
    motions = list(dict.fromkeys(key.split()[1] for key in records))
    rows = []
    for name in METHODS:
        cells, laws = [], []
        for motion in motions:
            mine = [told[name] for key, told in records.items() if key.split()[1] == motion]
            static = float(np.mean([np.nanmean(each["wrong"]) for each in mine]))
            flicker = sum(each["flipped"] for each in mine) / max(1, sum(each["compared"] for each in mine))
            cells.append(f"{100 * static:.2f} / {100 * flicker:.3f}")
            frames = len(mine[0]["wrong"])
            fits = (frames - 1) // HELD if name.startswith("held-") and motion != "sun" else frames - 1
            if name not in STABLE and fits:
                laws.append(f"{flicker * (frames - 1) / fits / static:.2f}")
        rows.append([method_title(name), *cells, " / ".join(laws) or "-"])
    scenes = len({key.split()[0] for key in records})
    note = (
        f"{scenes} scenes, {len(records)} paths. Static error / false flicker in per cent, means; in the last column "
        "flicker over static error times fits a frame, by motion: 1 if a fit draws a new error.\n"
    )
    return note + "\n" + table(["method", *motions, "flicker / (static x fits)"], rows)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/flicker"))
    parser.add_argument("--count", type=int, default=17, help="frames of each path")
    parser.add_argument("--scenes", nargs="+", choices=KINDS, help="some of the scenes only")
    parser.add_argument("--motions", nargs="+", choices=MOTIONS, help="some of the motions only")
    parser.add_argument("--short", action="store_true", help="one short path")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--images", type=Path, help="write the animation into this folder")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    kinds, motions = (("corridor",), ("walk",)) if asked.short else (KINDS, MOTIONS)
    kinds, motions = asked.scenes or kinds, asked.motions or motions
    count, size = (3, (96, 60)) if asked.short else (asked.count, (WIDTH, HEIGHT))
    kept = asked.directory / "flicker.json"
    records = json.loads(kept.read_text()) if kept.exists() else {}
    for kind in kinds:
        for motion in motions:
            if f"{kind} {motion}" in records:
                continue
            records[f"{kind} {motion}"], strips = record(kind, motion, count, size)
            print(f"{kind} {motion}", flush=True)
            if (kind, motion) == ("corridor", "walk") and asked.images:
                animated(strips, asked.images / "flicker.gif")
            kept.with_suffix(".part").write_text(json.dumps(records))
            kept.with_suffix(".part").replace(kept)
    text = page(records)
    (asked.directory / "flicker.md").write_text(text, encoding="utf-8")
    if asked.page:
        write_between(asked.page, "flicker", text)
    return 0


@style.shared_style()
def animated(strips: dict, target: Path) -> None:
    """The strips side by side, in grey-green steps of few colours, at a third of the speed."""
    images = []
    for k in range(len(next(iter(strips.values())))):
        parts = [
            np.pad(enlarged(strip[k], 2), ((0, 0), (0, 6), (0, 0)), constant_values=1) for strip in strips.values()
        ]
        images.append(Image.fromarray((np.hstack(parts).clip(0, 1) * 255).round().astype(np.uint8)))
    first = images[0].quantize(24)
    frames = [image.quantize(24, palette=first) for image in images]
    head = header([SHOWN[name] for name in strips], images[0].width)
    whole = [Image.fromarray(np.vstack([head, np.asarray(one.convert("RGB"))])).quantize(32) for one in frames]
    whole[0].save(target, save_all=True, append_images=whole[1:], duration=100, loop=0, optimize=True)


def header(titles: list[str], width: int) -> np.ndarray:
    """A line of titles above the strips."""
    figure: Figure = style.new_figure(width / 100, 0.2)
    for k, title in enumerate(titles):
        figure.text((k + 0.01) / len(titles), 0.25, title, fontsize=6.5)
    figure.set_dpi(100)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3]


if __name__ == "__main__":
    raise SystemExit(main())

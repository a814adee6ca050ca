"""Static error and false flicker of ways to fit a shadow map, along walks, turns, looking about, and a moving sun.

    python experiments/flicker.py --directory runs/flicker --long 300 --page docs/stability.md \\
        --images docs/images

A frame is 256 x 160 pixels, 30 frames a second; maps of 512 x 512 texels, read as they lie. Four scenes from seeds, one
path of each kind in each, and two longer ones with `--long`. Cascades have runs of their own, with as many texels:

    python experiments/flicker.py --cascades --motions walk turn --directory runs/flicker_cascades \
        --page docs/cascades.md
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
from warpopt.app.common.flicker_figure import flicker_figure
from warpopt.frames import LitScene, Reading, judge, see
from warpopt.frames.methods import HELD, method_of, method_title, refitted
from warpopt.frames.names import STABLE, WINDOW
from warpopt.frames.paths import MOTIONS, Moment, flips, path
from warpopt.frames.pictures import enlarged, painted, worst_places, wrong_pixels
from warpopt.scene_files.made import KINDS, made_scene

WIDTH, HEIGHT, TEXELS, RATE = 256, 160, 512, 30.0
LIGHT = np.array([0.5, -0.8, -0.35])
METHODS = (
    "none", "lispsm", "p-inf", "turned-edge", "turned-band", "held-turned-edge", "sphere", "sphere-receivers",
    "window-none", "window-turned-edge", "window-turned-band",
)  # fmt: skip
SHOWN = {
    "turned-edge": "turned edge, fitted each frame", "window-turned-edge": "the same in a stable window",
    "window-none": "no warp in a stable window", "sphere": "sphere, snapped",
}  # fmt: skip
"""Of the animation, with their titles."""
LONG = (("city", "look"), ("hills", "walk"))
SHORT_METHODS = ("none", "lispsm", "sphere", "window-p-inf")
MANY = 100
OF_CASCADES = (
    "none", "sphere", "4-logarithmic-none", "4-logarithmic-turned-edge", "4-logarithmic-sphere",
    "window-4-logarithmic-none", "window-4-logarithmic-turned-edge",
)  # fmt: skip
SHORT_OF_CASCADES = ("none", "2-logarithmic-sphere", "window-2-logarithmic-none")
LONG_METHODS = (
    "none", "lispsm", "turned-edge", "sphere", "sphere-receivers", "window-none", "window-turned-edge",
)  # fmt: skip
EACH_FRAME = {"window-none": "none", "window-turned-edge": "turned-edge", "window-turned-band": "turned-band"}
GOALS = {"flicker": 0.08, "static": 1.15, "sphere": 0.2, "refits": 8.0}
"""Per cent on walks and turns; over the static error of the same warp fitted each frame; over the static error of the
snapped sphere; a second, on the worst path."""


def record(
    kind: str, motion: str, count: int, size: tuple[int, int], names: tuple[str, ...] = METHODS
) -> tuple[dict, dict]:
    """(numbers of each method over one path, strips of pictures of those shown)."""
    width, height = size
    scene = made_scene(kind, 31)
    methods = {name: method_of(name, TEXELS) for name in names}
    told: dict = {name: {"wrong": [], "flipped": 0, "compared": 0, "between": 0, "pops": []} for name in names}
    before: dict[str, Moment] = {}
    strips: dict[str, list] = {name: [] for name in SHOWN if name in names}
    lit, last, place = None, None, None
    camera = next(c for c in (scene.camera(k, width / height) for k in range(64)) if _shadowed(scene, c, size))
    for number, (each, sun) in enumerate(path(motion, camera, LIGHT, count, RATE)):
        if lit is None or not np.array_equal(sun, last):
            lit, last = LitScene(scene.triangles, sun), sun
        frame = see(lit, each, height, width)
        shown = {}
        for name, method in methods.items():
            moment = Moment(lit, frame, method(number, lit, frame))
            shown[name] = moment.shadow_map.visibility(frame, Reading())
            told[name]["wrong"].append(judge(frame, shown[name]).wrong)
            if number:
                flipped, compared = flips(before[name], moment, Reading())
                told[name]["flipped"] += flipped
                told[name]["compared"] += compared
                if name.startswith(WINDOW):
                    if refitted(method):
                        told[name]["pops"].append(flipped / max(1, compared))
                    else:
                        told[name]["between"] += flipped
            before[name] = moment
        if place is None:
            side = (height // 2, height // 2)
            ((top, left),) = worst_places(np.sum([wrong_pixels(frame, v) for v in shown.values()], 0), side, 1)
            place = slice(top, top + side[0]), slice(left, left + side[1])
        for name in strips:
            strips[name].append(painted(lit, frame, shown[name], mark=False)[place])
    return told, strips


def _shadowed(scene, camera, size: tuple[int, int]) -> bool:
    frame = see(LitScene(scene.triangles, LIGHT), camera, size[1], size[0])
    return bool(frame.defined and not frame.inside and frame.true_edges.sum() > 100)


def page(records: dict) -> str:
    """For each method and motion static error and flicker, what refits cost, and the goals."""
    motions = list(dict.fromkeys(_motion(key) for key in records))
    rows, windows = [], []
    names = list(dict.fromkeys(name for told in records.values() for name in told))
    for name in names:
        cells, laws = [], []
        for motion in motions:
            mine = [told[name] for key, told in records.items() if _motion(key) == motion and name in told]
            if not mine:
                cells.append("-")
                continue
            static, flicker = _static(mine), _flicker(mine)
            cells.append(f"{100 * static:.2f} / {100 * flicker:.3f}")
            if name not in STABLE and not name.startswith(WINDOW) and "-sphere" not in name and motion in TITLES:
                frames = len(mine[0]["wrong"])
                fits = (frames - 1) // HELD if name.startswith("held-") and motion != "sun" else frames - 1
                laws += [f"{flicker * (frames - 1) / fits / static:.2f}"] if fits else []
        rows.append([method_title(name), *cells, " / ".join(laws) or "-"])
        if name.startswith(WINDOW):
            windows.append([method_title(name), *_refits(records, name)])
    scenes = len({key.split()[0] for key in records})
    frames = sum(len(told["none"]["wrong"]) for told in records.values())
    note = (
        f"{scenes} scenes, {len(records)} paths, {frames} frames. Static error / false flicker in per cent, means; in "
        "the last column flicker over static error times fits a frame, by motion: 1 if a fit draws a new error.\n"
    )
    heads = ["window", "refits a second", "on the worst path", "points flipped by a refit", "by the worst",
             "flicker between refits"]  # fmt: skip
    parts = [note, table(["method", *motions, "flicker / (static x fits)"], rows), table(heads, windows)]
    goals = _goals(records)
    return "\n".join([*parts, table(["goal", "bar", "measured", ""], goals)] if goals else parts)


def _motion(key: str) -> str:
    """Long paths are for themselves: not every method is measured on them."""
    kind, motion, frames = key.split()
    return motion if int(frames) < MANY else f"{motion}, {frames} frames, {kind}"


def _static(paths: list[dict]) -> float:
    return float(np.mean([np.nanmean(each["wrong"]) for each in paths]))


def _flicker(paths: list[dict]) -> float:
    return sum(each["flipped"] for each in paths) / max(1, sum(each["compared"] for each in paths))


def _refits(records: dict, name: str) -> list[str]:
    mine = [told[name] for told in records.values() if name in told]
    rates = [RATE * len(each["pops"]) / (len(each["wrong"]) - 1) for each in mine]
    pops = [pop for each in mine for pop in each["pops"]]
    between = sum(each["between"] for each in mine) / max(1, sum(each["compared"] for each in mine))
    popped = [f"{100 * np.mean(pops):.2f} %", f"{100 * max(pops):.2f} %"] if pops else ["-", "-"]
    return [f"{np.mean(rates):.2f}", f"{max(rates):.2f}", *popped, f"{100 * between:.4f} %"]


def _goals(records: dict) -> list[list[str]]:
    """What was aimed at and what was found, of both turned windows."""
    rows = []

    def row(words: str, bar: str, found: float, goal: float, unit: str = "") -> None:
        rows.append([words, bar, f"{found:.3g}{unit}", "met" if found <= goal else "**missed**"])

    for name in ("window-turned-edge", "window-turned-band"):
        title = method_title(name)
        mine = {key: told for key, told in records.items() if name in told}
        if not mine:
            continue
        for motion in ("walk", "turn"):
            paths = [told[name] for key, told in mine.items() if _motion(key) == motion]
            if paths:
                flicker = 100 * _flicker(paths)
                row(f"{title}: flicker, {motion}", f"{GOALS['flicker']} %", flicker, GOALS["flicker"], " %")
        moving = [told for key, told in mine.items() if _motion(key) in ("walk", "turn")]
        if moving:
            static = _static([told[name] for told in moving])
            each = static / _static([told[EACH_FRAME[name]] for told in moving])
            row(f"{title}: error over the same fitted each frame", f"{GOALS['static']}", each, GOALS["static"])
            sphere = static / _static([told["sphere"] for told in moving])
            row(f"{title}: error over the snapped sphere's", f"{GOALS['sphere']}", sphere, GOALS["sphere"])
        rates = [RATE * len(told[name]["pops"]) / (len(told[name]["wrong"]) - 1) for told in mine.values()]
        row(f"{title}: refits a second, worst path", f"{GOALS['refits']:g}", max(rates), GOALS["refits"])
        still = [told[name] for key, told in mine.items() if key.split()[1] != "sun"]
        between = 100 * sum(each["between"] for each in still) / max(1, sum(each["compared"] for each in still))
        row(f"{title}: flicker between refits, still light", "0", between, 0.0, " %")
    return rows


TITLES = {"walk": "walking", "turn": "turning", "look": "walking and looking about", "sun": "a sun that moves"}


def by_motion(records: dict) -> dict[str, list[dict]]:
    """Rows for the figure, by the motion's title."""
    made: dict[str, list[dict]] = {}
    for motion in dict.fromkeys(_motion(key) for key in records if _motion(key) in TITLES):
        mine = [told for key, told in records.items() if _motion(key) == motion]
        names = dict.fromkeys(name for told in mine for name in told)
        paths = {name: [told[name] for told in mine if name in told] for name in names}
        made[TITLES.get(motion, motion)] = [
            {"method": name, "static": _static(each), "flicker": _flicker(each)} for name, each in paths.items()
        ]
    return made


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/flicker"))
    parser.add_argument("--count", type=int, default=17, help="frames of each path")
    parser.add_argument("--long", type=int, help="frames of two longer paths")
    parser.add_argument("--renew", nargs="+", default=[], choices=METHODS, help="measure these anew on kept paths")
    parser.add_argument("--scenes", nargs="+", choices=KINDS, help="some of the scenes only")
    parser.add_argument("--motions", nargs="+", choices=MOTIONS, help="some of the motions only")
    parser.add_argument("--cascades", action="store_true", help="methods with four cascades instead of single maps")
    parser.add_argument("--short", action="store_true", help="one short path")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--images", type=Path, help="write the animation into this folder")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    kinds, motions = (("corridor",), ("walk",)) if asked.short else (KINDS, MOTIONS)
    kinds, motions = asked.scenes or kinds, asked.motions or motions
    count, size = (3, (96, 60)) if asked.short else (asked.count, (WIDTH, HEIGHT))
    pairs = [(kind, motion, count) for kind in kinds for motion in motions]
    methods = SHORT_METHODS if asked.short else METHODS
    if asked.cascades:
        methods = SHORT_OF_CASCADES if asked.short else OF_CASCADES
    if asked.long:
        pairs += [(kind, motion, asked.long) for kind, motion in LONG]
    kept = asked.directory / "flicker.json"
    records = json.loads(kept.read_text()) if kept.exists() else {}
    for kind, motion, frames in pairs:
        key = f"{kind} {motion} {frames}"
        names = methods if frames == count else LONG_METHODS
        if key in records and not asked.renew:
            continue
        if key in records:
            names = tuple(name for name in asked.renew if name in names)
        told, strips = record(kind, motion, frames, size, names)
        records[key] = records.get(key, {}) | told
        print(key, flush=True)
        if (kind, motion, frames) == ("corridor", "walk", count) and asked.images and not asked.renew:
            animated(strips, asked.images / "flicker.gif")
        kept.with_suffix(".part").write_text(json.dumps(records))
        kept.with_suffix(".part").replace(kept)
    if asked.images:
        flicker_figure(by_motion(records)).savefig(asked.images / "stability.png", dpi=130)
    text = page(records)
    (asked.directory / "flicker.md").write_text(text, encoding="utf-8")
    if asked.page:
        write_between(asked.page, "flicker of cascades" if asked.cascades else "flicker", text)
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

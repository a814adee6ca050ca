"""What several maps are worth in pixels: splits, warps, directions and aspects of cascades, over the frames of
`pixels.py`, against ray-cast truth and at equal texels.

    python experiments/pixels_cascades.py --directory runs/pixels_cascades --page docs/cascades.md

Each error is the mean over three sets of grid shifts. A killed run resumes; cascades.json has a row for each frame.
"""

import argparse
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
from pixels_page import geometric, table, write_between
from pixels_scenes import SCENES, kept_records

from warpopt.frames import Reading, measured
from warpopt.frames.cascade_fits import fit_cascades, maps_of
from warpopt.frames.fits import Fitting
from warpopt.frames.names import cascades_of

WIDTH, HEIGHT, SIZE = 384, 240, 1024
SHIFTS = (7, 8, 9)
ONE = ("none", "p-inf", "edge", "turned-edge", "shaped-edge")
COUNTS = (2, 4)
WARPS = ("none", "p-inf", "edge", "turned-edge", "shaped-edge")
SPLITS = {
    "logarithmic": "logarithmic, receivers", "p-inf": "best of E_p, norm inf", "edge": "best of edge",
    "uniform": "uniform, receivers", "three": "practical 0.5, near to far", "godot": "Godot's, near to far",
}  # fmt: skip
"""The splits, and their names in the table."""
PLAIN = ("uniform", "three", "godot")
"""Splits that are measured without a warp and with E_p's alone."""
GOALS = (("4-edge-shaped-edge", "4-logarithmic-none", 0.78), ("4-edge-edge", "4-logarithmic-edge", 0.97))
"""An error over another, and what it should be at most."""


def names() -> list[str]:
    """Every warp and every set of cascades."""
    made = list(ONE)
    for count in COUNTS:
        for splits in SPLITS:
            made += [f"{count}-{splits}-{warp}" for warp in (WARPS[:2] if splits in PLAIN else WARPS)]
        made.append(f"{count}-logarithmic-sphere")
    return made


def record(drawn) -> dict:
    """The wrong share under each name."""
    fitting = Fitting(drawn.lit, drawn.frame, (SIZE, SIZE), turn_only_if=1.0)
    errors = {}
    for name in names():
        made = maps_of(fitting, fit_cascades(fitting, name)) if cascades_of(name) else None
        shadow_map = made or fitting.map_of(fitting.fitted(name))
        errors[name] = float(np.mean([measured(drawn.frame, shadow_map, Reading(), s).wrong for s in SHIFTS]))
    return {
        "scene": drawn.scene, "class": drawn.theta_class, "judged": int(drawn.frame.judged.sum()), "error": errors,
    }  # fmt: skip


def errors_of(records: list[dict], name: str) -> np.ndarray:
    """Wrong shares; half a pixel where none is wrong."""
    return np.array([max(r["error"][name], 0.5 / r["judged"]) for r in records])


def tables(records: list[dict]) -> str:
    """The results as Markdown."""
    base = errors_of(records, "p-inf")
    titles = ["no warp", "E_p, norm inf", "edge", "edge, turned", "edge, turned, best aspect"]
    heads = ["maps", "splits", *titles, "snapped spheres"]

    def cell(name: str) -> str:
        return geometric(errors_of(records, name) / base) if name in records[0]["error"] else "-"

    rows = [["1", "", *(cell(name) for name in ONE), "-"]]
    for count in COUNTS:
        for splits, title in SPLITS.items():
            stem = f"{count}-{splits}-"
            rows.append([str(count), title, *(cell(stem + warp) for warp in WARPS), cell(stem + "sphere")])
    told = []
    for name, other, goal in GOALS:
        ratios = errors_of(records, name) / errors_of(records, other)
        value = np.exp(np.log(ratios).mean())
        told.append(
            f"{name} over {other}: {value:.2f}, worst {ratios.max():.2f} (goal {goal}: "
            + ("met)" if value <= goal else "**missed**)")
        )
    return (
        f"{len(records)} frames of {len({r['scene'] for r in records})} scenes, as in [pixels.md](pixels.md); together "
        "the maps of each row have the texels of one of 1024 x 1024. Error over that of one map warped for E_p, norm "
        f"inf, geometric mean with its 95 % interval. {'; '.join(told)}.\n\n" + table(heads, rows)
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/pixels_cascades"))
    parser.add_argument("--count", type=int, default=2, help="frames of each scene in each class of theta")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES, help="some of the scenes only")
    parser.add_argument("--short", action="store_true", help="one small frame")
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    done = kept_records(
        asked.directory / "cascades.json", SCENES[-2:-1] if asked.short else asked.scenes, asked.count,
        (96, 60) if asked.short else (WIDTH, HEIGHT), record, 1 if asked.short else None,
    )  # fmt: skip
    text = tables([each for name in done for each in done[name]])
    (asked.directory / "tables.md").write_text(text, encoding="utf-8")
    if asked.page:
        write_between(asked.page, "cascades", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

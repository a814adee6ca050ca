"""What turning a warp and shaping its map are worth in pixels: over the frames of `pixels.py`, against ray-cast truth.

    python experiments/pixels_turned.py --directory runs/pixels_turned --page docs/direction.md

Each error is the mean over three sets of grid shifts. Turned warps are measured wherever they promise any gain; what a
threshold on the promise does is computed afterwards. A killed run resumes; turned.json has a row for each frame.
"""

import argparse
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
from pixels_page import geometric, table, write_between
from pixels_scenes import CLASSES, SCENES, kept_records

from warpopt.frames import Reading, measured
from warpopt.frames.fits import Fitting
from warpopt.frames.names import title_of, turn_of

WIDTH, HEIGHT, SIZE = 384, 240, 1024
RULES = ("none", "lispsm", "tsm", "filament")
STRAIGHT = (*RULES, "p-inf", "edge", "band")
TURNED = ("turned-edge", "turned-band", "shaped-edge", "shaped-band")
SHIFTS = (7, 8, 9)
THRESHOLDS = (1.0, 1.1)
GOALS = {"edge": 0.80, "band": 0.83}


def record(drawn) -> dict:
    """The wrong share under every warp, and what turned ones promised."""
    fitting = Fitting(drawn.lit, drawn.frame, (SIZE, SIZE), turn_only_if=1.0)
    told: dict = {
        "scene": drawn.scene, "class": drawn.theta_class, "judged": int(drawn.frame.judged.sum()), "error": {},
        "promised": {},
    }  # fmt: skip
    for name in (*STRAIGHT, *TURNED):
        made = fitting.fitted(name)
        shadow_map = fitting.map_of(made)
        told["error"][name] = float(np.mean([measured(drawn.frame, shadow_map, Reading(), s).wrong for s in SHIFTS]))
        told["promised"][name] = made.promised
    return told


def errors(records: list[dict], name: str, threshold: float = 1.0) -> np.ndarray:
    """Wrong shares; half a pixel where none is wrong. A turned warp below the threshold is the straight one."""
    straight = turn_of(name)[1]
    chosen = [name if (r["promised"][name] or 1.0) >= threshold else straight for r in records]
    return np.array([max(r["error"][c], 0.5 / r["judged"]) for r, c in zip(records, chosen, strict=True)])


def tables(records: list[dict]) -> str:
    """The results as Markdown."""
    base = errors(records, "p-inf")
    rows = []

    def row(name: str, threshold: float) -> None:
        ratios = errors(records, name, threshold) / base
        classes = [[r["class"] == k for r in records] for k in range(len(CLASSES))]
        cells = [f"{np.exp(np.log(ratios[c]).mean()):.2f}" if any(c) else "-" for c in classes]
        within = [
            f"{100 * (errors(records, name, threshold) / errors(records, r) <= 1.05).mean():.0f} %" for r in RULES
        ]
        words = title_of(name) + (f", if it promises {threshold:g}" if threshold > 1 else "")
        rows.append([words, geometric(ratios), f"{ratios.max():.2f}", *cells, *within])

    for name in ("none", "lispsm", "edge", "band"):
        row(name, 1.0)
    for name in TURNED:
        # Below a threshold a shaped map keeps its aspect, which was not measured along the view.
        for threshold in THRESHOLDS if name.startswith("turned-") else THRESHOLDS[:1]:
            row(name, threshold)
    heads = ["warp", "error over E_p's, L-inf: geometric mean", "worst"]
    heads += [f"{a} to {b} degrees" for a, b in CLASSES] + [
        f"within 5 % of {title_of(rule)} or better" for rule in RULES
    ]
    goals = "; ".join(
        f"{'with' if name == 'edge' else 'without'} edges {goal:.2f}: {value:.2f}, "
        + ("met" if value <= goal else "**missed**")
        for name, goal in GOALS.items()
        for value in [np.exp(np.log(errors(records, f"shaped-{name}") / base).mean())]
    )
    return (
        f"{len(records)} frames of {len({r['scene'] for r in records})} scenes, as in [pixels.md](pixels.md), by the "
        "angle between light and view; maps of 1024 x 1024 texels. Goals, with the best direction and aspect: "
        f"{goals}.\n\n" + table(heads, rows)
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/pixels_turned"))
    parser.add_argument("--count", type=int, default=2, help="frames of each scene in each class of theta")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES, help="some of the scenes only")
    parser.add_argument("--short", action="store_true", help="one small frame")
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    done = kept_records(
        asked.directory / "turned.json", SCENES[-2:-1] if asked.short else asked.scenes, asked.count,
        (96, 60) if asked.short else (WIDTH, HEIGHT), record, 1 if asked.short else None,
    )  # fmt: skip
    text = tables([each for name in done for each in done[name]])
    (asked.directory / "tables.md").write_text(text, encoding="utf-8")
    if asked.page:
        write_between(asked.page, "turned", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""What a plan of four cascades costs, over one `optimal_warp` of the same view: a million frusta, and a 1080p buffer.

    python experiments/cascade_cost.py --directory runs/cascade_cost

Alternated in one run, medians of CPU seconds: other processes do not count. Bars: as many solves as cascades for
frusta, ten for pixels.
"""

import argparse
import json
import time
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import jax
import numpy as np

import warpopt
from warpopt.receivers import DepthBuffer
from warpopt.scene_files.made import made_scene
from warpopt.scene_files.rasterise import rasterise
from warpopt.theory.camera import camera_of

COUNT, BARS = 4, {"frusta": 4.0, "pixels": 10.0}


def frusta(number: int) -> warpopt.FrustumView:
    """Views from a seed: far/near of 3 to 3000, any angle."""
    random = np.random.default_rng(0)
    near = random.uniform(0.1, 2, number)
    frustum = warpopt.ViewFrustum(near, near * np.exp(random.uniform(1, 8, number)), random.uniform(0.2, 0.7, number))
    return warpopt.FrustumView(frustum, random.uniform(0, np.pi / 2, number))


def pixels(width: int, height: int) -> warpopt.SceneView:
    """A city from a seed, in single precision, as engines have it."""
    scene = made_scene("city", 31)
    seen = scene.camera(0, width / height)
    depth = np.asarray(rasterise(scene.triangles, seen, height, width), np.float32)
    single = lambda tree: jax.tree.map(lambda v: np.asarray(v, np.float32), tree)  # noqa: E731
    return warpopt.SceneView(
        single(camera_of(seen)), single(warpopt.DirectionalLight((0.5, -0.8, -0.35))), DepthBuffer(depth),
        screen=(width, height), shadow_map=(2048, 2048),
    )  # fmt: skip


def seconds(call) -> float:
    start = time.process_time()
    jax.block_until_ready(call())
    return time.process_time() - start


def ratio(view, objective: warpopt.Objective, repeats: int) -> float:
    """Median CPU time of a plan over that of one solve."""
    calls = (
        lambda: warpopt.optimal_warp(view, objective).value,
        lambda: warpopt.cascades.plan(view, COUNT, objective).value,
    )
    times = [[seconds(call) for call in calls] for _ in range(repeats + 1)][1:]  # the first compiles
    one, plan = np.median(times, 0)
    return float(plan / one)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/cascade_cost"))
    parser.add_argument("--short", action="store_true", help="a thousand frusta, a small buffer, two repeats")
    asked = parser.parse_args(arguments)
    number, size, repeats = (1000, (192, 108), 2) if asked.short else (1_000_000, (1920, 1080), 7)
    views = {"frusta": (frusta(number), ("p", "pxq")), "pixels": (pixels(*size), ("p", "storage"))}
    told = {}
    for kind, (view, metrics) in views.items():
        for metric in metrics:
            told[f"{kind}, {metric}"] = made = ratio(view, warpopt.Objective(metric), repeats)
            verdict = "met" if made <= BARS[kind] else "missed"
            print(f"{kind}, {metric}: {made:.3g} times one optimal_warp (bar {BARS[kind]:g}: {verdict})", flush=True)
    asked.directory.mkdir(parents=True, exist_ok=True)
    (asked.directory / "cascade_cost.json").write_text(json.dumps(told))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

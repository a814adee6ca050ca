"""What a mean over edges costs: run time over a depth buffer as a multiple of that of E_p in L2, in one run.

python experiments/runtime_of_means.py --height 1080
python experiments/runtime_of_means.py --directions    # what the best direction costs over the view's
"""

import argparse
import csv
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

import warpopt
from warpopt.receivers import DepthBuffer

OBJECTIVES = [
    warpopt.Objective("p", "l2"), warpopt.Objective("p"), warpopt.Objective("edge"), warpopt.Objective("band"),
    warpopt.Objective("max", "l1"),
]  # fmt: skip


def ground_and_walls(height: int, seed: int) -> np.ndarray:
    """(height, 16/9 height) eye depths of level ground with upright walls; 0 is background."""
    width = height * 16 // 9
    rng = np.random.default_rng(seed)
    up = (1 - (np.arange(height) + 0.5) / height * 2)[:, None] * np.tan(0.4)
    across = ((np.arange(width) + 0.5) / width * 2 - 1) * np.tan(0.4) * 16 / 9
    depth = np.where(up < -0.005, 2 / np.maximum(-up, 1e-9), np.inf) + np.zeros(width)
    for _ in range(40):
        z, middle = np.exp(rng.uniform(2, 5)), rng.uniform(-0.7, 0.7)
        wall = (np.abs(across - middle) < rng.uniform(0.5, 2) / z) & (up < rng.uniform(-1, 6) / z) & (up > -2 / z)
        depth = np.where(wall & (z < depth), z, depth)
    return np.where(depth < 400, depth, 0.0)


def measured(height: int, repetitions: int) -> list[dict[str, float | str]]:
    """Weights, objective, milliseconds, multiple of E_p L2's time, excess and gap of each."""
    camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4, aspect=16 / 9)
    light = warpopt.DirectionalLight((0.3, -1, -0.5))
    depth = ground_and_walls(height, 0)
    place = depth * (np.arange(depth.shape[1]) + 0.5) / depth.shape[1]
    edges = warpopt.edge_weights(np.sin(3 * place) + np.cos(depth) > 0, DepthBuffer(depth), camera)
    rows = []
    for name, weights in (("uniform", None), ("edges", edges)):
        buffer = DepthBuffer(depth, weights=weights)
        view = warpopt.SceneView(camera, light, buffer, screen=(1920, 1080), shadow_map=(2048, 2048))
        times, found = {objective: [] for objective in OBJECTIVES}, {}
        for i in range(repetitions + 1):  # in turn, so that all meet the same load; the first compiles
            for objective in OBJECTIVES:
                start = time.perf_counter()
                found[objective] = jax.block_until_ready(warpopt.optimal_warp(view, objective))
                if i:
                    times[objective].append(time.perf_counter() - start)
        base = min(times[OBJECTIVES[0]])
        for objective, solution in found.items():
            took = min(times[objective])
            row = {"weights": name, "objective": objective.title, "ms": took * 1e3, "over_p_l2": took / base}
            rows.append(row | {"excess": float(solution.excess), "gap": float(solution.gap)})
    return rows


TURNED = [warpopt.Objective(name) for name in ("edge", "band", "storage", "pxq")]


def turned(height: int, repetitions: int) -> list[dict[str, float | str]]:
    """Objective, milliseconds along the view and along the best direction, their ratio, and the error's."""
    camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4, aspect=16 / 9)
    light, buffer = warpopt.DirectionalLight((0.5, -0.4, -1)), DepthBuffer(ground_and_walls(height, 0), weights="depth")
    views = {
        how: warpopt.SceneView(camera, light, buffer, screen=(1920, 1080), shadow_map=(2048, 2048), warp_direction=how)
        for how in ("view", "best")
    }
    rows = []
    for objective in TURNED:
        times, found = {how: [] for how in views}, {}
        for i in range(repetitions + 1):  # in turn, so that both meet the same load; the first compiles
            for how, view in views.items():
                start = time.perf_counter()
                found[how] = jax.block_until_ready(warpopt.optimal_warp(view, objective))
                if i:
                    times[how].append(time.perf_counter() - start)
        least = {how: 1e3 * min(each) for how, each in times.items()}
        row = {"objective": objective.title, "view_ms": least["view"], "best_ms": least["best"]}
        gain = float(found["view"].value / found["best"].value)
        rows.append(row | {"ratio": least["best"] / least["view"], "gain": gain})
    return rows


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--height", type=int, default=1080)
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--directory", type=Path)
    parser.add_argument("--directions", action="store_true", help="the best direction's cost instead")
    asked = parser.parse_args(arguments)
    if asked.directions:
        for row in turned(asked.height, asked.repetitions):
            words = (
                "{objective:16} {view_ms:8.1f} ms, best direction {best_ms:8.1f} ms: {ratio:5.2f}, error / {gain:.2f}"
            )
            print(words.format(**row))
        return 0
    rows = measured(asked.height, asked.repetitions)
    for row in rows:
        print("{weights:8} {objective:16} {ms:8.1f} ms {over_p_l2:6.2f}   excess {excess:.1e}".format(**row))
    if asked.directory is not None:
        asked.directory.mkdir(parents=True, exist_ok=True)
        with (asked.directory / "runtime_of_means.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""What a stable window's update costs over a 1080p depth buffer: against one pass over the receivers' extents.

    python experiments/window_cost.py --directory runs/window_cost

Alternated in one run, medians. "keeps": an update between two checks of its loss. "checks": one that finds the optimum.
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
from warpopt.receivers.answers import footprint_of
from warpopt.scene_files.made import made_scene
from warpopt.scene_files.rasterise import rasterise
from warpopt.theory.camera import camera_of

BAR = 1.2


@jax.jit
def extents(camera: warpopt.Camera, light: warpopt.DirectionalLight, receivers: DepthBuffer):
    """The receivers' groups along the view's warp: what any fit begins with."""
    view = warpopt.SceneView(camera, light, receivers)
    return footprint_of(view.receivers, view.camera, view.frame(), warpopt.Objective()).sides


def seconds(call) -> float:
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start


def measured(size: tuple[int, int], repeats: int) -> dict[str, float]:
    """Medians in seconds, and the state's bytes."""
    width, height = size
    scene = made_scene("city", 31)
    seen = scene.camera(0, width / height)
    receivers = DepthBuffer(np.asarray(rasterise(scene.triangles, seen, height, width), np.float32))
    # As engines have it: all in single precision.
    single = lambda tree: jax.tree.map(lambda v: np.asarray(v, np.float32), tree)  # noqa: E731
    camera, light = single(camera_of(seen)), single(warpopt.DirectionalLight((0.5, -0.8, -0.35)))
    settings = {"objective": warpopt.Objective("pxq"), "warp_direction": "view", "screen": size}
    calls, states = {"extents": lambda: extents(camera, light, receivers)}, {}
    for name, every in (("keeps", 10**6), ("checks", 1)):
        window = warpopt.StableWindow(check_every=every, **settings)
        _, states[name] = window.update(window.start(np.float32), camera, light, receivers)
        calls[name] = lambda window=window, name=name: window.update(states[name], camera, light, receivers)
        assert int(calls[name]()[0].action) == 0, "kept"
    times = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            times[name].append(seconds(call))
    found = {name: float(np.median(each)) for name, each in times.items()}
    return found | {"state_bytes": sum(leaf.nbytes for leaf in jax.tree.leaves(states["keeps"]))}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/window_cost"))
    parser.add_argument("--short", action="store_true", help="a small buffer, few repeats")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    found = measured(*(((192, 108), 5) if asked.short else ((1920, 1080), 51)))
    ratios = {name: found[name] / found["extents"] for name in ("keeps", "checks")}
    (asked.directory / "window_cost.json").write_text(json.dumps(found | {"ratios": ratios}))
    verdict = "met" if ratios["keeps"] <= BAR else "MISSED"
    print(
        f"an update that keeps: {ratios['keeps']:.2f} times the extents' pass (bar {BAR}: {verdict}); that checks "
        f"(E_pxq along the view): {ratios['checks']:.2f}; the state: {found['state_bytes']} bytes"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

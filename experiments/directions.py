"""The best direction of a warp against exhaustive search: 720 directions over a hundred frames.

    python experiments/directions.py --directory runs/directions
    python experiments/directions.py --directory runs/directions --page docs/direction.md --images docs/images

Frames are drawn from seeds, in scenes that no other experiment uses: their pixels, weighted by depth, are the
receivers. For each of the 720 directions eta is the certified global optimum, which no scan over eta betters. A killed
run resumes; directions.json has a row for each frame.
"""

import argparse
import dataclasses
import functools
import json
import os
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=3")  # it runs for long: not the command line's 0

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import jax
import jax.numpy as jnp
import numpy as np
from pixels_page import write_between
from pixels_scenes import CLASSES, draw, read_scene

import warpopt
from warpopt.app.common.light_plane import Drawn, light_plane_figure
from warpopt.frames import LitScene, see
from warpopt.receivers import DepthBuffer, PointReceivers
from warpopt.scene_files.scene_camera import SceneCamera
from warpopt.theory.camera import camera_of

KINDS, SEEDS = ("hills", "city", "forest", "corridor"), (31, 32, 33, 34, 35, 36, 37)
WIDTH, HEIGHT, MAP = 64, 40, 1024
COUNT, DIRECTIONS = 100, 720
OBJECTIVES = {"edge": warpopt.Objective("edge"), "storage": warpopt.Objective("storage")}
GIVEN = ("view", "gradient", "middle")
_PICTURED = "hills 22"


@dataclasses.dataclass(frozen=True, eq=False)
class Seen:
    """What one frame sees: a scene's name, the camera, eye depths, and the light's direction."""

    scene: str
    theta_deg: float
    camera: SceneCamera
    depth: np.ndarray
    light: np.ndarray


def seen_in(name: str) -> Iterator[Seen]:
    """A frame of a scene in each class of theta."""
    scene = read_scene(name)
    random = np.random.default_rng([*name.encode()])
    for low, high in CLASSES:
        while True:
            camera = scene.camera(int(random.integers(64)), WIDTH / HEIGHT, half_fov=0.45)
            elevation, azimuth = np.deg2rad(random.uniform(5, 80)), random.uniform(0, 2 * np.pi)
            flat = np.cos(elevation)
            light = np.array([flat * np.sin(azimuth), -np.sin(elevation), flat * np.cos(azimuth)])
            theta = float(np.rad2deg(np.arccos(min(1.0, abs(light @ camera.rotation[2])))))
            if low <= theta < high:
                depth = see(LitScene(scene.triangles, light), camera, HEIGHT, WIDTH).depth
                yield Seen(name, theta, camera, depth, light)
                break


def view_of(frame: Seen, direction="best") -> warpopt.SceneView:
    """One frame's pixels as points, weighted by their depth; background is behind the camera."""
    camera = camera_of(frame.camera)
    seen = np.isfinite(frame.depth)
    across, up = frame.camera.slopes(*frame.depth.shape)
    z = np.where(seen, frame.depth, -1.0)
    eye = np.stack([np.where(seen, z * across, 0), np.where(seen, z * up[:, None], 0), z], -1).reshape(-1, 3)
    points = PointReceivers(eye @ np.asarray(camera.rotation) + np.asarray(camera.position), weights="depth")
    return warpopt.SceneView(
        camera, warpopt.DirectionalLight(frame.light), points, screen=(WIDTH, HEIGHT), shadow_map=(MAP, MAP),
        warp_direction=direction,
    )  # fmt: skip


@functools.partial(jax.jit, static_argnames=("objective", "count"))
def exhaustive(view: warpopt.SceneView, objective: warpopt.Objective, count: int) -> jax.Array:
    """The least norm over eta along each of `count` even directions."""
    ahead = view.frame_along("view")

    def along(turn):
        direction = view.camera.rotation.T @ ahead.turned(jnp.cos(turn), jnp.sin(turn)).z_axis
        turned = warpopt.SceneView(
            view.camera, view.light, view.receivers, screen=view.screen, shadow_map=view.shadow_map,
            warp_direction=direction,
        )  # fmt: skip
        return warpopt.optimal_warp(turned, objective, throw=False).value

    return jax.lax.map(along, jnp.linspace(0, 2 * jnp.pi, count, endpoint=False))


def record(drawn: Seen, directions: int) -> dict:
    """What is measured on one frame."""
    told: dict = {"scene": drawn.scene, "theta_deg": drawn.theta_deg, "values": {}, "least": {}, "minima": {}}
    for name, objective in OBJECTIVES.items():
        found = warpopt.optimal_warp(view_of(drawn), objective, throw=False)
        every = np.asarray(exhaustive(view_of(drawn, "view"), objective, directions))
        told["values"][name] = {"best": float(found.value)} | {
            how: float(warpopt.optimal_warp(view_of(drawn, how), objective, throw=False).value) for how in GIVEN
        }
        told["least"][name] = float(every.min())
        told["minima"][name] = int(((every < np.roll(every, 1)) & (every <= np.roll(every, -1))).sum())
    return told


def tables(records: list[dict], directions: int) -> str:
    """The results as Markdown."""
    lines = [
        f"{len(records)} frames, {directions} directions each; ratios to the least of these.",
        "",
        "| objective | best: within 0.5 % | worst | view: mean, worst | gradient | middle | local minima |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in OBJECTIVES:
        ratio = {
            how: np.array([r["values"][name][how] / r["least"][name] for r in records]) for how in ("best", *GIVEN)
        }
        minima = [r["minima"][name] for r in records]
        cells = [f"{np.exp(np.log(ratio[how]).mean()):.3g}, {ratio[how].max():.3g}" for how in GIVEN]
        lines.append(
            f"| {name} | {(ratio['best'] <= 1.005).sum()} of {len(records)} | {ratio['best'].max():.4f} | "
            + " | ".join(cells)
            + f" | {min(minima)} to {max(minima)}, median {int(np.median(minima))} |"
        )
    return "\n".join(lines) + "\n"


def write_picture(folder: Path) -> None:
    """A light near the view direction, where the direction matters most: three maps on the light plane."""
    drawn = next(d for d in draw(_PICTURED, 1, 192, 120) if d.theta_class == 0)
    camera = camera_of(drawn.frame.camera)
    light, buffer = warpopt.DirectionalLight(drawn.lit.axes[2]), DepthBuffer(drawn.frame.depth, weights="depth")
    maps = []
    for how in ("view", "gradient", "best"):
        view = warpopt.SceneView(camera, light, buffer, screen=(192, 120), shadow_map=(MAP, MAP), warp_direction=how)
        found = warpopt.optimal_warp(view, OBJECTIVES["edge"])
        maps.append((how, found))
    straight = float(maps[0][1].value)
    titles = {"view": "Along the view", "gradient": "Along the gradient of depth", "best": "Best direction"}
    panels = [
        Drawn(titles[how], f"η = {float(found.warp.eta):.2g}, error {float(found.value) / straight:.2f}", found)
        for how, found in maps
    ]
    z = drawn.frame.depth
    across, up = drawn.frame.camera.slopes(*z.shape)
    there = np.isfinite(z)
    slopes = np.stack([*np.broadcast_arrays(across, up[:, None]), np.ones(z.shape)], -1)
    figure = light_plane_figure(slopes[there] * z[there][:, None], panels)
    figure.savefig(folder / "directions.png", dpi=160)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directory", type=Path, default=Path("runs/directions"))
    parser.add_argument("--short", action="store_true", help="two frames and 60 directions")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--images", type=Path, help="write the picture into this folder")
    asked = parser.parse_args(arguments)
    asked.directory.mkdir(parents=True, exist_ok=True)
    kept = asked.directory / "directions.json"
    records = json.loads(kept.read_text()) if kept.exists() else []
    count, directions = (2, 60) if asked.short else (COUNT, DIRECTIONS)
    names = [f"{kind} {seed}" for seed in SEEDS for kind in KINDS]
    drawn = (frame for name in names for frame in seen_in(name))
    for number, frame in enumerate(drawn):
        if number >= count:
            break
        if number < len(records):
            continue
        records.append(record(frame, directions))
        part = kept.with_suffix(".part")
        part.write_text(json.dumps(records))
        part.replace(kept)
        print(f"{number + 1} of {count}: {frame.scene}", flush=True)
    text = tables(records, directions)
    (asked.directory / "tables.md").write_text(text, encoding="utf-8")
    if asked.page:
        write_between(asked.page, "directions", text)
    if asked.images:
        write_picture(asked.images)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

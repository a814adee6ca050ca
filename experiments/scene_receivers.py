"""What a scene's receivers cost, and what cheaper descriptions of them lose.

    python experiments/scene_receivers.py --directory runs/scene_receivers

Times a 1920 by 1080 depth buffer from its pixels to its optimal warp, as a ratio to two minimal passes over it and to
`jnp.sum`; a box, clipped and integrated; and measures the regret of a depth histogram's warp on the buffer it was
counted from. Writes `receivers.json` and prints the tables. `--short` is a slice for tests.
"""

import argparse
import itertools
import json
import os
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import jax.numpy as jnp
import numpy as np
from provenance import markdown_table, provenance, sentence, write_section
from runtime_vs_error import seconds

import warpopt
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, WholeFrustum


def camera_of(dtype=np.float64) -> warpopt.Camera:
    camera = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), 0.1, 1000.0, 0.4, 16 / 9)
    return jax.tree.map(lambda v: v.astype(dtype), camera)


def landscape(camera: warpopt.Camera, height: int, width: int, roughness: float, posts: bool = False) -> np.ndarray:
    """Eye depths of a hilly ground under a sky, 0 where there is only sky; before it thin posts if asked for."""
    left, right, bottom, top = np.asarray(camera.window)
    x = left + (right - left) * (np.arange(width) + 0.5) / width
    y = top - (top - bottom) * (np.arange(height) + 0.5) / height
    axes = np.asarray(camera.rotation)
    falling = -(x[None, :] * axes[0, 1] + y[:, None] * axes[1, 1] + axes[2, 1])
    hills = 1 + roughness * np.sin(17 * x)[None, :] * np.cos(23 * y)[:, None]
    z = 2 * hills / np.maximum(falling, 1e-9)
    z = np.where((falling > 0) & (z < 1000), z, 0)
    if posts:
        before = (np.arange(width) % 60 < 4)[None] & ((z == 0) | (z > 2.5))
        z = np.where(before, 2.5, z)
    return z


def minimal_passes(z: jax.Array, camera: warpopt.Camera, frame: warpopt.theory.LightFrame) -> tuple[float, float]:
    """Seconds of the two passes that any solution must make, written for speed alone: extents, and five moments."""
    height, width = z.shape
    across = jnp.asarray(np.linspace(-0.7, 0.7, width), z.dtype)
    up = jnp.asarray(np.linspace(0.4, -0.4, height), z.dtype)

    @jax.jit
    def extents(z):
        def row(found, line):
            z, y = line
            d, x = (z * (axis[0] * across + (axis[1] * y + axis[2])) for axis in (frame.z_axis, frame.x_axis))
            least, largest = found
            new = (d, x, z)
            return (tuple(map(jnp.minimum, least, new)), tuple(map(jnp.maximum, largest, new))), None

        ends = tuple((jnp.full(width, edge, z.dtype),) * 3 for edge in (jnp.inf, -jnp.inf))
        (least, largest), _ = jax.lax.scan(row, ends, (z, up))
        return [v.min() for v in least] + [v.max() for v in largest]

    @jax.jit
    def moments(z, start, mu):
        def row(sums, line):
            z, y = line
            delta = (z * (frame.z_axis[0] * across + (frame.z_axis[1] * y + frame.z_axis[2])) - start) / mu
            rest, weight = 1 - delta, 1 / (z * z)
            near, far = rest * rest, delta * delta
            terms = (near * near, near * rest * delta, near * far, rest * delta * far, far * far)
            return tuple(s + weight * t for s, t in zip(sums, terms, strict=True)), None

        return [v.sum() for v in jax.lax.scan(row, (jnp.zeros(width, z.dtype),) * 5, (z, up))[0]]

    start, mu = jnp.asarray(-5.0, z.dtype), jnp.asarray(1000.0, z.dtype)
    return seconds(lambda: extents(z), 20), seconds(lambda: moments(z, start, mu), 20)


def buffer_times(height: int, width: int) -> list[dict]:
    rows = []
    small = height < 100  # a slice for tests: one dtype, one objective
    for dtype in (np.float64, np.float32)[: 1 if small else 2]:
        camera = camera_of(dtype)
        light = warpopt.DirectionalLight(np.array([0.3, -1, -0.4], dtype))
        frame = warpopt.theory.LightFrame(camera, light)
        total = jax.jit(jnp.sum)
        names = (("p", "l2"), ("pxq", "l2"), ("p", "inf"), ("pxq", "inf"))[: 1 if small else 4]
        for posts, objective in itertools.product((False, True), itertools.starmap(warpopt.Objective, names)):
            z = jnp.asarray(landscape(camera_of(), height, width, 0.1, posts), dtype)
            view = warpopt.SceneView(camera, light, DepthBuffer(z))
            summed = seconds(lambda v=z, f=total: f(v), 20)
            extents, moments = minimal_passes(jnp.where(z > 0, z, 1), camera, frame)

            def solve(view=view, objective=objective):
                return warpopt.optimal_warp(view, objective, throw=False)

            time = seconds(solve, 20)
            least = extents + (0 if objective.supremum else moments)
            rows.append(
                {"dtype": np.dtype(dtype).name, "scene": "posts" if posts else "hills",
                 "objective": named(objective), "ms": time * 1e3,
                 "minimal_passes": time / least, "sums": time / summed, "excess": float(solve().excess)}
            )  # fmt: skip
    return rows


def histogram_regrets(height: int, width: int) -> list[dict]:
    """How much worse the histogram's warp is on the buffer than the buffer's own, over light directions."""
    camera, rows = camera_of(), []
    theta = np.radians(np.arange(5, 180, 25))
    lights = np.stack([0.3 * np.sin(theta), -np.sin(theta), -np.cos(theta)], 1)
    small = height < 100
    lights = lights[2:4] if small else lights
    for roughness in (0.0,) if small else (0.0, 0.3):
        z = landscape(camera, height, width, roughness)
        buffer = DepthBuffer(z)
        edges = np.geomspace(z[z > 0].min() * (1 - 1e-12), z.max() * (1 + 1e-12), 65)
        others = {
            "histogram": DepthHistogram(edges, np.histogram(z[z > 0], edges)[0]),
            "whole frustum": WholeFrustum(),
        }
        for objective in (warpopt.Objective(metric, "l2") for metric in (("p",) if small else ("p", "pxq"))):
            worst = dict.fromkeys((*others, "no warp"), 0.0)
            for light in map(warpopt.DirectionalLight, lights):
                view = warpopt.SceneView(camera, light, buffer)
                own = warpopt.optimal_warp(view, objective)
                values = {"no warp": own.unwarped}
                for name, receivers in others.items():  # the same apex, fitted to what is seen
                    warp = warpopt.optimal_warp(warpopt.SceneView(camera, light, receivers), objective)
                    values[name] = warpopt.error_norm(view, warp, objective)
                worst |= {name: max(worst[name], float(value / own.value - 1)) for name, value in values.items()}
            rows.append({"roughness": roughness, "objective": named(objective), **worst})
    return rows


def body_times() -> list[dict]:
    camera, light = camera_of(), warpopt.DirectionalLight((0.3, -1, -0.4))
    rows = []
    for receivers in (WholeFrustum(), ConvexBody.box((-50, -1, -200), (50, 12, -3))):
        view = warpopt.SceneView(camera, light, receivers)
        for objective in (warpopt.Objective("p", "inf"), warpopt.Objective("p", "l2")):
            time = seconds(lambda v=view, o=objective: warpopt.optimal_warp(v, o, throw=False), 20)
            rows.append({"receivers": type(receivers).__name__, "objective": named(objective), "ms": time * 1e3})
    return rows


def named(objective: warpopt.Objective) -> str:
    return f"E_{objective.name} {objective.norm}"


def table(rows: list[dict]) -> str:
    return markdown_table((head.replace("_", " ") for head in rows[0]), (row.values() for row in rows))


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/scene_receivers"))
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--page", type=Path, help="a page with a place for `scene receivers`")
    arguments = parser.parse_args(words)
    size = (27, 48) if arguments.short else (1080, 1920)
    summary = provenance() | {
        "buffer": buffer_times(*size),
        "bodies": body_times(),
        "histogram_regret": histogram_regrets(*((27, 48) if arguments.short else (270, 480))),
    }
    arguments.directory.mkdir(parents=True, exist_ok=True)
    (arguments.directory / "receivers.json").write_text(json.dumps(summary, indent=1) + "\n")
    text = "\n\n".join(
        [
            f"A depth buffer of {size[1]} by {size[0]} pixels; `minimal passes` and `sums` are ratios (target: 1.5"
            " minimal passes), `excess` the bound on what grouping loses:",
            table(summary["buffer"]),
            "Other receivers, one call:",
            table(summary["bodies"]),
            "Worst regret on the buffer, over light directions, of warps made for a histogram of its depths (64 bins),"
            " for the whole frustum, and of none:",
            table(summary["histogram_regret"]),
            f"{sentence(summary)}.",
        ]
    )
    print(text)
    if arguments.page:
        write_section(arguments.page, "scene receivers", text)


if __name__ == "__main__":
    main()

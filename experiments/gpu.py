"""Depth buffers, batches and an animation on one GPU: times, what bounds them, and agreement with the CPU.

    python experiments/gpu.py --page docs/performance.md

In at most five minutes. Times are medians over ten runs of ten calls queued on the device, with the inputs there and
compilation apart; each call returns what a frame needs (warp, value, excess, result). The memory bound is the time that
a kernel takes to copy as many bytes as go in and out, measured in the same run. It runs on a CPU too, and names it;
`--short` is a slice for tests.
"""

import argparse
import contextlib
import functools
import gzip
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax import monitoring
from provenance import markdown_table, provenance, sentence, write_section

import warpopt
from warpopt.receivers import DepthBuffer

Call = Callable[..., object]
BATCH = [warpopt.Objective(metric, norm) for norm in ("inf", "l2") for metric in ("p", "q", "pxq")]
BATCH_BARS = {"inf": 3.0, "l2": 10.0}  # times the memory bound
PER_PIXEL = [warpopt.Objective("p", "l2"), warpopt.Objective("pxq", "l2")]
PER_PIXEL += [warpopt.Objective(metric) for metric in ("p", "q", "pxq", "storage", "max", "edge", "band")]


def scene(height: int, width: int) -> np.ndarray:
    """Eye depths of ground, hills behind it, and boxes, in single precision."""
    rng, top = np.random.default_rng(0), np.tan(0.5)
    y = (top - 2 * top * (np.arange(height) + 0.5) / height)[:, None]
    x = (-1 + 2 * (np.arange(width) + 0.5) / width) * top * width / height
    z = np.where(y < 0.05, 1.7 / np.maximum(0.06 - y, 1e-3), 80 + 20 * np.sin(3 * x))
    z = np.minimum(z, 120)
    for _ in range(30):
        row, column = rng.integers(0, height - height // 6), rng.integers(0, width - width // 8)
        box = z[row : row + height // 6, column : column + width // 10]
        np.minimum(box, rng.uniform(3, 60), out=box)
    return z.astype(np.float32)


def view_of(depth, position, forward, light, objective: warpopt.Objective, **options) -> warpopt.SceneView:
    height, width = depth.shape
    one = np.float32
    camera = warpopt.Camera(position, forward, (0, 1, 0), one(0.1), one(200), one(0.5), one(width / height))
    buffer = DepthBuffer(depth, weights="depth" if objective.kernel else None)
    return warpopt.SceneView(
        camera, warpopt.DirectionalLight(light), buffer, screen=(width, height), shadow_map=(1024, 1024), **options
    )


def still(height: int, width: int, objective: warpopt.Objective, **options) -> warpopt.SceneView:
    where = (np.array(v, np.float32) for v in ((0, 1.7, 0), (0, 0, -1), (0.5, -0.6, -1)))
    return view_of(scene(height, width), *where, objective, **options)


def needed(objective: warpopt.Objective) -> Call:
    """What a frame needs, compiled."""

    def solve(view):
        solution = warpopt.optimal_warp(view, objective, throw=False)
        return solution.warp, solution.value, solution.excess, solution.result

    return jax.jit(solve)


def queued(call: Call, *args, calls: int) -> float:
    """Seconds a call: the median over ten runs."""
    jax.block_until_ready(call(*args))
    jax.block_until_ready(call(*args))
    times, each = [], max(1, calls // 10)
    for _ in range(min(10, calls)):
        start = time.perf_counter()
        for _ in range(each):
            out = call(*args)
        jax.block_until_ready(out)
        times.append((time.perf_counter() - start) / each)
    return float(np.median(times))


def kernels(call: Call, *args) -> tuple[float, float]:
    """(kernels and copies a call, milliseconds that the device is busy with them); NaN where nothing tells."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            for _ in range(5):
                out = call(*args)
            jax.block_until_ready(out)
        files = sorted(Path(folder).rglob("*.trace.json.gz"))
        events = json.load(gzip.open(files[0]))["traceEvents"] if files else []
    names = {e["pid"]: e["args"]["name"] for e in events if e.get("name") == "process_name"}
    lanes = {(e["pid"], e["tid"]): e["args"]["name"] for e in events if e.get("name") == "thread_name"}
    times = [
        e["dur"] for e in events
        if e.get("ph") == "X" and "GPU" in names.get(e["pid"], "")
        and "Stream" in lanes.get((e["pid"], e["tid"]), "")
    ]  # fmt: skip
    return (len(times) / 5, sum(times) / 5e3) if times else (np.nan, np.nan)


def bandwidth(count: int, calls: int) -> float:
    """Bytes read and written a second by a kernel that adds 1."""
    values = jax.block_until_ready(jnp.ones(count, jnp.float32))
    return 8 * count / queued(jax.jit(lambda v: v + 1), values, calls=calls)


def frusta(count: int) -> warpopt.FrustumView:
    """That all differ."""
    ratio = jnp.geomspace(2, 1000, count, dtype=jnp.float32)
    frustum = warpopt.ViewFrustum(jnp.ones(count, jnp.float32), ratio, jnp.linspace(0.3, 0.7, count, dtype=jnp.float32))
    return warpopt.FrustumView(frustum, jnp.linspace(1.5, 0.1, count, dtype=jnp.float32))


def batches(count: int, objectives: list, calls: int, rate: float) -> list[dict]:
    view = jax.block_until_ready(frusta(count))
    rows = []
    for objective in objectives:
        plain = functools.partial(warpopt.optimal_warp, objective=objective, throw=False)
        compiled = jax.jit(plain)
        memory = compiled.lower(view).compile().memory_analysis()
        moved = memory.argument_size_in_bytes + memory.output_size_in_bytes
        took = queued(compiled, view, calls=calls)
        rows.append(
            {
                "objective": objective.title, "ms": took * 1e3, "device busy, ms": kernels(compiled, view)[1],
                "ns a solve": took / count * 1e9,
                "of the memory bound": took * rate / moved, "at most": BATCH_BARS[objective.norm],
                "plain call / compiled": queued(plain, view, calls=calls) / took,
                "peak / (in + out)": 1 + memory.temp_size_in_bytes / moved,
            }
        )  # fmt: skip
        _told(rows)
    return rows


def bar(objective: warpopt.Objective, height: int) -> float:
    """Milliseconds at most; other heights than these have none."""
    bars = {1080: (0.3, 0.5), 2160: (0.4, 1.0)}.get(height, (np.nan, np.nan))
    return bars[0] if objective.title == "E_p, norm l2" else bars[1]


def cases(sizes: list[tuple[int, int]], objectives: list[warpopt.Objective]) -> Iterator[tuple]:
    """(height, width, objective, options) of each row."""
    for height, width in sizes:
        for objective in objectives:
            yield height, width, objective, {}
    if len(objectives) > 1:
        yield *sizes[0], warpopt.Objective("pxq"), {"warp_direction": "best"}


def etas(sizes: list[tuple[int, int]], objectives: list[warpopt.Objective]) -> list[float]:
    return [float(call(view)[0].eta) for _, call, view in compiled_cases(sizes, objectives)]


def compiled_cases(sizes: list[tuple[int, int]], objectives: list[warpopt.Objective]) -> list[tuple]:
    """(case, call, view), all compiled, several at a time."""

    def compiled(case: tuple) -> tuple:
        height, width, objective, options = case
        view, call = jax.device_put(still(height, width, objective, **options)), needed(objective)
        jax.block_until_ready(call(view))
        return case, call, view

    with ThreadPoolExecutor(8) as pool:
        return list(pool.map(compiled, cases(sizes, objectives)))


def buffers(sizes: list, objectives: list, calls: int, short: bool) -> list[dict]:
    reference = None if jax.default_backend() == "cpu" else on_the_cpu(short)
    rows, found = [], compiled_cases(sizes, objectives)
    # Before anything is timed, as it keeps all cores busy.
    cpu = [float(call(view)[0].eta) for _, call, view in found] if reference is None else reference()
    for ((height, width, objective, options), call, view), eta in zip(found, cpu, strict=True):
        warp, _, excess, _ = call(view)
        took = queued(call, view, calls=calls)
        count, busy = kernels(call, view)
        rows.append(
            {
                "pixels": f"{width} x {height}", "objective": objective.title + (", best direction" if options else ""),
                "ms": took * 1e3, "at most": 2.0 if options and height == 1080 else bar(objective, height),
                "device busy, ms": busy, "kernels": count, "eta off the CPU's": abs(float(warp.eta) / eta - 1),
                "excess": float(excess),
            }
        )  # fmt: skip
        _told(rows)
    return rows


@contextlib.contextmanager
def compilations() -> Iterator[list[str]]:
    """The programs that are compiled meanwhile."""
    seen: list[str] = []

    def listen(event: str, _: float, **__) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            seen.append(event)

    monitoring.register_event_duration_secs_listener(listen)
    try:
        yield seen
    finally:
        monitoring.unregister_event_duration_listener(listen)


def animation(height: int, width: int, frames: int) -> dict:
    """A new camera, light and buffer for each frame, all made on the device; the warps stay there."""
    objective = warpopt.Objective("p", "l2")

    @jax.jit
    def frame(depth, position, forward, light):
        solution = warpopt.optimal_warp(view_of(depth, position, forward, light, objective), objective, throw=False)
        return jnp.roll(depth, 1, 1), solution.warp.eta

    turn = np.linspace(0, 2 * np.pi, frames, dtype=np.float32)
    ahead = np.stack([0.3 * np.sin(turn), 0 * turn, -1 + 0 * turn], 1)
    light = np.stack([np.cos(turn), -1 + 0 * turn, np.sin(turn)], 1)
    places, ahead, light = (list(jnp.asarray(v, jnp.float32)) for v in (ahead + np.float32(2), ahead, light))
    depth = jnp.asarray(scene(height, width))
    depth, first = jax.block_until_ready(frame(depth, places[0], ahead[0], light[0]))
    found = [first]
    with compilations() as compiled, jax.transfer_guard("disallow"):
        start = time.perf_counter()
        for parts in zip(places[1:], ahead[1:], light[1:], strict=True):
            depth, eta = frame(depth, *parts)
            found.append(eta)
        jax.block_until_ready(found)
        took = time.perf_counter() - start
    values = np.array([float(eta) for eta in found])
    return {
        "frames": frames, "pixels": f"{width} x {height}", "ms a frame": took / (frames - 1) * 1e3,
        "compilations after the first": len(compiled), "least eta": values.min(), "largest eta": values.max(),
    }  # fmt: skip


def driver() -> str:
    try:
        asked = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
        name, version = (
            subprocess.run(asked, capture_output=True, text=True, check=True).stdout.splitlines()[0].split(",")
        )
        return f"{name.strip()}, driver {version.strip()}; "
    except (OSError, subprocess.CalledProcessError, IndexError, ValueError):
        return ""


def on_the_cpu(short: bool) -> Callable[[], list[float]]:
    """The same etas from a process of its own that sees no GPU, begun at once."""
    command = [sys.executable, __file__, "--etas", *(["--short"] if short else [])]
    process = subprocess.Popen(command, env=os.environ | {"JAX_PLATFORMS": "cpu"}, stdout=subprocess.PIPE, text=True)
    return lambda: json.loads(process.communicate()[0].splitlines()[-1])


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/gpu"))
    parser.add_argument("--page", type=Path, help="a page with a place for `gpu`")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--etas", action="store_true", help="print the etas of the buffers, and nothing else")
    asked = parser.parse_args(words)
    sizes = [(36, 64)] if asked.short else [(1080, 1920), (2160, 3840)]
    objectives, calls = (PER_PIXEL[:1], 2) if asked.short else (PER_PIXEL, 100)
    if asked.etas:
        print(json.dumps(etas(sizes, objectives)))
        return
    of_batch = BATCH[::3] if asked.short else BATCH
    start = time.perf_counter()
    rate, count = bandwidth(2**14 if asked.short else 2**28, calls), 2**10 if asked.short else 2**24
    summary = provenance() | {
        "driver": driver(), "copies, GB/s": rate / 1e9, "batches": batches(count, of_batch, calls, rate),
        "buffers": buffers(sizes, objectives, calls, asked.short),
        "animation": animation(*sizes[0], 3 if asked.short else 1000),
    }  # fmt: skip
    summary["seconds"] = time.perf_counter() - start
    asked.directory.mkdir(parents=True, exist_ok=True)
    (asked.directory / "gpu.json").write_text(json.dumps(summary, indent=1) + "\n")
    text = "\n\n".join(
        [
            "Depth buffers, float32:", _table(summary["buffers"]),
            f"{count} frusta, float32; a kernel copies {rate / 1e9:.0f} GB/s, read and written:",
            _table(summary["batches"]),
            "An animation, E_p L2, without a transfer:", _table([summary["animation"]]),
            f"{summary['driver']}{sentence(summary)}.",
        ]
    )  # fmt: skip
    print(text)
    if asked.page:
        write_section(asked.page, "gpu", text)


def _told(rows: list[dict]) -> None:
    """Progress."""
    print(", ".join(f"{k} {v:.4g}" if isinstance(v, float) else str(v) for k, v in rows[-1].items()), file=sys.stderr)


def _table(rows: list[dict]) -> str:
    shown = [["-" if isinstance(v, float) and np.isnan(v) else v for v in row.values()] for row in rows]
    return markdown_table(rows[0], shown)


if __name__ == "__main__":
    main()

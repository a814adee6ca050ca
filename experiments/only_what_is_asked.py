"""What is not asked for is not paid for: each saving by its time with and without.

    python experiments/only_what_is_asked.py --directory runs/only_what_is_asked

Writes `savings.json` and prints the table. `--short` is a slice for tests. `--page` writes the table into a page.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import jax.monitoring
import numpy as np
from provenance import markdown_table, provenance, sentence, write_section
from runtime_vs_error import problems, seconds, view_of
from scene_receivers import landscape

import warpopt

_ROOT = Path(__file__).parents[1]


def saving(name: str, without: float, with_it: float, unit: str, how: str) -> dict:
    """`without` is the cost when it is not asked for, or taken the short way; `with_it` the other."""
    return {"saving": name, "without": without, "with": with_it, "unit": unit, "how": how}


def solves(count: int) -> list[dict]:
    """Inside the solver: no-warp cases, closed forms, a sweep's shared integrals."""
    found = []
    *frusta, _ = problems(count, 0)
    across = view_of((*frusta, np.full(count, 1.2)))
    along = view_of((*frusta, np.zeros(count)))  # the light along the view: no warp is best in every frustum

    def ns(view: warpopt.FrustumView, *objective: str, **options) -> float:
        what = warpopt.Objective(*objective)
        return seconds(lambda: warpopt.optimal_warp(view, what, throw=False, **options)) / count * 1e9

    outcomes = np.asarray(warpopt.optimal_warp(along, warpopt.Objective("p", "l2"), throw=False).result)
    if not (outcomes == warpopt.Outcome.no_warp).all():
        raise RuntimeError("expected no warp everywhere")
    decided, solved = (ns(view, "pxq", "l2") for view in (along, across))
    found.append(saving("no warp is best: no iteration", decided, solved, "ns a solve", "E_pxq L2, theta 0 and 1.2"))
    closed_forms = (("p", "l1"), ("q", "l2"), ("p", "inf"), ("q", "inf"), ("pxq", "inf"))
    for metric, norm in closed_forms if count > 10_000 else closed_forms[:1]:
        closed, iterated = (ns(across, metric, norm, method=m) for m in ("auto", "iterative"))
        found.append(
            saving(f"closed form, E_{metric} {norm}", closed, iterated, "ns a solve", "method= auto, iterative")
        )
    one, many = (
        warpopt.FrustumView(warpopt.ViewFrustum(near, 100.0, 0.5), across.theta) for near in (1.0, np.ones(count))
    )
    for metric in ("p", "pxq") if count > 10_000 else ("p",):
        shared, apart = (ns(view, metric, "l2") for view in (one, many))
        found.append(
            saving(
                f"a sweep's shared integrals, E_{metric} L2", shared, apart, "ns a solve", "one frustum, a copy each"
            )
        )
    return found


def scenes(count: int, height: int) -> list[dict]:
    """Any camera and light: no warp decided by its margin, moments that L-inf does not need."""
    found = []
    camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), 0.1, 1000.0, 0.4, 16 / 9)

    @jax.jit
    def solve(directions):
        def one(direction):
            view = warpopt.SceneView(camera, warpopt.DirectionalLight(direction))
            return warpopt.optimal_warp(view, warpopt.Objective("pxq", "l2"), throw=False)

        return jax.vmap(one)(directions)

    rng = np.random.default_rng(0)
    across = rng.normal(size=(count, 3)) * [1, 1, 0.2]
    along = np.array([0, 0, -1]) + 1e-9 * rng.normal(size=(count, 3))  # parallel up to rounding
    outcomes = np.asarray(solve(along).result)
    if not (outcomes == warpopt.Outcome.no_warp).all():
        raise RuntimeError("expected no warp everywhere")
    decided, solved = (seconds(lambda d=d: solve(d)) / count * 1e9 for d in (along, across))
    how = "E_pxq L2 over a frustum, light along the view and across, one vmap"
    found.append(saving("scene, no warp is best", decided, solved, "ns a solve", how))
    z = landscape(camera, height, height * 16 // 9, 0.1)
    light = warpopt.DirectionalLight((0.3, -1, -0.4))
    view = warpopt.SceneView(camera, light, warpopt.receivers.DepthBuffer(z))
    extents, both = (
        seconds(lambda o=objective: warpopt.optimal_warp(view, o, throw=False)) * 1e3
        for objective in (warpopt.Objective("p", "inf"), warpopt.Objective("p", "l2"))
    )
    how = f"E_p L-inf and L2 over {z.shape[1]} by {z.shape[0]} pixels"
    found.append(saving("scene, the pass for moments", extents, both, "ms a solve", how))
    return found


def runs() -> list[dict]:
    """The command: metrics, norms and figures that were not asked for, by compilations and by wall time."""
    config = _ROOT / "configs" / "quick.toml"
    compiled = {}
    for name, words in {
        "one metric": ["--objective.metrics", '["p"]', "--objective.norms", '["l2"]'],
        "three metrics": ["--objective.metrics", '["p", "q", "pxq"]', "--objective.norms", '["l2"]'],
        "three norms": ["--objective.metrics", '["p"]', "--objective.norms", '["inf", "l1", "l2"]'],
        "figures": ["--objective.metrics", '["p"]', "--objective.norms", '["l2"]', "--output.figures", "true"],
    }.items():
        with tempfile.TemporaryDirectory() as folder:
            figures = [] if name == "figures" else ["--output.figures", "false"]
            command = [sys.executable, __file__, "--count-compilations", str(config), *words, *figures]
            start = time.perf_counter()
            environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": ""}
            out = subprocess.run(
                [*command, "--output.directory", f"{folder}/run"],
                capture_output=True,
                text=True,
                check=True,
                env=environment,
            )
            compiled[name] = int(out.stdout.split()[-1]), time.perf_counter() - start
    base = compiled.pop("one metric")
    found = []
    for name, (count, wall) in compiled.items():
        found.append(
            saving(f"{name}: compilations", base[0], count, "compilations", "a run of E_p L2 alone, and with them")
        )
        found.append(saving(f"{name}: wall time", base[1], wall, "s a run", "a run of E_p L2 alone, and with them"))
    return found


def count_compilations(words: list[str]) -> None:
    """Run the command in this process and print how many programs XLA compiled."""
    from warpopt.app.cli import main as warpopt_main

    count = 0

    def listen(event: str, duration: float, **_) -> None:
        nonlocal count
        count += event == "/jax/core/compile/backend_compile_duration"

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        code = warpopt_main(["run", *words])
    except SystemExit as end:
        code = end.code
    print(f"\n{count}")
    raise SystemExit(code or 0)


def table(savings: list[dict]) -> str:
    rows = ((s["saving"], f"{s['without']:.4g}", f"{s['with']:.4g}", s["unit"], s["how"]) for s in savings)
    return markdown_table(("what", "without", "with", "unit", "how"), rows)


def main(words: list[str] | None = None) -> None:
    words = sys.argv[1:] if words is None else words
    if words[:1] == ["--count-compilations"]:
        return count_compilations(words[1:])
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/only_what_is_asked"))
    parser.add_argument("--batch", type=int, default=1_000_000)
    parser.add_argument("--short", action="store_true", help="a small batch and no runs of the command")
    parser.add_argument("--page", type=Path, help="a page with a place for `only what is asked`")
    arguments = parser.parse_args(words)
    savings = (
        solves(2_000) + scenes(64, 27) if arguments.short else solves(arguments.batch) + scenes(4096, 1080) + runs()
    )
    summary = provenance() | {"savings": savings}
    arguments.directory.mkdir(parents=True, exist_ok=True)
    (arguments.directory / "savings.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(table(savings))
    if arguments.page:
        write_section(arguments.page, "only what is asked", f"{table(savings)}\n\n{sentence(summary)}.")


if __name__ == "__main__":
    main()

"""What works with what: each camera, kind of receivers, metric and verb is tried, and refusals are quoted.

    python experiments/support.py [--page docs/support.md]

Solves are traced, not run: what is refused is refused before; bounds and comparisons are computed.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import jax.numpy as jnp
import numpy as np
from provenance import markdown_table, write_section

import warpopt
from warpopt import receivers

_POSE = (0.0, 2.0, 0.0), (0.0, -0.1, -1.0), (0.0, 1.0, 0.0)
CAMERAS = {
    "perspective": warpopt.Camera(*_POSE, near=0.5, far=100.0, half_fov=0.4),
    "orthographic": warpopt.Camera.orthographic(*_POSE, near=0.5, far=100.0, half_height=10.0),
}
_POINTS = np.array([(-3.0, 0.0, -9.0), (2.0, 1.0, -20.0), (0.0, 0.0, -40.0), (4.0, 3.0, -30.0)])
RECEIVERS = {
    "WholeFrustum": receivers.WholeFrustum(),
    "ConvexBody": receivers.ConvexBody.box((-5, -1, -60), (5, 6, -5)),
    "GroundPlane": receivers.GroundPlane((0.0, 1.0, 0.0), 0.0),
    "PointReceivers": receivers.PointReceivers(_POINTS),
    "DepthBuffer": receivers.DepthBuffer(np.geomspace(5.0, 60.0, 12).reshape(3, 4)),
    "DepthHistogram": receivers.DepthHistogram([1.0, 9.0, 60.0], [1.0, 2.0]),
}
OBJECTIVES = {
    "p inf": ("p", "inf"), "p l2": ("p", "l2"), "q inf": ("q", "inf"), "pxq l1": ("pxq", "l1"),
    "max inf": ("max", "inf"), "max l1": ("max", "l1"), "storage": ("storage", "inf"), "edge l1": ("edge", "l1"),
}  # fmt: skip
_LIGHT = warpopt.DirectionalLight((0.3, -1.0, -0.4))
_LIGHTS = jax.vmap(warpopt.DirectionalLight)(jnp.array([[0.3, -1.0, -0.4]]))


def _solve(camera: Any, seen: Any, objective: Any, **how: Any) -> None:
    view = warpopt.SceneView(camera, _LIGHT, seen, **how)

    def verbs() -> Any:
        solution = warpopt.optimal_warp(view, objective, throw=False)
        norm = solution.value if view.searched else warpopt.error_norm(view, solution, objective)
        return solution, norm, warpopt.shadow_matrix(view, solution)

    jax.eval_shape(verbs)


def _window(camera: Any, seen: Any, objective: Any) -> None:
    window = warpopt.StableWindow(objective=objective, warp_direction="view")
    jax.eval_shape(lambda state: window.update(state, camera, _LIGHT, seen), window.start())


VERBS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "`optimal_warp`, `error_norm`, `shadow_matrix`": _solve,
    '`warp_direction="best"`': lambda c, r, o: _solve(c, r, o, warp_direction="best"),
    '`map_aspect="best"`': lambda c, r, o: _solve(c, r, o, map_aspect="best"),
    '`lateral="free"`': lambda c, r, o: _solve(c, r, o, lateral="free"),
    "`lower_bound`": lambda c, r, o: warpopt.lower_bound(warpopt.SceneView(c, _LIGHT, r), o),
    "`compare_rules`": lambda c, r, o: warpopt.compare_rules(warpopt.SceneView(c, _LIGHTS, r), ["lispsm"], o),
    "`StableWindow.update`": _window,
    "`cascades.plan`": lambda c, r, o: warpopt.cascades.plan(warpopt.SceneView(c, _LIGHT, r), 2, o),
}


def words(verb: str, camera: str, seen: str, objective: str) -> str | None:
    """None if it works, or what it is refused with."""
    try:
        VERBS[verb](CAMERAS[camera], RECEIVERS[seen], warpopt.Objective(*OBJECTIVES[objective]))
    except ValueError as error:
        return str(error)
    return None


def tables(found: Callable[[str, str, str, str], str | None]) -> Iterator[str]:
    """A table for each verb, and the refusals that its numbers stand for."""
    for verb in VERBS:
        notes: dict[str, int] = {}
        rows = []
        for camera in CAMERAS:
            for seen in RECEIVERS:
                told = [found(verb, camera, seen, objective) for objective in OBJECTIVES]
                cells = ["works" if text is None else str(notes.setdefault(text, len(notes) + 1)) for text in told]
                rows.append((camera, seen, *cells))
                jax.clear_caches()  # of programs that nothing runs again
        yield f"## {verb}\n\n{markdown_table(('camera', 'receivers', *OBJECTIVES), rows)}\n"
        yield "".join(f"{number}. `{text}`\n" for text, number in notes.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    arguments = parser.parse_args()
    parts = []
    for part in tables(words):
        print(part, flush=True)
        parts.append(part)
    text = "\n".join(parts)
    if arguments.page:
        write_section(arguments.page, "support", text)


if __name__ == "__main__":
    main()

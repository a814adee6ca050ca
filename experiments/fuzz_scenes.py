"""Scenes with flaws: a result that an oracle does not refute, or one sentence, and never anything else.

    python experiments/fuzz_scenes.py --directory runs/fuzz_scenes

Each try writes a scene's TOML, a depth array or a glTF file, changes some of it at random, and takes it through the
command's own reading, checking and solving, in one process. What is solved is compared with brute force over the pixels
of its depth image, at the optimum and on a grid of eta; a depth file with its conventions, pixel by pixel; glTF with
the tests' own reader of its specification. A warning is a defect too. Writes `fuzz.json`: how the tries ended, and each
defect with its seed.
"""

import argparse
import collections
import copy
import json
import os
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any

os.environ.setdefault("JAX_ENABLE_X64", "1")
sys.path.append(str(Path(__file__).parents[1] / "tests"))

import gltf_cases
import gltf_oracle
import numpy as np
from provenance import provenance

import warpopt
from warpopt.app.inputs import ConfigError, SceneInput, SceneSettings, read_scene, read_settings
from warpopt.app.inputs.scene_values import under_light, views_of

SHAPE = (9, 16)  # of every image that is solved, so that there is one compiled program for each kind
MOST_LINES = 12
MOST_TEXT = 1500
_FOREIGN = ("Traceback", "Error", "<class", "Input ", "after validation", "pydantic", "numpy", "jax")
_NUMBERS = [0.0, -1.0, 1.0, 0.5, 1e-3, 2.5, 1e3, 1e9, 1e30, 1e300, 1e-300, float("inf"), -float("inf"), float("nan")]
_ORDERS = [2.0, 33.0]  # of E_p's norm over receivers: the largest with an answer, and a common one
_LARGE_ORDERS = [33.5, 40.0, 70.0, 1e3, 1e300]
_OTHERS = [True, False, "", "x", "inf", [], [0.0, 1.0], {}, 0, 1, -3, 7, 10**6]
_KEYS = {
    "camera": {
        "far": [float("inf"), 50.0, 5.0], "half_fov_x_deg": [30.0], "half_fov_deg": [20.0], "fx": [14.0], "fy": [14.0],
        "aspect": [SHAPE[1] / SHAPE[0], 1.0], "cx": [8.0, 3.0], "cy": [4.5], "image_size": [[16, 9], [8, 8]],
        "first_centre": [0, 0.5], "window": [[-0.5, 0.5, -0.3, 0.3]], "up": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "target": [[0.0, 0.0, -5.0]], "looks_along": ["+z"],
    },
    "depth": {
        "encoding": ["linear", "standard", "reversed"], "scale": [0.001, 2.0], "background": [30.0, 0.5, 1e9],
        "nan_is_background": [True], "rows": ["bottom_up"], "distance": ["ray", "planar"], "key": ["z"],
        "channel": ["Z"], "part": [0], "size": [[16, 9]],
    },
    "gltf": {"include": ["a*", "*"], "exclude": ["*b*"], "camera": [0, 1, "x"], "far": [100.0], "width": [16, 8]},
    "light": {"from_file": [True, 0, "sun"], "direction": [[0.0, -1.0, 0.0], [0.1, -0.2, 1.0]]},
}  # fmt: skip


_PINHOLE = {"fx", "fy", "cx", "cy", "image_size", "first_centre"}


class Defect(Exception):
    """What must not be."""


def base(random: np.random.Generator, kind: str, document: dict[str, Any] | None) -> dict[str, Any]:
    """A scene that is right, in one of some norms; a document's is seen whole, if the oracle can read it."""
    camera = {
        "position": [0.0, 2.0, 0.0], "forward": [0.0, -0.3, -1.0], "near": 0.5, "far": 200.0, "half_fov_deg": 22.0,
        "aspect": SHAPE[1] / SHAPE[0],
    }  # fmt: skip
    scene = {
        "camera": camera,
        "light": {"direction": [float(v) for v in random.normal(size=3)]},
        "receivers": {"depth": {"files": ["a.npy"]}}
        if kind == "depth"
        else {"gltf": {"file": "a.gltf", "width": SHAPE[1]}},
    }
    if kind == "gltf":
        camera |= looking_at(document)
    if random.random() < 0.15:
        scene["objective"] = {"norms": [float(random.choice(_ORDERS if random.random() < 0.7 else _LARGE_ORDERS))]}
    if random.random() < 0.3:
        del camera["far"]
    return scene


def looking_at(document: dict[str, Any] | None) -> dict[str, Any]:
    """A camera's keys, for a view of a document's triangles from above their middle."""
    try:
        low, high = gltf_oracle.box(gltf_oracle.triangles(document))
    except Exception:  # it trusts its input
        low = high = np.zeros(3)
    size = float(np.linalg.norm(high - low))
    if not 0 < size < np.inf:
        return {"position": [0.0, 2.0, 6.0]}
    position = (low + high) / 2 + np.array([0.0, 0.5, 1.5]) * size
    return {
        "position": position.tolist(), "forward": [0.0, -0.3, -1.0], "near": size / 100, "far": 10 * size,
    }  # fmt: skip


def changed(random: np.random.Generator, scene: dict[str, Any], kind: str) -> dict[str, Any]:
    """Some keys added, replaced or taken away: half with what is meant for them."""
    tables = {"camera": scene["camera"], kind: scene["receivers"][kind], "light": scene["light"]}
    for _ in range(random.choice([0, 1, 2, 3], p=[0.65, 0.2, 0.1, 0.05])):
        name = str(random.choice(list(tables)))
        table, known = tables[name], _KEYS[name]
        if random.random() < 0.7:
            key = str(random.choice(list(known)))
            table[key] = copy.deepcopy(known[key][random.integers(len(known[key]))])
            if random.random() < 0.9:  # with what belongs to it, without what it excludes
                table.pop({"from_file": "direction", "target": "forward"}.get(key), None)
                if key in _PINHOLE | {"half_fov_x_deg", "window"}:
                    table.pop("half_fov_deg", None)
                if key in _PINHOLE | {"window"}:
                    table.pop("aspect", None)
                if key in _PINHOLE:
                    table |= {"fx": 14.0, "fy": 14.0, "cx": 8.0, "cy": 4.5} | table
        else:
            key = str(random.choice(list(table)))
            if random.random() < 0.3:
                del table[key]
            else:
                values = _NUMBERS if random.random() < 0.6 else _OTHERS
                table[key] = copy.deepcopy(values[random.integers(len(values))])
        if not table:
            break
    return scene


def depth_values(random: np.random.Generator, near: float = 0.5) -> np.ndarray:
    """A depth image of ground, a wall or noise, some of it background or worse, in some dtype."""
    rows = (np.arange(SHAPE[0])[:, None] + 0.5) / SHAPE[0]
    z = [
        2 / np.maximum(rows - 0.2, 1e-2) + np.zeros(SHAPE),
        np.full(SHAPE, 10 ** random.uniform(-1, 4)),
        10 ** random.uniform(-1, 4, SHAPE),
    ][random.integers(3)]
    form = random.integers(6)
    if form == 0:
        z = np.clip(near / z, 0, 1)
    elif form == 1:
        z = np.clip(1 - near / z, 0, 1)
    for value in (0.0, -1.0, np.inf, np.nan, 1e30):
        if random.random() < (0.04 if np.isnan(value) else 0.2):
            z = np.where(random.random(SHAPE) < random.choice([0.1, 0.5, 1.0]), value, z)
    dtype = random.choice(
        ["f8", "f4", "f2", ">f4", "u2", "i4", "b1", "c8"], p=[0.4, 0.2, 0.1, 0.05, 0.1, 0.1, 0.025, 0.025]
    )
    with np.errstate(all="ignore"):
        z = z.astype(dtype)
    shapes = [z, z[..., None], z[:, :8], z[0], z[::-1].T]
    return shapes[random.choice(5, p=[0.86, 0.1, 0.02, 0.01, 0.01])]


def attempt(seed: int, folder: Path) -> str:
    """How a try ends: "read", "empty", or the kind of refusal.

    Raises:
        Defect: an exception that is no sentence, a sentence that is none, or a number that the oracle refutes.
    """
    random = np.random.default_rng(seed)
    kind = "depth" if seed % 2 else "gltf"
    document = None
    if kind == "gltf":
        names = list(gltf_cases.MAKERS)
        document = gltf_cases.document(names[random.integers(len(names))])
        if random.random() < 0.5:
            document = gltf_cases.random_document(seed)
        for _ in range(random.choice([0, 0, 0, 1, 2])):
            document = gltf_cases.mutated(document, random)
        (folder / "a.gltf").write_text(json.dumps(document))
    right = base(random, kind, document)
    if kind == "depth":
        values = depth_values(random)
        np.save(folder / "a.npy", values)
        if values.dtype.kind in "iu" and random.random() < 0.8:
            right["receivers"]["depth"]["scale"] = 0.1
        if values.ndim == 2 and values.shape == SHAPE and values.dtype.kind == "f" and random.random() < 0.8:
            right["receivers"]["depth"] |= {"nan_is_background": True} if np.isnan(values).any() else {}
    scene = changed(random, right, kind)
    (folder / "scene.toml").write_text(toml_of(scene))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            config = read_settings(folder / "scene.toml")
            read = read_scene(config, folder)
            (view,) = views_of(config, read)
            (objective,) = config.objective.objectives()
            solution = warpopt.optimal_warp(under_light(view, 0), objective, throw=False)
            matrix = warpopt.shadow_matrix(under_light(view, 0), solution)
    except ConfigError as error:
        told = str(error)
        if len(told) > MOST_TEXT or len(told.splitlines()) > MOST_LINES or any(word in told for word in _FOREIGN):
            raise Defect(f"no sentence: {told}") from None
        return "refused"
    except Exception:
        raise Defect(traceback.format_exc()) from None
    outcome = warpopt.Outcome(int(solution.result))
    if kind == "depth":
        values = np.load(folder / "a.npy")
        check_depth(config, read, values)
    elif config.receivers.gltf is not None:
        check_gltf(config, read, document)
    if outcome is warpopt.Outcome.empty:
        if kind == "depth" and not read.notes:
            raise Defect("an image of background alone, and no word of why")
        return "empty"
    if not outcome.succeeded:
        return outcome.name
    if not np.isfinite(matrix).all():
        raise Defect("a warp whose matrix is not finite")
    check_optimum(read, under_light(view, 0), solution, outcome, objective.order)
    return "solved"


def check_depth(config: SceneSettings, read: SceneInput, values: np.ndarray) -> None:
    """The eye depths that were read, against the conventions written out pixel by pixel."""
    asked, camera = config.receivers.depth, read.cameras[0]
    found = eye_depth(read)
    values = values[..., 0] if values.ndim == 3 else values
    height, width = values.shape
    left, right, bottom, top = camera.window
    for row, column in np.ndindex(height, width):
        v = float(values[row, column]) * (asked.scale or 1.0)
        at = height - 1 - row if asked.rows == "bottom_up" else row
        x = left + (right - left) * (column + 0.5) / width
        y = top - (top - bottom) * (at + 0.5) / height
        expected = np.inf
        limit = asked.background
        if asked.encoding == "linear":
            shown = 0 < v < np.inf and (limit is None or v < limit)
            z = v / np.sqrt(1 + x * x + y * y) if asked.distance == "ray" else v
            expected = z if shown and z < camera.far else np.inf
        elif v == v:
            u = 1 - v if asked.encoding == "standard" else v
            beyond = limit is not None and (v >= limit if asked.encoding == "standard" else v <= limit)
            share = camera.near / camera.far
            expected = camera.near / (share + u * (1 - share)) if u > 0 and not beyond else np.inf
        got = found[at, column]
        if not (np.isclose(got, max(expected, camera.near), rtol=1e-9, atol=0) or got == expected):
            raise Defect(f"pixel {row}, {column}: read as {got}, expected {expected}")


def eye_depth(read: SceneInput) -> np.ndarray:
    """Of the first image; inf for background, nothing nearer than the near plane."""
    depth, camera = np.asarray(read.depths[0], float), read.cameras[0]
    share = camera.near / camera.far
    if read.encoding == "linear":
        shown = (depth > 0) & (depth < camera.far)
        return np.where(shown, np.maximum(np.where(shown, depth, 1), camera.near), np.inf)
    u = 1 - depth if read.encoding == "standard" else depth
    return np.where(u > 0, camera.near / np.where(u > 0, share + u * (1 - share), 1), np.inf)


def check_gltf(config: SceneSettings, read: SceneInput, document: dict[str, Any]) -> None:
    """The box of the triangles, where the oracle can read the document and nothing was chosen."""
    asked = config.receivers.gltf
    if asked.include or asked.exclude:
        return
    try:
        expected = gltf_oracle.triangles(document)
    except Exception:  # it trusts its input; a document that it cannot read has no expected value
        return
    found = read.triangles
    atol = 1e-12 * max(np.abs(expected).max(), 1e-300)
    if found.shape != expected.shape or not np.allclose(
        gltf_oracle.box(found), gltf_oracle.box(expected), rtol=1e-12, atol=atol
    ):
        raise Defect("the triangles are not where the oracle has them")


def check_optimum(read: SceneInput, view: Any, solution: Any, outcome: Any, order: float) -> None:
    """E_p in L_order over the pixels, by brute force: the value at the optimum, and that no other eta has less.

    With Z_w the light's own, as world vectors, e = density mu A^2 / (z eta), A = eta + (1 - eta) delta.
    """
    camera = read.cameras[0]
    z = eye_depth(read)
    across, up = camera.slopes(*z.shape)
    shown = np.isfinite(z)
    x, y = (np.broadcast_to(slopes, z.shape)[shown] * z[shown] for slopes in (across, up[:, None]))
    z = z[shown]
    light = camera.rotation @ np.asarray(view.light.direction)
    side = np.hypot(light[0], light[1])
    if side < 1e-6:  # light along the view: Z_w has no direction of its own
        return
    axis = np.array([0, 0, 1.0]) - light * light[2]
    axis /= np.linalg.norm(axis)
    d = np.stack([x, y, z], 1) @ axis
    mu = np.ptp(d)
    if outcome is warpopt.Outcome.flat or mu <= 1e-9 * np.abs(d).max():
        if (outcome is warpopt.Outcome.flat) and mu > 1e-9 * np.abs(d).max():
            raise Defect(f"flat, and depths differ by {mu}")
        return
    delta = (d - d.min()) / mu
    best = float(solution.warp.eta)
    etas = np.array([best, 1.0, 0.3, 0.01, best * 0.9, min(1.0, best * 1.1), *np.geomspace(1e-4, 1, 60)])
    blend = etas[:, None] + (1 - etas[:, None]) * delta
    errors = float(solution.frame.density_p) * mu * blend**2 / (z * etas[:, None])
    values = errors.max(1)
    if np.isfinite(order):
        values = values * ((errors / values[:, None]) ** order).mean(1) ** (1 / order)
    # Groups of pixels bound theirs from above, by at most what the solution says.
    for reported, pixels in zip((float(solution.value), float(solution.unwarped)), values[:2], strict=True):
        if not pixels * (1 - 1e-6) <= reported <= pixels * (1 + float(solution.excess) + 1e-6):
            raise Defect(f"E_p was reported as {reported}, and is {pixels} over the pixels")
    least = values.min()
    if values[0] > least * (1 + float(solution.excess) + 1e-6):
        raise Defect(f"eta {best} has {values[0]}, another has {least}")


def toml_of(data: dict[str, Any]) -> str:
    """As TOML, tables inline."""
    return "".join(f"{name} = {_inline(value)}\n" for name, value in data.items())


def _inline(value: Any) -> str:
    match value:
        case dict():
            return "{ " + ", ".join(f"{k} = {_inline(v)}" for k, v in value.items()) + " }"
        case list():
            return f"[{', '.join(map(_inline, value))}]"
        case bool():
            return str(value).lower()
        case float():
            return repr(value)
        case _:
            return json.dumps(value) if isinstance(value, str) else str(value)


def fuzz(first: int, count: int, folder: Path) -> tuple[collections.Counter, list[dict[str, Any]]]:
    """(how tries ended, defects)."""
    ends: collections.Counter = collections.Counter()
    defects = []
    for seed in range(first, first + count):
        try:
            ends[attempt(seed, folder)] += 1
        except Defect as defect:
            ends["defect"] += 1
            defects.append({"seed": seed, "defect": str(defect)})
    return ends, defects


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/fuzz_scenes"))
    parser.add_argument("--tries", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        ends, defects = fuzz(arguments.first, arguments.tries, Path(folder))
    arguments.directory.mkdir(parents=True, exist_ok=True)
    summary = provenance() | {
        "tries": arguments.tries,
        "first": arguments.first,
        "ends": dict(ends),
        "defects": defects,
    }
    (arguments.directory / "fuzz.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(dict(ends))
    for defect in defects[:20]:
        print(defect["seed"], defect["defect"].strip().splitlines()[-1])


if __name__ == "__main__":
    main()

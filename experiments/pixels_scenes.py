"""The frames of `pixels.py`: ten scenes, four classes of theta, drawn from seeds; no frame is chosen by its result."""

import dataclasses
import itertools
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from warpopt.frames import Frame, LitScene, see
from warpopt.scene_files.gltf import read_geometry
from warpopt.scene_files.made import MadeScene, made_scene

ASSETS = Path(__file__).with_name("assets")
CLASSES = ((0, 15), (15, 45), (45, 75), (75, 90))
"""Degrees between the light and the view's axis, either way along it."""
SCENES = (
    "hills 21", "hills 22", "city 21", "city 22", "forest 21", "forest 22", "corridor 21", "corridor 22",
    "hand.glb", "controller.glb",
)  # fmt: skip
"""Two of each kind from seeds, and two grids of a real model."""
LEAST_EDGES = 100
"""Pixels beside a true edge below which a frame's error rests on too few pixels: drawn again, and counted."""


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """A frame that was drawn.

    Attributes:
        scene: its name in `SCENES`.
        theta_class: index in `CLASSES`.
        theta_deg: angle between light and view's axis, either way along it: at most 90.
        lit: the scene under the frame's light.
        frame: its pixels and truth.
        skipped: draws before it that had no shadow's edge, or almost none.
    """

    scene: str
    theta_class: int
    theta_deg: float
    lit: LitScene
    frame: Frame
    skipped: int


def read_scene(name: str) -> MadeScene:
    """A scene by its name in `SCENES`."""
    if name.endswith(".glb"):
        return model_grid(name)
    kind, seed = name.split()
    return made_scene(kind, int(seed))


def model_grid(name: str, side: int = 5) -> MadeScene:
    """side x side copies of a model, 2 high and 5 apart, on a floor, each turned by a random angle."""
    model = read_geometry(ASSETS / name).triangles
    model = model - np.append((model.min((0, 1)) + model.max((0, 1)))[:2] / 2, 0)[[0, 1, 2]]
    model = model[..., [0, 2, 1]] * [1, 1, -1] if name == "controller.glb" else model
    model = model - [0, model[..., 1].min(), 0]
    model = model * (2 / np.ptp(model[..., 1]))
    random = np.random.default_rng([len(name), side])
    parts, places = [], 5.0 * (np.arange(side) - (side - 1) / 2)
    for x in places:
        for z in places:
            angle = random.uniform(0, 2 * np.pi)
            c, s = np.cos(angle), np.sin(angle)
            parts.append(model @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [x, 0, z])
    half = 5.0 * side
    corners = np.array([[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]])
    floor = np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]])
    angle = random.uniform(0, 2 * np.pi, 64)
    reach = random.uniform(3, 14, 64)
    eyes = np.stack([reach * np.sin(angle), random.uniform(1.0, 2.5, 64), reach * np.cos(angle)], 1)
    targets = random.uniform(-4, 4, (64, 3)) * [1, 0, 1] + [0, 0.8, 0]
    return MadeScene(np.concatenate([floor, *parts]), eyes, targets - eyes, 100.0)


def kept_records(
    kept: Path, scenes: Iterable[str], count: int, size: tuple[int, int], record: Callable[[Drawn], dict],
    most: int | None = None,
) -> dict[str, list[dict]]:  # fmt: skip
    """What is recorded of the frames of each scene, kept after each frame: a run that was killed goes on there.

    Args:
        kept: a JSON file; scenes of earlier runs stay in it.
        count, size: as for `draw`.
        record: numbers of one frame.
        most: frames of each scene, if not all.
    """
    done = json.loads(kept.read_text()) if kept.exists() else {}
    whole = min(most or count * len(CLASSES), count * len(CLASSES))
    for name in scenes:
        mine = done.setdefault(name, [])
        frames = draw(name, count, *size) if len(mine) < whole else ()
        for drawn in itertools.islice(frames, len(mine), whole):
            mine.append(record(drawn))
            part = kept.with_suffix(".part")
            part.write_text(json.dumps(done))
            part.replace(kept)
            print(f"{name}: {len(mine)} frames", flush=True)
    return done


def draw(name: str, count: int, width: int, height: int) -> Iterator[Drawn]:
    """`count` frames of a scene in each class of theta: its eyes, and suns between 5 and 80 degrees of elevation."""
    scene = read_scene(name)
    random = np.random.default_rng([*name.encode()])
    for index, (low, high) in enumerate(CLASSES):
        found = skipped = 0
        while found < count:
            camera = scene.camera(int(random.integers(64)), width / height, half_fov=0.45)
            elevation, azimuth = np.deg2rad(random.uniform(5, 80)), random.uniform(0, 2 * np.pi)
            light = np.array([np.cos(elevation) * np.sin(azimuth), -np.sin(elevation),
                              np.cos(elevation) * np.cos(azimuth)])  # fmt: skip
            theta = float(np.rad2deg(np.arccos(min(1.0, abs(light @ camera.rotation[2])))))
            if not low <= theta < high:
                continue
            lit = LitScene(scene.triangles, light)
            frame = see(lit, camera, height, width)
            if not frame.defined or frame.inside or frame.true_edges.sum() < LEAST_EDGES:
                skipped += 1
                if skipped > 200:
                    break
                continue
            found += 1
            yield Drawn(name, index, theta, lit, frame, skipped)
            skipped = 0

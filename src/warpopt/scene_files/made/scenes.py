"""Scenes from a seed, and where a walker could stand in them."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from ..landscape import landscape
from ..scene_camera import SceneCamera, centred_window, orientation
from .shapes import box, broadleaf, conifer, lathe, turned

EYE = 1.7  # metres above the ground


@dataclasses.dataclass(frozen=True, eq=False)
class MadeScene:
    """A scene in metres, y up.

    Attributes:
        triangles: (N, 3, 3) world points, counter-clockwise from outside.
        eyes: (M, 3) places at eye height where a walker could stand, and some higher.
        forwards: (M, 3) directions in which to look from them, a little downwards.
        far: a far plane that holds all of it.
    """

    triangles: np.ndarray
    eyes: np.ndarray
    forwards: np.ndarray
    far: float

    def camera(self, index: int, aspect: float, half_fov: float = 0.5) -> SceneCamera:
        """The camera at one of the eyes, counted from 0 and over again; half the vertical field of view in radians."""
        i = index % len(self.eyes)
        turn = orientation(self.forwards[i], np.array([0.0, 1.0, 0.0]), "right")
        return SceneCamera(self.eyes[i], turn, 0.1, self.far, centred_window(half_fov, aspect))


def made_scene(kind: str, seed: int) -> MadeScene:
    """A scene of one of `KINDS`; the same seed gives the same scene.

    Raises:
        ValueError: an unknown kind, or a seed that is not an integer >= 0.

    Example:
        >>> one, other = made_scene("city", 1), made_scene("city", 2)
        >>> one.triangles.shape[1:], len(one.triangles) == len(other.triangles)
        ((3, 3), False)
    """
    if kind not in KINDS:
        raise ValueError(f"kind: got {kind!r}, expected one of {', '.join(KINDS)}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed: got {seed!r}, expected an integer >= 0")
    return KINDS[kind](np.random.default_rng([seed, *kind.encode()]))


def _looks(random: np.random.Generator, count: int, spread: float = np.pi) -> np.ndarray:
    """Directions within an angle of -z, between level and 12 degrees down."""
    azimuth, fall = random.uniform(-spread, spread, count), np.tan(random.uniform(0, 0.21, count))
    return np.stack([np.sin(azimuth), -fall, -np.cos(azimuth)], 1)


def _ground(random: np.random.Generator, size: float, relief: float, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """(triangles, (cells, cells, 3) its vertices)."""
    triangles = landscape(int(random.integers(1 << 31)), size, relief, cells)
    return triangles, triangles[: cells * cells, 0].reshape(cells, cells, 3)


def _planted(random: np.random.Generator, places: np.ndarray, heights: tuple[float, float], kinds: list) -> list:
    """A tree of a random kind on each place."""
    made = [kind(random) for kind in kinds for _ in range(6)]
    which = random.integers(len(made), size=len(places))
    return [
        turned(made[i], random.uniform(0, 6.3), random.uniform(*heights), place)
        for i, place in zip(which, places, strict=True)
    ]


def _hills(random: np.random.Generator) -> MadeScene:
    triangles, points = _ground(random, 500.0, 60.0, 128)
    inner = points[8:-8, 8:-8].reshape(-1, 3)
    places = random.choice(inner, 700, replace=False) + random.uniform(-0.3, 0.3, (700, 1)) * [1, 0, 1]
    trees = _planted(random, places - [0, 0.3, 0], (4.0, 11.0), [conifer, broadleaf])
    middle = inner[np.hypot(inner[:, 0], inner[:, 2]) < 180]
    clear = middle[np.linalg.norm(middle[:, None, ::2] - places[None, :, ::2], axis=2).min(1) > 5]
    eyes = clear[random.permutation(len(clear))[:64]] + [0, EYE, 0]
    eyes[3::4, 1] += 8
    return MadeScene(np.concatenate([triangles, *trees]), eyes, _looks(random, 64), 600.0)


def _city(random: np.random.Generator) -> MadeScene:
    block, street, count = 32.0, 14.0, 9
    pitch = block + street
    half = count * pitch / 2
    parts = [box(np.array([-half, -1.0, -half]), np.array([half, 0.0, half]))]
    for i, j in np.ndindex(count, count):
        corner = np.array([i, 0, j]) * pitch - [half - street / 2, 0, half - street / 2]
        cuts = np.sort(random.uniform(0.3, 0.7, 2)) * block
        for low, high in (((0, 0), cuts), ((cuts[0], 0), (block, cuts[1])), ((0, cuts[1]), (block, block))):
            height = random.uniform(5, 14) if random.random() < 0.7 else random.uniform(15, 40)
            lower, upper = (corner + np.array([end[0], 0, end[1]]) for end in (low, high))
            parts.append(box(lower + np.array([0.5, 0, 0.5]), upper + np.array([-0.5, height, -0.5])))
            if random.random() < 0.5:  # a smaller storey on the roof
                parts.append(box(lower + np.array([3, height, 3]), upper + np.array([-3, height + 4, -3])))
    lamps = random.uniform(-half, half, (160, 2))
    lamps[:, 0] = (np.floor(lamps[:, 0] / pitch) + 0.5) * pitch + 5.5  # streets lie between the blocks
    parts += [box(np.array([x - 0.08, 0, z - 0.08]), np.array([x + 0.08, 5.0, z + 0.08])) for x, z in lamps]
    parts += [box(np.array([x - 1.6, 4.9, z - 0.1]), np.array([x + 0.1, 5.1, z + 0.1])) for x, z in lamps]
    line = (np.arange(1, count) - count / 2) * pitch
    cross = random.uniform(-half * 0.7, half * 0.7, 64)
    along = random.choice(line, 64)
    swap = random.random(64) < 0.5
    eyes = np.stack([np.where(swap, along, cross), np.full(64, EYE), np.where(swap, cross, along)], 1)
    eyes[3::4, 1] = 9.0
    return MadeScene(np.concatenate(parts), eyes, _looks(random, 64), 900.0)


def _forest(random: np.random.Generator) -> MadeScene:
    triangles, points = _ground(random, 160.0, 5.0, 64)
    inner = points[3:-3, 3:-3].reshape(-1, 3)
    places = random.choice(inner, 420, replace=False) + random.uniform(-0.8, 0.8, (420, 1)) * [1, 0, 1]
    trees = _planted(random, places - [0, 0.4, 0], (6.0, 14.0), [conifer, broadleaf, broadleaf])
    middle = inner[np.hypot(inner[:, 0], inner[:, 2]) < 55]
    clear = middle[np.linalg.norm(middle[:, None, ::2] - places[None, :, ::2], axis=2).min(1) > 3.2]
    eyes = clear[random.permutation(len(clear))[:64] % len(clear)] + [0, EYE, 0]
    eyes[3::4, 1] += 3
    return MadeScene(np.concatenate([triangles, *trees]), eyes, _looks(random, 64), 300.0)


def _corridor(random: np.random.Generator) -> MadeScene:
    length, half, pitch = 90.0, 4.0, random.uniform(3.0, 5.0)
    parts = [box(np.array([-half - 1, -0.5, -length]), np.array([half + 1, 0.0, 0.0]))]
    round_, height = random.random() < 0.5, random.uniform(4.0, 6.0)
    profile = np.array([0, 0.25, 0.3, 0.9, 0.94, 1]) * height
    radii = np.array([0.5, 0.5, 0.34, 0.3, 0.46, 0.46])
    for z in np.arange(-length + 1, -0.5, pitch):
        for x in (-half + 0.8, half - 0.8):
            column = lathe(profile, radii, 16 if round_ else 4, 0.0 if round_ else np.pi / 4)
            parts.append(column + np.array([x, 0, z]))
        if random.random() < 0.7:  # a beam across
            parts.append(box(np.array([-half, height, z - 0.25]), np.array([half, height + 0.5, z + 0.25])))
    for x in (-half + 0.8, half - 0.8):  # beams along
        parts.append(box(np.array([x - 0.4, height, -length]), np.array([x + 0.4, height + 0.4, 0])))
    # One wall with openings
    edge = np.arange(-length, 0.1, pitch)
    for low, high in itertools.pairwise(edge):
        parts.append(box(np.array([half, 0, low]), np.array([half + 0.4, 1.1, high])))
        parts.append(box(np.array([half, 0, low]), np.array([half + 0.4, height, low + 1.1])))
    for z in random.uniform(-length + 5, -8, 14):  # crates
        side, x = random.uniform(0.4, 1.2), random.uniform(-2.2, 2.0)
        parts.append(turned(box(np.array([-1, 0, -1.0]), np.array([1, 2, 1.0])), random.uniform(0, 1.5), side / 2,
                            np.array([x, 0, z])))  # fmt: skip
    eyes = np.stack([random.uniform(-2.4, 2.4, 64), np.full(64, EYE), random.uniform(-length + 25, -4, 64)], 1)
    return MadeScene(np.concatenate(parts), eyes, _looks(random, 64, 0.5), 200.0)


KINDS: dict[str, Callable[[np.random.Generator], MadeScene]] = {
    "hills": _hills,
    "city": _city,
    "forest": _forest,
    "corridor": _corridor,
}
"""The makers of scenes, by name."""

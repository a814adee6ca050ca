"""A random landscape from a seed: hills and a valley as a triangle mesh, so that an example needs no file."""

import numpy as np

_OCTAVES = 7


def landscape(seed: int, size: float, relief: float, cells: int) -> np.ndarray:
    """Triangles (N, 3, 3) of a square heightfield about the world's origin, y up.

    Octaves of value noise on broad sine ridges, with a valley along z that rises to hills on both sides.

    Args:
        seed: of the noise.
        size: side length.
        relief: height of the highest hill over the lowest ground, which is at y = 0.
        cells: quads along a side.
    """
    side = np.linspace(-0.5, 0.5, cells + 1)
    x, z = np.meshgrid(side, side, indexing="xy")
    random = np.random.default_rng(seed)
    height = 0.18 * np.sin(7 * x + 2.1 * np.sin(5 * z)) + 0.12 * np.cos(9 * z - 4 * x)
    for octave in range(_OCTAVES):
        points = 4 * 2**octave
        height += 0.55 * 0.5**octave * _value_noise(random, points, x, z)
    bend = 0.07 * np.sin(6.0 * z + random.uniform(0, 2 * np.pi))
    valley = 1 - np.exp(-(((x - bend) / 0.16) ** 2))
    height = (height - height.min()) / np.ptp(height)
    height = height * (0.12 + 0.88 * valley) * (0.55 + 0.9 * np.hypot(x, z))
    height = relief * (height - height.min()) / np.ptp(height)
    points = np.stack([size * x, height, size * z], -1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.stack([np.stack([a, d, c], -2), np.stack([a, c, b], -2)]).reshape(-1, 3, 3)


def _value_noise(random: np.random.Generator, points: int, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Random values on a lattice with smooth interpolation between them, in [-1, 1]."""
    lattice = random.uniform(-1, 1, (points + 1, points + 1))

    def split(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position = np.clip((share + 0.5) * points, 0, points - 1e-9)
        index = position.astype(int)
        t = position - index
        return index, t * t * t * (t * (6 * t - 15) + 10)

    (i, s), (j, t) = split(z), split(x)
    top = lattice[i, j] * (1 - t) + lattice[i, j + 1] * t
    bottom = lattice[i + 1, j] * (1 - t) + lattice[i + 1, j + 1] * t
    return top * (1 - s) + bottom * s

"""Closed triangle meshes (N, 3, 3), y up, counter-clockwise from outside."""

import itertools

import numpy as np


def box(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """An axis-parallel box: 12 triangles."""
    corners = np.array([[(lower, upper)[i >> k & 1][k] for k in range(3)] for i in range(8)], float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return np.array([corners[[quad[i] for i in turn]] for quad in quads for turn in ((0, 1, 2), (0, 2, 3))])


def lathe(heights: np.ndarray, radii: np.ndarray, sides: int, turn: float = 0.0) -> np.ndarray:
    """A solid of revolution about y from a profile, bottom to top; its ends are closed."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.zeros(sides), -np.sin(angle)], 1)  # counter-clockwise from above
    levels = [radius * ring + [0, height, 0] for height, radius in zip(heights, radii, strict=True)]
    parts = []
    for low, high in itertools.pairwise(levels):
        low_next, high_next = np.roll(low, -1, 0), np.roll(high, -1, 0)
        parts += [np.stack([low, low_next, high_next], 1), np.stack([low, high_next, high], 1)]
    bottom, top = (np.broadcast_to([0.0, height, 0.0], ring.shape) for height in (heights[0], heights[-1]))
    parts += [np.stack([bottom, np.roll(levels[0], -1, 0), levels[0]], 1)]
    parts += [np.stack([top, levels[-1], np.roll(levels[-1], -1, 0)], 1)]
    made = np.concatenate(parts)
    area = np.linalg.norm(np.cross(made[:, 1] - made[:, 0], made[:, 2] - made[:, 0]), axis=1)
    return made[area > 0]  # a cone's tip is a ring of radius 0


def conifer(random: np.random.Generator) -> np.ndarray:
    """A trunk and three cones, 1 high."""
    trunk = lathe(np.array([-0.03, 0.3]), np.array([0.03, 0.02]), 6)
    width = random.uniform(0.16, 0.26)
    cones = [
        lathe(np.array([low, high]), np.array([width * size, 0.0]), 9, random.uniform(0, 1))
        for low, high, size in ((0.18, 0.55, 1.0), (0.4, 0.78, 0.75), (0.62, 1.0, 0.5))
    ]
    return np.concatenate([trunk, *cones])


def broadleaf(random: np.random.Generator, leaves: int = 90) -> np.ndarray:
    """A trunk, branches and a crown of small tetrahedra with gaps between them, 1 high."""
    trunk = lathe(np.array([-0.03, 0.6]), np.array([0.035, 0.015]), 6)
    direction = random.normal(size=(leaves, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    centre = direction * random.uniform(0.3, 1, (leaves, 1)) ** 0.5 * [0.3, 0.32, 0.3] + [0, 0.66, 0]
    base = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 0.035
    spin = np.linalg.qr(random.normal(size=(leaves, 3, 3)))[0]
    spin *= np.sign(np.linalg.det(spin))[:, None, None]
    tips = np.einsum("vk,njk->nvj", base, spin) * random.uniform(0.7, 1.5, (leaves, 1, 1)) + centre[:, None]
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    return np.concatenate([trunk, tips[:, faces].reshape(-1, 3, 3)])


def turned(shape: np.ndarray, angle: float, scale: float | np.ndarray, place: np.ndarray) -> np.ndarray:
    """The shape turned about y, scaled and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return (shape * scale) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + place

"""What the tests of frames share: boxes, a camera, and an independent ray caster in NumPy."""

import numpy as np

from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation

AHEAD = np.array([0.0, 0.0, 1.0])
FLOOR = np.array([[[-20, 0, -20], [-20, 0, 20], [20, 0, 20]], [[-20, 0, -20], [20, 0, 20], [20, 0, -20]]], float)


def box(lower, upper) -> np.ndarray:
    """12 triangles, counter-clockwise from outside."""
    corners = np.array([[(lower, upper)[i >> k & 1][k] for k in range(3)] for i in range(8)], float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return np.array([corners[[q[i] for i in t]] for q in quads for t in ((0, 1, 2), (0, 2, 3))])


def tables(seed: int, count: int = 6) -> np.ndarray:
    """A floor with floating boxes from a seed."""
    random = np.random.default_rng(seed)
    low = random.uniform((-3, 0.2, -3), (2, 1.2, 2), (count, 3))
    return np.concatenate([FLOOR, *(box(corner, corner + random.uniform(0.3, 1.5, 3)) for corner in low)])


def camera_at(position, target, up=(0, 1, 0), half_fov=0.45, aspect=None) -> SceneCamera:
    position = np.array(position, float)
    turn = orientation(np.array(target, float) - position, np.array(up, float), "right")
    return SceneCamera(position, turn, 0.05, 100.0, centred_window(half_fov, 1.0 if aspect is None else aspect))


def brute_truth(triangles, camera, light, height, width):
    """(eye depths, whether lit) of each pixel by testing every triangle (Moeller and Trumbore 1997), in double."""

    def nearest(origin, direction):
        edge, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        p = np.cross(direction, other)
        det = (edge * p).sum(1)
        det = np.where(np.abs(det) > 1e-14, det, np.nan)
        offset = origin - triangles[:, 0]
        u = (offset * p).sum(1) / det
        q = np.cross(offset, edge)
        v, t = (q @ direction) / det, (other * q).sum(1) / det
        good = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-7)
        return np.where(good, t, np.inf).min()

    across, up = camera.slopes(height, width)
    depth, lit = np.full((height, width), np.inf), np.zeros((height, width), bool)
    for i in range(height):
        for j in range(width):
            place = np.array([across[j], up[i], 0.0])
            begin, ray = (place, AHEAD) if camera.is_orthographic else (0 * place, place + AHEAD)
            begin, ray = camera.position + begin @ camera.rotation, ray @ camera.rotation
            depth[i, j] = nearest(begin, ray)
            if np.isfinite(depth[i, j]):
                lit[i, j] = not np.isfinite(nearest(begin + depth[i, j] * ray, -light))
    return depth, lit

"""Aliasing errors pixel by pixel, in NumPy: what the pictures of a scene show."""

import dataclasses

import numpy as np

from ..scene_files.scene_camera import SceneCamera
from .scene_solve import Mapping


@dataclasses.dataclass(frozen=True, eq=False)
class Seen:
    """What the camera sees.

    Attributes:
        depths: (K, height, width) eye depths of receivers at each pixel, inf for none. K is 1 for surfaces, and 2 for
            bodies: where the pixel's ray enters and leaves. Along a ray the errors are largest at one of its ends:
            A^2/z is convex in z for A linear in z, A/z monotonic, and A^3/z^2 has no inner maximum where A > 0.
        slopes: (height, width, 3): eye coordinates over z.
    """

    depths: np.ndarray
    slopes: np.ndarray


def slopes_of(camera: SceneCamera, height: int, width: int) -> np.ndarray:
    across, up = camera.slopes(height, width)
    return np.stack([*np.broadcast_arrays(across, up[:, None]), np.ones((height, width))], -1)


def seen_surfaces(camera: SceneCamera, z: np.ndarray) -> Seen:
    """Of an image of eye depths, inf for background."""
    return Seen(z[None], slopes_of(camera, *z.shape))


def seen_body(camera: SceneCamera, planes: np.ndarray, width: int) -> Seen:
    """Of the intersection of the view frustum with world half-spaces (K, 4)."""
    slopes = slopes_of(camera, max(1, round(width / camera.aspect)), width)
    start, end = np.full(slopes.shape[:2], camera.near), np.full(slopes.shape[:2], camera.far)
    for plane in planes:
        normal = camera.rotation @ plane[:3]
        offset = plane[3] + plane[:3] @ camera.position
        towards = slopes @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -offset / towards
        start = np.where(towards > 0, np.maximum(start, at), start)
        end = np.where(towards < 0, np.minimum(end, at), end)
        end = np.where((towards == 0) & (offset < 0), -np.inf, end)
    hit = start < end
    return Seen(np.stack([np.where(hit, start, np.inf), np.where(hit, end, np.inf)]), slopes)


def errors(mapping: Mapping, seen: Seen, metric: str, warped: bool) -> np.ndarray:
    """(height, width): the error at each pixel, the largest along its ray; NaN where there is none.

    E_p = density_p mu A^2 / (z eta) and E_q = density_q width A / z, with A = (1 - delta) eta + delta.
    """
    eta, width = (mapping.eta, mapping.width) if warped else (1.0, mapping.plain_width)
    there = np.isfinite(seen.depths)
    z = np.where(there, seen.depths, 1)
    delta = np.clip((z * (seen.slopes @ mapping.z_axis) - mapping.start) / mapping.mu, 0, 1)
    blend = (1 - delta) * eta + delta
    density_p, density_q = mapping.densities
    e_p = density_p * mapping.mu * blend**2 / (z * eta)
    e_q = density_q * width * blend / z
    error = {"p": e_p, "q": e_q, "pxq": e_p * e_q, "max": np.maximum(e_p, e_q)}[metric]
    largest = np.where(there, error, -np.inf).max(0)
    return np.where(there.any(0), largest, np.nan)


def shading(seen: Seen, light: np.ndarray) -> np.ndarray:
    """(height, width) in [0, 1]: matt surfaces in the light, from the depths alone; NaN for background.

    A pixel's normal is of the steps to that neighbour, on each axis, which is the nearer in depth: edges stay sharp.
    """
    z = seen.depths[-1]
    points = np.where(np.isfinite(z), z, np.nan)[..., None] * seen.slopes
    normal = np.cross(_step(points, 1), _step(points, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    facing = np.where((normal * seen.slopes).sum(-1) > 0, -1, 1)
    lit = np.clip(-(normal @ light) * facing, 0, 1)
    # A little light from the eye, so that what is turned away keeps its shape.
    ambient = 0.12 + 0.1 * np.abs(normal[..., 2])
    shade = ambient + 0.78 * lit
    return np.where(np.isfinite(z), np.nan_to_num(shade, nan=0.2), np.nan)


def _step(points: np.ndarray, axis: int) -> np.ndarray:
    if points.shape[axis] < 2:
        return np.zeros_like(points)
    gap = np.full_like(np.take(points, [0], axis), np.nan)
    difference = np.diff(points, axis=axis)
    after, before = np.concatenate([difference, gap], axis), np.concatenate([gap, difference], axis)
    size_after, size_before = (np.nan_to_num(np.abs(d[..., 2:]), nan=np.inf) for d in (after, before))
    return np.where(size_after <= size_before, after, before)

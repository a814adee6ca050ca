"""Aliasing errors per pixel, in NumPy: for the pictures of a scene, and those of docs/objectives.md."""

import dataclasses

import jax.numpy as jnp
import numpy as np

import warpopt
from warpopt import theory
from warpopt.receivers.footprint import LateralFit
from warpopt.theory import LightDepth

from ...scene_files.scene_camera import SceneCamera


@dataclasses.dataclass(frozen=True, eq=False)
class Mapping:
    """The parameters of a warped shadow map that determine its errors, as plain numbers.

    Attributes:
        x_axis, z_axis: X_w and Z_w in eye coordinates.
        light: the light's direction in eye coordinates.
        start, mu: of the footprint.
        axis: of the footprint.
        densities: (density_p, density_q) of the light frame.
        pixel_ratio: of the light frame.
        eta: of the warp.
        warped, plain: the map across the warp, (m0, m1, left, right), with the warp and without.
    """

    x_axis: np.ndarray
    z_axis: np.ndarray
    light: np.ndarray
    start: float
    mu: float
    axis: float
    densities: tuple[float, float]
    pixel_ratio: float
    eta: float
    warped: LateralFit
    plain: LateralFit

    @classmethod
    def of(cls, solution: "warpopt.SceneSolution", warped: LateralFit, plain: LateralFit) -> "Mapping":
        """From one scene's solution, and its lateral fits at the optimal eta and at 1."""
        frame, footprint = solution.frame, solution.footprint
        return cls(
            x_axis=np.asarray(frame.x_axis),
            z_axis=np.asarray(frame.z_axis),
            light=np.asarray(frame.light),
            start=float(footprint.start),
            mu=float(footprint.mu),
            axis=float(footprint.axis),
            densities=(float(np.asarray(frame.density_p)), float(np.asarray(frame.density_q))),
            pixel_ratio=float(np.asarray(frame.pixel_ratio)),
            eta=float(solution.warp.eta),
            warped=LateralFit(*map(jnp.asarray, warped)),
            plain=LateralFit(*map(jnp.asarray, plain)),
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Seen:
    """Receivers on a grid of pixels.

    Attributes:
        depth: (height, width) eye depths, inf for none.
        slopes: (height, width, 3): eye coordinates over z.
        extent: for a section: (least z, largest z, least slope, largest slope). None for an image.
        is_orthographic: whether the camera's rays are parallel.
    """

    depth: np.ndarray
    slopes: np.ndarray
    extent: tuple[float, float, float, float] | None = None
    is_orthographic: bool = False


def image_of(camera: SceneCamera, depth: np.ndarray) -> Seen:
    """What the camera sees, from an image of eye depths, inf for background."""
    across, up = camera.slopes(*depth.shape)
    slopes = np.stack([*np.broadcast_arrays(across, up[:, None]), np.ones(depth.shape)], -1)
    if camera.is_orthographic:
        slopes[..., :2] /= np.where(np.isfinite(depth), depth, 1)[..., None]
    return Seen(depth, slopes, is_orthographic=camera.is_orthographic)


def section_of(camera: SceneCamera, planes: np.ndarray, mapping: Mapping, height: int, width: int) -> Seen:
    """The view frustum, within world half-spaces (K, 4), from the side: log z across, the light at the top.

    Rows are slopes along the screen image of Z_w. Errors do not vary across it, so no information is lost: a point is a
    receiver if any point across it is.
    """
    # Half-spaces in eye coordinates, normal . c + offset >= 0: first the window's edges, then the body's.
    left, right, bottom, top = camera.window
    normals = np.concatenate(
        [np.array([[1, 0, -left], [-1, 0, right], [0, 1, -bottom], [0, -1, top]]), planes[:, :3] @ camera.rotation.T]
    )
    offsets = np.concatenate([np.zeros(4), planes[:, 3] + planes[:, :3] @ camera.position])
    x_axis = mapping.x_axis
    along = np.array([-x_axis[1], x_axis[0], 0.0])
    along = along if along @ mapping.light <= 0 else -along
    corners = np.array([(x, y, 0) for x in (left, right) for y in (bottom, top)]) @ along
    u = np.linspace(corners.max(), corners.min(), 2 * height + 1)[1::2, None]

    normals, offsets = (v / np.linalg.norm(normals, axis=1, keepdims=v.ndim > 1) for v in (normals, offsets))
    row = float(u[0, 0] - u[-1, 0]) / height

    def inside(z: np.ndarray, slack: float) -> np.ndarray:
        # Each half-space bounds the slope w across: (normal . x_axis) w + rest >= 0.
        least, most = np.full((height, len(z)), -np.inf), np.full((height, len(z)), np.inf)
        for normal, offset in zip(normals, offsets, strict=True):
            rest = normal @ along * u + normal[2] + offset / z + slack
            factor = normal @ x_axis
            if abs(factor) < 1e-12:
                least = np.where(rest < 0, np.inf, least)
            elif factor > 0:
                least = np.maximum(least, -rest / factor)
            else:
                most = np.minimum(most, -rest / factor)
        return least < most

    edges = np.geomspace(camera.near, camera.far, 2 * width + 1)
    # A body thinner than a row, such as a ground plane, is drawn with the thickness of a row.
    slack = 0.0 if inside(edges[1::2], 0.0).any() else row
    filled = np.flatnonzero(inside(edges[1::2], slack).any(0))
    if len(filled):
        edges = np.geomspace(edges[2 * filled[0]], edges[2 * filled[-1] + 2], 2 * width + 1)
    z = edges[1::2]
    depth = np.where(inside(z, slack), z, np.inf)
    slopes = u[..., None] * along + np.zeros((1, width, 1)) + np.array([0.0, 0.0, 1.0])
    return Seen(depth, slopes, (float(edges[0]), float(edges[-1]), float(corners.min()), float(corners.max())))


def errors(mapping: Mapping, seen: Seen, metric: str, warped: bool) -> np.ndarray:
    """(height, width): the error of each receiver, with A = (1 - delta) eta + delta; NaN where there is none."""
    eta, fit = (mapping.eta, mapping.warped) if warped else (1.0, mapping.plain)
    there = np.isfinite(seen.depth)
    z = np.where(there, seen.depth, 1)
    delta = np.clip((z * (seen.slopes @ mapping.z_axis) - mapping.start) / mapping.mu, 0, 1)
    blend = (1 - delta) * eta + delta
    density_p, density_q = mapping.densities
    far_off = np.ones_like(z) if seen.is_orthographic else z
    width = float(fit.left + fit.right)
    e_p, e_q = theory.errors(blend, eta, density_p * mapping.mu / far_off, density_q * width / far_off)
    x = z * (seen.slopes @ mapping.x_axis) - mapping.axis
    depth = LightDepth(jnp.asarray(delta), jnp.asarray(1 - delta))
    sigma = jnp.abs(fit.shear(depth, jnp.asarray(x), jnp.asarray(eta))) * mapping.pixel_ratio / mapping.mu
    return np.where(there, theory.aggregate(metric, e_p, e_q, sigma), np.nan)


def shading(seen: Seen, light: np.ndarray) -> np.ndarray:
    """(height, width) in [0, 1]: shading of matt surfaces from the depths; NaN for background.

    On each axis, a pixel's normal uses the neighbour that is nearer in depth: edges stay sharp.
    """
    there = np.isfinite(seen.depth)
    points = np.where(there, seen.depth, np.nan)[..., None] * seen.slopes
    normal = np.cross(_step(points, 1), _step(points, 0))
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(size > 0, size, 1)
    rays = np.array([0.0, 0.0, 1.0]) if seen.is_orthographic else seen.slopes
    facing = np.where((normal * rays).sum(-1) > 0, -1, 1)
    lit = np.clip(-(normal @ light) * facing, 0, 1)
    # A little light from the eye keeps surfaces in shade readable.
    shade = 0.12 + 0.1 * np.abs(normal[..., 2]) + 0.78 * lit
    return np.where(there, np.nan_to_num(shade, nan=0.2), np.nan)


def _step(points: np.ndarray, axis: int) -> np.ndarray:
    if points.shape[axis] < 2:
        return np.zeros_like(points)
    gap = np.full_like(np.take(points, [0], axis), np.nan)
    difference = np.diff(points, axis=axis)
    after, before = np.concatenate([difference, gap], axis), np.concatenate([gap, difference], axis)
    size_after, size_before = (np.nan_to_num(np.abs(d[..., 2:]), nan=np.inf) for d in (after, before))
    return np.where(size_after <= size_before, after, before)

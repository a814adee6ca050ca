"""The limit for receivers: the least norm that any monotone map of the depth along Z_w reaches over them.

`limit` for V; here for bodies under any light, whose nearest receivers at each depth are the lower hull of their
vertices, and for points, whose density is counted in bins.
"""

import functools

import jax
import numpy as np
from numpy.typing import NDArray

from .._checks import instance
from ..receivers.convex_body import ConvexBody
from ..receivers.depth_buffer import DepthBuffer, eye_points
from ..receivers.footprint import Receivers
from ..receivers.groups import BINS
from ..receivers.points import PointReceivers, seen_from
from ..receivers.view_frustum import WholeFrustum
from ..theory.camera import Camera, DirectionalLight
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.light_frame import LightFrame
from .limit import refuse_unknown

_FINEST = 1e-4  # bins are even in log(delta + this): a warp with eta above it is within 8 % of constant slope in each


def scene_limit(
    camera: Camera,
    light: DirectionalLight,
    receivers: Receivers | None = None,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    *,
    bins: int = BINS,
    screen: tuple[int, int] | None = None,
    shadow_map: tuple[int, int] | None = None,
) -> float:
    """The least norm over the receivers that any reparameterisation along Z_w reaches, in `scene_warp`'s units.

    `WholeFrustum` and `ConvexBody`, L-inf: E_p and E_q exactly, by the body's vertices. `PointReceivers` and
    `DepthBuffer`: E_p, in every norm, the best of the maps that are linear within each bin of depth. Finitely many
    points alone would have the limit 0, with every texel row at a point: the bins stand for the surfaces between them,
    and a warp, which is not quite linear within a bin, can be below by up to 8 %. 0 for no receivers, or one depth.

    Args:
        camera, light, receivers, metric, norm, screen, shadow_map: as in `scene_warp`.
        bins: for points and depth buffers, how many.

    Raises:
        ValueError: bad arguments; no limit is known (E_q in L_P, products); or none for these receivers (E_p of bodies
            in L_P: sample them as `PointReceivers`; E_q of points; `DepthHistogram`).

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> light = warpopt.DirectionalLight((0, -1, 0))
        >>> round(scene_limit(camera, light), 3)   # log(100) / tan(phi); the optimal warp's norm is 2.15 times it
        7.976
    """
    instance("camera", camera, Camera)
    instance("light", light, DirectionalLight)
    receivers = WholeFrustum() if receivers is None else receivers
    error_norm = ErrorNorm.of(metric, norm, getattr(receivers, "measure", "screen"))
    refuse_unknown(error_norm)
    if isinstance(bins, bool) or not isinstance(bins, int) or bins < 1:
        raise ValueError(f"bins: got {bins!r}, expected an integer >= 1")
    frame = _frame(camera, light, *(tuple(r) if isinstance(r, list) else r for r in (screen, shadow_map)))
    alpha, beta = error_norm.metric.alpha, error_norm.metric.beta
    if isinstance(receivers, PointReceivers | DepthBuffer) and not beta:
        order = error_norm.order * alpha
        return float(float(frame.density_p) * _of_points(camera, frame, receivers, order, bins)) ** alpha
    if isinstance(receivers, WholeFrustum | ConvexBody) and error_norm.supremum:
        vertices = _vertices(camera, receivers)
        z_axis, x_axis = (np.asarray(v, np.float64) for v in (frame.z_axis, frame.x_axis))
        d, x, z = vertices @ z_axis, vertices @ x_axis, vertices[:, 2]
        if beta:
            return float(float(frame.density_q) * _widest(d, x, z)) ** beta
        return float(float(frame.density_p) * _nearest_integral(d, z)) ** alpha
    what = "E_q" if beta else f"E_p in L_{error_norm.order:g}"
    raise ValueError(
        f"receivers: got {type(receivers).__name__} with {what}, expected WholeFrustum or ConvexBody with an L-inf "
        "norm, or PointReceivers or DepthBuffer with E_p"
    )


# Compiled: step by step, their many small operations take a hundred times as long.
@functools.partial(jax.jit, static_argnames=("screen", "shadow_map"))
def _frame(camera, light, screen, shadow_map) -> LightFrame:
    return LightFrame(camera, light, screen, shadow_map)


@jax.jit
def _body_vertices(camera: Camera, body: ConvexBody):
    return body.vertices(camera)


def _vertices(camera: Camera, receivers: WholeFrustum | ConvexBody):
    if isinstance(receivers, ConvexBody):
        vertices, valid = map(np.asarray, _body_vertices(camera, receivers))
        return vertices[valid]
    edges = np.array([[0.0, 0.0, 1.0]]) if receivers.measure == "axis" else np.asarray(camera.corner_slopes())
    return np.concatenate([edges * float(z) for z in (camera.near, camera.far)])


def _lower_hull(d: NDArray, v: NDArray) -> tuple[NDArray, NDArray]:
    """The lower convex hull of points (d, v), by d: what is least at each d of their convex hull."""
    kept: list[tuple[float, float]] = []
    for at, value in sorted(zip(d.tolist(), v.tolist(), strict=True)):
        if kept and at == kept[-1][0]:
            continue  # above the one before it
        while len(kept) > 1 and _above(kept[-2], kept[-1], (at, value)):
            kept.pop()
        kept.append((at, value))
    return tuple(np.array(column) for column in zip(*kept, strict=True))


def _above(p: tuple[float, float], q: tuple[float, float], r: tuple[float, float]) -> bool:
    """Whether q is on or above the segment from p to r."""
    return (q[1] - p[1]) * (r[0] - p[0]) >= (r[1] - p[1]) * (q[0] - p[0])


def _nearest_integral(d: NDArray, z: NDArray) -> float:
    """The integral over depths of max(1/z) at each; a body's nearest points are piecewise linear in depth."""
    if not len(d):
        return 0.0
    at, least = _lower_hull(d, z)
    low, high = np.minimum(least[1:], least[:-1]), np.maximum(least[1:], least[:-1])
    growth = (high - low) / low
    even = growth < 1e-8
    # (log of the ratio) / difference, its own limit where the two are equal
    mean = np.where(even, (1 - growth / 2) / low, np.log1p(growth) / np.where(even, 1, high - low))
    return float((np.diff(at) * mean).sum())


def _widest(d: NDArray, x: NDArray, z: NDArray) -> float:
    """The largest (x_max - x_min) / z_min at one depth: on each stretch between vertices a quotient of lines."""
    if not len(d):
        return 0.0
    at = np.unique(d)
    least, left, right = (np.interp(at, *_lower_hull(d, v)) for v in (z, x, -x))
    return float(((-right - left) / least).max())


def _of_points(camera: Camera, frame: LightFrame, receivers, order: float, bins: int) -> float:
    """mu times ((sum of (W_b width_b^P)^(1/(P+1)))^(P+1) / mass)^(1/P) over the bins, widths in delta."""
    if isinstance(receivers, DepthBuffer):
        points, seen = eye_points(receivers, camera)
        weights = seen
    else:
        points = camera.to_eye(receivers.points)
        weights = np.where(np.asarray(seen_from(camera, points)), np.asarray(receivers.weights), 0)
    points, weights = np.asarray(points, np.float64).reshape(-1, 3), np.asarray(weights, np.float64).ravel()
    points, weights = points[weights > 0], weights[weights > 0]
    d, z = points @ np.asarray(frame.z_axis, np.float64), points[:, 2]
    if not len(d) or d.max() == d.min():
        return 0.0
    mu = d.max() - d.min()
    edges = _FINEST * np.expm1(np.linspace(0, np.log1p(1 / _FINEST), bins + 1))
    edges[-1] = 1.0
    which = np.clip(np.searchsorted(edges, (d - d.min()) / mu, side="right") - 1, 0, bins - 1)
    if np.isinf(order):
        nearest = np.zeros(bins)
        np.maximum.at(nearest, which, 1 / z)
        return float(mu * (np.diff(edges) * nearest).sum())
    unit = z.min()  # powers of ratios stay in range
    density = np.bincount(which, weights * (unit / z) ** order, bins)
    total = ((density * np.diff(edges) ** order) ** (1 / (order + 1))).sum()
    return float(mu / unit * total * (total / weights.sum()) ** (1 / order))

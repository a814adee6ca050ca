"""The limit for receivers: the least norm that any monotone map of the depth along Z_w reaches over them.

`limit` for V; here for bodies under any light, whose nearest receivers at each depth are the lower hull of their
vertices and whose densities are integrated slice by slice, and for points, which are counted in bins of depth.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from .._checks import instance
from ..receivers.convex_body import ConvexBody
from ..receivers.depth_buffer import DepthBuffer, eye_points
from ..receivers.depth_histogram import DepthHistogram
from ..receivers.footprint import Receivers
from ..receivers.groups import BINS, ends
from ..receivers.points import PointReceivers, seen_from
from ..receivers.view_frustum import WholeFrustum
from ..theory.camera import Camera, DirectionalLight
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.light_frame import LightFrame
from .body_limit import body_shares, cells
from .limit import refuse_unknown

_FINEST = 1e-4  # bins are even in log(delta + this): a warp with eta above it is within 8 % of constant slope in each
_TOGETHER = 4096  # receivers in a row


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

    `WholeFrustum`, `ConvexBody` and `DepthHistogram` (a slab of the frustum for each bin): E_p and E_q in L-inf,
    exactly, by their vertices; E_p in L_P by quadrature, to 1e-12 for f/n up to 1e4 and 2e-8 for 1e12 (a histogram:
    1e-7 while no bin spans a depth ratio above 30). `PointReceivers` and `DepthBuffer`: E_p in every norm and E_q in
    L-inf, the best of the maps that are linear, and of one width, within each bin of depth. Finitely many points alone
    would have the limit 0, with every texel row at a point: the bins stand for the surfaces between them, and a warp,
    whose slope and width vary within a bin, can be below by up to 8 % (E_q: 4 %). 0 for no receivers, or one depth. For
    "max" it is the larger of the two limits: the slope is one map's choice and the width another's.

    Args:
        camera, light, receivers, metric, norm, screen, shadow_map: as in `scene_warp`.
        bins: for points and depth buffers, how many.

    Raises:
        ValueError: bad arguments, or no limit is known: E_q in L_P, products.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> light = warpopt.DirectionalLight((0, -1, 0))
        >>> round(scene_limit(camera, light), 3)   # log(100) / tan(phi); the optimal warp's norm is 2.15 times it
        7.976
    """
    if metric == "max":
        options = {"bins": bins, "screen": screen, "shadow_map": shadow_map}
        return max(scene_limit(camera, light, receivers, one, norm, **options) for one in ("p", "q"))
    receivers = WholeFrustum() if receivers is None else receivers
    error_norm = ErrorNorm.of(metric, norm, getattr(receivers, "measure", "screen"))
    refuse_unknown(error_norm)
    frame = checked_frame(camera, light, bins, screen, shadow_map)
    alpha, beta = error_norm.metric.alpha, error_norm.metric.beta
    if not beta:
        return pieces_of(camera, frame, receivers, error_norm.order * alpha, bins).value ** alpha
    if isinstance(receivers, PointReceivers | DepthBuffer):
        widest = float(_widest_bin(camera, frame, receivers, bins))
    else:
        widest = _widest(_bodies(camera, frame, receivers))
    return (float(frame.density_q) * widest) ** beta


@dataclasses.dataclass(frozen=True, eq=False)
class Pieces:
    """The best map of E_p, piece by piece.

    Attributes:
        at: (N + 1,) Z_w . c of the pieces' ends, increasing; empty for no receivers.
        shares: (N,) of the map, up to a factor.
        value: the limit of E_p in L_order.
    """

    at: NDArray
    shares: NDArray
    value: float


def checked_frame(camera: Camera, light: DirectionalLight, bins: int, screen, shadow_map) -> LightFrame:
    """The light's frame.

    Raises:
        ValueError: a bad argument.
    """
    instance("camera", camera, Camera)
    instance("light", light, DirectionalLight)
    if isinstance(bins, bool) or not isinstance(bins, int) or bins < 1:
        raise ValueError(f"bins: got {bins!r}, expected an integer >= 1")
    return _frame(camera, light, *(tuple(r) if isinstance(r, list) else r for r in (screen, shadow_map)))


def pieces_of(
    camera: Camera, frame: LightFrame, receivers: Receivers, order: float, bins: int, parts: int = 1
) -> Pieces:
    """The best map; of bodies, whose own is curved between vertices, `parts` straight pieces for each stretch."""
    density = float(frame.density_p)
    if isinstance(receivers, PointReceivers | DepthBuffer):
        start, mu, unit, mass, found = map(np.asarray, _binned(camera, frame, receivers, order, bins))
        if not mu > 0:
            return Pieces(np.zeros(0), np.zeros(0), 0.0)
        edges = _FINEST * np.expm1(np.linspace(0, np.log1p(1 / _FINEST), bins + 1))
        edges[-1] = 1.0
        if np.isinf(order):
            shares = np.diff(edges) * found
            value = mu * shares.sum()
        else:
            shares = (found * np.diff(edges) ** order) ** (1 / (order + 1))
            value = mu / unit * shares.sum() * (shares.sum() / mass) ** (1 / order)
        return Pieces(float(start) + float(mu) * edges, shares, float(density * value))
    if isinstance(receivers, WholeFrustum) and receivers.measure == "axis" and not np.isinf(order):
        return _along_axis(camera, frame, order, parts)
    if not np.isinf(order):
        if not isinstance(receivers, ConvexBody | WholeFrustum):
            instance("receivers", receivers, DepthHistogram)
        *stretches, value = body_shares(camera, frame, receivers, order)
        if not value > 0:
            return Pieces(np.zeros(0), np.zeros(0), 0.0)
        return Pieces(*cells(*stretches, parts), float(value))
    at, first, last = _nearest(_bodies(camera, frame, receivers))
    if not len(at):
        return Pieces(at, at, 0.0)
    if parts > 1:  # even in log z, along which the map is even
        t = np.linspace(0, 1, parts + 1)
        there = np.isfinite(first)
        low, high = (np.where(there, v, 1)[:, None] for v in (first, last))
        z = low * (high / low) ** t
        even = np.abs(high - low) < 1e-8 * low
        share = np.where(even, t, (z - low) / np.where(even, 1, high - low))
        at = np.append((at[:-1, None] + np.diff(at)[:, None] * share)[:, :-1], at[-1])
        first, last = (np.where(there[:, None], v, np.inf).ravel() for v in (z[:, :-1], z[:, 1:]))
    shares = np.diff(at) * _mean_nearness(first, last)
    return Pieces(at, shares, float(density * shares.sum()))


def _along_axis(camera: Camera, frame: LightFrame, order: float, parts: int) -> Pieces:
    """Depth and eye depth are in proportion, W is z^-P: the map is that of z^(1/(P+1))."""
    z = np.geomspace(float(camera.near), float(camera.far), parts + 1)
    rate, root = abs(float(frame.z_axis[2])), 1 / (order + 1)
    shares = np.diff(z**root) / root
    value = float(frame.density_p) * rate * shares.sum() * (shares.sum() / (z[-1] - z[0])) ** (1 / order)
    return Pieces(rate * z if value else z[:0], shares if value else z[:0], float(value))


# Compiled: step by step, their many small operations take a hundred times as long.
@functools.partial(jax.jit, static_argnames=("screen", "shadow_map"))
def _frame(camera, light, screen, shadow_map) -> LightFrame:
    return LightFrame(camera, light, screen, shadow_map)


@jax.jit
def _body_vertices(camera: Camera, body: ConvexBody):
    return body.vertices(camera)


def _bodies(camera: Camera, frame: LightFrame, receivers: Receivers) -> list[NDArray]:
    """Convex bodies by their vertices, (N, 3): (Z_w . c, X_w . c, z)."""
    if isinstance(receivers, ConvexBody):
        vertices, valid = map(np.asarray, _body_vertices(camera, receivers))
        bodies = [vertices[valid]]
    elif isinstance(receivers, WholeFrustum):
        axis = receivers.measure == "axis"
        bodies = [_slab(np.array([[0.0, 0.0, 1.0]]) if axis else camera.corner_slopes(), camera.near, camera.far)]
    else:
        instance("receivers", receivers, DepthHistogram)
        edges = np.clip(np.asarray(receivers.edges), camera.near, camera.far)
        near, far = edges[:-1], edges[1:]
        filled = (np.asarray(receivers.counts) > 0) & (far > near)
        bodies = [_slab(camera.corner_slopes(), n, f) for n, f in zip(near[filled], far[filled], strict=True)]
    axes = np.stack([*(np.asarray(v, np.float64) for v in (frame.z_axis, frame.x_axis)), [0.0, 0.0, 1.0]], 1)
    return [np.asarray(vertices, np.float64) @ axes for vertices in bodies if len(vertices)]


def _slab(edges, near, far) -> NDArray:
    return np.concatenate([np.asarray(edges, np.float64) * float(z) for z in (near, far)])


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


def _along(bodies: list[NDArray], column: int) -> tuple[NDArray, NDArray]:
    """(stretches' ends (N + 1,), the least of a column at both ends of each for each body (bodies, N, 2)).

    Between vertices the least is linear in depth; inf where a body has nothing.
    """
    at = np.unique(np.concatenate([body[:, 0] for body in bodies])) if bodies else np.zeros(0)
    if len(at) < 2:
        return np.zeros(0), np.zeros((len(bodies), 0, 2))
    least = np.full((len(bodies), len(at) - 1, 2), np.inf)
    for row, body in zip(least, bodies, strict=True):
        there = (at[:-1] >= body[:, 0].min()) & (at[1:] <= body[:, 0].max())
        values = np.interp(at, *_lower_hull(body[:, 0], body[:, column]))
        row[there] = np.stack([values[:-1], values[1:]], 1)[there]
    return at, least


def _nearest(bodies: list[NDArray]) -> tuple[NDArray, NDArray, NDArray]:
    """(stretches' ends, the nearest eye depth at the first and at the last end of each; inf where there is none).

    Slabs of a histogram have eye depths of their own each, so that the nearest body is the same along a stretch.
    """
    at, least = _along(bodies, 2)
    if not len(at):
        return at, at, at
    nearest = least[least.sum(2).argmin(0), np.arange(len(at) - 1)]
    return at, nearest[:, 0], nearest[:, 1]


def _mean_nearness(first: NDArray, last: NDArray) -> NDArray:
    """The mean of 1/z along stretches on which z is linear; 0 where there is nothing."""
    low, high = np.minimum(first, last), np.maximum(first, last)
    there = np.isfinite(low)
    low, high = np.where(there, low, 1), np.where(there, high, 1)
    growth = (high - low) / low
    even = growth < 1e-8
    # (log of the ratio) / difference, its own limit where the two are equal
    mean = np.where(even, (1 - growth / 2) / low, np.log1p(growth) / np.where(even, 1, high - low))
    return np.where(there, mean, 0)


def _widest(bodies: list[NDArray]) -> float:
    """The largest (x_max - x_min) / z_min at one depth: on each stretch quotients of lines, largest at an end."""
    at, z = _along(bodies, 2)
    if not len(at):
        return 0.0
    left = _along(bodies, 1)[1].min(0)
    right = -_along([body * [1, -1, 1] for body in bodies], 1)[1].min(0)
    z = z.min(0)
    there = np.isfinite(z)
    return float(((right - left)[there] / z[there]).max())


def _bins_of(camera: Camera, frame: LightFrame, receivers: PointReceivers | DepthBuffer, bins: int):
    """(points in eye coordinates, weights, start, mu, the bin of each)."""
    if isinstance(receivers, DepthBuffer):
        points, seen = eye_points(receivers, camera)
        points, weights = points.reshape(-1, 3), seen.ravel().astype(points.dtype)
    else:
        points, weights = camera.to_eye(receivers.points), receivers.weights
        weights = jnp.where(seen_from(camera, points), weights, 0)
        if not len(points):  # one point of no weight
            points, weights = jnp.ones((1, 3), points.dtype), jnp.zeros(1, points.dtype)
    seen = weights > 0
    points = jnp.where(seen[:, None], points, jnp.ones(3, points.dtype))
    d = frame.depth(points)
    start, end = ends(seen, d)
    share = (d - start) / jnp.where(end > start, end - start, 1)
    position = jnp.log1p(jnp.where(seen, share, 0) / _FINEST) / np.log1p(1 / _FINEST) * bins
    return points, weights, start, end - start, jnp.clip(position.astype(jnp.int32), 0, bins - 1)


@functools.partial(jax.jit, static_argnames=("order", "bins"))
def _binned(camera: Camera, frame: LightFrame, receivers, order: float, bins: int) -> tuple[Array, ...]:
    """(start, mu, the least eye depth, all weights, each bin's largest 1/z or sum of weights (least z / z)^P)."""
    points, weights, start, mu, which = _bins_of(camera, frame, receivers, bins)
    z, seen = points[:, 2], weights > 0
    unit = jnp.where(seen, z, jnp.inf).min()
    if np.isinf(order):
        nearest = jnp.maximum(jax.ops.segment_max(jnp.where(seen, 1 / z, 0), which, bins), 0)
        return start, mu, unit, weights.sum(), nearest
    # Rows of receivers first, then the rows: one long sum would lose half of single precision's digits.
    row = np.arange(len(z)) // _TOGETHER
    terms = weights * jnp.where(seen, unit / z, 0) ** order
    sums = jax.ops.segment_sum(terms, which + bins * row, bins * (int(row[-1]) + 1))
    return start, mu, unit, weights.sum(), sums.reshape(-1, bins).sum(0)


@functools.partial(jax.jit, static_argnames=("bins",))
def _widest_bin(camera: Camera, frame: LightFrame, receivers, bins: int) -> Array:
    """The largest (x_max - x_min) / z_min of a bin; 0 where all receivers are at one depth."""
    points, weights, _, mu, which = _bins_of(camera, frame, receivers, bins)
    seen = weights > 0

    def least(values: Array) -> Array:
        return jax.ops.segment_min(jnp.where(seen, values, jnp.inf), which, bins)

    x = frame.lateral(points)
    z, left, right = least(points[:, 2]), least(x), -least(-x)
    there = jnp.isfinite(z) & (mu > 0)
    return jnp.where(there, jnp.where(there, right - left, 0) / jnp.where(there, z, 1), 0).max()

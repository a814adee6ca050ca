"""Convex bodies by depth along Z_w: the nearest receivers at each depth are the lower hull of the vertices."""

import dataclasses

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array
from numpy.typing import NDArray

from ...theory.camera import Camera
from ...theory.light_frame import LightFrame
from .profile import NOTHING, Stretches
from .slices import Solid, sliced_stretches


@dataclasses.dataclass(frozen=True, eq=False)
class BodyProfile:
    """Convex bodies: exact in L-inf by their vertices, by quadrature in L_P; see `DepthProfile`.

    Attributes:
        bodies: each one's vertices in eye coordinates, (N, 3).
        solid: the same for L_P norms.
    """

    bodies: list[NDArray]
    solid: Solid
    camera: Camera
    frame: LightFrame

    def stretches(self, order: float, parts: int) -> Stretches:
        """See `DepthProfile`; the exact map is curved between vertices."""
        if np.isinf(order):
            return hull_stretches(self.bodies, self.frame, parts)
        return sliced_stretches(self.camera, self.frame, self.solid, order, parts)

    def widest(self) -> float:
        """On each stretch a quotient of linear functions, so the largest value is at an end."""
        return widest(_in_frame(self.bodies, self.frame))


def slab(edges: ArrayLike, near: Array | float, far: Array | float) -> NDArray:
    """Vertices of the frustum with these edges, (x/z, y/z, 1), between two eye depths."""
    return np.concatenate([np.asarray(edges, np.float64) * float(z) for z in (near, far)])


def _in_frame(bodies: list[NDArray], frame: LightFrame) -> list[NDArray]:
    """Bodies by their vertices, (N, 3): (Z_w . c, X_w . c, z; 1 for z under parallel rays)."""
    axes = np.stack([np.asarray(v, np.float64) for v in (frame.z_axis, frame.x_axis)], 1)
    found = []
    for vertices in (np.asarray(body, np.float64) for body in bodies if len(body)):
        # What errors are inversely proportional to: 1 for all under parallel rays.
        z = np.ones(len(vertices)) if frame.is_orthographic else vertices[:, 2]
        found.append(np.column_stack([vertices @ axes, z]))
    return found


def hull_stretches(bodies: list[NDArray], frame: LightFrame, parts: int) -> Stretches:
    """The best map of E_p in L-inf: a depth's share is the nearest receiver's 1/z."""
    at, first, last = _nearest(_in_frame(bodies, frame))
    if not len(at):
        return NOTHING
    if parts > 1:  # evenly in log z, in which the map is linear
        t = np.linspace(0, 1, parts + 1)
        there = np.isfinite(first)
        low, high = (np.where(there, v, 1)[:, None] for v in (first, last))
        z = low * (high / low) ** t
        even = np.abs(high - low) < 1e-8 * low
        share = np.where(even, t, (z - low) / np.where(even, 1, high - low))
        at = np.append((at[:-1, None] + np.diff(at)[:, None] * share)[:, :-1], at[-1])
        first, last = (np.where(there[:, None], v, np.inf).ravel() for v in (z[:, :-1], z[:, 1:]))
    shares = np.diff(at) * _mean_nearness(first, last)
    return Stretches(at, shares, float(float(frame.density_p) * shares.sum()))


def _lower_hull(d: NDArray, v: NDArray) -> tuple[NDArray, NDArray]:
    """The lower convex hull of points (d, v), by d: the least v of their convex hull at each d."""
    kept: list[tuple[float, float]] = []
    for at, value in sorted(zip(d.tolist(), v.tolist(), strict=True)):
        if kept and at == kept[-1][0]:
            continue  # above the previous point
        while len(kept) > 1 and _above(kept[-2], kept[-1], (at, value)):
            kept.pop()
        kept.append((at, value))
    at, least = np.array(kept).T
    return at, least


def _above(p: tuple[float, float], q: tuple[float, float], r: tuple[float, float]) -> bool:
    """Whether q is on or above the segment from p to r."""
    return (q[1] - p[1]) * (r[0] - p[0]) >= (r[1] - p[1]) * (q[0] - p[0])


def _along(bodies: list[NDArray], column: int) -> tuple[NDArray, NDArray]:
    """(stretches' ends (N + 1,), the least of a column at both ends of each for each body (bodies, N, 2)).

    Between vertices the least is linear in depth; inf outside the body.
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

    Each slab of a histogram has its own range of eye depths, so that the nearest body is the same along a stretch.
    """
    at, least = _along(bodies, 2)
    if not len(at):
        return at, at, at
    nearest = least[least.sum(2).argmin(0), np.arange(len(at) - 1)]
    return at, nearest[:, 0], nearest[:, 1]


def _mean_nearness(first: NDArray, last: NDArray) -> NDArray:
    """The mean of 1/z along stretches on which z is linear; 0 where there are none."""
    low, high = np.minimum(first, last), np.maximum(first, last)
    there = np.isfinite(low)
    low, high = np.where(there, low, 1), np.where(there, high, 1)
    growth = (high - low) / low
    even = growth < 1e-8
    # (log of the ratio) / difference; its limit where the two are equal
    mean = np.where(even, (1 - growth / 2) / low, np.log1p(growth) / np.where(even, 1, high - low))
    return np.where(there, mean, 0)


def widest(bodies: list[NDArray]) -> float:
    """The largest (x_max - x_min) / z_min at one depth; on each stretch it is attained at an end."""
    at, z = _along(bodies, 2)
    if not len(at):
        return 0.0
    left = _along(bodies, 1)[1].min(0)
    right = -_along([body * [1, -1, 1] for body in bodies], 1)[1].min(0)
    z = z.min(0)
    there = np.isfinite(z)
    return float(((right - left)[there] / z[there]).max())

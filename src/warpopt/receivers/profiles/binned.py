"""Sets of points by depth along Z_w, counted in bins.

Finitely many points would have the lower bound 0, with every texel row at a point: the bins stand for the surfaces
between them.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...theory.light_frame import LightFrame
from ..bins import bin_edges, bin_of, ends
from .profile import NOTHING, Stretches

_TOGETHER = 4096  # receivers per row


class PointSet(NamedTuple):
    """Points in eye coordinates and their weights; 0 for invisible points."""

    points: Float[Array, "N 3"]
    weights: Float[Array, " N"]


@dataclasses.dataclass(frozen=True, eq=False)
class BinnedProfile:
    """Points in bins of depth; within each, the map is linear and has one width; see `DepthProfile`."""

    receivers: PointSet
    frame: LightFrame
    bins: int

    def stretches(self, order: float, parts: int) -> Stretches:
        """See `DepthProfile`; a bin is one linear part."""
        start, mu, unit, mass, found = map(np.asarray, _binned(self.receivers, self.frame, order, self.bins))
        if not mu > 0:
            return NOTHING
        edges = bin_edges(self.bins)
        if np.isinf(order):
            shares = np.diff(edges) * found
            value = mu * shares.sum()
        else:
            shares = (found * np.diff(edges) ** order) ** (1 / (order + 1))
            value = mu / unit * shares.sum() * (shares.sum() / mass) ** (1 / order)
        return Stretches(float(start) + float(mu) * edges, shares, float(float(self.frame.density_p) * value))

    def widest(self) -> float:
        """See `DepthProfile`."""
        return float(_widest_bin(self.receivers, self.frame, self.bins))


def _placed(receivers: PointSet, frame: LightFrame, bins: int) -> tuple[Array, Array, Array, Array, Int[Array, " N"]]:
    """(points in eye coordinates, weights, start, mu, the bin of each)."""
    points, weights = receivers
    if not len(points):  # empty: one point of weight 0
        points, weights = jnp.ones((1, 3), points.dtype), jnp.zeros(1, points.dtype)
    seen = weights > 0
    points = jnp.where(seen[:, None], points, jnp.ones(3, points.dtype))
    d = frame.depth(points)
    start, end = ends(seen, d)
    share = (d - start) / jnp.where(end > start, end - start, 1)
    return points, weights, start, end - start, bin_of(jnp.where(seen, share, 0), bins)


@functools.partial(jax.jit, static_argnames=("order", "bins"))
def _binned(receivers: PointSet, frame: LightFrame, order: float, bins: int) -> tuple[Array, ...]:
    """(start, mu, the least eye depth, all weights, each bin's largest 1/z or sum of weights (least z / z)^P)."""
    points, weights, start, mu, which = _placed(receivers, frame, bins)
    z, seen = frame.eye_depth(points), weights > 0
    unit = jnp.where(seen, z, jnp.inf).min()
    if np.isinf(order):
        nearest = jnp.maximum(jax.ops.segment_max(jnp.where(seen, 1 / z, 0), which, bins), 0)
        return start, mu, unit, weights.sum(), nearest
    # Sum within rows, then over rows: one long sum would lose half the digits in float32.
    row = np.arange(len(z)) // _TOGETHER
    terms = weights * jnp.where(seen, unit / z, 0) ** order
    sums = jax.ops.segment_sum(terms, which + bins * row, bins * (int(row[-1]) + 1))
    return start, mu, unit, weights.sum(), sums.reshape(-1, bins).sum(0)


@functools.partial(jax.jit, static_argnames=("bins",))
def _widest_bin(receivers: PointSet, frame: LightFrame, bins: int) -> Array:
    """The largest (x_max - x_min) / z_min of a bin; 0 where all receivers are at one depth."""
    points, weights, _, mu, which = _placed(receivers, frame, bins)
    seen = weights > 0

    def least(values: Array) -> Array:
        return jax.ops.segment_min(jnp.where(seen, values, jnp.inf), which, bins)

    x = frame.lateral(points)
    z, left, right = least(frame.eye_depth(points)), least(x), -least(-x)
    there = jnp.isfinite(z) & (mu > 0)
    return jnp.where(there, jnp.where(there, right - left, 0) / jnp.where(there, z, 1), 0).max()

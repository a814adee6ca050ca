"""Samples of any number of receivers: one by one where they are few, else in cells.

Cells are even in log depth and, across, in the slope at which the eye sees them, x over the distance from the eye.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._numerics import power
from ..objective import Objective
from ..theory.light_space import LightDepth
from .bins import bin_edges, bin_of
from .footprint import Footprint
from .samples import Corners, Samples

EXACT = 4096
"""At most this many points are taken one by one."""
_DEPTHS, _SLOPES = 256, 64
_LEAST_START = 0.02  # of mu: where slopes are measured from if the receivers begin at the eye's depth or behind it


def with_samples(
    footprint: Footprint,
    d: Float[Array, " N"],
    x: Float[Array, " N"],
    nearness: Float[Array, " N"],
    weights: Float[Array, " N"],
    unit: Float[Array, ""],
    objective: Objective,
) -> Footprint:
    """The footprint with its samples.

    Args:
        footprint: of all receivers that must fit into the map.
        d, x: Z_w . c and X_w . c of each receiver; anything finite where the weight is 0.
        nearness: `unit` / z.
        weights: >= 0; 0 for what is not seen.
        unit: the least eye depth of all.
        objective: gives the order P of the mean.
    """
    scale = jnp.where(footprint.flat, 0, 1 / footprint.mu)
    there = weights > 0
    depth = LightDepth(
        jnp.where(there, (d - footprint.start) * scale, 0),
        jnp.where(there & ~footprint.flat, (footprint.start + footprint.mu - d) * scale, 1),
    )
    # Rounding may put the first or the last receiver outside of [0, 1] by eps.
    depth = LightDepth(*(jnp.where(part < 0, 0, part) for part in (depth.delta, depth.one_minus_delta)))
    lateral = jnp.where(there, jnp.abs(x - footprint.axis) * scale, 0)
    mass = weights.sum()
    weight = weights / jnp.where(mass > 0, mass, 1) * power(jnp.where(there, nearness, 0), objective.order)
    if len(d) <= EXACT:
        samples = Samples(depth, lateral, weight, None)
    else:
        samples = _in_cells(depth, lateral, weight, footprint.start * scale)
    return eqx.tree_at(
        lambda f: (f.samples, f.unit), footprint, (samples, unit), is_leaf=lambda leaf: leaf is None
    )


def _in_cells(depth: LightDepth, lateral: Array, weight: Array, start: Array) -> Samples:
    offset = jax.lax.stop_gradient(jnp.where(start > _LEAST_START, start, _LEAST_START)).astype(lateral.dtype)
    edges = bin_edges(_DEPTHS).astype(lateral.dtype)
    slope = jax.lax.stop_gradient(lateral / (depth.delta + offset))
    width = jnp.where(weight > 0, slope, 0).max() / _SLOPES
    width = jnp.where(width > 0, width, 1)
    row = bin_of(depth.delta, _DEPTHS)
    column = jnp.clip((slope / width).astype(jnp.int32), 0, _SLOPES - 1)
    first, last = edges[:-1], edges[1:]
    # A cell's receivers lie between two slopes and two depths: a trapezoid, in this rectangle.
    inner = np.arange(_SLOPES) * width * (first[:, None] + offset)
    outer = np.arange(1, _SLOPES + 1) * width * (last[:, None] + offset)
    which = row * _SLOPES + column
    u = (depth.delta - jnp.asarray(first)[row]) / jnp.asarray(last - first)[row]
    v = (lateral - inner.ravel()[which]) / (outer - inner).ravel()[which]
    u, v = (jnp.clip(place, 0, 1) for place in (u, v))  # rounding
    sums = jnp.zeros((_DEPTHS * _SLOPES, 4), lateral.dtype)
    sums = sums.at[which].add(jnp.stack([weight, weight * u, weight * v, weight * u * v], 1))
    total = sums[:, 0]
    u, v, uv = (jnp.where(total > 0, part / jnp.where(total > 0, total, 1), 0.5) for part in sums[:, 1:].T)
    near, far = (np.repeat(edge, _SLOPES) for edge in (first, last))
    inner, outer = inner.ravel(), outer.ravel()

    def at(delta: Array) -> LightDepth:
        return LightDepth(delta, 1 - delta)

    corners = Corners(at(jnp.asarray(near)), at(jnp.asarray(far)), inner, outer, u, v, uv)
    return Samples(at(near + u * (far - near)), inner + v * (outer - inner), total, corners)

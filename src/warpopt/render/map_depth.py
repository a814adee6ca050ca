"""The map's own depth: what it spans, and how fine its steps are over the receivers."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..receivers.footprint import Footprint
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .casters import Casters, Prism, nearest_of


class MapDepth(NamedTuple):
    """The depth u = ((l . c - reference)/A - least)/(largest - least), in [0, 1], 0 next to the light.

    Attributes:
        reference: l . c of W's axis, a length from the eye: that with nearly the least span. A step of u is
            A (largest - least) of it along the light, so that this makes the steps fine at every receiver.
        least, largest: lengths along the light over A.
        first: the receivers' own least.
        extent: of the receivers along the light, over that of all together.
        bounded: whether the casters are points that were traced, of which a body about them counts whole.
    """

    reference: Float[Array, ""]
    least: Float[Array, ""]
    largest: Float[Array, ""]
    first: Float[Array, ""]
    extent: Float[Array, ""]
    bounded: Bool[Array, ""]

    @property
    def share(self) -> Float[Array, ""]:
        """Of the map's depth that receivers get, in [0, 1]."""
        span = self.largest - self.least
        return jnp.where(span > 0, (self.largest - self.first) / jnp.where(span > 0, span, 1), 1)


# Where several references have nearly the same span, the one is taken that leaves the receivers most of it: this share
# of a span is given up for as much of the receivers' own.
_FOR_SHARE = 1 / 64
_REFINED, _AT_ONCE = 4, 16  # to 1e-4 of the extent along the light: of the span, as much over eta


def _best_fraction(span: Callable[[Array], Array], dtype) -> Array:
    """Where in [0, 1] a function with one minimum is least, nearly. A constant for derivatives: any place serves."""
    low, width, best = jnp.zeros((), dtype), 1.0, jnp.zeros((), dtype)
    for _ in range(_REFINED):
        at = jnp.clip(low + width * np.linspace(0, 1, _AT_ONCE + 1).astype(dtype), 0, 1)
        best = at[jnp.argmin(jax.vmap(span)(at))]
        width = 2 * width / _AT_ONCE
        low = best - width / 2
    return jax.lax.stop_gradient(best)


def map_depth(
    camera: Camera, frame: LightFrame, footprint: Footprint, eta: Float[Array, ""], casters: Casters | None
) -> MapDepth:
    """The depth range of the receivers, and of the casters that can shadow one."""
    sides = footprint.sides
    there = jnp.isfinite(sides.light_least)
    some = there.any()
    first = jnp.where(there, sides.light_least, jnp.inf).min()
    last = jnp.where(there, sides.light_largest, -jnp.inf).max()
    first, last = (jnp.where(some, v, 0) for v in (first, last))
    # From the first receiver: numbers of the receivers' own size.
    start, end = (jnp.where(there, v - first, 0) for v in (sides.light_least, sides.light_largest))
    blends = jnp.stack([depth.blend(eta) for depth in (sides.depth, sides.farthest)])
    # Receivers in one plane across the light, up to rounding of their own coordinates, have no extent to lose.
    rounding = 64 * jnp.finfo(first.dtype).eps * jnp.maximum(jnp.abs(first), jnp.abs(last))
    height = jnp.where(last - first > rounding, last - first, footprint.mu)
    nearest, above, extent = None, jnp.zeros_like(first), jnp.ones_like(first)
    if casters is not None:
        nearest = nearest_of(casters, camera, Prism.of(footprint, frame, first, height))
        heights = jnp.where(some & (nearest.height < 0), nearest.height, 0)
        extent = height / (height - heights.min())
        above = jnp.where(jnp.isfinite(heights), heights, 0).min()

    def range_at(fraction: Array) -> tuple[Array, Array, Array, Array]:
        reference = (1 - fraction) * above + fraction * (last - first)
        own = jnp.where(there | ~some, (start - reference) / blends, jnp.inf).min()
        largest = jnp.where(there | ~some, (end - reference) / blends, -jnp.inf).max()
        least = own
        if nearest is not None:
            parts = [(nearest.height - reference) / (eta + (1 - eta) * v) for v in (nearest.low, nearest.high)]
            before = jnp.stack(parts).min()
            least = jnp.where(some & (before < own), before, own)
        return reference, least, largest, own

    def cost(fraction: Array) -> Array:
        _, least, largest, own = range_at(fraction)
        return (largest - least) - _FOR_SHARE * (largest - own)

    reference, least, largest, own = range_at(_best_fraction(cost, first.dtype))
    # What is left of one depth is rounding, which must not become the whole of the map's.
    one = largest - least <= rounding / blends.min()
    least, own = (jnp.where(one, largest - footprint.mu, v) for v in (least, own))
    return MapDepth(first + reference, least, largest, own, extent, jnp.zeros((), bool))


class DepthCells(NamedTuple):
    """What groups of receivers have of the map's depth; each may be a little less or more than any receiver's.

    Attributes:
        there: which groups have receivers.
        blend: least and largest A.
        depth: least and largest u.
        along, across: least and largest edge of a texel on the light plane, along and across the warp, lengths.
    """

    there: Bool[Array, " N"]
    blend: tuple[Float[Array, " N"], Float[Array, " N"]]
    depth: tuple[Float[Array, " N"], Float[Array, " N"]]
    along: tuple[Float[Array, " N"], Float[Array, " N"]]
    across: tuple[Float[Array, " N"], Float[Array, " N"]]


def depth_cells(depth: MapDepth, footprint: Footprint, eta: Float[Array, ""], texels: Float[Array, "2"]) -> DepthCells:
    """The receivers' groups in the map's depth, with its texels along (t, s)."""
    sides, fit = footprint.sides, footprint.lateral_fit(eta)
    there = jnp.isfinite(sides.light_least)
    start, end = (jnp.where(there, v - depth.reference, 0) for v in (sides.light_least, sides.light_largest))
    low, high = sides.depth.blend(eta), sides.farthest.blend(eta)
    span = depth.largest - depth.least
    span = jnp.where(span > 0, span, 1)
    corners = jnp.stack([h / blend for h in (start, end) for blend in (low, high)])
    first, last = (jnp.clip((v - depth.least) / span, 0, 1) for v in (corners.min(0), corners.max(0)))
    edge, width = footprint.mu / eta / texels[1], (fit.left + fit.right) / texels[0]
    return DepthCells(
        there, (low, high), (first, last), (edge * low * low, edge * high * high), (width * low, width * high)
    )

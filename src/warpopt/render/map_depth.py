"""The map's own depth: what it spans, and how fine its steps are over the receivers."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._numerics import least_and_largest, least_of
from ..receivers.footprint import Footprint
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .casters import Casters, Nearest, Prism, nearest_of


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


class _Held(NamedTuple):
    """What a map's depth must hold, along the light from the first receiver.

    Attributes:
        above: the least height of any caster, or 0.
        last: the largest of any receiver.
        there: which groups have receivers.
        start, end: the least and the largest height of each group.
        blends: A at each group's two ends.
        nearest: the casters' parts; None for no casters.
        eta: of the warp.
    """

    above: Float[Array, ""]
    last: Float[Array, ""]
    there: Bool[Array, " N"]
    start: Float[Array, " N"]
    end: Float[Array, " N"]
    blends: Float[Array, "2 N"]
    nearest: Nearest | None
    eta: Float[Array, ""]

    def spanned(self, fraction: Float[Array, ""]) -> tuple[Array, Array, Array, Array]:
        """(reference, least, largest, the receivers' own least) for a reference between the ends."""
        some = self.there.any()
        reference = (1 - fraction) * self.above + fraction * self.last
        counted = self.there | ~some
        own, largest = least_and_largest(
            jnp.where(counted, (self.start - reference) / self.blends, jnp.inf),
            jnp.where(counted, (self.end - reference) / self.blends, -jnp.inf),
        )
        least = own
        if self.nearest is not None:
            delta, height = jnp.stack([self.nearest.low, self.nearest.high]), self.nearest.height
            finite = jnp.isfinite(height)  # inf where there is no caster: its derivatives would be NaN
            before = (jnp.where(finite, height, 0) - reference) / (self.eta + (1 - self.eta) * delta)
            before = least_of(jnp.where(finite, before, height).ravel())
            least = jnp.where(some & (before < own), before, own)
        return reference, least, largest, own

    def cost(self, fraction: Float[Array, ""]) -> Float[Array, ""]:
        """The span, less a small part of the receivers' own; it has one minimum over the references."""
        _, least, largest, own = self.spanned(fraction)
        return (largest - least) - _FOR_SHARE * (largest - own)

    def best_fraction(self) -> Float[Array, ""]:
        """Of the reference with nearly the least cost. A constant for derivatives: any place serves."""
        held, dtype = jax.lax.stop_gradient(self), self.last.dtype
        steps = np.linspace(0, 1, _AT_ONCE + 1).astype(dtype)

        # A loop: its rounds written out would be half of what a map's matrix takes to compile.
        def narrowed(_: Array, place: tuple[Array, Array]) -> tuple[Array, Array]:
            best, width = place
            at = jnp.clip(best - width / 2 + width * steps, 0, 1)
            return at[jnp.argmin(jax.vmap(held.cost)(at))], 2 * width / _AT_ONCE

        whole = jnp.full((), 0.5, dtype), jnp.ones((), dtype)
        return jax.lax.fori_loop(0, _REFINED, narrowed, whole)[0]


def map_depth(
    camera: Camera, frame: LightFrame, footprint: Footprint, eta: Float[Array, ""], casters: Casters | None
) -> MapDepth:
    """The depth range of the receivers, and of the casters that can shadow one."""
    sides = footprint.sides
    there = jnp.isfinite(sides.light_least)
    some = there.any()
    ends = least_and_largest(
        jnp.where(there, sides.light_least, jnp.inf), jnp.where(there, sides.light_largest, -jnp.inf)
    )
    first, last = (jnp.where(some, v, 0) for v in ends)
    # From the first receiver: numbers of the receivers' own size.
    start, end = (jnp.where(there, v - first, 0) for v in (sides.light_least, sides.light_largest))
    blends = jnp.stack([depth.blend(eta) for depth in (sides.depth, sides.farthest)])
    # Receivers in one plane across the light, up to rounding of their own coordinates, have no extent to lose.
    rounding = 64 * jnp.finfo(first.dtype).eps * jnp.maximum(jnp.abs(first), jnp.abs(last))
    height = jnp.where(last - first > rounding, last - first, footprint.mu)
    nearest, above, extent = None, jnp.zeros_like(first), jnp.ones_like(first)
    if casters is not None:
        nearest = nearest_of(casters, camera, Prism.of(footprint, frame, first, height))
        heights = jnp.where(some & (nearest.height < 0), nearest.height, 0).ravel()
        extent = height / (height - least_of(heights))
        above = least_of(jnp.where(jnp.isfinite(heights), heights, 0))
    held = _Held(above, last - first, there, start, end, blends, nearest, eta)
    reference, least, largest, own = held.spanned(held.best_fraction())
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

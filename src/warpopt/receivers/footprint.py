"""The footprint: what a warp needs to know about any receivers, as a few extents, lines and moments.

`Receivers.footprint` makes one from every kind of receivers; all later code uses only the footprint.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._numerics import largest_of, least_and_largest
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from .moments import Moments
from .samples import Samples


class Nearest(eqx.Module):
    """Candidates for the maximum error: each an upper bound on a group of receivers, exact for a group of one.

    Invalid entries have z = inf, which no maximum attains.
    """

    depth: LightDepth  # the largest delta of each group
    z: Float[Array, " N"]  # the least eye depth of each group


class Sides(eqx.Module):
    """Candidates for the extents of the map, again groups of receivers.

    Empty groups have right = left = 0 and light_least = inf.
    """

    depth: LightDepth  # the least delta of each group
    farthest: LightDepth  # the largest
    right: Float[Array, " K"]  # largest x - axis, >= 0
    left: Float[Array, " K"]  # largest axis - x, >= 0
    light_least: Float[Array, " K"]  # least l . c, which increases away from the light
    light_largest: Float[Array, " K"]
    # For groups that may be narrower than `right` and `left`: a width that some receiver attains or exceeds.
    reached: tuple[Float[Array, " K"], Float[Array, " K"]] | None = None
    # (least, largest) x - axis of each group, for a free fit; inf, -inf for empty groups. None: -left and right.
    signed: tuple[Float[Array, " K"], Float[Array, " K"]] | None = None

    @property
    def across(self) -> tuple[Float[Array, " K"], Float[Array, " K"]]:
        """(least, largest) x - axis of each group: `signed` where it is known."""
        return (-self.left, self.right) if self.signed is None else self.signed


class FreeFit(eqx.Module):
    """The convex hull of receivers in (delta, x - axis), for a map whose axis may lie anywhere (T62).

    Attributes:
        depth: of the hull's vertices, and others.
        upper, lower: the hull's x there; -inf and inf for entries that say nothing.
    """

    depth: LightDepth
    upper: Float[Array, " K"]
    lower: Float[Array, " K"]

    def line(self, eta: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(m0, m1) of the axis x = m0 + m1 delta with the least width of the map, and the least |m1| of these.

        The widest chord over A is the width; both its ends touch the map's sides, so the axis passes through its
        middle. Every other vertex bounds the slope: for a given width the slopes that contain all are an interval.
        """
        there = self.upper >= self.lower
        blend = self.depth.blend(eta)
        upper, lower = (jnp.where(there, v, 0) for v in (self.upper, self.lower))
        width = jnp.where(there, (upper - lower) / blend, -jnp.inf)
        widest = jnp.argmax(width)
        half, centre = width[widest] / 2, (upper[widest] + lower[widest]) / 2
        delta = self.depth.delta[widest]
        # 1 - delta where that is the smaller, for the difference's last digits.
        away = jnp.where(
            self.depth.delta < 0.5, self.depth.delta - delta,
            self.depth.one_minus_delta[widest] - self.depth.one_minus_delta,
        )  # fmt: skip
        # A vertex at the same depth bounds nothing: its chord is no wider.
        usable = there & (jnp.abs(away) > 64 * jnp.finfo(eta.dtype).eps)
        safe = jnp.where(usable, away, 1)
        rising, falling = (upper - centre - half * blend) / safe, (lower - centre + half * blend) / safe
        most, least = least_and_largest(
            jnp.where(usable, jnp.where(away > 0, falling, rising), jnp.inf),
            jnp.where(usable, jnp.where(away > 0, rising, falling), -jnp.inf),
        )
        # Where two chords are equally wide, the interval is a point, up to rounding.
        pinned = (jnp.where(jnp.isfinite(least), least, 0) + jnp.where(jnp.isfinite(most), most, 0)) / 2
        slope = jnp.where(least > most, pinned, jnp.where(least > 0, least, jnp.where(most < 0, most, 0)))
        nothing = ~there.any()
        return jnp.where(nothing, 0, centre - slope * delta), jnp.where(nothing, 0, slope)


class LateralFit(NamedTuple):
    """The map across the warp: t = ((x - axis - m0 - m1 delta)/A + left)/(left + right)."""

    m0: Float[Array, ""]
    m1: Float[Array, ""]
    left: Float[Array, ""]
    right: Float[Array, ""]

    def shear(self, depth: LightDepth, x: Float[Array, "..."], eta: Float[Array, ""]) -> Float[Array, "..."]:
        """dx/ddelta at constant t, for x from W's axis (T62)."""
        return self.m1 + (x - self.m0 - self.m1 * depth.delta) * (1 - eta) / depth.blend(eta)


class Footprint(eqx.Module):
    """The data of receivers that a warp needs.

    Attributes:
        start: least Z_w . c, in eye coordinates: where the warping frustum begins.
        mu: its depth range; 1 where `flat`.
        axis: X_w . c of W's axis: the eye's, clamped into the body.
        nearest, sides: see `Nearest`, `Sides`.
        moments: for L_P norms.
        unit: the unit of length of the moments.
        empty: no receivers at all.
        flat: all receivers at one depth along Z_w, up to rounding: nothing to warp.
        grouped: whether some group has more than one receiver.
        samples: for means over weighted receivers that have no moments.
        directed: those of `samples` beside an edge of a known direction, apart; None if no direction is known.
        depth_weighted: whether all weights were 0, so that receivers are weighted by z; None if there are no weights.
        free: the hull of the receivers, if the map's axis need not pass through the eye.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> footprint = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0))).footprint()
        >>> round(float(footprint.start), 3), round(float(footprint.mu), 3)   # the whole frustum, from n to f
        (1.0, 99.0)
    """

    start: Float[Array, ""]
    mu: Float[Array, ""]
    axis: Float[Array, ""]
    nearest: Nearest
    sides: Sides
    moments: Moments | None
    unit: Float[Array, ""]
    empty: Bool[Array, ""]
    flat: Bool[Array, ""]
    grouped: bool = eqx.field(static=True, default=False)
    samples: Samples | None = None
    directed: Samples | None = None
    depth_weighted: Bool[Array, ""] | None = None
    free: FreeFit | None = None

    def lateral_fit(self, eta: Float[Array, ""]) -> LateralFit:
        """The map across the warp, for one eta.

        Args:
            eta: one number.
        """
        if self.free is None:
            zero = jnp.zeros_like(eta)
            return LateralFit(zero, zero, *self.half_widths(eta))
        m0, m1 = self.free.line(eta)
        there = self.free.upper >= self.free.lower
        blend, axis = self.free.depth.blend(eta), m0 + m1 * self.free.depth.delta
        away = axis - jnp.where(there, self.free.lower, 0), jnp.where(there, self.free.upper, 0) - axis
        sides = largest_of(jnp.where(there, jnp.stack(away) / blend, -jnp.inf))
        return LateralFit(m0, m1, *jnp.where(there.any(), sides, 0))

    def half_widths(self, eta: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(largest (axis - x)/A, largest (x - axis)/A): the map's half widths on both sides of W's axis.

        Args:
            eta: one number.
        """
        left, right = largest_of(jnp.stack([self.sides.left, self.sides.right]) / self.sides.depth.blend(eta))
        return left, right

    def coordinates(
        self, frame: LightFrame, eye_points: Float[Array | np.ndarray, "... 3"]
    ) -> tuple[LightDepth, Float[Array, "..."], Float[Array, "..."]]:
        """(depth along Z_w as delta and 1 - delta, x from W's axis, eye depth z) of points in eye coordinates.

        Args:
            frame: W's axes.
            eye_points: (..., 3).
        """
        d = frame.depth(eye_points)
        depth = LightDepth((d - self.start) / self.mu, (self.start + self.mu - d) / self.mu)
        return depth, frame.lateral(eye_points) - self.axis, frame.eye_depth(eye_points)

    def with_moments(self, moments: Moments, unit: Float[Array, ""]) -> "Footprint":
        """The same, for an L_P norm.

        Args:
            moments: of the norm.
            unit: their unit of length.
        """
        return eqx.tree_at(lambda f: (f.moments, f.unit), self, (moments, unit), is_leaf=lambda v: v is None)

    def weighted_by_depth(self, fallback: Bool[Array, ""]) -> "Footprint":
        """The same; `fallback` says whether all weights were 0."""
        return eqx.tree_at(lambda f: f.depth_weighted, self, fallback, is_leaf=lambda leaf: leaf is None)

    def lost_where(self, endless: Bool[Array, ""]) -> "Footprint":
        """The same, or NaN where the receivers are unbounded, so that no finite result appears.

        Args:
            endless: whether they are.
        """
        mu, flat = jnp.where(endless, jnp.nan, self.mu), self.flat & ~endless
        return eqx.tree_at(lambda f: (f.mu, f.flat), self, (mu, flat))

    def at_best(self) -> "Footprint":
        """For a `grouped` footprint: the most favourable receivers, at each group's other depth and least known width.

        At every eta, the norms of this footprint and of the original one enclose that of the individual receivers.
        """
        sides = self.sides
        right, left = (sides.right, sides.left) if sides.reached is None else sides.reached
        return eqx.tree_at(
            lambda f: (f.nearest.depth, f.sides.depth, f.sides.right, f.sides.left),
            self,
            (sides.depth, sides.farthest, right, left),
        )


def axis_inside(least: Array, largest: Array) -> Array:
    """X_w . c of W's axis: 0, the eye's, clamped into the body, as pseudo-convexity requires."""
    return jnp.where(largest < 0, largest, jnp.where(least > 0, least, 0))


def range_of(start: Array, end: Array, largest: Array) -> tuple[Array, Array]:
    """(mu, flat): the depth range, 1 where it is within rounding of the depths themselves (`largest` in size)."""
    flat = ~(end - start > 4 * jnp.finfo(start.dtype).eps * largest)
    return jnp.where(flat, 1, end - start), flat

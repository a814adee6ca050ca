"""A warp frozen in the world: every map of its pencil has texels of the same lines, whichever square it shows.

With rows that are linear in a world point p,

    delta = along . (p - origin, 1)      u = across . (p - origin, 1)      A = eta + (1 - eta) delta
    s = delta / A                        t = u / A + 1/2

and A is linear in p too. So (s - j/N) A and (t - i/N) A are linear: moving the square by whole texels (i, j) after the
projection is again a shadow matrix, and every texel keeps its place in the world, at every depth. The square
[s_0, s_0 + k] x [t_0, t_0 + l] of one map is the unit square of another of the same pencil:

    A_0, A_1 = A at its two ends = eta / (1 - (1 - eta) s)
    eta' = A_0 / A_1     delta' = (delta - s_0 A) / (k A_1)     u' = (u - (t_0 + l/2 - 1/2) A) / (l A_1)
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..receivers.footprint import Footprint
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from ..theory.warp import Warp


class Square(eqx.Module):
    """A rectangle of a map: where it begins, and its extents, in (t, s).

    Attributes:
        t, s: (2,) each, least and largest.
    """

    t: Float[Array, "2"]
    s: Float[Array, "2"]


class Pencil(eqx.Module):
    """A warp frozen in the world, for one direction of the light.

    Attributes:
        origin: (3,) world point that the rows are relative to, so that single precision holds far from the world's.
        along: (4,) row of delta, the depth along the warp, 0 and 1 at the map's ends.
        across: (4,) row of u: (t - 1/2) A.
        eta, one_minus_eta: of the map [0, 1] x [0, 1].
    """

    origin: Float[Array, "3"]
    along: Float[Array, "4"]
    across: Float[Array, "4"]
    eta: Float[Array, ""]
    one_minus_eta: Float[Array, ""]

    @classmethod
    def fitted(cls, camera: Camera, frame: LightFrame, footprint: Footprint, warp: Warp) -> "Pencil":
        """The map that `shadow_matrix` fits to receivers, relative to the eye."""
        fit = footprint.lateral_fit(warp.eta)
        width = fit.left + fit.right
        width = jnp.where(width > 0, width, 1)  # no lateral extent: a map of one unit of length
        turn = camera.rotation.T
        along = turn @ frame.z_axis / footprint.mu, -footprint.start / footprint.mu
        # t = ((x - axis - m0 - m1 delta)/A + left)/width, and 1/2 of it is A's.
        centre = jnp.where(fit.left + fit.right > 0, fit.left / width, 0.5) - 0.5
        blend = warp.one_minus_eta * along[0], warp.eta + warp.one_minus_eta * along[1]
        across = (
            (turn @ frame.x_axis - fit.m1 * along[0]) / width + centre * blend[0],
            -(footprint.axis + fit.m0 + fit.m1 * along[1]) / width + centre * blend[1],
        )
        return cls(camera.position, jnp.append(*along), jnp.append(*across), warp.eta, warp.one_minus_eta)

    @property
    def blend(self) -> Float[Array, "4"]:
        """The row of A."""
        return (self.one_minus_eta * self.along).at[3].add(self.eta)

    @property
    def mu(self) -> Float[Array, ""]:
        """The map's length along the warp."""
        return 1 / jnp.sqrt((self.along[:3] ** 2).sum())

    @property
    def size(self) -> Float[Array, ""]:
        """The larger of the map's lengths along and across the warp."""
        across = 1 / jnp.sqrt((self.across[:3] ** 2).sum())
        return jnp.maximum(self.mu, across)

    def blend_at(self, s: Float[Array, "..."]) -> Float[Array, "..."]:
        """A at one s of the map; infinite at the horizon, beyond which there is none."""
        return self.eta / (1 - self.one_minus_eta * s)

    def cropped(self, square: Square) -> "Pencil":
        """The map whose unit square is that of this one; it must end before the horizon."""
        before, beyond = 1 - self.one_minus_eta * square.s[0], 1 - self.one_minus_eta * square.s[1]
        length, width = square.s[1] - square.s[0], square.t[1] - square.t[0]
        largest, middle = self.eta / beyond, (square.t[0] + square.t[1] - 1) / 2
        along = (self.along - square.s[0] * self.blend) / (length * largest)
        across = (self.across - middle * self.blend) / (width * largest)
        # A / A_1 = eta' + (1 - eta') delta' only up to rounding of eta': of its two parts the smaller is exact.
        return Pencil(self.origin, along, across, beyond / before, self.one_minus_eta * length / before)

    def about(self, origin: Float[Array, "3"]) -> "Pencil":
        """The same map with rows relative to another world point."""
        moved = origin - self.origin
        along, across = (row.at[3].add(row[:3] @ moved) for row in (self.along, self.across))
        return eqx.tree_at(lambda p: (p.origin, p.along, p.across), self, (origin, along, across))

    def under(self, light: Float[Array, "3"], plane: Float[Array, "4"]) -> "Pencil":
        """The map for another direction of the light whose texels are the same on a plane.

        Every point is taken to where its ray meets the plane. A stays a function of delta, so this is again a warp, of
        another shear.

        Args:
            light: (3,) unit vector.
            plane: (4,) with plane . (p - origin, 1) = 0; not parallel to the light.
        """

        def sheared(row: Array) -> Array:
            return row - (row[:3] @ light) / (plane[:3] @ light) * plane

        return eqx.tree_at(lambda p: (p.along, p.across), self, (sheared(self.along), sheared(self.across)))

    def frame(self, camera: Camera, ahead: LightFrame) -> LightFrame:
        """The axes of this warp as the camera sees them; `ahead`: any frame of the same light."""
        return ahead.towards(camera.rotation @ self.along[:3])

    def placed(self, camera: Camera, frame: LightFrame) -> "Placed":
        """The map in a frame's coordinates (d, x), from the eye."""
        turn, eye = camera.rotation, camera.position - self.origin
        (d_along, _), (d_across, x_across) = (
            (turn @ row[:3] @ frame.z_axis, turn @ row[:3] @ frame.x_axis) for row in (self.along, self.across)
        )
        first, middle = (row[:3] @ eye + row[3] for row in (self.along, self.across))
        return Placed(d_along, d_across, x_across, first, middle, self.eta, self.one_minus_eta)


class Placed(eqx.Module):
    """A map's rows in coordinates (d, x) along and across its warp, from the eye.

    Attributes:
        along: d delta / dd.
        lean, across: du/dd and du/dx.
        first, middle: delta and u at the eye.
        eta, one_minus_eta: the warp's.
    """

    along: Float[Array, ""]
    lean: Float[Array, ""]
    across: Float[Array, ""]
    first: Float[Array, ""]
    middle: Float[Array, ""]
    eta: Float[Array, ""]
    one_minus_eta: Float[Array, ""]

    def texture(
        self, d: Float[Array, "..."], x: Float[Array, "..."]
    ) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
        """(t, s, A) of points; NaN where A is not positive: at the apex and behind it."""
        delta = self.along * d + self.first
        blend = self.eta + self.one_minus_eta * delta
        blend = jnp.where(blend > 0, blend, jnp.nan)
        return (self.lean * d + self.across * x + self.middle) / blend + 0.5, delta / blend, blend

    @property
    def extent(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(start, mu) of the map along Z_w, from the eye."""
        return -self.first / self.along, 1 / self.along

    @property
    def warp(self) -> Warp:
        """The warp, over the map's own extent."""
        return Warp(self.eta, self.one_minus_eta, *self.extent, jnp.ones((), bool))

    def shear(self, d: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
        """dx/dd at constant t."""
        t, _, _ = self.texture(d, x)
        return ((t - 0.5) * self.one_minus_eta * self.along - self.lean) / self.across


class Corners(eqx.Module):
    """The corners of groups of receivers, which bound all of them in any map of the same direction.

    Attributes:
        d, x: (2, 2 K) from the eye: a row for the least and one for the largest depth, each with both sides.
        light, depths: (2, K) least and largest l . c, and d.
        there: (K,) which groups have a receiver.
    """

    d: Float[Array, "2 K"]
    x: Float[Array, "2 K"]
    light: Float[Array, "2 N"]
    depths: Float[Array, "2 N"]
    there: Bool[Array, " N"]

    @classmethod
    def of(cls, footprint: Footprint) -> "Corners":
        """Those of a footprint's sides."""
        sides = footprint.sides
        least, largest = sides.across
        there = largest >= least
        depths = jnp.stack([_depths(footprint, depth, there) for depth in (sides.depth, sides.farthest)])
        x = footprint.axis + jnp.where(there, jnp.stack([least, largest]), 0).ravel()
        light = jnp.stack([sides.light_least, sides.light_largest])
        return cls(jnp.concatenate([depths, depths], 1), jnp.broadcast_to(x, (2, len(x))), light, depths, there)

    def within(self, placed: Placed) -> Square:
        """The extents of all in a map's (t, s); NaN if some lie at the apex or behind it."""
        t, s, _ = placed.texture(self.d, self.x)
        there = jnp.concatenate([self.there, self.there])
        return Square(*(jnp.stack(_ends(v, there)) for v in (t, s)))

    def depth_range(self, placed: Placed, level: Array, above: Array) -> Float[Array, "2"]:
        """Least and largest (l . c - level)/A of all, and of casters on the same rays: `above` is their least l . c."""
        blend = placed.texture(self.depths, jnp.zeros_like(self.depths))[2]
        first, last = (jnp.where(self.there, v, 0) for v in self.light)
        first = jnp.minimum(first, above)
        least = jnp.where(self.there, (first - level) / blend, jnp.inf).min()
        return jnp.stack([least, jnp.where(self.there, (last - level) / blend, -jnp.inf).max()])

    @property
    def middle(self) -> Float[Array, ""]:
        """The middle of all l . c; 0 for none."""
        first = jnp.where(self.there, self.light[0], jnp.inf).min()
        last = jnp.where(self.there, self.light[1], -jnp.inf).max()
        return jnp.where(self.there.any(), (first + last) / 2, 0)


def _depths(footprint: Footprint, depth: LightDepth, there: Array) -> Array:
    # From the nearer end, so that it cancels least.
    near = footprint.start + footprint.mu * depth.delta
    far = footprint.start + footprint.mu - footprint.mu * depth.one_minus_delta
    near = jnp.where(depth.delta < 0.5, near, far)
    return jnp.where(there & ~footprint.flat, near, footprint.start)


def _ends(values: Array, there: Array) -> tuple[Array, Array]:
    lost = (there & jnp.isnan(values)).any()
    least, largest = jnp.where(there, values, jnp.inf).min(), jnp.where(there, values, -jnp.inf).max()
    return jnp.where(lost, jnp.nan, least), jnp.where(lost, jnp.nan, largest)


def offset_for(
    square: Square, texels: Int[Array, "2"], old: Int[Array, "2"], padding: Int[Array, ""], ahead: Float[Array, ""],
    last: Float[Array, ""],
) -> tuple[Int[Array, "2"], Bool[Array, ""]]:  # fmt: skip
    """(the whole texels by which the unit square must move so that it holds all, whether it can).

    Args:
        square: the receivers' extents in the map that has not moved.
        texels: (2,) along (t, s).
        old: (2,) where the square lies now; it is kept if it holds all.
        padding: texels left free at each edge.
        ahead: the share of the free texels that lies on the side to which the square moves.
        last: the largest s that the square may reach.
    """
    size = texels.astype(square.t.dtype)
    least, largest = (jnp.stack([square.t[k], square.s[k]]) * size for k in (0, 1))
    limit = jnp.stack([jnp.asarray(jnp.inf, size.dtype), jnp.floor((last - 1) * size[1])])
    # The offsets that hold all: from `low` to `high`. What rounding adds to an extent is no reason to move.
    slack = 64 * jnp.finfo(size.dtype).eps * size
    low = jnp.ceil(largest + padding - size - slack)
    high = jnp.minimum(jnp.floor(least - padding + slack), limit)
    fits = (low <= high).all()
    free = high - low
    part = jnp.floor(ahead * free + 0.5)  # as exported code rounds
    forward, backward = low + part, high - part
    kept = old.astype(size.dtype)
    new = jnp.where(kept < low, forward, jnp.where(kept > high, backward, kept))
    new = jnp.where(fits & jnp.isfinite(new), new, kept)
    return new.astype(jnp.int32), fits

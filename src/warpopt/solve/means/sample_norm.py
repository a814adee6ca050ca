"""The mean of a texel's size over weighted receivers, as a function of eta, with the bound that certifies its minimum.

    J(eta) = sum of w_i k(E_p, sigma E_p, E_q)^P,    k convex and rising in all three (`theory.texel`)

E_p and sigma E_p are convex in eta. E_q = a w, with a rising line a and the map's width w, which is at least what the
two receivers that set it at m span. With f one of them, its share of a receiver's E_q is A/A_f up to a constant:
convex in eta where delta >= delta_f, and else

    A/A_f (eta) >= tangent at m - (1 - delta/delta_f) (1 - delta_f)/A_f(m)^2 (eta - m)^2.

By the gradients of k at m, which are not negative, J lies above a parabola that touches it at m:

    J(eta) >= J(m) + J'(m) (eta - m) - C(m) (eta - m)^2.

Beside an edge of known normal (c, s), k is that of E_p (c + sigma s) and E_q s. In eta the former is linear but for a
term g/eta, which is convex or concave by the sign of g and of k's derivative; where it is concave,

    1/eta = 1/m - (eta - m)/m^2 + (eta - m)^2/(m^2 eta)

adds -D(m) (eta - m)^2 / eta, with D(m) = sum of w_i |g_i dk^P/d(E_p (c + sigma s))| / m^2 over these.

J may have several local minima; a few such curves bound them all (`weak_convexity`).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..._numerics import picked, power
from ..._parallel import sums, wide
from ...receivers.footprint import Footprint
from ...receivers.samples import Normal, Samples
from ...theory.light_space import LightDepth
from ...theory.texel import KERNELS, lean, offset_across


class Touch(NamedTuple):
    """J at some eta, its slope, C and D: the curve that touches J there from below.

    value + slope (e - eta) - (bend + pole / e) (e - eta)^2
    """

    value: Float[Array, ""]
    slope: Float[Array, ""]
    bend: Float[Array, ""]
    pole: Float[Array, ""]


class Selection(NamedTuple):
    """The active pieces at some eta: the receivers at the right and left edge, and which samples' E_q is the larger."""

    right: Int[Array, ""]
    left: Int[Array, ""]
    across: Bool[Array, " S"]

    def same_top(self, other: "Selection") -> Bool[Array, ""]:
        return (self.across == other.across).all()

    def same_sides(self, other: "Selection") -> Bool[Array, ""]:
        return (self.right == other.right) & (self.left == other.left)


class SampleNorm(eqx.Module):
    """A mean over a footprint's samples.

    Attributes:
        footprint: with samples.
        along, across: E_p = along A^2 / eta and E_q = across w A for a receiver at `footprint.unit`, both over the
            larger error without a warp.
        log_scale: log of that.
        pixel_ratio: see `LightFrame`.
        kernel, order: name of the size (`KERNELS`), P.
    """

    footprint: Footprint
    along: Float[Array, ""]
    across: Float[Array, ""]
    log_scale: Float[Array, ""]
    pixel_ratio: Float[Array, ""]
    kernel: str = eqx.field(static=True)
    order: float = eqx.field(static=True)

    @property
    def samples(self) -> Samples:
        """The footprint's.

        Raises:
            ValueError: it has none.
        """
        if self.footprint.samples is None:
            raise ValueError(
                f"receivers: got a footprint without samples, expected some for a mean of {self.kernel!r}: "
                "warpopt.receivers.weighted.cells.with_samples makes them"
            )
        return self.footprint.samples

    def active(self, u: Float[Array, ""]) -> Selection:
        """The active pieces at u = log(eta)."""
        eta = jnp.exp(u)
        right, left = self._edges(eta)
        e_p, sigma, e_q = self._texels(eta, self._width(eta, right, left))
        column = e_p if self.kernel == "max" else e_p * jnp.sqrt(1 + sigma * sigma)
        return Selection(right, left, e_q > column)

    def value(self, u: Float[Array, ""], active: Selection) -> Float[Array, ""]:
        """log of the norm on the smooth piece selected by `active`."""
        return self.log_of(self.mean(u, active))

    def mean(self, u: Float[Array, ""], active: Selection) -> Float[Array, ""]:
        """J on that piece."""
        return sum((terms.sum() for terms in self._piece(u, active)), start=jnp.zeros_like(u))

    def slope(self, u: Float[Array, ""], active: Selection) -> Float[Array, ""]:
        """d value / du on that piece."""
        return self.value_and_slope(u, active)[1]

    def value_and_slope(self, u: Float[Array, ""], active: Selection) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Both."""
        terms, changes = jax.jvp(lambda v: self._piece(v, active), (u,), (jnp.ones_like(u),))
        parts = [sums([own, change]) for own, change in zip(terms, changes, strict=True)]
        total, change = (sum((part[k] for part in parts), start=jnp.zeros_like(u)) for k in (0, 1))
        return self.log_of(total), change / (total * self.order)

    def touch(self, eta: Float[Array, ""]) -> Touch:
        """The curve that touches J at eta."""
        sides = self._both_active(eta)
        width, widening = (sum((side[k] for side in sides), start=jnp.zeros_like(eta)) for k in (0, 1))
        value = by_eta = by_width = bend = pole = jnp.zeros_like(eta)
        for part in self.parts:
            delta, nothing = part.depth.delta, jnp.zeros_like(part.weight)
            # By each sample's own eta and E_q: what is left are a few sums of one shape, which a GPU takes together.
            each, backwards = jax.vjp(
                lambda eta, row, leaning, part=part: self._terms(part, eta, width, row, leaning),
                jnp.broadcast_to(eta, delta.shape), nothing, nothing,
            )  # fmt: skip
            own, rise, lean_rise = backwards(jnp.ones_like(each))
            before = [
                jnp.where(delta < first, 1 - delta * (1 / jnp.where(first > 0, first, 1)), 0) for *_, first in sides
            ]
            terms = [each, own, rise * part.depth.blend(eta), *(rise * share for share in before)]
            if part.normal is not None:
                c, s = part.normal
                over_eta = self.along * delta * (c * delta + s * part.lateral * self.pixel_ratio)
                terms.append(jnp.where(lean_rise * over_eta < 0, -lean_rise * over_eta, 0))
            of_part, by_own, by_row, right, left, *leaning = sums(terms)
            value, by_eta, by_width = value + of_part, by_eta + by_own, by_width + by_row * self.across
            for found, (_, steepness, _) in zip((right, left), sides, strict=True):
                bend = bend - self.across * steepness * found
            pole = pole + sum(leaning, start=jnp.zeros_like(eta)) / (eta * eta)
        return Touch(value, by_eta + by_width * widening, bend, pole)

    def of_mean(self, mean: Float[Array, "..."]) -> Float[Array, "..."]:
        """The norm where J is `mean`."""
        return jnp.exp(self.log_of(mean))

    def log_of(self, mean: Float[Array, "..."]) -> Float[Array, "..."]:
        """log of the norm where J is `mean`."""
        return jnp.log(mean) / self.order + self.log_scale

    @property
    def parts(self) -> list[Samples]:
        """The samples without and, for a kernel that depends on them, with a known direction."""
        directed = self.footprint.directed if self.kernel == "band" else None
        return [self.samples] if directed is None else [self.samples, directed]

    def _both_active(self, eta: Array) -> list[tuple[Array, Array, Array]]:
        """`_active` of the right and of the left."""
        sides = self.footprint.sides
        if not wide():
            return [self._active(side, eta) for side in (sides.right, sides.left)]
        # An argmax: one pass over the sides in place of three, each of which is a kernel and more to compute.
        found = []
        for side, i in zip((sides.right, sides.left), self._edges(eta), strict=True):
            depth = sides.depth.at(i)
            blend = depth.blend(eta)
            span = picked(side, i) / blend
            found.append((span, -span * depth.one_minus_delta / blend, depth.delta))
        return found

    def _active(self, side: Array, eta: Array) -> tuple[Array, Array, Array]:
        """(what a side spans, its slope, the delta of a receiver that spans it), without an argmax, which takes longer
        than all the rest."""
        depth = LightDepth(*(_in_lanes(part) for part in self.footprint.sides.depth))
        blend = jnp.where(depth.delta + depth.one_minus_delta > 0, depth.blend(eta), 1)
        spans = _in_lanes(side) / blend
        widest = spans.max(0).max()
        # Of those that tie the first, which is the steepest.
        tied = spans >= (1 - 8 * jnp.finfo(eta.dtype).eps) * widest
        steepness = jnp.where(tied, spans * depth.one_minus_delta / blend, 0).max(0).max()
        return widest, -steepness, jnp.where(tied, depth.delta, jnp.inf).min(0).min()

    def _edges(self, eta: Array) -> tuple[Array, Array]:
        sides = self.footprint.sides
        blend = sides.depth.blend(eta)
        if wide():
            right, left = jnp.argmax(jnp.stack([sides.right, sides.left]) / blend, -1)
            return right, left
        return _first_largest(sides.right / blend), _first_largest(sides.left / blend)

    def _width(self, eta: Array, right: Array, left: Array) -> Array:
        sides = self.footprint.sides

        def span(side: Array, i: Array) -> Array:
            return picked(side, i) / sides.depth.at(i).blend(eta)

        return span(sides.right, right) + span(sides.left, left)

    def width(self, eta: Float[Array, ""]) -> Float[Array, ""]:
        """The map's width at A = 1."""
        left, right = self.footprint.half_widths(eta)
        return left + right

    def errors(
        self, depth: LightDepth, lateral: Array, eta: Array, width: Array
    ) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
        """(E_p, sigma, E_q) at `footprint.unit` (T51)."""
        blend = depth.blend(eta)
        sigma = lateral * ((1 - eta) * self.pixel_ratio) / blend
        # In this order: A's square by itself may underflow to 0.
        return (self.along / eta) * blend * blend, sigma, (self.across * width) * blend

    def _texels(self, eta: Array, width: Array) -> tuple[Array, Array, Array]:
        return self.errors(self.samples.depth, self.samples.lateral, eta, width)

    def _terms(
        self, part: Samples, eta: Array, width: Array, row: ArrayLike = 0.0, leaning: ArrayLike = 0.0
    ) -> Float[Array, " N"]:
        """J's, of some samples; `row` is added to their E_q, `leaning` to their columns' extents across edges."""
        e_p, sigma, e_q = self.errors(part.depth, part.lateral, eta, width)
        return part.weight * power(self.size((e_p, sigma, e_q + row), part.normal, leaning), self.order)

    def size(
        self, errors: tuple[Array, Array, Array], normal: Normal | None, leaning: ArrayLike = 0.0
    ) -> Float[Array, "..."]:
        """The size of a texel of these E_p, sigma and E_q, beside an edge of a known normal if one is given.

        `leaning` is added to the column's extent across the edge.
        """
        e_p, sigma, e_q = errors
        if normal is None:
            return KERNELS[self.kernel](e_p, sigma, e_q)
        return offset_across(lean(e_p, sigma, normal) + leaning, e_q * normal[1])

    def _piece(self, u: Array, active: Selection) -> list[Array]:
        """J's terms, of each part."""
        eta = jnp.exp(u)
        width = self._width(eta, active.right, active.left)
        if self.kernel == "band":
            return [self._terms(part, eta, width) for part in self.parts]
        e_p, sigma, e_q = self._texels(eta, width)
        column = e_p if self.kernel == "max" else e_p * jnp.sqrt(1 + sigma * sigma)
        return [self.samples.weight * power(jnp.where(active.across, e_q, column), self.order)]


def _first_largest(values: Array) -> Array:
    """The index of the first of those that are the largest up to rounding, of values >= 0; the last for NaN.

    On a CPU it takes a fifth of an argmax's time.
    """
    lanes = _in_lanes(values)
    largest = (1 - 8 * jnp.finfo(values.dtype).eps) * lanes.max(0).max()
    order = jnp.arange(lanes.size, dtype=jnp.int32).reshape(lanes.shape)
    return jnp.minimum(jnp.where(lanes >= largest, order, lanes.size).min(0).min(), len(values) - 1)


def _in_lanes(values: Array) -> Array:
    """In rows, so that a maximum over the first axis uses vector instructions; filled up with 0."""
    return jnp.pad(values, (0, -len(values) % 128)).reshape(-1, 128) if len(values) > 1024 else values[None]

"""The mean of a texel's size over weighted receivers, as a function of eta, with the bound that certifies its minimum.

    J(eta) = sum of w_i k(E_p, sigma E_p, E_q)^P,    k convex and rising in all three (`theory.texel`)

E_p and sigma E_p are convex in eta. E_q = a(eta) w(eta), a linear and rising, the map's width w convex and falling; so

    E_q(eta) >= E_q(m) + E_q'(m) (eta - m) - a' |w'(m)| (eta - m)^2,

and by the gradients of k at m, which are not negative, J lies above a parabola that touches it at m:

    J(eta) >= J(m) + J'(m) (eta - m) - C(m) (eta - m)^2,    C(m) = |w'(m)| sum of w_i a_i' dk^P/dE_q.

J may have several local minima; a few such parabolas bound them all (`weak_convexity`).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._numerics import power
from ...receivers.footprint import Footprint
from ...receivers.samples import Samples
from ...theory.light_space import LightDepth
from ...theory.texel import KERNELS


class Touch(NamedTuple):
    """J at some eta, its slope, and C: the parabola that touches J there from below."""

    value: Float[Array, ""]
    slope: Float[Array, ""]
    bend: Float[Array, ""]


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
            larger of the two.
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
        return jnp.log(self._piece(u, active)) / self.order + self.log_scale

    def slope(self, u: Float[Array, ""], active: Selection) -> Float[Array, ""]:
        """d value / du on that piece."""
        return jax.jvp(lambda v: self.value(v, active), (u,), (jnp.ones_like(u),))[1]

    def touch(self, eta: Float[Array, ""]) -> Touch:
        """The parabola that touches J at eta."""
        width, widening = self._widening(eta)

        def mean(eta: Array, width: Array, more: Array) -> Array:
            e_p, sigma, e_q = self._texels(eta, width)
            return self._sum(e_p, sigma, e_q + more * self.samples.depth.one_minus_delta)

        # One pass backwards for all three: compiling takes most of a first call.
        value, (by_eta, by_width, rise) = jax.value_and_grad(mean, (0, 1, 2))(eta, width, jnp.zeros_like(eta))
        return Touch(value, by_eta + by_width * widening, self.across * jnp.abs(widening) * rise)

    def corner_mean(self, eta: Float[Array, ""]) -> Float[Array, ""]:
        """An upper bound on J for the individual receivers: the size interpolated between the cells' corners.

        It is convex in delta at a given distance and in the distance at a given delta.
        """
        samples, corners = self.samples, self.samples.corners
        width = self._width(eta, *self._edges(eta))
        if corners is None:
            return self._sum(*self._texels(eta, width))
        u, v, uv = corners.u, corners.v, corners.uv
        depth = LightDepth(*(jnp.stack(ends)[:, None] for ends in zip(corners.near, corners.far, strict=True)))
        lateral = jnp.stack([corners.inner, corners.outer])
        share = jnp.stack([jnp.stack([1 - u - v + uv, v - uv]), jnp.stack([u - uv, uv])])
        size = KERNELS[self.kernel](*self._errors(depth, lateral, eta, width))
        return (samples.weight * jnp.where(share > 0, share, 0) * power(size, self.order)).sum()

    def covariance_loss(self, eta: Float[Array, ""]) -> Float[Array, ""]:
        """How far J of the individual receivers may lie below the centroids', as a share; falls as eta rises.

        The size is A k(.) with k(.) convex in (A, x): with g its slope in x, a cell's mean is at least its centroid's
        size plus g times the covariance of A and x, and g is at most k / max(A, x (1 - eta) / mu). For a power P > 1 it
        is the covariance of A^P and x, at most a quarter of the product of their ranges.
        """
        samples, corners = self.samples, self.samples.corners
        if corners is None or self.kernel == "max":
            return jnp.zeros_like(eta)
        spread = (corners.far.delta - corners.near.delta) * (corners.outer - corners.inner)
        blend = samples.depth.blend(eta)
        if self.order == 1:
            share = jnp.abs(corners.uv - corners.u * corners.v)
        else:
            share = 0.25 * self.order**2 * power(corners.far.blend(eta) / blend, self.order - 1)
        shear = samples.lateral * (1 - eta)
        loss = share * spread * (1 - eta) ** 2 / (blend * jnp.where(shear > blend, shear, blend))
        return jnp.where(samples.weight > 0, loss, 0).max()

    def _widening(self, eta: Array) -> tuple[Array, Array]:
        """(the width, its slope), without an argmax, which takes longer than all the rest."""
        sides = self.footprint.sides
        depth = LightDepth(*(_in_lanes(part) for part in sides.depth))
        blend = jnp.where(depth.delta + depth.one_minus_delta > 0, depth.blend(eta), 1)
        nearly = 1 - 8 * jnp.finfo(eta.dtype).eps
        width = widening = jnp.zeros_like(eta)
        for side in (sides.right, sides.left):
            spans = _in_lanes(side) / blend
            widest = spans.max(0).max()
            steepness = jnp.where(spans >= nearly * widest, spans * depth.one_minus_delta / blend, 0).max(0).max()
            width, widening = width + widest, widening - steepness
        return width, widening

    def _edges(self, eta: Array) -> tuple[Array, Array]:
        sides = self.footprint.sides
        blend = sides.depth.blend(eta)
        return jnp.argmax(sides.right / blend), jnp.argmax(sides.left / blend)

    def _width(self, eta: Array, right: Array, left: Array) -> Array:
        sides = self.footprint.sides

        def span(side: Array, i: Array) -> Array:
            return side[i] / (sides.depth.one_minus_delta[i] * eta + sides.depth.delta[i])

        return span(sides.right, right) + span(sides.left, left)

    def _texels(self, eta: Array, width: Array) -> tuple[Array, Array, Array]:
        return self._errors(self.samples.depth, self.samples.lateral, eta, width)

    def _errors(self, depth: LightDepth, lateral: Array, eta: Array, width: Array) -> tuple[Array, Array, Array]:
        """(E_p, sigma, E_q) at `footprint.unit`: theory2 section 0."""
        blend = depth.blend(eta)
        sigma = lateral * ((1 - eta) * self.pixel_ratio) / blend
        return self.along * blend * blend / eta, sigma, self.across * width * blend

    def _sum(self, e_p: Array, sigma: Array, e_q: Array) -> Array:
        return (self.samples.weight * power(KERNELS[self.kernel](e_p, sigma, e_q), self.order)).sum()

    def _piece(self, u: Array, active: Selection) -> Array:
        eta = jnp.exp(u)
        e_p, sigma, e_q = self._texels(eta, self._width(eta, active.right, active.left))
        if self.kernel == "band":
            return self._sum(e_p, sigma, e_q)
        column = e_p if self.kernel == "max" else e_p * jnp.sqrt(1 + sigma * sigma)
        return (self.samples.weight * power(jnp.where(active.across, e_q, column), self.order)).sum()


def _in_lanes(values: Array) -> Array:
    """In rows, so that a maximum over the first axis uses vector instructions; filled up with 0."""
    return jnp.pad(values, (0, -len(values) % 128)).reshape(-1, 128) if len(values) > 1024 else values[None]

"""The body that a rule receives: the whole view frustum, or the extents of receivers.

Every rule except `tsm_alternative` is a formula of a few numbers: the nearest and farthest eye depth (n, f), the start
of the body along Z_w (y_min) and its length (d), theta, and the camera's half_fov. Engines compute them from the
visible receivers, and sometimes use the camera's near or far plane for n or f. A rule given a `Body` is applied as in
its source; docs/corrections.md lists the n and f of each.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, floats_of
from ..theory.light_space import LightDepth, LightSpace, checked_theta, refuse_no_frustum
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp


class Body(eqx.Module):
    """The extents of receivers that a rule for lambda needs; passed instead of a rule's `frustum`.

    Lengths in any common unit, of shapes that broadcast; not checked, as the values come from a solution.

    Attributes:
        near, far: eye depths of the nearest and the farthest receiver.
        half_fov: of the camera along the warp, radians.
        start: least Z_w . c over the receivers, from the eye (`Footprint.start`).
        mu: their depth range along Z_w, > 0 (`Footprint.mu`).
        camera_near, camera_far: distances of the camera's near and far plane, at most `near` and at least `far`. Used
            by Filament (hints), Scherzer (n) and OGRE (the square root).

    Example:
        >>> import jax, warpopt
        >>> body = Body(*jax.numpy.array([5.0, 50.0, 0.5236, 4.0, 45.0, 0.1, 90.0]))
        >>> round(float(warpopt.rules.lispsm(body, 1.5707963).lam), 3)   # 5 + sqrt(5 * 50), from start
        20.811
    """

    near: Float[Array, "..."]
    far: Float[Array, "..."]
    half_fov: Float[Array, "..."]
    start: Float[Array, "..."]
    mu: Float[Array, "..."]
    camera_near: Float[Array, "..."]
    camera_far: Float[Array, "..."]


class BodySpace(eqx.Module):
    """The attributes of `LightSpace` that rules read, for a `Body`."""

    body: Body
    sin_theta: Float[Array, "..."]
    mirrored: Bool[Array, "..."]
    tan_phi: Float[Array, "..."]
    slope: Float[Array, "..."]

    def __init__(self, body: Body, theta: Float[Array, "..."]):
        cosine = jnp.cos(theta)
        self.body = body
        self.sin_theta, self.mirrored = jnp.abs(jnp.sin(theta)), cosine < 0  # float32(pi) lies beyond pi
        self.tan_phi = jnp.tan(body.half_fov)
        self.slope = self.tan_phi * jnp.abs(cosine)

    @property
    def near(self) -> Float[Array, "..."]:
        return self.body.near

    @property
    def depth_range(self) -> Float[Array, "..."]:
        return (self.body.far - self.body.near) / self.body.near

    @property
    def mu(self) -> Float[Array, "..."]:
        return self.body.mu

    @property
    def mu_over_near(self) -> Float[Array, "..."]:
        return self.body.mu / self.body.near

    @property
    def start(self) -> Float[Array, "..."]:
        return self.body.start

    @property
    def a_plus(self) -> Float[Array, "..."]:
        """y_min / n if the body begins beyond the eye: PSM's lambda."""
        return jnp.where(self.body.start > 0, self.body.start, 0) / self.body.near

    def axis_depths(self) -> tuple[LightDepth, LightDepth]:
        """Depths of the view axis at the nearest and farthest eye depth, in [0, 1] if inside the body."""

        def at(z: Array) -> LightDepth:
            depth, body = z * self.sin_theta, self.body
            return LightDepth((depth - body.start) / body.mu, (body.start + body.mu - depth) / body.mu)

        return at(self.body.near), at(self.body.far)


def space_of(frustum: ViewFrustum | Body, theta: Numbers) -> LightSpace | BodySpace:
    """The light space that a rule reads.

    Raises:
        ValueError: theta outside [0, pi].
    """
    angle = checked_theta(theta, frustum)
    return BodySpace(frustum, angle) if isinstance(frustum, Body) else _light_space(frustum, angle)


# A separate function, so that a program with many rules traces and lowers it only once.
@jax.jit
def _light_space(frustum: ViewFrustum, theta: Array) -> LightSpace:
    return LightSpace(frustum, theta)


def camera_planes(frustum: ViewFrustum | Body) -> tuple[Array, Array]:
    """Distances of the camera's near and far plane; those of a frustum are the body's."""
    return (frustum.camera_near, frustum.camera_far) if isinstance(frustum, Body) else (frustum.near, frustum.far)


def axis_depths(space: LightSpace | BodySpace) -> tuple[LightDepth, LightDepth]:
    """Depths of the ends of the view axis within the body."""
    return space.axis_depths() if isinstance(space, BodySpace) else space.edge(0.5)


def warp_of_product(space: LightSpace | BodySpace, product: Array, factor: ArrayLike = 1) -> Warp:
    """The warp of lambda = n product / factor; undefined (eta = 1) unless that is positive."""
    positive = product > 0
    return Warp.from_range_ratio(space.mu_over_near * factor / jnp.where(positive, product, 1), space, positive)


def parameter(name: str, value: Numbers, frustum: ViewFrustum | Body, valid: Callable, expected: str) -> Array:
    """A rule's parameter in the frustum's dtype.

    Raises:
        ValueError: the parameter is not `valid`; no frustum.
    """
    refuse_no_frustum(frustum)
    (value,) = floats_of(frustum.near.dtype, **{name: value})
    return checked(name, value, valid, expected)

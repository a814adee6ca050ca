"""The view frustum in light space: AT09 section 2.4, written with sums of non-negative terms only.

The direct formulas lose up to 12 digits of mu and all digits of delta (theta near phi, light along the view). Here
every length is a sum of non-negative terms in units of the far distance, so nothing cancels, and nothing overflows for
any far/near that the dtype holds.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from .._checks import Numbers, checked, float_arrays, joint_shape
from .._numerics import compiled, horner, over, picked
from .._words import shown
from .view_frustum import ViewFrustum


class LightDepth(NamedTuple):
    """A normalised depth along the warping axis Z_w, and its complement, so that neither is computed as a difference.

    Attributes:
        delta, one_minus_delta: (...), in [0, 1] within the body.

    Example:
        >>> depth = LightDepth(delta=0.25, one_minus_delta=0.75)
        >>> depth.blend(1.0), depth.blend(0.2)   # z_w for no warp, and for a warp
        (1.0, 0.4)
    """

    delta: Float[Array, "..."]
    one_minus_delta: Float[Array, "..."]

    def blend(self, eta: Float[Array, "..."]) -> Float[Array, "..."]:
        """A = (1 - delta) eta + delta: z_w up to the factor mu / (1 - eta); 1 everywhere for no warp.

        Args:
            eta: of a shape that broadcasts.
        """
        return self.one_minus_delta * eta + self.delta

    def at(self, i: Int[Array, "..."]) -> "LightDepth":
        """Of one entry, or of some, by an index that is in bounds.

        Args:
            i: whole numbers.
        """
        return LightDepth(picked(self.delta, i), picked(self.one_minus_delta, i))


def checked_theta(theta: Numbers, frustum: Any) -> Float[Array, "..."]:
    """theta as an array of the frustum's dtype; the frustum is a `ViewFrustum`, or a stand-in for it that rules accept.

    Raises:
        ValueError: theta outside [0, pi], NaN, or of a shape that does not broadcast with the frustum; a `frustum` of
            the wrong class, such as a camera.
    """
    refuse_no_frustum(frustum)
    theta, near = float_arrays(theta=theta, near=frustum.near)
    joint_shape(theta=theta, frustum=near)
    # float32(pi), which lies 9e-8 beyond pi: accepted, as float32 users write it, also after promotion.
    top = np.float32(np.pi)
    return checked("theta", theta, lambda v: (v >= 0) & (v <= top), "radians in [0, pi]")


def refuse_no_frustum(frustum: Any) -> None:
    """Refuse what has no planes: rules accept stand-ins for a `ViewFrustum`.

    Raises:
        ValueError: naming what was got.
    """
    if not (hasattr(frustum, "near") and hasattr(frustum, "half_fov")):
        raise ValueError(f"frustum: got {shown(frustum)}, expected a ViewFrustum")


class LightSpace(eqx.Module):
    """One view frustum under one directional light in the YZ plane, at angle theta to the view direction.

    Light-space depth is d = z sin(theta) - y cos(theta) - d0, in [0, mu] over the frustum (AT09 appendix; VN (13), both
    branches). Points are given by (u, z): u = 0 on the side plane of least d ("upper" in AT09's figures), 1 on the
    other. The fields are lengths over `near`, in the derivation's notation: a = sin(theta) - tan(phi) cos(theta) and
    b = sin(theta) + tan(phi) cos(theta) are the light-space slopes of the two side planes.

    At theta = phi (a = 0) mu and d0 have a kink; the derivative there is the left one in theta.

    Args:
        frustum: a `ViewFrustum`, of any shape.
        theta: radians, of a shape that broadcasts; its range is not checked.

    Raises:
        ValueError: `frustum` has no planes and field of view.

    Example:
        >>> import jax.numpy as jnp, warpopt
        >>> space = LightSpace(warpopt.ViewFrustum(1.0, 100.0, 0.5236), jnp.array([1.0472, 0.0]))
        >>> [round(float(v), 2) for v in space.mu]   # 2 f tan(phi) for a light along the view
        [114.89, 115.47]
    """

    near: Float[Array, "..."]
    far: Float[Array, "..."]
    tan_phi: Float[Array, "..."]
    depth_range: Float[Array, "..."]  # (far - near) / near
    share: Float[Array, "..."]  # (far - near) / far
    ratio: Float[Array, "..."]  # near / far
    sin_theta: Float[Array, "..."]
    mirrored: Bool[Array, "..."]  # theta > pi/2: the scene upside down
    slope: Float[Array, "..."]  # T = tan(phi) |cos(theta)|
    a_plus: Float[Array, "..."]
    a_minus: Float[Array, "..."]
    b: Float[Array, "..."]

    def __init__(self, frustum: ViewFrustum, theta: Float[Array, "..."]):
        refuse_no_frustum(frustum)
        (theta,) = float_arrays(theta=theta)
        # notation: n, f, phi as in AT09 and the derivation
        n, f, phi = frustum.near, frustum.far, frustum.half_fov
        self.near, self.far = n, f
        self.tan_phi, self.sin_theta, self.mirrored, self.slope, self.a_plus, self.a_minus, self.b = side_slopes(
            phi, theta
        )
        self.depth_range, self.share, self.ratio = (f - n) / n, (f - n) / f, n / f

    @property
    def log_ratio(self) -> Float[Array, "..."]:
        """log(far / near), accurate for thin frusta."""
        return jnp.log1p(self.depth_range)

    @property
    @compiled
    def mu_over_near(self) -> Float[Array, "..."]:
        return self.depth_range * self.a_plus + 2 * (1 + self.depth_range) * self.slope

    @property
    @compiled
    def mu_over_far(self) -> Float[Array, "..."]:
        """In range for every far/near, as `mu_over_near` is not."""
        return self.share * self.a_plus + 2 * self.slope

    @property
    @compiled
    def mu(self) -> Float[Array, "..."]:
        """Depth range of the warping frustum, VN (13)."""
        return self.far * self.mu_over_far

    @property
    @compiled
    def start(self) -> Float[Array, "..."]:
        """d0 = min over V of z sin(theta) - y cos(theta): n a for theta >= phi, f a below."""
        return self.near * self.a_plus - self.far * self.a_minus

    def edge(self, u: ArrayLike) -> tuple[LightDepth, LightDepth]:
        """Depths (near end, far end) of the segment of V at height fraction u; delta is linear between them.

        Args:
            u: in [0, 1], of a shape that broadcasts.
        """
        return _edge(self, u)

    @compiled
    def depth_uz(self, u: Float[Array, "..."], z: Float[Array, "..."]) -> LightDepth:
        """Depth of the points at height fraction u in [0, 1] and eye depth z.

        Args:
            u, z: of shapes that broadcast; z in [near, far].
        """
        reach = z / self.far * self.slope * 2
        return _depth(self, z, u * reach, (1 - u) * reach)

    @compiled
    def depth_yz(self, y: Float[Array | np.ndarray, "..."], z: Float[Array | np.ndarray, "..."]) -> LightDepth:
        """Depth of the points at eye coordinates (y, z).

        On the upper plane y = z tan(phi) cancels: A's relative error there is up to eps / eta, whatever the formula.
        `depth_uz` does not have this problem.

        Args:
            y, z: of shapes that broadcast; z in [near, far].
        """
        y, z = jnp.asarray(y), jnp.asarray(z)
        half = z / self.far * self.slope
        offset = y / self.far * jnp.where(self.mirrored, -1, 1) * (self.slope / self.tan_phi)
        return _depth(self, z, half - offset, half + offset)


class SideSlopes(NamedTuple):
    """What light space takes from the angles alone; the fields as those of `LightSpace`.

    Example:
        >>> SideSlopes(*range(7)).b
        6
    """

    tan_phi: Float[Array, "..."]
    sin_theta: Float[Array, "..."]
    mirrored: Bool[Array, "..."]
    slope: Float[Array, "..."]
    a_plus: Float[Array, "..."]
    a_minus: Float[Array, "..."]
    b: Float[Array, "..."]


@compiled
def side_slopes(phi: Float[Array, "..."], theta: Float[Array, "..."]) -> SideSlopes:
    """Of the half field of view and the angle between light and view, radians; they are not checked."""
    # notation: phi, s, c, T, a as in AT09 and the derivation
    sin, cos = jnp.sin(theta), jnp.cos(theta)
    s = jnp.where(sin < 0, -sin, sin)  # float32(pi) lies beyond pi
    mirrored = cos < 0
    c = jnp.where(mirrored, -cos, cos)
    tan_phi = jnp.tan(phi)
    T = tan_phi * c
    # a = s - T cancels near theta = phi; sin(theta - phi)/cos(phi) does not. Beyond pi/2 the angle is pi - theta,
    # and rounding of pi would lose digits: the remainder of pi and the rounding of the sum are added back.
    pi, rest, rest_of_rest = _pi_in_parts(s.dtype)
    difference = (jnp.asarray(pi) - theta) - phi
    angle = jnp.where(mirrored, difference + rest, theta - phi)
    rounding = jnp.where(mirrored, _rounding_of_sum(difference, rest) + rest_of_rest, 0)
    a = jnp.where((T < s / 2) | (T > 2 * s), s - T, _sine_near_zero(angle, rounding) / jnp.cos(phi))
    above = (a > 0) | (mirrored & (a == 0))
    return SideSlopes(tan_phi, s, mirrored, T, jnp.where(above, a, 0), jnp.where(above, 0, -a), s + T)


@compiled
def _edge(space: LightSpace, u: ArrayLike) -> tuple[LightDepth, LightDepth]:
    share, T, mu = space.share, space.slope, space.mu_over_far
    near_span, far_span = 2 * space.ratio * T, 2 * T
    # By `over`: the near end's derivatives are up to f/n large, times 1/mu^2 beyond the largest number.
    near = over(share * space.a_minus + near_span * u, mu), over(share * space.b + near_span * (1 - u), mu)
    far = over(share * space.a_plus + far_span * u, mu), over(far_span * (1 - u), mu)
    return LightDepth(*near), LightDepth(*far)


@compiled
def _depth(space: LightSpace, z: Array, above: Array, below: Array) -> LightDepth:
    """Of points at eye depth z, `above` and `below` the side planes' light-space ranges over far."""
    mu, before, behind = space.mu_over_far, (z - space.near) / space.far, (space.far - z) / space.far
    delta = (before * space.a_plus + behind * space.a_minus + above) / mu
    return LightDepth(delta, (behind * space.b + below) / mu)


def _sine_near_zero(x: Array, rounding: Array) -> Array:
    """sin(x + rounding) for |x| <= 0.34, where tan(theta)/tan(phi) is in [1/2, 2]; finite elsewhere.

    Taylor's series to x^15; its error is 3e-23 there, and it takes a quarter of the library sine's time.
    """
    series = [(-1) ** k / math.factorial(2 * k + 1) for k in range(7, 0, -1)]
    square = x * x
    return x + (x * square * horner(series, square) + rounding)


def _pi_in_parts(dtype) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """pi as the sum of three numbers of the dtype, each the rounded remainder of those before."""
    hexadecimal = "0x1.921fb54442d18p+1", "0x1.1a62633145c07p-53", "-0x1.f1976b7ed8fbcp-109"
    parts = [float.fromhex(digits) for digits in hexadecimal]
    if dtype == np.float64:
        first, second, third = (np.asarray(part, dtype) for part in parts)
        return first, second, third
    first = np.asarray(parts[0], dtype)
    second = np.asarray(parts[0] - float(first), dtype)
    return first, second, np.asarray(parts[0] - float(first) - float(second) + parts[1], dtype)


def _rounding_of_sum(p: Array, q: np.ndarray) -> Array:
    """p + q - fl(p + q), exactly (Knuth's two-sum)."""
    total = p + q
    q_part = total - p
    return (p - (total - q_part)) + (q - q_part)

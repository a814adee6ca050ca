"""The aliasing errors of AT09 at points of the view frustum, and the shadow map's texture coordinates.

Units: normalised device coordinates (the screen spans 2) per texture unit (the map spans 1); pixels per texel are
E (screen pixels / 2) / (map texels).
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._checks import Numbers, floats_of, instance
from .._numerics import compiled, larger, power, smaller
from ..objective import Metric, Objective
from .light_space import LightDepth, LightSpace, checked_theta
from .texel import KERNELS
from .view_frustum import ViewFrustum
from .warp import Warp, refuse_lost


def inverse_width(space: LightSpace, eta: Float[Array, "..."]) -> Float[Array, "..."]:
    """f tan(phi) / xhat, where xhat = max over V's corners of |x| / A is the half width that the map must span.

    Only the two corners of the upper plane can attain it: at equal z the lower ones have the larger A. AT09 uses
    tan(phi_w) of the upper far corner only, which leaves the near corners outside the map for lambda < n a.
    """
    near, far = space.edge(0.0)
    return smaller((1 + space.depth_range) * near.blend(eta), far.blend(eta))


def errors(
    blend: Float[ArrayLike, "..."],
    eta: Float[ArrayLike, "..."],
    along: Float[ArrayLike, "..."],
    across: Float[ArrayLike, "..."],
) -> tuple[Any, Any]:
    """(E_p, E_q) at receivers whose z_w is proportional to A = `blend`: AT09 (13), (14), for any camera and light.

    Computed in NumPy for NumPy arrays. E_p = along A^2 / eta, E_q = across A.

    Args:
        blend: A = (1 - delta) eta + delta; `LightDepth.blend`.
        eta: the warp's parameter.
        along: (screen units per unit slope along the warp) mu / z: E_p without a warp.
        across: (screen units per unit slope across it) (width that the map spans at A = 1) / z.

    Returns:
        Both, of the joint shape.

    Example:
        >>> errors(blend=0.5, eta=0.25, along=2.0, across=3.0)   # A = 1 and eta = 1 give `along` and `across`
        (2.0, 1.5)
    """
    return along * blend * (blend / eta), across * blend


def aggregate(
    metric: str | Metric,
    e_p: Float[Array, "..."],
    e_q: Float[Array, "..."],
    sigma: Float[Array, "..."] | None = None,
) -> Float[Array, "..."]:
    """A metric of the two errors: the largest of its products E_p^alpha E_q^beta, or a texel's size (`KERNELS`).

    "storage" is a norm of a map; one texel's share in it is its area, E_p E_q.

    Args:
        metric: "p", "q", "pxq", "max", "edge", "band" or a `Metric`.
        e_p, e_q: of arrays that broadcast.
        sigma: the shear, for "edge" and "band".

    Returns:
        The metric, of the joint shape.

    Raises:
        ValueError: an unknown metric, or one that needs the shear without one.

    Example:
        >>> import jax.numpy as jnp
        >>> e_p, e_q = jnp.array([2.0, 1.0]), jnp.array([1.5, 3.0])
        >>> [aggregate(name, e_p, e_q).tolist() for name in ("pxq", "max")]
        [[3.0, 3.0], [2.0, 3.0]]
    """
    return _aggregated(Objective(metric), e_p, e_q, sigma)


def _aggregated(objective: Objective, e_p: Array, e_q: Array, sigma: Array | None = None) -> Array:
    if objective.storage:
        return e_p * e_q
    if objective.kernel is None:
        return functools.reduce(larger, [power(e_p, t.alpha) * power(e_q, t.beta) for t in objective.terms])
    if sigma is None:
        raise ValueError(
            f"metric: got {objective.name!r}, which also depends on the shear of a texel, expected 'p', 'q', 'pxq', "
            "'max' or a warpopt.Metric"
        )
    return KERNELS[objective.kernel](e_p, sigma, e_q)


def _over(warp: Warp, space: LightSpace) -> Warp:
    """The warp over V, even if it was made for another body."""
    warp = getattr(warp, "warp", warp)  # a solution's
    instance("warp", warp, Warp)
    own = warp.over(space)
    refuse_lost(warp.lost_over(own))
    return own


@functools.partial(jax.jit, static_argnames=("depth_at", "objective"), inline=True)
def _error(
    space: LightSpace, eta: Array, depth_at: Callable[..., LightDepth], at: Array, z: Array, objective: Objective
) -> Array:
    """The objective's metric at eye depth z and what `depth_at`, a method of `LightSpace`, takes before it."""
    depth = depth_at(space, at, z)
    along = space.mu_over_far * (space.far / z) / space.tan_phi
    across = 2 * (space.far / z) / inverse_width(space, eta)
    return _aggregated(objective, *errors(depth.blend(eta), eta, along, across))


def aliasing_error(
    frustum: ViewFrustum, theta: Numbers, warp: Warp, y: Numbers, z: Numbers, metric: str | Metric = "p"
) -> Float[Array, "..."]:
    """Perspective aliasing error at eye-space points (y, z): AT09 (13), (14), with the width of `inverse_width`.

    E_p = mu A^2 / (z tan(phi) eta), E_q = 2 xhat A / (z tan(phi)), E_pxq = E_p E_q; none depends on x.

    Args:
        frustum, theta, warp: any shapes that broadcast; theta in radians, in [0, pi].
        y, z: eye coordinates, broadcast too; z in [near, far], |y| <= z tan(phi) for points of V.
        metric: "p", "q", "pxq", "max" or a `Metric`.

    Returns:
        E, of the joint shape: screen units (the screen spans 2) per map width or height; times screen pixels / (2
        texels) it is pixels per texel.

    Raises:
        ValueError: theta outside [0, pi], an unknown metric, or a warp whose apex does not lie before V.

    Example:
        >>> import jax.numpy as jnp, warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, jnp.pi / 6)
        >>> warp = warpopt.rules.lispsm(frustum, jnp.pi / 2)
        >>> [round(float(aliasing_error(frustum, jnp.pi / 2, warp, 0.0, z)), 3) for z in (1.0, 100.0)]
        [17.147, 17.147]
    """
    space = LightSpace(frustum, checked_theta(theta, frustum))
    y, z = floats_of(space.near.dtype, y=y, z=z)
    return _error(space, _over(warp, space).eta, LightSpace.depth_yz, y, z, Objective(metric))


def aliasing_error_uz(
    frustum: ViewFrustum, theta: Numbers, warp: Warp, u: Numbers, z: Numbers, metric: str | Metric = "p"
) -> Float[Array, "..."]:
    """`aliasing_error` at height fraction u in [0, 1] (0: the side plane next to the warp's near plane) and depth z.

    The well-conditioned form: accurate to a few units in the last place everywhere, including the side planes.

    Args:
        frustum, theta, warp: any shapes that broadcast; theta in radians, in [0, pi].
        u: height fraction.
        z: eye depth, in [near, far].
        metric: as for `aliasing_error`.

    Returns:
        As `aliasing_error`.

    Raises:
        ValueError: as `aliasing_error`.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> warp = warpopt.rules.lispsm(frustum, 1.5707963)
        >>> round(float(aliasing_error_uz(frustum, 1.5707963, warp, 1.0, 1.0)), 3)   # the lower near corner
        17.147
    """
    space = LightSpace(frustum, checked_theta(theta, frustum))
    u, z = floats_of(space.near.dtype, u=u, z=z)
    return _error(space, _over(warp, space).eta, LightSpace.depth_uz, u, z, Objective(metric))


def local_aliasing_error(
    frustum: ViewFrustum, warp: Warp, z: Numbers, metric: str | Metric = "p"
) -> Float[Array, "..."]:
    """The local form, AT09 (8), (9): the view axis under a light at theta = pi/2, mu = f - n.

    Written in eta instead of lambda, so that no warp (eta = 1) is not a special case. AT09 calls (8) approximate; it is
    exact on the axis.

    Args:
        frustum, warp: any shapes that broadcast.
        z: eye depth on the axis, in [near, far], broadcast too.
        metric: "p", "q", "pxq", "max" or a `Metric`.

    Returns:
        E, of the joint shape, in the units of `aliasing_error`.

    Raises:
        ValueError: an argument of another class, or an unknown metric.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> warp = warpopt.Warp.from_lam(11.0, warpopt.FrustumView(frustum, 1.5707963))
        >>> [round(float(local_aliasing_error(frustum, warp, z, "q")), 3) for z in (1.0, 100.0)]
        [20.0, 2.0]
    """
    instance("frustum", frustum, ViewFrustum)
    warp = getattr(warp, "warp", warp)  # a solution's
    instance("warp", warp, Warp)
    n, f = frustum.near, frustum.far
    (z,) = floats_of(n.dtype, z=z)
    blend = LightDepth((z - n) / (f - n), (f - z) / (f - n)).blend(warp.eta)
    e_p, e_q = errors(blend, warp.eta, (f - n) / (z * jnp.tan(frustum.half_fov)), 2 * f / z)
    return aggregate(metric, e_p, e_q)


def texture_coordinates(
    frustum: ViewFrustum, theta: Numbers, warp: Warp, x: Numbers, y: Numbers, z: Numbers
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Shadow-map coordinates (t, s) in [0, 1]^2 of eye-space points: AT09 (12) with the width that contains V.

    s = delta / A is a Moebius map of [0, 1]; t = 1/2 + x / (2 xhat A).

    Args:
        frustum, theta, warp: any shapes that broadcast; theta in radians, in [0, pi].
        x, y, z: eye coordinates, broadcast too; z in [near, far], |x|, |y| <= z tan(phi) for points of V.

    Returns:
        (t, s), across and along the warp, each of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], or a warp whose apex does not lie before V.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> warp = warpopt.Warp.from_lam(11.0, warpopt.FrustumView(frustum, 1.5707963))
        >>> t, s = texture_coordinates(frustum, 1.5707963, warp, 0.0, 0.0, [1.0, 10.0, 100.0])
        >>> [round(float(v), 3) for v in s]   # nine of 99 depths take half the map
        [0.0, 0.5, 1.0]
    """
    space = LightSpace(frustum, checked_theta(theta, frustum))
    x, y, z = floats_of(space.near.dtype, x=x, y=y, z=z)
    return _coordinates(space, _over(warp, space).eta, x, y, z)


@compiled
def _coordinates(space: LightSpace, eta: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    depth = space.depth_yz(y, z)
    blend = depth.blend(eta)
    half_width = space.tan_phi / inverse_width(space, eta)  # over far
    return 0.5 + x / space.far / (2 * half_width * blend), depth.delta / blend


def screen_coordinates(
    frustum: ViewFrustum, x: Numbers, y: Numbers, z: Numbers
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Normalised device coordinates (q, p) in [-1, 1]^2 of eye-space points: AT09 section 1.2.

    Args:
        frustum: of any shape.
        x, y, z: eye coordinates, of shapes that broadcast with it; z > 0.

    Returns:
        (q, p), to the right and up, each of the joint shape.

    Raises:
        ValueError: not a `ViewFrustum`.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> q, p = screen_coordinates(frustum, 0.0, -1.0, 2.0)
        >>> float(q), round(float(p), 3)
        (0.0, -0.866)
    """
    instance("frustum", frustum, ViewFrustum)
    x, y, z = floats_of(frustum.near.dtype, x=x, y=y, z=z)
    scale = z * jnp.tan(frustum.half_fov)
    return x / scale, y / scale


def projection_factors(
    frustum: ViewFrustum,
    theta: Numbers,
    warp: Warp,
    x: Numbers,
    y: Numbers,
    z: Numbers,
    kx: Numbers,
    ky: Numbers,
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Projection aliasing (E_q^proj, E_p^proj) along a line of slopes dx/dz = kx, dy/dz = ky: AT09 (10), (11).

    The full errors |dq/dt|, |dp/ds| along the line are these factors times `aliasing_error`. Infinite where the line is
    parallel to the light.

    Args:
        frustum, theta, warp: any shapes that broadcast; theta in radians, in [0, pi].
        x, y, z: eye coordinates of a point of the line, broadcast too; z in [near, far].
        kx, ky: slopes of the line.

    Returns:
        Both factors, >= 0, each of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], or a warp whose apex does not lie before V.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> warp = warpopt.rules.ssm(frustum, 1.5707963)
        >>> q, p = projection_factors(frustum, 1.5707963, warp, 0.0, -1.0, 5.0, kx=1.0, ky=0.0)   # level ground
        >>> round(float(q), 3), round(float(p), 3)
        (1.0, 0.2)
    """
    theta = checked_theta(theta, frustum)
    space = LightSpace(frustum, theta)
    x, y, z, kx, ky = floats_of(space.near.dtype, x=x, y=y, z=z, kx=kx, ky=ky)
    rate = jnp.sin(theta) - ky * jnp.cos(theta)  # d z_w / d z along the line
    own = _over(warp, space)
    x_over_z_w = x * own.one_minus_eta / (space.mu * space.depth_yz(y, z).blend(own.eta))
    return jnp.abs((kx - x / z) / (kx - x_over_z_w * rate)), jnp.abs((ky - y / z) / rate)

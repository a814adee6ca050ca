"""The published rules for lambda: functions (frustum, theta) -> Warp; all but the last accept a `Body` too.

A rule that yields no lambda > 0 returns no warp (eta = 1) with `Warp.defined` False. Each raises a ValueError for theta
outside [0, pi]. The formulas use mu / lambda, which is finite for every rule and zero for no warp.
"""

import jax.numpy as jnp
from jaxtyping import Array

from .._checks import Numbers
from .._numerics import compiled, smaller
from ..solve.sign_change import on_lanes, positive_root
from ..theory.light_space import LightSpace
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from .body import Body, axis_depths, camera_planes, parameter, space_of, warp_of_product


def ssm(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """Standard shadow maps: no warp, lambda = inf.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> float(ssm(frustum, 1.0).eta)
        1.0
    """
    space = space_of(frustum, theta)
    return Warp.from_range_ratio(jnp.zeros_like(space.mu), space)


def psm(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """Perspective shadow maps: lambda = n a, the apex at the eye; lambda = n at theta = pi/2 (AT09 section 2.1).

    E_q is about 1 and E_p about z on the view axis: the generalised linear distribution. Undefined for theta <= phi.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> warp = psm(frustum, [1.5707963, 0.4])
        >>> round(float(warp.lam[0]), 3), warp.defined.tolist()
        (1.0, [True, False])
    """
    space = space_of(frustum, theta)
    return warp_of_product(space, space.a_plus)


def lispsm(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """Light space perspective shadow maps: lambda = (n + sqrt(f n)) / sin(theta), VN section 2.1.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(warpopt.rules.lispsm(frustum, 1.5707963).lam), 3)
        11.0
    """
    space = space_of(frustum, theta)
    # sqrt(f n) / n; the product f n could overflow
    ratio = space.mu_over_near * space.sin_theta / (1 + jnp.sqrt(1 + space.depth_range))
    return Warp.from_range_ratio(ratio, space)


def scherzer(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """SC (1), (2): n_opt = (n + sqrt(n (n + mu))) / sin(theta) measured from n before the eye, lambda = n_opt - n + d0.

    n is the camera's near distance, for a `Body` too; mu, the paper's Dz, is the body's extent along Z_w. Can be
    negative for theta < phi.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(scherzer(frustum, 1.5707963).lam), 3)
        11.0
    """
    space = space_of(frustum, theta)
    s = space.sin_theta
    n = camera_planes(frustum)[0] / space.near
    # multiplied by sin(theta), so that theta = 0 (lambda = inf) needs no special case
    lam_sin = n + jnp.sqrt(n) * jnp.sqrt(n + space.mu_over_near) + s * (space.start / space.near - n)
    return warp_of_product(space, lam_sin, s)


def minimum_norm(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """Generalised minimum norm on the view axis: E_p(z = n) = E_p(z = f) there, lambda = d0 + sin(theta) sqrt(n f).

    The minimiser of the axis' L-inf norm is `optimal_warp` with `Objective("p", "inf", "axis")`; it differs where only
    the near end is stationary.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(minimum_norm(frustum, 1.0471976).lam), 3)
        9.238
    """
    space = space_of(frustum, theta)
    lam = space.start / space.near + space.sin_theta * jnp.sqrt(1 + space.depth_range)
    return warp_of_product(space, lam)


def tsm(frustum: ViewFrustum | Body, theta: Numbers, kappa: Numbers = 0.5, xi: Numbers = 0.8) -> Warp:
    """Trapezoidal shadow maps: the axis point z = n + (f - n) kappa is mapped to s = xi; VN (16), corrected.

    lambda = mu d_k (1 - xi) / (xi mu - d_k), d_k the point's light-space depth; undefined where d_k is beyond xi mu.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        kappa, xi: in (0, 1), of shapes that broadcast.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi]; kappa or xi outside (0, 1).

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(tsm(frustum, 1.5707963).lam), 3)   # mu / 3
        33.0
    """
    kappa, xi = _fraction("kappa", kappa, frustum), _fraction("xi", xi, frustum)
    space = space_of(frustum, theta)
    near, far = axis_depths(space)
    depth = (1 - kappa) * near.delta + kappa * far.delta
    ratio = (xi - depth) / (depth * (1 - xi))
    return Warp.from_range_ratio(ratio, space, ratio >= 0)


def tsm_alternative(frustum: ViewFrustum | Body, theta: Numbers, kappa: Numbers = 0.5) -> Warp:
    """TSM's alternative for theta <= phi: the warp with the largest map area for the focus region; VN section 3.

    The focus region, eye depths up to z_k = n + (f - n) kappa, covers delta in [p, q], with middle m; the maximum of
    eta^2 A(m) / (A(p) A(q))^2 is the root of a cubic with one sign change (VN's factor 4 is 2; the argmax is the same).
    No warp where (1 - z_k / f) tan(theta) <= tan(phi) / 3. Not defined for theta > phi.

    Args:
        frustum: a `ViewFrustum`, of any shape.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        kappa: in (0, 1), of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: a `Body`; theta outside [0, pi]; kappa outside (0, 1).

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> [round(float(tsm_alternative(frustum, theta).eta), 3) for theta in (0.2, 0.5)]
        [1.0, 0.496]
    """
    kappa = _fraction("kappa", kappa, frustum)
    space = space_of(frustum, theta)
    if not isinstance(space, LightSpace):
        raise ValueError("frustum: got a Body, expected a ViewFrustum: the rule's focus region is a part of V")
    eta, defined = _of_focus_region(space, kappa)
    return Warp.from_range_ratio((1 - eta) / eta, space, defined)


@compiled
def _of_focus_region(space: LightSpace, kappa: Array) -> tuple[Array, Array]:
    """(eta, whether the rule is defined)."""
    p, q, m = (
        [(1 - kappa) * near + kappa * far for near, far in zip(*space.edge(u), strict=True)] for u in (0.0, 1.0, 0.5)
    )
    (p, p_), (q, q_), (m, m_) = p, q, m
    cubic = (p_ * q_ * m_, 2 * m * p_ * q_ - p * q_ * m_ - q * p_ * m_, -3 * p * q * m_, -2 * p * q * m)
    warps = (space.a_plus <= 0) & (3 * m < 1)
    root, _ = positive_root(on_lanes(warps, ((3, 2, 1, 0), cubic)), iterative=True)
    return jnp.where(warps, smaller(root, 1), 1), space.a_plus <= 0


def _fraction(name: str, value: Numbers, frustum: ViewFrustum | Body) -> Array:
    return parameter(name, value, frustum, lambda v: (v > 0) & (v < 1), "a number in (0, 1)")

"""The rules for lambda used in engines: functions (frustum, theta, ...) -> Warp; a `Body` can replace the frustum.

Each follows the named source file and commit, rewritten as mathematics; the defaults are the engine's. Where an
engine's guard disables the warp ("uniform"), eta = 1; a rule that yields no lambda > 0 gives eta = 1 with
`Warp.defined` False. Each raises a ValueError for theta outside [0, pi] and for a parameter out of its range.
docs/corrections.md has the result of re-deriving each.

Notation: n, f near and far; g = theta, s = sin(g); d = mu, the body's length along Z_w; y_min = d0, its start.
Everything is in units of n, so that nothing overflows, and uses mu / lambda, which is 0 for no warp.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import Numbers
from .._numerics import larger, smaller
from ..theory.light_space import LightSpace, checked_theta
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from .body import Body, BodySpace, camera_planes, parameter, space_of, warp_of_product


def lispsm_paper(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """The paper's rule with the body's depth extent: lambda = (n + sqrt(n (n + d s))) / s, measured from y_min.

    Equal E_p at both ends of the line through (y_min, z = n) along Z_w, which reaches eye depth n + d s. Wimmer,
    Scherzer and Purgathofer 2004; VN and `lispsm` use f instead of n + d s, which is equal only at theta = pi/2.

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
        >>> [round(float(lispsm_paper(frustum, theta).lam), 2) for theta in (1.5708, 0.1745329)]
        [11.0, 31.99]
    """
    space = space_of(frustum, theta)
    reach = space.mu_over_near * space.sin_theta
    return Warp.from_range_ratio(reach / (1 + jnp.sqrt(1 + reach)), space)


def filament(frustum: ViewFrustum | Body, theta: Numbers, near_hint: Numbers = 1.0, far_hint: Numbers = 100.0) -> Warp:
    """Google Filament: lambda = max(n0, n1), n0 = (n + sqrt(v0 v1)) / s, n1 = h / (2 - 3 h / (f - n)).

    v0 = max(n, near_hint) and v1 = min(f, far_hint, n + d s) are the depths that matter, h = max(near_hint - c, 0) with
    c the camera's near plane, which is n except for a `Body`. n0 equalises E_p at v0 and v1; n1 minimises E_p E_q at
    v0, for a light overhead and n = c. Uniform unless s > 0.02 and 3 h < 2 (f - n). filament/src/ShadowMap.cpp
    @0362f36, which does not warp in its `stable` mode.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        near_hint: eye depth below which shadows do not matter, a length in the frustum's units (the engine's: m).
        far_hint: eye depth above which shadows do not matter.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi]; hints that are not finite, a negative near_hint, or far_hint <= 0.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(0.1, 500.0, 0.5236)
        >>> round(float(filament(frustum, 1.5707963).lam), 3)   # v0 = 1, v1 = 100
        10.1
    """
    near_hint = parameter("near_hint", near_hint, frustum, lambda v: (v >= 0) & (v < jnp.inf), "a finite length >= 0")
    far_hint = parameter("far_hint", far_hint, frustum, lambda v: (v > 0) & (v < jnp.inf), "a finite length > 0")
    space = space_of(frustum, theta)
    s, m, x = space.sin_theta, space.mu_over_near, space.depth_range
    h = larger(near_hint - camera_planes(frustum)[0], 0) / space.near
    first, last = larger(1, near_hint / space.near), smaller(smaller(1 + x, far_hint / space.near), 1 + m * s)
    # separate square roots: the product could overflow in float32
    equal = m * s / (1 + jnp.sqrt(first) * jnp.sqrt(last))
    hinted = h > 0
    stationary = m * (2 - 3 * (h / x)) / jnp.where(hinted, h, 1)
    warps = (s > 0.02) & (3 * h < 2 * x)
    return _guarded(space, warps, jnp.where(hinted, smaller(equal, stationary), equal))


def osg_lispsm(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """OpenSceneGraph's LiSPSM, and the paper authors' code of 2004: N = (z_n + sqrt(z_n (z_n + d s))) / s, z_n = n / s.

    The apex is N - n behind the eye along Z_w, so that lambda = N - n + y_min; N >= 0.02 d. The second 1/s
    mixes units (z_n is a distance along Z_w, d s an eye depth); see `osg_lispsm_corrected`.
    src/osgShadow/LightSpacePerspectiveShadowMap.cpp @2e4ae2e.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5235987755982988)
        >>> [round(float(rule(frustum, 0.7853981633974483).lam), 2) for rule in (osg_lispsm, osg_lispsm_corrected)]
        [16.35, 12.92]
    """
    space = space_of(frustum, theta)
    square = space.sin_theta**2
    reach = space.mu_over_near * square
    # times s^2, so that theta = 0 (lambda = inf) needs no special case
    N = larger(1 + jnp.sqrt(1 + reach), 0.02 * reach)
    return warp_of_product(space, N + square * (space.start / space.near - 1), square)


def osg_lispsm_corrected(frustum: ViewFrustum | Body, theta: Numbers) -> Warp:
    """`osg_lispsm` with consistent units: lambda = sqrt(n (n + d s)) / s + y_min.

    Equal E_p at eye depths n and n + d s on the line through the eye along Z_w, which is what
    the code's apex is for. It is set relative to the eye: along Z_w these are n / s and n / s + d from the eye.
    Undefined where y_min is too far behind the eye (theta < phi); `lispsm_paper` measures the same N from y_min and
    always gives a warp.

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
        >>> bool(osg_lispsm_corrected(frustum, 0.2).defined)
        False
    """
    space = space_of(frustum, theta)
    s = space.sin_theta
    return warp_of_product(space, jnp.sqrt(1 + space.mu_over_near * s) + s * (space.start / space.near), s)


def osg_vdsm(frustum: ViewFrustum | Body, theta: Numbers, near_far_ratio: Numbers = 0.05) -> Warp:
    """OpenSceneGraph's view-dependent shadow maps: lambda = (d/2) max(tan(30 deg) cot(g)^2, 2 y_min / d, r).

    The middle term is PSM's lambda = y_min, the apex at the eye. Uniform within 2 degrees of the view direction.
    src/osgShadow/ViewDependentShadowMap.cpp:1959 @2e4ae2e.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        near_far_ratio: r, the engine's "minimum shadow map near far ratio".

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], or near_far_ratio <= 0.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> [round(float(rule(frustum, 1.5707963).lam), 3) for rule in (osg_vdsm, openmw)]
        [2.475, 12.375]
    """
    r = parameter("near_far_ratio", near_far_ratio, frustum, lambda v: (v > 0) & (v < jnp.inf), "a finite number > 0")
    space = space_of(frustum, theta)
    s = space.sin_theta
    warps = s >= math.sin(math.radians(2))
    cotangent = _cosine(space) / jnp.where(warps, s, 1)
    lam_over_mu = larger(math.tan(math.radians(30)) / 2 * cotangent**2, r / 2)
    lam_over_mu = larger(lam_over_mu, space.start / space.near / space.mu_over_near)
    return _guarded(space, warps, 1 / lam_over_mu)


def openmw(frustum: ViewFrustum | Body, theta: Numbers, near_far_ratio: Numbers = 0.25) -> Warp:
    """OpenMW: `osg_vdsm` with r = 0.25, a user setting. components/sceneutil/mwshadowtechnique.cpp:2953 @e47ad77.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        near_far_ratio: r, > 0.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], or near_far_ratio <= 0.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(openmw(frustum, 1.5707963).lam), 3)
        12.375
    """
    return osg_vdsm(frustum, theta, near_far_ratio)


def ogre(frustum: ViewFrustum | Body, theta: Numbers, adjust: Numbers = 0.1, threshold: Numbers = 0.451) -> Warp:
    """OGRE up to 13.5, its simple rule: lambda = (n + sqrt(c_n c_f)) k t, without any sin(theta).

    c_n and c_f are the camera's near and far plane, which are n and f except for a `Body`. t = 1 while
    |cos(g)| < c = cos(threshold), and 1 + 20 (|cos(g)| - c) / (1 - c) beyond.
    OgreMain/src/OgreShadowCameraSetupLiSPSM.cpp @00dd9a5.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        adjust: k, the engine's "optimal adjust factor".
        threshold: radians from the view direction within which t grows.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], adjust <= 0, or a threshold outside (0, pi/2).

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(ogre(frustum, 1.5707963).lam), 3)
        1.1
    """
    k = parameter("adjust", adjust, frustum, lambda v: (v > 0) & (v < jnp.inf), "a finite number > 0")
    angle = parameter("threshold", threshold, frustum, lambda v: (v > 0) & (v < math.pi / 2), "radians in (0, pi/2)")
    space = space_of(frustum, theta)
    c = jnp.cos(angle)
    # 1 - c without its cancellation for small angles
    tweak = 1 + 20 * larger(_cosine(space) - c, 0) / (2 * jnp.sin(angle / 2) ** 2)
    planes = camera_planes(frustum)
    # separate square roots: the product could overflow in float32
    root = jnp.sqrt(planes[0] / space.near) * jnp.sqrt(planes[1] / space.near)
    lam = (1 + root) * k * tweak
    return Warp.from_range_ratio(space.mu_over_near / lam, space)


def veloren(frustum: ViewFrustum | Body, theta: Numbers, at_phi: Numbers = -0.2, span: Numbers = 0.3) -> Warp:
    """Veloren, after Lloyd's thesis, section 5.2: lambda shaped by e from -1 (uniform) to 0 (LiSPSM).

    With w = min(f/n - 1, d s / n): lambda = d (1 + sqrt(1 + w) - e w) / (w (e + 1)). e = -1 below phi/3, rises as
    1 - cos to at_phi at phi, then as sin to 0 at phi + span (pi/2 - phi). voxygen/src/scene/mod.rs @d36ddcb.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        at_phi: e at theta = phi, in (-1, 0].
        span: share of the way from phi to pi/2 over which e rises to 0, in (0, 1].

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], at_phi outside (-1, 0], or span outside (0, 1].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> [round(float(veloren(frustum, theta).lam), 2) for theta in (1.5707963, 0.7853982)]
        [11.0, 14.9]
    """
    at_phi = parameter("at_phi", at_phi, frustum, lambda v: (v > -1) & (v <= 0), "a number in (-1, 0]")
    span = parameter("span", span, frustum, lambda v: (v > 0) & (v <= 1), "a number in (0, 1]")
    space = space_of(frustum, theta)
    phi, theta = frustum.half_fov, checked_theta(theta, frustum)
    angle = jnp.where(space.mirrored, math.pi - theta, theta)
    low = jnp.clip((angle - phi / 3) / (2 * phi / 3), 0, 1) * (math.pi / 2)
    high = jnp.clip((angle - phi) / (span * (math.pi / 2 - phi)), 0, 1) * (math.pi / 2)
    # 1 - cos and 1 - sin as squares: e + 1 and -e stay accurate near 0
    below = angle < phi
    minus_e = -at_phi * 2 * jnp.sin((math.pi / 2 - high) / 2) ** 2
    e_plus_1 = jnp.where(below, (1 + at_phi) * 2 * jnp.sin(low / 2) ** 2, 1 - minus_e)
    minus_e = jnp.where(below, 1 - e_plus_1, minus_e)
    w = smaller(space.depth_range, space.mu_over_near * space.sin_theta)
    return Warp.from_range_ratio(w * e_plus_1 / (1 + jnp.sqrt(1 + w) + minus_e * w), space)


def tsm_xray(
    frustum: ViewFrustum | Body, theta: Numbers, delta: Numbers = 0.3, xi: Numbers = -0.6, cutoff: Numbers = 0.99
) -> Warp:
    """TSM in X-Ray (OpenXRay): lambda = d delta (1 + xi) / (1 - xi - 2 delta); uniform where |cos(g)| >= cutoff.

    Maps the depth fraction delta of the body to s = (1 - xi) / 2, 0.8 of the map. The fraction is fixed, while `tsm`
    uses that of a point on the view axis. src/Layers/xrRender_R2/r2_R_sun.cpp @ec397af.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        delta: depth fraction of the focus.
        xi: where the focus is placed, in [-1, 1] from the far end of the map.
        cutoff: |cos(theta)| from which the map is uniform.

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta outside [0, pi], delta outside (0, 1), xi outside (-1, 1), or cutoff outside (0, 1].

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> [round(float(rule(frustum, 1.5707963).lam), 2) for rule in (tsm_xray, tsm_dagor)]
        [11.88, 36.77]
    """
    delta = parameter("delta", delta, frustum, lambda v: (v > 0) & (v < 1), "a number in (0, 1)")
    xi = parameter("xi", xi, frustum, lambda v: (v > -1) & (v < 1), "a number in (-1, 1)")
    cutoff = parameter("cutoff", cutoff, frustum, lambda v: (v > 0) & (v <= 1), "a number in (0, 1]")
    space = space_of(frustum, theta)
    ratio = jnp.broadcast_to((1 - xi - 2 * delta) / (delta * (1 + xi)), space.mu.shape)
    return _guarded(space, _cosine(space) < cutoff, ratio)


def tsm_dagor(
    frustum: ViewFrustum | Body, theta: Numbers, delta: Numbers = 0.52, xi: Numbers = -0.6, cutoff: Numbers = 0.95
) -> Warp:
    """TSM in Dagor: `tsm_xray` with other parameters. prog/gameLibs/render/psm.cpp @3aaa489.

    The engine then tries 15 values of xi in (-0.67, 0) each frame and keeps the one that gives a box of interest the
    largest area; this is its initial value.

    Args:
        frustum: a `ViewFrustum` of any shape, or a `Body`.
        theta: between light and view direction, radians in [0, pi], of a shape that broadcasts.
        delta, xi, cutoff: as for `tsm_xray`: in (0, 1), (-1, 1) and (0, 1].

    Returns:
        A `Warp` of the joint shape.

    Raises:
        ValueError: theta, delta, xi or cutoff out of its range.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5236)
        >>> round(float(tsm_dagor(frustum, 1.5707963).lam_over_mu), 4)
        0.3714
    """
    return tsm_xray(frustum, theta, delta, xi, cutoff)


def _cosine(space: LightSpace | BodySpace) -> Float[Array, "..."]:
    """|cos(theta)|."""
    return space.slope / space.tan_phi


def _guarded(space: LightSpace | BodySpace, warps: Array, ratio: Array) -> Warp:
    """The warp of mu / lambda where the engine warps at all; undefined where mu / lambda is negative."""
    ratio = jnp.where(warps, ratio, 0)
    return Warp.from_range_ratio(ratio, space, ratio >= 0)

"""What engines' stable fit costs: the texels of a square about each cascade's sphere, over those of a tight map."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import Numbers, assembled
from ..objective import Objective
from ..render.sphere_fit import least_sphere, sphere_about
from ..views import FrustumView, SceneView, one_light, refuse_other
from .over_frustum import pieces
from .over_scene import within
from .splits import checked_splits


def sphere_texels(view: FrustumView | SceneView, splits: Numbers) -> Float[Array, "... K"]:
    """How many times the texels of a tight unwarped map each cascade's sphere takes, for texels of the same size.

    The tight map is a rectangle about the cascade's receivers (a whole piece of a frustum) along the view; the sphere's
    is a square that holds still while the camera turns: `Plan.matrices(fit="sphere")`.

    Args:
        view: a `FrustumView`, of any shape, whose window is as wide as high; or a `SceneView`.
        splits: (..., K + 1) non-decreasing view depths.

    Returns:
        (..., K); inf for a cascade without receivers, or with all in one line along the light.

    Raises:
        ValueError: what is no view; splits of a wrong shape, not finite and positive, or decreasing; several lights.

    Example:
        >>> import warpopt
        >>> view = warpopt.FrustumView(warpopt.ViewFrustum(near=1.0, far=31.6, half_fov=0.5236), theta=1.5708)
        >>> [round(float(v), 1) for v in sphere_texels(view, warpopt.cascades.splits.logarithmic(1.0, 31.6, 2))]
        [2.8, 2.8]
    """
    refuse_other(view)
    splits = checked_splits(splits, isinstance(view, SceneView))
    starts, ends = splits[..., :-1], splits[..., 1:]
    if isinstance(view, FrustumView):
        return _over_frustum(view, starts, ends)
    return _over_scene(one_light(view), starts, ends)


@jax.jit
def _over_frustum(view: FrustumView, starts: Array, ends: Array) -> Array:
    frustum, theta = pieces(view, starts, ends)
    part = assembled(FrustumView, frustum=frustum, theta=theta)
    slope = jnp.tan(frustum.half_fov)
    # The window's corners are at slopes (1, 1) tan(phi).
    _, radius = least_sphere(starts, ends, 2 * slope**2, False)
    return jnp.where(ends > starts, (2 * radius) ** 2 / (part.mu * 2 * ends * slope), jnp.inf)


@jax.jit
def _over_scene(view: SceneView, starts: Array, ends: Array) -> Array:
    def one(start: Array, end: Array) -> Array:
        part = within(view, start, end)
        _, radius = sphere_about(part.camera, start, end)
        footprint = part.footprint_in(part.frame_along("view"), Objective())
        lateral = footprint.lateral_fit(jnp.ones_like(radius))
        tight = footprint.mu * (lateral.left + lateral.right)
        return jnp.where(footprint.empty | ~(tight > 0), jnp.inf, (2 * radius) ** 2 / jnp.where(tight > 0, tight, 1))

    return jax.lax.map(lambda ab: one(*ab), (starts, ends))

"""Engines' stable fit: a square about the sphere that holds a piece of the camera's frustum, moved by whole texels."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays, instance
from .._words import flag, whole_number
from ..objective import Objective
from ..receivers import ConvexBody
from ..theory.camera import Camera
from ..views import SceneView, settled
from .casters import Casters, casters_of
from .map_depth import map_depth
from .shadow_matrix import ClipSpace, checked_clip_space, refuse_no_depth, to_clip


def sphere_matrix(
    view: SceneView, texels: int, clip_space: ClipSpace | None = None, *, casters: Numbers | ConvexBody | None = None,
    depth_clamp: bool = False, near: Numbers | None = None, far: Numbers | None = None,
) -> Float[Array, "4 4"]:  # fmt: skip
    """World to clip space of an unwarped square map about the sphere around what the camera can see.

    Its size is that of the frustum, its axes are the light's alone, and its corner lies at whole texels: a camera that
    moves and turns changes no texel. One spare texel keeps the sphere in the map wherever it is.
    The price is the sphere's: see `warpopt.cascades.sphere_texels`.

    Args:
        view: one camera, light and receivers.
        texels: along each side of the map.
        clip_space, casters, depth_clamp: as for `shadow_matrix`.
        near, far: the view depths of the piece of the camera's frustum that the sphere is about; the camera's planes,
            by default; the farthest receiver for far = inf.

    Returns:
        (4, 4), as `shadow_matrix`.

    Raises:
        ValueError: texels that are no whole number >= 2, depths without 0 < near < far, or as `shadow_matrix`.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=10.0, half_fov=0.5236)
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0)))
        >>> moved = warpopt.Camera((0.37, 0.2, 0.1), (0, 0, -1), (0, 1, 0), near=1.0, far=10.0, half_fov=0.5236)
        >>> step = sphere_matrix(view, 512) - sphere_matrix(warpopt.SceneView(moved, view.light), 512)
        >>> texels = 512 / 2 * step[:2, 3]                  # by whole texels
        >>> bool(abs(texels - jnp.round(texels)).max() < 1e-9), bool(abs(texels).max() > 1)
        (True, True)
    """
    whole_number("texels", texels, 2, 2**20)
    flag("depth_clamp", depth_clamp)
    instance("view", view, SceneView)
    clip = checked_clip_space(clip_space)
    camera = view.camera
    ends = float_arrays(near=camera.near if near is None else near, far=camera.far if far is None else far)
    first = checked("near", ends[0], lambda v: (v > 0) & (v < jnp.inf), "a positive view depth")
    last = checked("far", ends[1], lambda v, n: v > n, "a view depth beyond near", first)
    casters = None if depth_clamp else casters_of(casters)
    matrix, extent = _matrix(settled(view, None), (first, last), texels, casters, clip)
    refuse_no_depth(extent)
    return matrix


def sphere_about(
    camera: Camera, near: Float[Array, ""], far: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(view depth of its centre, radius) of the least sphere, its centre on the view's axis, about a piece of what is
    seen."""
    left, right, bottom, top = camera.window
    squared = jnp.maximum(left**2, right**2) + jnp.maximum(bottom**2, top**2)
    return least_sphere(near, far, squared, camera.is_orthographic)


def least_sphere(
    near: Float[Array, "..."], far: Float[Array, "..."], squared: Float[Array, "..."], parallel: bool
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`sphere_about` of a window whose farthest corner has this squared slope; `parallel`: this squared distance."""
    growth = 0 * squared if parallel else squared
    # Where near and far corners are equally far; at the far plane where that is behind it.
    middle = jnp.minimum((far + near) * (1 + growth) / 2, far)
    sizes = [jnp.ones_like(z) if parallel else z for z in (near, far)]
    reach = [jnp.hypot(middle - z, jnp.sqrt(squared) * size) for z, size in zip((near, far), sizes, strict=True)]
    return middle, jnp.maximum(*reach)


@functools.partial(jax.jit, static_argnames=("texels", "clip_space"))
def _matrix(
    view: SceneView, ends: tuple[Array, Array], texels: int, casters: Casters | None, clip_space: ClipSpace
) -> tuple[Array, Array]:
    camera, frame = view.camera, view.frame_along("view")
    _, farthest = view.receivers.depth_extent(camera)
    near, far = (end.astype(farthest.dtype) for end in ends)
    middle, radius = sphere_about(camera, near, jnp.where(jnp.isfinite(far), far, farthest))
    footprint = view.footprint_in(frame, Objective())
    depth = map_depth(camera, frame, footprint, jnp.ones_like(radius), casters)
    light = frame.light @ camera.rotation  # the frame's are eye coordinates
    across = jnp.cross(light, jnp.eye(3, dtype=light.dtype)[jnp.abs(light).argmin()])
    across = across / jnp.linalg.norm(across)
    axes = jnp.stack([across, light, jnp.cross(light, across)])
    texel = 2 * radius / (texels - 1)
    side = texels * texel
    centre = axes @ (camera.position + middle * camera.rotation[2])
    corner = jnp.floor((centre - radius) / texel) * texel
    span = jnp.where(depth.largest > depth.least, depth.largest - depth.least, 1)
    begin = light @ camera.position + depth.reference + depth.least
    scale = jnp.stack([side, span, side])
    offset = jnp.stack([corner[0], begin, corner[2]])
    rows = jnp.concatenate([axes / scale[:, None], (-offset / scale)[:, None]], 1)
    rows = jnp.concatenate([rows, jnp.array([[0.0, 0.0, 0.0, 1.0]], rows.dtype)])
    matrix = jnp.asarray(to_clip(clip_space, rows.dtype)) @ rows
    return matrix.T if clip_space.row_vectors else matrix, depth.extent

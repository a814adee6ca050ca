"""The matrix from world space to the warped shadow map, WI's product S_w = F W_p W_v R L_p L_v."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import Numbers, instance, is_traced, pair
from .._words import flag, shown
from ..objective import Objective
from ..receivers import ConvexBody
from ..solve.solution import SceneSolution, Solution, placed
from ..theory.warp import Warp, refuse_lost
from ..views import SceneView, settled
from .casters import Casters, casters_of
from .map_depth import MapDepth, map_depth

_LEAST_EXTENT = 16  # eps: of the extent along the light that receivers must have, so that the depth tells any apart


@dataclasses.dataclass(frozen=True)
class ClipSpace:
    """A graphics API's convention for clip coordinates (x, y, z, w).

    Texture coordinates (t, s) of the map, both in [0, 1], are ((x/w + 1)/2, (y/w + 1)/2), or (1 - y/w)/2 with `y_down`.

    Args:
        z_zero_to_one: z/w spans [0, 1] rather than [-1, 1].
        y_down: y/w grows towards the lower edge of the map.
        reversed_z: the point nearest to the light has the largest z/w.
        row_vectors: for p M instead of M p: the matrix is transposed.

    Raises:
        ValueError: anything but True and False.

    Example:
        >>> ClipSpace.vulkan().y_down
        True
    """

    z_zero_to_one: bool = False
    y_down: bool = False
    reversed_z: bool = False
    row_vectors: bool = False

    def __post_init__(self):
        for field in dataclasses.fields(self):
            flag(field.name, getattr(self, field.name))

    @classmethod
    def opengl(cls, *, reversed_z: bool = False, row_vectors: bool = False) -> "ClipSpace":
        """z in [-1, 1], y up.

        Args:
            reversed_z, row_vectors: as for the class.
        """
        return cls(False, False, reversed_z, row_vectors)

    @classmethod
    def direct3d(cls, *, reversed_z: bool = False, row_vectors: bool = True) -> "ClipSpace":
        """z in [0, 1], y up; row vectors by default.

        Args:
            reversed_z, row_vectors: as for the class.
        """
        return cls(True, False, reversed_z, row_vectors)

    @classmethod
    def vulkan(cls, *, reversed_z: bool = False, row_vectors: bool = False) -> "ClipSpace":
        """z in [0, 1], y down.

        Args:
            reversed_z, row_vectors: as for the class.
        """
        return cls(True, True, reversed_z, row_vectors)


def shadow_matrix(
    view: SceneView,
    warp: Warp | Solution | SceneSolution,
    clip_space: ClipSpace | None = None,
    *,
    casters: Numbers | ConvexBody | None = None,
    depth_clamp: bool = False,
    padding: tuple[float, float] = (0.0, 0.0),
) -> Float[Array, "4 4"]:
    """World to clip space of the shadow map, fitted to the receivers.

    Every receiver, and every caster between the light and a receiver, is in the map with w > 0; the depth grows away
    from the light, from the first of them to the last receiver. `eta = 1` gives the plain focused map, with w = 1
    everywhere. All this holds up to rounding: in single precision a camera 1e5 map
    widths from the world's origin moves receivers by a tenth of a texel, as in any engine; use coordinates near the
    origin.

    Args:
        view: one camera, light and receivers; `SceneView.reduced` saves a second pass over the receivers.
        warp: a warp, or a solution. A warp made for another body keeps its apex: see `Warp.over`.
        clip_space: the graphics API's convention; OpenGL's by default.
        casters: the shadow casters: a `ConvexBody` that contains them, such as a box; triangles (T, 3, 3); or points
            (N, 3) that bound them, such as a box's corners, which stand for their convex hull. Only the part in the
            receivers' sweep towards the light counts: the map's depth begins where that does. Traced points stand for
            the body between 26 planes about them, which is exact for a box and a little larger for others:
            `MapDepth.bounded` says so. By default the depth begins at the receivers.
        depth_clamp: whether nearer casters are clamped to the map's depth when they are drawn, as Vulkan's
            depthClampEnable, Direct3D's DepthClipEnable = FALSE and OpenGL's GL_DEPTH_CLAMP do ("pancaking"): the depth
            begins at the receivers, whatever the casters.
        padding: fractions of the map, along (t, s), left free at each edge: (1/width, 1/height) leaves a texel for
            filters. For maps that stay where they are over time see `StableWindow`.

    Returns:
        (4, 4), for column vectors unless `clip_space` says otherwise.

    Raises:
        ValueError: for casters of a wrong shape or not finite, a padding outside [0, 1/2), or an apex that is not
            before the receivers (a matrix of NaN when traced); casters so far before the receivers that the depth
            would tell none of these apart (NaN when traced).

    First derivatives grow as 1/sin(theta); where light and view are parallel (see `LightFrame`), those with respect to
    a rotation of W about the view are zero.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> light = warpopt.DirectionalLight((0, -1, 0))
        >>> view = warpopt.SceneView(camera, light)
        >>> matrix = shadow_matrix(view, warpopt.optimal_warp(view))
        >>> x, y, z, w = matrix @ jnp.array([0.0, 0.0, -1.0, 1.0])   # on the near plane: s = 0
        >>> [round(float(v), 6) + 0.0 for v in (x / w, y / w)]
        [0.0, -1.0]
    """
    return matrix_and_depth(view, warp, clip_space, casters=casters, depth_clamp=depth_clamp, padding=padding)[0]


def matrix_and_depth(
    view: SceneView,
    warp: Warp | Solution | SceneSolution,
    clip_space: ClipSpace | None = None,
    *,
    casters: Numbers | ConvexBody | None = None,
    depth_clamp: bool = False,
    padding: tuple[float, float] = (0.0, 0.0),
) -> tuple[Float[Array, "4 4"], MapDepth]:
    """(`shadow_matrix`, what its depth spans); raises as that."""
    clip_space = checked_clip_space(clip_space)
    padding = pair("padding", padding, lambda v: 0 <= v < 0.5, "two fractions in [0, 1/2)")
    instance("view", view, SceneView)
    view, warp = placed(view, warp)
    view = settled(view, None)
    if warp.eta.ndim:
        raise ValueError(f"warp: got shape {warp.eta.shape}, expected one; use jax.vmap over more")
    flag("depth_clamp", depth_clamp)
    given, casters = casters, casters_of(casters)
    bounded = isinstance(casters, ConvexBody) and casters is not given  # traced points
    convention = to_clip(clip_space, view.camera.position.dtype)
    matrix, lost, depth = _matrix(view, warp, None if depth_clamp else casters, np.array(padding), convention)
    refuse_lost(lost)
    refuse_no_depth(depth.extent)
    depth = depth._replace(bounded=depth.bounded | bounded)
    return matrix.T if clip_space.row_vectors else matrix, depth


def refuse_no_depth(extent: Float[Array, ""]) -> None:
    """Refuse casters that leave the receivers no digits of the depth. Traced values are not checked.

    Raises:
        ValueError: naming the receivers' share of the extent along the light.
    """
    least = _LEAST_EXTENT * float(jnp.finfo(extent.dtype).eps)
    if not is_traced(extent) and float(extent) < least:
        raise ValueError(
            f"casters: got ones so far before the receivers that these have {float(extent):.3g} of the extent along "
            f"the light, expected at least {least:.3g} ({extent.dtype}): give their true bounds, or depth_clamp=True"
        )


@jax.jit
def _matrix(
    view: SceneView, warp: Warp, casters: Casters | None, padding: Array, convention: Array
) -> tuple[Array, Array, MapDepth]:
    """For column vectors. The convention is an array, so that another one compiles nothing anew."""
    camera, frame = view.camera, view.frame()
    footprint = view.footprint_in(frame, Objective())
    own = warp.over(footprint)
    eta = own.eta.astype(camera.position.dtype)
    depth = map_depth(camera, frame, footprint, eta, casters)
    mu, lateral = footprint.mu, footprint.lateral_fit(eta)
    width = lateral.left + lateral.right
    wide = width > 0
    width = jnp.where(wide, width, 1)

    # L_v: world to eye, then the axes X_w, l, Z_w. L_p: lengths in units of mu; a directional light's is orthographic.
    axes = jnp.stack([frame.x_axis, frame.light, frame.z_axis])
    turn = axes @ camera.rotation
    l_v = _affine(turn, -turn @ camera.position)
    l_p = jnp.diag(jnp.stack([1 / mu, 1 / mu, 1 / mu, jnp.ones_like(mu)]))
    # R orders the axes, as L_v already does: Z_w is last. W_v: moves W's axis and near plane to the origin.
    w_v = _affine(jnp.eye(3, dtype=mu.dtype), -jnp.stack([footprint.axis, depth.reference, footprint.start]) / mu)
    # A free fit's axis is x = m0 + m1 delta: sheared upright.
    upright = _plus(np.eye(4), {(0, 2): -lateral.m1 / mu, (0, 3): -lateral.m0 / mu})
    # W_p: (x, h, delta) to (x, h, delta) / A, with A = eta + (1 - eta) delta.
    w_p = _plus(np.diag([1, 1, 1, 0]), {(3, 2): 1 - eta, (3, 3): eta})
    # F: to t, depth and s in [0, 1], then to clip space.
    span = depth.largest - depth.least
    span = jnp.where(span > 0, span, 1)
    f = _affine(
        jnp.diag(jnp.stack([mu / width, mu / span, jnp.ones_like(mu)])),
        jnp.stack([jnp.where(wide, lateral.left / width, 0.5), -depth.least / span, jnp.zeros_like(mu)]),
    )
    pad_t, pad_s = padding.astype(mu.dtype)
    inner = _plus(np.eye(4), {(0, 0): -2 * pad_t, (0, 3): pad_t, (2, 2): -2 * pad_s, (2, 3): pad_s})
    matrix = convention @ inner @ f @ w_p @ upright @ w_v @ l_p @ l_v
    # With fewer digits than that, all receivers are at one depth.
    matrix = jnp.where(depth.extent < _LEAST_EXTENT * jnp.finfo(mu.dtype).eps, jnp.nan, matrix)
    return matrix, warp.lost_over(own), depth


def checked_clip_space(clip_space: ClipSpace | None) -> ClipSpace:
    """The convention; OpenGL's for None.

    Raises:
        ValueError: anything else.
    """
    if clip_space is None:
        return ClipSpace()
    if not isinstance(clip_space, ClipSpace):
        raise ValueError(f"clip_space: got {shown(clip_space)}, expected a ClipSpace, such as ClipSpace.vulkan()")
    return clip_space


def _plus(constant: np.ndarray, entries: dict[tuple[int, int], Array]) -> Array:
    """A constant matrix plus numbers at some entries. (Sums with constants fuse; updates of single entries do not.)"""
    matrix: Any = 0
    for (row, column), value in entries.items():
        place = np.zeros((4, 4), value.dtype)
        place[row, column] = 1
        matrix = matrix + value * place
    return matrix + constant.astype(matrix.dtype)


def _affine(linear: Array, offset: Array) -> Array:
    return jnp.concatenate([jnp.c_[linear, offset], jnp.array([[0.0, 0.0, 0.0, 1.0]], linear.dtype)])


def to_clip(clip_space: ClipSpace, dtype: Any) -> Float[np.ndarray, "4 4"]:
    """From (t, depth, s, 1), the depth increasing away from the light, to clip space."""
    y = -1 if clip_space.y_down else 1
    low, high = (0, 1) if clip_space.z_zero_to_one else (-1, 1)
    if clip_space.reversed_z:
        low, high = high, low
    rows = [[2, 0, 0, -1], [0, 0, 2 * y, -y], [0, high - low, 0, low], [0, 0, 0, 1]]
    return np.array(rows, dtype)

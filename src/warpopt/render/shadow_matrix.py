"""The matrix from world space to the warped shadow map, WI's product S_w = F W_p W_v R L_p L_v."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays, instance, pair
from .._words import flag, shown
from ..objective import Objective
from ..receivers.footprint import Footprint
from ..solve.solution import SceneSolution, Solution, placed
from ..theory.light_frame import LightFrame
from ..theory.warp import Warp, refuse_lost
from ..views import SceneView, settled


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
        """z in [-1, 1], y up."""
        return cls(False, False, reversed_z, row_vectors)

    @classmethod
    def direct3d(cls, *, reversed_z: bool = False, row_vectors: bool = True) -> "ClipSpace":
        """z in [0, 1], y up; row vectors by default."""
        return cls(True, False, reversed_z, row_vectors)

    @classmethod
    def vulkan(cls, *, reversed_z: bool = False, row_vectors: bool = False) -> "ClipSpace":
        """z in [0, 1], y down."""
        return cls(True, True, reversed_z, row_vectors)


def shadow_matrix(
    view: SceneView,
    warp: Warp | Solution | SceneSolution,
    clip_space: ClipSpace | None = None,
    *,
    casters: Numbers | None = None,
    padding: tuple[float, float] = (0.0, 0.0),
) -> Float[Array, "4 4"]:
    """World to clip space of the shadow map, fitted to the receivers.

    Every receiver, and every caster between the light and a receiver, is in the map with w > 0. `eta = 1` gives the
    plain focused map, with w = 1 everywhere. All this holds up to rounding: in single precision a camera 1e5 map
    widths from the world's origin moves receivers by a tenth of a texel, as in any engine; use coordinates near the
    origin.

    Args:
        view: one camera, light and receivers; `SceneView.reduced` saves a second pass over the receivers.
        warp: a warp, or a solution. A warp made for another body keeps its apex: see `Warp.over`.
        clip_space: the graphics API's convention; OpenGL's by default.
        casters: (N, 3) world points that bound the shadow casters (such as the corners of the scene's box): the map's
            depth begins at the point nearest to the light. By default it begins at the receivers.
        padding: fractions of the map, along (t, s), left free at each edge: (1/width, 1/height) leaves a texel for
            filters. For maps that stay where they are over time see `StableWindow`.
    Raises:
        ValueError: for casters of a wrong shape or not finite, a padding outside [0, 1/2), or an apex that is not
            before the receivers (a matrix of NaN when traced).

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
    clip_space = checked_clip_space(clip_space)
    padding = pair("padding", padding, lambda v: 0 <= v < 0.5, "two fractions in [0, 1/2)")
    instance("view", view, SceneView)
    view, warp = placed(view, warp)
    view = settled(view, None)
    if warp.eta.ndim:
        raise ValueError(f"warp: got shape {warp.eta.shape}, expected one; use jax.vmap over more")
    if casters is not None:
        (casters,) = float_arrays(casters=casters)
        if casters.ndim != 2 or casters.shape[1] != 3:
            raise ValueError(f"casters: got shape {casters.shape}, expected (N, 3)")
        casters = checked("casters", casters, lambda v: abs(v) < np.inf, "finite numbers")
    matrix, lost = _matrix(view, warp, casters, np.array(padding), clip_space)
    refuse_lost(lost)
    return matrix


@functools.partial(jax.jit, static_argnames=("clip_space",))
def _matrix(
    view: SceneView, warp: Warp, casters: Array | None, padding: Array, clip_space: ClipSpace
) -> tuple[Array, Array]:
    camera, frame = view.camera, view.frame()
    footprint = view.footprint_in(frame, Objective())
    own = warp.over(footprint)
    eta = own.eta.astype(camera.position.dtype)
    reference, least, largest = _light_range(camera, frame, footprint, eta, casters)
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
    w_v = _affine(jnp.eye(3, dtype=mu.dtype), -jnp.stack([footprint.axis, reference, footprint.start]) / mu)
    # A free fit's axis is x = m0 + m1 delta: sheared upright.
    upright = jnp.eye(4, dtype=mu.dtype).at[0, 2].set(-lateral.m1 / mu).at[0, 3].set(-lateral.m0 / mu)
    # W_p: (x, h, delta) to (x, h, delta) / A, with A = eta + (1 - eta) delta.
    w_p = jnp.eye(4, dtype=mu.dtype).at[3].set(jnp.stack([jnp.zeros_like(eta), jnp.zeros_like(eta), 1 - eta, eta]))
    # F: to t, depth and s in [0, 1], then to clip space.
    span = jnp.where(largest > least, largest - least, 1)
    f = _affine(
        jnp.diag(jnp.stack([mu / width, mu / span, jnp.ones_like(mu)])),
        jnp.stack([jnp.where(wide, lateral.left / width, 0.5), -least / span, jnp.zeros_like(mu)]),
    )
    pad_t, pad_s = padding.astype(mu.dtype)
    inner = jnp.diag(jnp.stack([1 - 2 * pad_t, jnp.ones_like(mu), 1 - 2 * pad_s, jnp.ones_like(mu)]))
    inner = inner.at[0, 3].set(pad_t).at[2, 3].set(pad_s)
    matrix = jnp.asarray(to_clip(clip_space, mu.dtype)) @ inner @ f @ w_p @ upright @ w_v @ l_p @ l_v
    return matrix.T if clip_space.row_vectors else matrix, warp.lost_over(own)


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


def _light_range(camera, frame: LightFrame, footprint: Footprint, eta: Array, casters) -> tuple[Array, Array, Array]:
    """(reference, least, largest): of (l . c - reference)/A over receivers and the casters in front of them."""
    sides = footprint.sides
    there = jnp.isfinite(sides.light_least)
    first = jnp.where(there, sides.light_least, jnp.inf).min()
    last = jnp.where(there, sides.light_largest, -jnp.inf).max()
    first, last = (jnp.where(there.any(), v, 0) for v in (first, last))
    start = jnp.where(there, sides.light_least, first)
    end = jnp.where(there, sides.light_largest, last)
    if casters is not None:
        nearest = jnp.append(frame.along_light(camera.to_eye(casters)), first).min()
        start = jnp.where(nearest < start, nearest, start)  # between the light and a receiver
    # Any reference works; the middle of the receivers keeps accuracy in the division by a small A.
    reference = (first + last) / 2
    blends = [depth.blend(eta) for depth in (sides.depth, sides.farthest)]
    least = jnp.stack([(start - reference) / blend for blend in blends]).min()
    largest = jnp.stack([(end - reference) / blend for blend in blends]).max()
    return reference, least, largest


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

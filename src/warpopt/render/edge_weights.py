"""Weights of pixels beside a shadow edge: where a shadow map's errors are seen."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays, instance, is_traced
from ..receivers.depth_buffer import DepthBuffer, eye_points
from ..receivers.weighted.weights import EdgeWeights, mask_of
from ..scene_files.depth_files import read_mask
from ..theory.camera import Camera, refuse_orthographic
from .shadow_matrix import ClipSpace


class RenderedMap(eqx.Module):
    """A shadow map that was rendered, such as a small one without a warp, from which edges are taken.

    Args:
        depth: (rows, columns) of the texels' depths as stored, in [0, 1]. Row 0 is at y/w = -1, column 0 at x/w = -1:
            as OpenGL and Vulkan store it; flip Direct3D's rows.
        matrix: (4, 4), world to clip space, as `shadow_matrix` gives it.
        clip_space: the convention of the matrix; OpenGL's by default.

    Raises:
        ValueError: other shapes, NaN, depths outside [0, 1].

    Example:
        >>> import warpopt
        >>> empty = RenderedMap(jnp.ones((64, 64)), jnp.eye(4))   # nothing was drawn: the light reaches everything
        >>> camera = warpopt.Camera((0, 0, 0.5), (0, 0, -1), (0, 1, 0), near=0.1, far=10.0, half_fov=0.4)
        >>> float(edge_weights(empty, DepthBuffer(jnp.full((4, 4), 1.0)), camera).share)
        0.0
    """

    depth: Float[Array, "R C"]
    matrix: Float[Array, "4 4"]
    clip_space: ClipSpace = eqx.field(static=True)

    def __init__(self, depth: Numbers, matrix: Numbers, clip_space: ClipSpace | None = None):
        depth, matrix = float_arrays(depth=depth, matrix=matrix)
        if depth.ndim != 2 or 0 in depth.shape:
            raise ValueError(f"depth: got shape {depth.shape}, expected (rows, columns)")
        if matrix.shape != (4, 4):
            raise ValueError(f"matrix: got shape {matrix.shape}, expected (4, 4)")
        clip_space = ClipSpace() if clip_space is None else clip_space
        instance("clip_space", clip_space, ClipSpace)
        self.depth = checked("depth", depth, lambda d: (d >= 0) & (d <= 1), "numbers in [0, 1]")
        self.matrix = checked("matrix", matrix, lambda m: abs(m) < np.inf, "finite numbers")
        self.clip_space = clip_space


def edge_weights(
    lit: Numbers | str | Path | RenderedMap,
    receivers: DepthBuffer | None = None,
    camera: Camera | None = None,
    *,
    last_camera: Camera | None = None,
) -> EdgeWeights:
    """Weights that are 1 beside a shadow edge, where of two adjacent pixels only one is lit, and 0 elsewhere.

    With the edges' normals, by the mask's gradient over 5 x 5 pixels: to 17 degrees, 5 in the mean.

    Args:
        lit: which pixels the light reaches, of this frame or of the last: (H, W) of booleans or 0 and 1, or a `.npy` or
            PNG file of it; or a `RenderedMap`, in which every pixel is looked up with a bias of one texel along its
            surface; what faces away from the light is not lit.
        receivers, camera: of this frame. With them, only pixels that show something count; required for
            `last_camera` and for a map.
        last_camera: the camera of the frame that `lit` is from: its edges are carried over by the receivers' places.
            Pixels that it did not see have weight 0.

    Returns:
        An `EdgeWeights` of (H, W) weights and (H, W, 2) normals, as `DepthBuffer` takes it.

    Raises:
        ValueError: a mask of another size than the receivers', or a file that is no mask; a missing argument; an
            orthographic camera with a map or `last_camera`; `last_camera` with a map; two cameras whose views share no
            receiver (traced values are not checked).
        OSError: a mask file that cannot be read.

    Example:
        >>> import numpy as np
        >>> edges = edge_weights(np.arange(12).reshape(3, 4) % 4 < 2)   # the light reaches the left half
        >>> edges.weights[0].tolist(), round(float(edges.share), 2)
        ([0.0, 1.0, 1.0, 0.0], 0.5)
    """
    for name, value, kind in (
        ("receivers", receivers, DepthBuffer), ("camera", camera, Camera), ("last_camera", last_camera, Camera)
    ):  # fmt: skip
        if value is not None:
            instance(name, value, kind)
    if (receivers is None) != (camera is None):
        name, other = ("camera", "receivers") if camera is None else ("receivers", "camera")
        raise ValueError(f"{name}: got none with {other}, expected both or neither")
    moved = isinstance(lit, RenderedMap) or last_camera is not None
    if moved and camera is not None:
        for seen in filter(None, (camera, last_camera)):
            refuse_orthographic(seen, "surfaces are followed from pixel to pixel of a perspective image")
    if moved and (receivers is None or camera is None):
        name = "a RenderedMap" if isinstance(lit, RenderedMap) else "last_camera"
        raise ValueError(f"receivers: got none with {name}, expected the receivers and the camera of this frame")
    if isinstance(lit, RenderedMap):
        if last_camera is not None:
            raise ValueError("last_camera: got one with a RenderedMap, expected none: a map holds for any camera")
        return _of_map(lit, receivers, camera)
    if isinstance(lit, str | Path):
        lit = read_mask(Path(lit))
    mask = mask_of("lit", lit, None)
    if mask.ndim != 2:
        raise ValueError(f"lit: got shape {mask.shape}, expected (height, width)")
    if last_camera is not None:
        found, shared = _carried(mask, receivers, camera, last_camera)
        if not is_traced(shared) and not bool(shared):
            raise ValueError("last_camera: got one that sees none of this frame's receivers, expected it to see some")
        return found
    if receivers is not None and mask.shape != receivers.depth.shape:
        raise ValueError(f"lit: got shape {mask.shape}, expected the receivers' {receivers.depth.shape}")
    return _beside(mask, receivers, camera)


@jax.jit
def _beside(lit: Bool[Array, "H W"], receivers: DepthBuffer | None, camera: Camera | None) -> EdgeWeights:
    seen = jnp.ones(lit.shape, bool)
    if receivers is not None and camera is not None:
        seen = jnp.isfinite(receivers.eye_depth(camera))
    return _weights(edges_between(lit, seen), _normals(lit, seen))


def _weights(beside: Bool[Array, "H W"], normals: Float[Array, "H W 2"]) -> EdgeWeights:
    weights = beside.astype(normals.dtype)
    return EdgeWeights(weights, normals * weights[..., None])


def _normals(lit: Bool[Array, "H W"], seen: Bool[Array, "H W"]) -> Float[Array, "H W 2"]:
    """The direction (right, up) across a mask's edges, of any length: of its gradients about each pixel, without sign.

    Gradients are over 3 x 3 pixels. Of 3 x 3 of them the squares as complex numbers are summed, which n and -n have in
    common: a thin line's two edges do not cancel.
    """
    level = lit.astype(jnp.zeros(()).dtype)

    def gradient(axis: int) -> Array:
        one, other = (jax.lax.slice_in_dim(level, i, level.shape[axis] - 1 + i, axis=axis) for i in (0, 1))
        both = [jax.lax.slice_in_dim(seen, i, level.shape[axis] - 1 + i, axis=axis) for i in (0, 1)]
        step = jnp.where(both[0] & both[1], other - one, 0)
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 1)
        padded = jnp.pad(step, pad)
        before, after = (jax.lax.slice_in_dim(padded, i, level.shape[axis] + i, axis=axis) for i in (0, 1))
        return _summed(before + after, 1 - axis, (1, 2, 1))

    right, up = gradient(1), -gradient(0)
    real, imaginary = right * right - up * up, 2 * right * up
    real, imaginary = (_summed(_summed(v, 0, (1, 1, 1)), 1, (1, 1, 1)) for v in (real, imaginary))
    size = jnp.sqrt(real * real + imaginary * imaginary)
    # The root of a complex number up to its length, in the form without cancellation.
    rather_right = jnp.stack([size + real, imaginary], -1)
    return jnp.where((real >= 0)[..., None], rather_right, jnp.stack([imaginary, size - real], -1))


def _summed(values: Float[Array, "H W"], axis: int, factors: tuple[int, int, int]) -> Array:
    """The weighted sum of each and its two neighbours."""
    pad = [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
    wide = jnp.pad(values, pad)
    before, own, after = (jax.lax.slice_in_dim(wide, i, values.shape[axis] + i, axis=axis) for i in range(3))
    return factors[0] * before + factors[1] * own + factors[2] * after


@jax.jit
def edges_between(lit: Bool[Array, "H W"], seen: Bool[Array, "H W"]) -> Bool[Array, "H W"]:
    """Pixels of both sides of a mask's edges, across or up, both visible."""
    beside = jnp.zeros(lit.shape, bool)
    for axis in (0, 1):
        one, other = (jax.lax.slice_in_dim(lit, i, lit.shape[axis] - 1 + i, axis=axis) for i in (0, 1))
        both = [jax.lax.slice_in_dim(seen, i, lit.shape[axis] - 1 + i, axis=axis) for i in (0, 1)]
        differ = (one != other) & both[0] & both[1]
        for before, after in ((1, 0), (0, 1)):
            pad = [(0, 0), (0, 0)]
            pad[axis] = (before, after)
            beside = beside | jnp.pad(differ, pad)
    return beside


@jax.jit
def _carried(
    lit: Array, receivers: DepthBuffer, camera: Camera, last_camera: Camera
) -> tuple[EdgeWeights, Bool[Array, ""]]:
    """(weights, whether the last camera sees any receiver)."""
    edges = edges_between(lit, jnp.ones(lit.shape, bool))
    points, seen = eye_points(receivers, camera)
    at = last_camera.to_eye(_to_world(camera, points))
    left, right, bottom, top = last_camera.window
    before = at[..., 2] >= last_camera.near
    z = jnp.where(before, at[..., 2], 1)
    height, width = lit.shape
    column = (at[..., 0] / z - left) / (right - left) * width
    row = (top - at[..., 1] / z) / (top - bottom) * height
    inside = seen & before & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    i, j = (jnp.where(inside, v, 0).astype(int) for v in (row, column))
    # A normal is a gradient: it turns by the transposed Jacobian of the last frame's pixel, where that is known.
    normals, place = _normals(lit, jnp.ones(lit.shape, bool))[i, j], jnp.stack([column, row], -1)
    nearness = jnp.where(seen, 1 / points[..., 2], 0)
    (by_row, known), (by_column, known_too) = (_step(place, nearness, axis) for axis in (0, 1))
    turned = jnp.stack([(by_column * normals * _UP).sum(-1), -(by_row * normals * _UP).sum(-1)], -1)
    normals = jnp.where((known & known_too)[..., None], turned, normals)
    return _weights(inside & edges[i, j], normals), inside.any() | ~seen.any()


@jax.jit
def _of_map(rendered: RenderedMap, receivers: DepthBuffer, camera: Camera) -> EdgeWeights:
    points, seen = eye_points(receivers, camera)
    place = _in_map(rendered, _to_world(camera, points))
    s, t, depth = (place[..., k] for k in range(3))
    rows, columns = rendered.depth.shape
    i, j = jnp.floor(s * rows), jnp.floor(t * columns)
    inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns) & (depth <= 1)
    i, j = (jnp.where(inside, v, 0).astype(int) for v in (i, j))
    stored = rendered.depth[i, j]
    stored = 1 - stored if rendered.clip_space.reversed_z else stored
    bias, facing = _surface(place, jnp.where(seen, 1 / points[..., 2], 0), 1 / rows, 1 / columns)
    # How pixels turn into texels: the same way round for each surface that faces both the eye and the light.
    turn = -jnp.linalg.det(rendered.matrix) * jnp.linalg.det(camera.rotation)
    turn = -turn if rendered.clip_space.reversed_z else turn
    faces = facing * turn >= 0
    # A texel at the foot of a wall holds the wall's depth, for pixels of the floor too.
    bias = _widest(jnp.where(seen & faces, bias, 0))
    reached = faces & (~inside | (depth - bias <= stored))
    return _weights(edges_between(reached, seen), _normals(reached, seen))


def _widest(values: Float[Array, "H W"]) -> Array:
    """The largest of each pixel's value and those beside it, diagonally too."""
    for axis in (0, 1):
        pad = [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
        wide = jnp.pad(values, pad, mode="edge")
        parts = [jax.lax.slice_in_dim(wide, i, values.shape[axis] + i, axis=axis) for i in range(3)]
        values = jnp.maximum(jnp.maximum(parts[0], parts[1]), parts[2])
    return values


def _surface(place: Float[Array, "H W 3"], nearness: Array, ds: float, dt: float) -> tuple[Array, Array]:
    """(the depth that a pixel's surface spans over one texel, the sign of its area in the map or 0 where unknown)."""
    (down, known_down), (right, known_right) = (_step(place, nearness, axis) for axis in (0, 1))
    (s_p, t_p, z_p), (s_q, t_q, z_q) = ([v[..., k] for k in range(3)] for v in (down, right))
    area = s_p * t_q - s_q * t_p
    # Where the light grazes a surface its area is rounding: it is taken as facing the light, and as steep.
    eps = jnp.finfo(place.dtype).eps
    known = known_down & known_right & (jnp.abs(area) > 16 * eps * sum(map(jnp.abs, (s_p, t_p, s_q, t_q))))
    safe = jnp.where(known, area, 1)
    by_s, by_t = (z_p * t_q - z_q * t_p) / safe, (z_q * s_p - z_p * s_q) / safe
    bias = jnp.abs(by_s) * ds + jnp.abs(by_t) * dt + _QUANTA
    return jnp.where(known, bias, _UNKNOWN), jnp.where(known, jnp.sign(area), 0)


_QUANTA = 2.0**-15  # of the map's depth: two steps of one stored in 16 bits
_UNKNOWN = 0.02  # of the map's depth: the bias of pixels without a neighbour on their surface


def _step(place: Float[Array, "H W K"], nearness: Float[Array, "H W"], axis: int) -> tuple[Array, Array]:
    """(the change of place from a pixel to the next on its surface, whether there is one).

    Over a plane 1/z is linear in the pixel. Of the two neighbours the one is taken towards which 1/z is closer to
    linear, so that differences cross neither silhouettes nor creases; none where both are far from linear.
    """
    index = np.expand_dims(np.arange(nearness.shape[axis]), 1 - axis)

    def towards(by: int) -> tuple[Array, Array]:
        """(the second difference of 1/z, whether it is a surface's)."""
        one, two = (jnp.roll(nearness, -by * k, axis) for k in (1, 2))
        there = (index + 2 * by >= 0) & (index + 2 * by < index.size) & (nearness > 0) & (one > 0)
        bend = jnp.where(there, jnp.abs(nearness - 2 * one + two), jnp.inf)
        return bend, bend <= _CURVED * jnp.abs(one - nearness) + _NOISE * nearness

    (after, smooth_after), (before, smooth_before) = towards(1), towards(-1)
    step = jnp.where((after <= before)[..., None], jnp.roll(place, -1, axis) - place, place - jnp.roll(place, 1, axis))
    return step, jnp.where(after <= before, smooth_after, smooth_before)


_UP = np.array([1.0, -1.0])  # rows are counted downwards
_CURVED, _NOISE = 0.25, 1e-3  # the second difference of a surface over its first, and over 1/z, at most


def _in_map(rendered: RenderedMap, world: Array) -> Float[Array, "H W 3"]:
    """(s, t, depth from the light), in [0, 1] inside of the map; outside for what is not before the map's apex."""
    convention = rendered.clip_space
    matrix = rendered.matrix.T if convention.row_vectors else rendered.matrix
    clip = world @ matrix[:, :3].T + matrix[:, 3]
    before = clip[..., 3] > 0
    x, y, z = (jnp.where(before, clip[..., k] / jnp.where(before, clip[..., 3], 1), 2) for k in range(3))
    depth = z if convention.z_zero_to_one else (z + 1) / 2
    return jnp.stack([(y + 1) / 2, (x + 1) / 2, 1 - depth if convention.reversed_z else depth], -1)


def _to_world(camera: Camera, points: Array) -> Array:
    return camera.position + points @ camera.rotation

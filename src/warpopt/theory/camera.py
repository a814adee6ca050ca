"""A camera and a directional light in world space, as engines describe them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._checks import Numbers, assembled, checked, float_arrays, points_of
from .._numerics import compiled
from .._words import one_of, shown
from ..scene_files.scene_camera import SceneCamera


class Camera(eqx.Module):
    """A camera, perspective unless made by `orthographic`: position, orientation and view frustum.

    Eye coordinates are left-handed as in AT09: x to the right, y up, z along the view. One camera; use `jax.vmap` for
    several.

    Args:
        position: (3,) world position of the eye.
        forward: (3,) world direction of view, of any length.
        up: (3,) world direction that is up on the screen, not parallel to `forward`.
        near, far: distances of the near and far planes, 0 < near < far; far may be inf for a projection without a far
            plane.
        half_fov: half the vertical field of view, in radians, in (0, pi/2).
        aspect: width over height of the screen.
        handedness: "right" or "left", of the world's axes (OpenGL, Vulkan and glTF: right; Direct3D: left).

    Raises:
        ValueError: for a value out of range or not finite, naming it (`equinox.error_if` when traced).

    Example:
        >>> camera = Camera((0, 2, 0), forward=(0, 0, -1), up=(0, 1, 0), near=0.1, far=100.0, half_fov=0.5)
        >>> [round(float(v), 3) for v in camera.to_eye((1.0, 2.0, -5.0))]
        [1.0, 0.0, 5.0]
    """

    position: Float[Array, "3"]
    rotation: Float[Array, "3 3"]  # rows: right, up and forward in world coordinates
    near: Float[Array, ""]
    far: Float[Array, ""]
    # Slopes of the side planes: left, right, bottom, top; x / z or y / z of each. Orthographic: x or y, lengths.
    window: Float[Array, "4"]
    is_orthographic: bool = eqx.field(static=True, default=False)

    def __init__(
        self,
        position: Numbers,
        forward: Numbers,
        up: Numbers,
        near: Numbers,
        far: Numbers,
        half_fov: Numbers,
        aspect: Numbers = 1.0,
        *,
        handedness: str = "right",
    ):
        position, forward, up = _vectors(position=position, forward=forward, up=up)
        near, far, half_fov, aspect = _numbers(near=near, far=far, half_fov=half_fov, aspect=aspect)
        near = checked("near", near, lambda v: (v > 0) & (v < np.inf), "a finite number > 0")
        far = checked("far", far, lambda v, near: v > near, "a number > near, or inf", near)
        half_fov = checked("half_fov", half_fov, lambda v: (v > 0) & (v < np.pi / 2), "radians in (0, pi/2)")
        aspect = checked("aspect", aspect, lambda v: (v > 0) & (v < np.inf), "a finite number > 0")
        top = jnp.tan(half_fov)
        right = top * aspect
        self._set(position, _rotation(forward, up, handedness), near, far, (-right, right, -top, top))

    def _set(self, position, rotation, near, far, window):
        dtype = jnp.result_type(position, rotation, near, far, *window)
        self.position, self.rotation, self.near, self.far = (
            jnp.asarray(v, dtype) for v in (position, rotation, near, far)
        )
        self.window = jnp.stack([jnp.asarray(v, dtype) for v in window])

    @classmethod
    def from_view_matrix(
        cls,
        view: Numbers,
        near: Numbers,
        far: Numbers,
        half_fov: Numbers,
        aspect: Numbers = 1.0,
        *,
        looks_along: str = "-z",
    ) -> "Camera":
        """The camera with a given world-to-eye matrix.

        Args:
            view: (4, 4), for column vectors (transpose a matrix for row vectors); must be a rotation and translation
                to 1e-4. The view direction and up are orthonormalised.
            near, far, half_fov, aspect: as for the class.
            looks_along: "-z" (OpenGL, Vulkan) or "+z" (Direct3D): the eye axis that points into the scene.

        Raises:
            ValueError: a matrix that is singular or more than rotation, reflection and translation.
        """
        (view,) = float_arrays(view=view)
        if view.shape != (4, 4):
            raise ValueError(f"view: got shape {view.shape}, expected (4, 4)")
        one_of("looks_along", looks_along, ("-z", "+z"))
        # Engines compute these matrices in single precision and print them with few digits.
        tolerance = 1e3 * float(jnp.finfo(jnp.float32).eps)

        def rigid(matrix):
            square = matrix[:3, :3] @ matrix[:3, :3].T
            return (abs(square - jnp.eye(3)).max() < tolerance) & (
                abs(matrix[3] - jnp.array([0, 0, 0, 1])).max() < tolerance
            )

        expected = "a regular, rigid world-to-eye matrix for column vectors: orthonormal rows and (0, 0, 0, 1) last"
        view = checked("view", view, lambda v: jnp.broadcast_to(rigid(v), v.shape), expected)
        turn = view[:3, :3]
        position = -turn.T @ view[:3, 3]
        forward = turn[2] if looks_along == "+z" else -turn[2]
        camera = cls(position, forward, turn[1], near, far, half_fov, aspect)
        # The matrix's own right axis: a mirrored view stays mirrored.
        side = jnp.where(turn[0] @ camera.rotation[0] < 0, -1, 1)
        rotation = camera.rotation.at[0].multiply(side)
        return eqx.tree_at(lambda c: c.rotation, camera, rotation)

    @classmethod
    def off_centre(
        cls,
        position: Numbers,
        forward: Numbers,
        up: Numbers,
        near: Numbers,
        far: Numbers,
        window: tuple[Numbers, Numbers, Numbers, Numbers],
        *,
        handedness: str = "right",
    ) -> "Camera":
        """A camera whose window (left, right, bottom, top), slopes x/z and y/z of the side planes, is not centred.

        Args:
            position, forward, up, near, far, handedness: as for the class.
            window: slopes of the side planes, left < right and bottom < top.

        Raises:
            ValueError: as the class; slopes that are not finite, left >= right, or bottom >= top.
        """
        try:
            left, right, bottom, top = window
        except (TypeError, ValueError):
            raise ValueError(f"window: got {shown(window)}, expected (left, right, bottom, top)") from None
        slopes = jnp.stack(_numbers(left=left, right=right, bottom=bottom, top=top))
        slopes = checked(
            "window",
            slopes,
            lambda w: (abs(w) < np.inf) & (w[0] < w[1]) & (w[2] < w[3]),
            "finite slopes with left < right and bottom < top",
        )
        camera = cls(position, forward, up, near, far, 0.5, handedness=handedness)
        return eqx.tree_at(lambda c: c.window, camera, slopes.astype(camera.window.dtype))

    @classmethod
    def orthographic(
        cls,
        position: Numbers,
        forward: Numbers,
        up: Numbers,
        near: Numbers,
        far: Numbers,
        half_height: Numbers,
        aspect: Numbers = 1.0,
        *,
        handedness: str = "right",
    ) -> "Camera":
        """A camera with parallel rays: a box from near to far, 2 half_height high.

        The screen sees all depths alike, so that z is a constant in the errors: for every maximum no warp is best, and
        for a mean the receivers' distribution along the warp decides ((T65) of docs/theory.md). Rules need an eye and
        are undefined. docs/support.md says what works with it.

        Args:
            half_height: half the height of the window, a length > 0.
            position, forward, up, near, far, aspect, handedness: as for the class; `near` > 0, as parallel rays have no
                eye: move the position back along the view.

        Raises:
            ValueError: as the class, and for a half height that is not a finite number > 0.

        Example:
            >>> camera = Camera.orthographic((0, 50, 0), (0, -1, -1), (0, 1, 0), near=1.0, far=200.0, half_height=20.0)
            >>> camera.is_orthographic, camera.window.tolist()
            (True, [-20.0, 20.0, -20.0, 20.0])
        """
        half_height, aspect = _numbers(half_height=half_height, aspect=aspect)
        top = checked("half_height", half_height, lambda v: (v > 0) & (v < np.inf), "a finite number > 0")
        right = top * checked("aspect", aspect, lambda v: (v > 0) & (v < np.inf), "a finite number > 0")
        camera = cls(position, forward, up, near, far, 0.5, handedness=handedness)
        dtype = jnp.result_type(camera.window, top, right)
        window = jnp.stack([-right, right, -top, top]).astype(dtype)
        parts = (v.astype(dtype) for v in (camera.position, camera.rotation, camera.near, camera.far))
        names = ("position", "rotation", "near", "far")
        return assembled(cls, **dict(zip(names, parts, strict=True)), window=window, is_orthographic=True)

    def to_eye(self, points: Numbers) -> Float[Array, "... 3"]:
        """World points (..., 3) in eye coordinates.

        Args:
            points: (..., 3).

        Returns:
            (..., 3): right, up and forward.

        Raises:
            ValueError: another shape, or what are no real numbers.
        """
        return _to_eye(self, points_of(self.position.dtype, "points", points))

    def screen_depth(self, z: Float[Array, "..."]) -> Float[Array, "..."]:
        """What sizes on the screen are inversely proportional to: the eye depth z, or 1 where rays are parallel.

        Args:
            z: eye depth.
        """
        return jnp.ones_like(z) if self.is_orthographic else z

    def corners(self) -> Float[Array, "8 3"]:
        """Eye coordinates of the frustum's corners, those of the near plane first."""
        left, right, bottom, top = self.window
        ends = []
        for z in (self.near, self.far):
            size = self.screen_depth(z)
            ends += [jnp.stack([x * size, y * size, z]) for x in (left, right) for y in (bottom, top)]
        return jnp.stack(ends)

    def corner_slopes(self) -> Float[Array, "4 3"]:
        """Eye coordinates over z of a perspective frustum's four edges: (x/z, y/z, 1)."""
        left, right, bottom, top = self.window
        one = jnp.ones_like(left)
        return jnp.stack([jnp.stack([x, y, one]) for x in (left, right) for y in (bottom, top)])

    def planes(self) -> Float[Array, "6 4"]:
        """The frustum in eye coordinates as half-spaces normal . c + offset >= 0, normals of unit length.

        Without a far plane, the last one contains all of space: normal 0, offset 1.
        """
        left, right, bottom, top = self.window
        zero, one = jnp.zeros_like(left), jnp.ones_like(left)
        sides = [(one, zero, -left), (-one, zero, right), (zero, one, -bottom), (zero, -one, top)]
        ends = jnp.stack([jnp.stack([zero, zero, one, -self.near]), far_plane(self.far)])
        if self.is_orthographic:
            return jnp.concatenate([jnp.stack([jnp.stack([x, y, zero, offset]) for x, y, offset in sides]), ends])
        normals = jnp.stack([jnp.stack(v) / jnp.sqrt(1 + v[2] ** 2) for v in sides])
        return jnp.concatenate([jnp.pad(normals, ((0, 0), (0, 1))), ends])


class DirectionalLight(eqx.Module):
    """A directional light.

    Args:
        direction: (3,) world direction in which the light travels, of any nonzero length; it may be parallel to the
            view direction. Next to it, `SceneView`'s direction "steady" keeps a map from turning with the light.

    Raises:
        ValueError: for the zero vector, NaN or infinity.

    Example:
        >>> light = DirectionalLight((0, -2, 0))
        >>> [float(v) for v in light.direction]
        [0.0, -1.0, 0.0]
    """

    direction: Float[Array, "3"]

    def __init__(self, direction: Numbers):
        (direction,) = _vectors(direction=direction)
        self.direction = normalised("direction", direction)


def refuse_orthographic(camera: Camera, why: str) -> None:
    """Refuse an orthographic camera.

    Raises:
        ValueError: with the reason.
    """
    if camera.is_orthographic:
        raise ValueError(f"camera: got an orthographic one, expected a perspective one: {why}")


def normalised(name: str, vector: Float[Array, "3"]) -> Float[Array, "3"]:
    """The unit vector; divides by the largest component first, so that no square over- or underflows.

    Raises:
        ValueError: for a zero vector.
    """
    return _unit(vector, checked(name, _largest(vector), lambda v: v > 0, "a vector that is not zero"))


@compiled
def _to_eye(camera: Camera, points: Array) -> Array:
    return (points - camera.position) @ camera.rotation.T


@jax.jit
def _largest(vector: Array) -> Array:
    return jnp.abs(vector).max()


@jax.jit
def _unit(vector: Array, largest: Array) -> Array:
    scaled = vector / largest
    return scaled / jnp.sqrt((scaled * scaled).sum())


def far_plane(far: Float[Array, ""]) -> Float[Array, "4"]:
    """The half-space in front of a far plane, in eye coordinates; all of space for inf."""
    zero, one = jnp.zeros_like(far), jnp.ones_like(far)
    ends = far < jnp.inf
    return jnp.stack([zero, zero, jnp.where(ends, -one, zero), jnp.where(ends, far, one)])


def _numbers(**named: Numbers) -> list[Array]:
    values = float_arrays(**named)
    for name, value in zip(named, values, strict=True):
        if value.shape:
            raise ValueError(f"{name}: got shape {value.shape}, expected a number; use jax.vmap for more")
    return values


def _vectors(**named: Numbers) -> list[Array]:
    values = float_arrays(**named)
    for name, value in zip(named, values, strict=True):
        if value.shape != (3,):
            raise ValueError(f"{name}: got shape {value.shape}, expected (3,); use jax.vmap for more than one")
    return [
        checked(name, value, lambda v: abs(v) < np.inf, "finite numbers")
        for name, value in zip(named, values, strict=True)
    ]


def _rotation(forward: Array, up: Array, handedness: str) -> Array:
    """Rows right, up, forward, orthonormal."""
    one_of("handedness", handedness, ("right", "left"))
    side = 1 if handedness == "right" else -1
    forward, up = normalised("forward", forward), normalised("up", up)
    size = _sine_between(forward, up)
    # Vectors parallel up to rounding define no orientation.
    least = 8 * jnp.finfo(size.dtype).eps
    size = checked("up", size, lambda v: v > least, "a direction that is not parallel to forward")
    return _rows(forward, up, size, side)


@jax.jit
def _sine_between(forward: Array, up: Array) -> Array:
    right = jnp.cross(forward, up)
    return jnp.sqrt((right * right).sum())


@jax.jit
def _rows(forward: Array, up: Array, size: Array, side: ArrayLike) -> Array:
    right = side * jnp.cross(forward, up) / size
    return jnp.stack([right, side * jnp.cross(right, forward), forward])


def camera_of(seen: SceneCamera) -> Camera:
    """The camera of a scene's file or settings."""
    _, up, forward = seen.rotation
    if seen.is_orthographic:
        _, _, bottom, top = seen.window
        camera = Camera.orthographic(
            seen.position, forward, up, seen.near, seen.far, (top - bottom) / 2, handedness=seen.handedness
        )
        return eqx.tree_at(lambda c: c.window, camera, jnp.asarray(seen.window, camera.window.dtype))
    return Camera.off_centre(seen.position, forward, up, seen.near, seen.far, seen.window, handedness=seen.handedness)

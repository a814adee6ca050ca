"""A camera in a configuration. Does not import JAX."""

import math
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from ...scene_files.depth_image import pinhole_window
from ...scene_files.scene_camera import SceneCamera, centred_window, centred_window_across, orientation
from ..common.settings import FileName, HalfFovDeg, NearFar, Positive, Section

_RIGID = 1e-4  # accepts rotation matrices written with four decimals


def _vector(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(_is_number(v) for v in value):
        raise ValueError("expected three numbers")
    if not all(math.isfinite(v) for v in value):
        raise ValueError("expected three finite numbers")
    return tuple(float(v) for v in value)


def _bound(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(_is_number(v) and v == v for v in value):
        raise ValueError("expected three numbers, which may be inf or -inf")
    return tuple(float(v) for v in value)


def _direction(value: Any) -> Any:
    value = _vector(value)
    if not any(value):
        raise ValueError("expected a vector that is not zero")
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


Triple = tuple[float, float, float]
Vector = Annotated[Triple, pydantic.BeforeValidator(_vector)]
_Endless = Annotated[float, pydantic.AllowInfNan(True)]
Bound = Annotated[tuple[_Endless, _Endless, _Endless], pydantic.BeforeValidator(_bound)]
Direction = Annotated[Triple, pydantic.BeforeValidator(_direction)]


def _no_plane_for_inf(value: Any) -> Any:
    # inf means no far plane, as a missing value does
    return None if value == math.inf and isinstance(value, float) else value


FarPlane = Annotated[
    Positive | None,
    pydantic.BeforeValidator(_no_plane_for_inf),
]
# Of a list in TOML; its numbers stay strict.
Four = Annotated[tuple[float, float, float, float], Field(strict=False)]
_Pixels = Annotated[int, Field(ge=1, le=65_536)]
Resolution = Annotated[tuple[_Pixels, _Pixels], Field(strict=False)]


def exactly_one(section: Any, names: tuple[str, ...]) -> None:
    """Refuse a table with none or several of some keys.

    Raises:
        ValueError: names the keys present.
    """
    given = [name for name in names if getattr(section, name) is not None]
    if len(given) != 1:
        raise ValueError(f"got {' and '.join(given) or 'none of them'}, expected exactly one of {', '.join(names)}")


def _view_matrix(value: Any) -> Any:
    rows = value if isinstance(value, list | tuple) else []
    if len(rows) != 4 or not all(isinstance(row, list | tuple) and len(row) == 4 for row in rows):
        raise ValueError("expected four rows of four numbers")
    if not all(_is_number(v) and math.isfinite(v) for row in rows for v in row):
        raise ValueError("expected finite numbers")
    matrix = np.array(rows, float)
    turn = matrix[:3, :3]  # without the translation, which may be large
    if abs(np.linalg.det(turn / max(np.abs(turn).max(), 1e-300))) < 1e-12:
        raise ValueError("expected a matrix that is not singular")
    if np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.abs(matrix[3] - [0, 0, 0, 1]).max() > _RIGID:
        raise ValueError(
            "expected a rigid world-to-eye matrix for column vectors: orthonormal rows and (0, 0, 0, 1) last"
        )
    return value


def _of_a_pixel(value: float) -> float:
    if value not in (0, 0.5):
        raise ValueError("expected 0 or 0.5")
    return value


class CameraPath(Section):
    """The camera in motion: one pose after the other, from a table or from a glTF animation."""

    file: FileName | None = None
    """A CSV file with columns x, y, z, forward_x, forward_y, forward_z, and perhaps up_x, up_y, up_z; near, far and
    field of view are [camera]'s."""
    animation: Annotated[int, Field(ge=0)] | str | None = None
    """Number or name of an animation of receivers.gltf, which moves its camera."""
    rate: Positive | None = None
    """Frames a second of an animation; 30 by default."""

    @pydantic.model_validator(mode="after")
    def _one(self) -> "CameraPath":
        exactly_one(self, ("file", "animation"))
        if self.rate is not None and self.animation is None:
            raise ValueError("got rate with file, expected it with an animation only")
        return self


class CameraConfig(NearFar):
    """A camera: position, forward or target, and up; or a view_matrix."""

    position: Vector | None = None
    forward: Direction | None = None
    target: Vector | None = None
    """A world point in the middle of the view, instead of `forward`."""
    up: Direction = (0.0, 1.0, 0.0)
    view_matrix: Annotated[list[list[float]], pydantic.BeforeValidator(_view_matrix)] | None = None
    """World to eye, for column vectors, instead of position, forward and up."""
    looks_along: Literal["-z", "+z"] = "-z"
    """The eye axis of `view_matrix` that points into the scene: -z (OpenGL, Vulkan) or +z (Direct3D)."""
    near: Positive
    far: FarPlane = None
    """None or inf: a projection without a far plane."""
    half_fov_deg: HalfFovDeg | None = None
    """Half the vertical field of view."""
    half_fov_x_deg: HalfFovDeg | None = None
    """Half the horizontal field of view, instead."""
    half_height: Positive | None = None
    """An orthographic camera, instead: half the height of its window, a length."""
    aspect: Positive | None = None
    """Width over height; by default that of objective.screen, or 1."""
    window: Four | None = None
    """Slopes (left, right, bottom, top) of the side planes, instead of field of view and aspect."""
    fx: Positive | None = None
    """A pinhole camera, instead of these: focal lengths fx and fy, principal point (cx, cy) from the top left, in
    pixels of an image of `image_size`."""
    fy: Positive | None = None
    cx: float | None = None
    cy: float | None = None
    image_size: Resolution | None = None
    """(width, height); by default that of the depth file, or objective.screen."""
    first_centre: Annotated[float, pydantic.AfterValidator(_of_a_pixel)] = 0.5
    """Pixel coordinate of the first pixel's centre: 0 as in OpenCV, 0.5 if the image's edge is at 0."""

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "CameraConfig":
        exactly_one(self, ("position", "view_matrix"))
        exactly_one(self, ("half_fov_deg", "half_fov_x_deg", "half_height", "window", "fx"))
        pinhole = {name: getattr(self, name) for name in ("fx", "fy", "cx", "cy")}
        if any(v is None for v in pinhole.values()) and any(v is not None for v in pinhole.values()):
            missing = ", ".join(name for name, value in pinhole.items() if value is None)
            raise ValueError(f"got a pinhole camera without {missing}, expected fx, fy, cx and cy")
        alone = {"image_size", "first_centre"} & self.model_fields_set
        if alone and self.fx is None:
            raise ValueError(f"got {min(alone)} without fx, expected it with a pinhole camera only")
        if self.view_matrix is not None:
            other = {"forward", "target", "up"} & self.model_fields_set
            if other:
                raise ValueError(f"got {min(other)} with view_matrix, expected one or the other")
        else:
            if "looks_along" in self.model_fields_set:
                raise ValueError("got looks_along without view_matrix, expected it with a view_matrix only")
            exactly_one(self, ("forward", "target"))
            if np.linalg.norm(self._forward()) == 0:
                raise ValueError(f"got target {self.target}, which is the position, expected another point")
            try:
                orientation(self._forward(), np.array(self.up), "right")
            except ValueError as error:
                raise ValueError(f"up: got {self.up}, {error}") from None
        if self.aspect is not None and (self.window is not None or self.fx is not None):
            other = "window" if self.window is not None else "fx"
            raise ValueError(f"got aspect with {other}, expected one or the other")
        if self.window is not None:
            left, right, bottom, top = self.window
            if not (left < right and bottom < top):
                raise ValueError(f"window: got {self.window}, expected left < right and bottom < top")
        return self

    def _forward(self) -> np.ndarray:
        if self.forward is not None:
            return np.array(self.forward)
        return np.array(self.target) - np.array(self.position)

    def _window(self, default_aspect: float, size: tuple[int, int] | None) -> tuple[float, float, float, float]:
        if self.window is not None:
            return self.window
        if self.fx is not None:
            size = self.image_size or size
            if size is None:
                raise ValueError("image_size: missing, expected (width, height) of the image for fx to cy")
            assert self.fy is not None  # given with fx, as are cx and cy
            assert self.cx is not None
            assert self.cy is not None
            return pinhole_window(self.fx, self.fy, self.cx, self.cy, *size, first_centre=self.first_centre)
        aspect = self.aspect or default_aspect
        if self.half_height is not None:
            top = self.half_height
            return -top * aspect, top * aspect, -top, top
        if self.half_fov_x_deg is not None:
            return centred_window_across(math.radians(self.half_fov_x_deg), aspect)
        assert self.half_fov_deg is not None  # exactly one of the three is given
        return centred_window(math.radians(self.half_fov_deg), aspect)

    def scene_camera(self, handedness: str, default_aspect: float, size: tuple[int, int] | None = None) -> SceneCamera:
        """The camera as numbers.

        Args:
            handedness: of the world's axes.
            default_aspect: used if none is given.
            size: (width, height) of the image of the intrinsics, used if none is given.

        Raises:
            ValueError: intrinsics without an image size.
        """
        window, far = self._window(default_aspect, size), math.inf if self.far is None else self.far
        if self.view_matrix is None:
            rotation = orientation(self._forward(), np.array(self.up), handedness)
            return SceneCamera(np.array(self.position), rotation, self.near, far, window, self.half_height is not None)
        matrix = np.array(self.view_matrix, float)
        # The nearest rotation: the text has few digits, and the library expects full accuracy.
        u, _, v = np.linalg.svd(matrix[:3, :3])
        turn = u @ v
        side = 1 if self.looks_along == "+z" else -1
        position = -turn.T @ matrix[:3, 3]
        rotation = np.stack([turn[0], turn[1], side * turn[2]])
        return SceneCamera(position, rotation, self.near, far, window, self.half_height is not None)

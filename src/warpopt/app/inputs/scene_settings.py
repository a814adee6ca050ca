"""A scene in a configuration: cameras, light, receivers, objective. Knows nothing of JAX."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from warpopt.objective import METRICS, Measure, Objective

from ...scene_files.depth_image import pinhole_window
from ...scene_files.scene_camera import SceneCamera, centred_window, centred_window_across, orientation
from ..common.settings import Distinct, HalfFovDeg, NearFar, Norm, Positive, Section, listed

_RIGID = 1e-4  # entries with four digits after the point still make a matrix that is meant as a rotation


def _vector(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(_is_number(v) for v in value):
        raise ValueError("expected three numbers")
    if not all(math.isfinite(v) for v in value):
        raise ValueError("expected three finite numbers")
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
Direction = Annotated[Triple, pydantic.BeforeValidator(_direction)]


def _no_plane_for_inf(value: Any) -> Any:
    # inf where numbers are finite: no far plane, which nothing stands for too
    return None if value == math.inf and isinstance(value, float) else value


FarPlane = Annotated[
    Positive | None,
    pydantic.BeforeValidator(_no_plane_for_inf),
]
Resolution = tuple[Annotated[int, Field(ge=1, le=65_536)], Annotated[int, Field(ge=1, le=65_536)]]


def _exactly_one(section: Any, names: tuple[str, ...]) -> None:
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
    turn = matrix[:3, :3]  # the translation may be large, and has no part in it
    if abs(np.linalg.det(turn / max(np.abs(turn).max(), 1e-300))) < 1e-12:
        raise ValueError("expected a matrix that is not singular")
    if np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.abs(matrix[3] - [0, 0, 0, 1]).max() > _RIGID:
        raise ValueError(
            "expected a rigid world-to-eye matrix for column vectors: orthonormal rows and (0, 0, 0, 1) last"
        )
    return value


class CameraConfig(NearFar):
    """A camera: position, forward or target, and up; or a view_matrix."""

    position: Vector | None = None
    forward: Direction | None = None
    target: Vector | None = None
    """A world point in the middle of the view, in the place of `forward`."""
    up: Direction = (0.0, 1.0, 0.0)
    view_matrix: Annotated[list[list[float]], pydantic.BeforeValidator(_view_matrix)] | None = None
    """World to eye, for column vectors, in the place of position, forward and up."""
    looks_along: Literal["-z", "+z"] = "-z"
    """The eye axis of `view_matrix` that points into the scene: -z (OpenGL, Vulkan) or +z (Direct3D)."""
    near: Positive
    far: FarPlane = None
    """None, or inf: a projection without a far plane."""
    half_fov_deg: HalfFovDeg | None = None
    """Half the vertical field of view."""
    half_fov_x_deg: HalfFovDeg | None = None
    """Half the horizontal one, in its place."""
    aspect: Positive | None = None
    """Width over height; that of objective.screen, or 1, if not given."""
    window: tuple[float, float, float, float] | None = None
    """Slopes (left, right, bottom, top) of the side planes, in the place of field of view and aspect."""
    fx: Positive | None = None
    """A pinhole camera in the place of these: focal lengths fx and fy, principal point (cx, cy) from the top left, in
    pixels of an image of `image_size`."""
    fy: Positive | None = None
    cx: float | None = None
    cy: float | None = None
    image_size: Resolution | None = None
    """(width, height); that of the depth file, or objective.screen, if not given."""
    first_centre: Literal[0.5, 0] = 0.5
    """Where in these pixels the first one's centre is: 0 as in OpenCV, 0.5 where the image's edge is at 0."""

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "CameraConfig":
        _exactly_one(self, ("position", "view_matrix"))
        _exactly_one(self, ("half_fov_deg", "half_fov_x_deg", "window", "fx"))
        pinhole = {name: getattr(self, name) for name in ("fx", "fy", "cx", "cy")}
        if any(v is None for v in pinhole.values()) and any(v is not None for v in pinhole.values()):
            missing = ", ".join(name for name, value in pinhole.items() if value is None)
            raise ValueError(f"got a pinhole camera without {missing}, expected fx, fy, cx and cy")
        if self.view_matrix is not None:
            if self.forward is not None or self.target is not None:
                raise ValueError("got forward or target beside view_matrix, expected one or the other")
        else:
            _exactly_one(self, ("forward", "target"))
            if np.linalg.norm(self._forward()) == 0:
                raise ValueError(f"got target {self.target}, which is the position, expected another point")
            try:
                orientation(self._forward(), np.array(self.up), "right")
            except ValueError as error:
                raise ValueError(f"up: got {self.up}, {error}") from None
        if self.aspect is not None and (self.window is not None or self.fx is not None):
            other = "window" if self.window is not None else "fx"
            raise ValueError(f"got aspect beside {other}, expected one or the other")
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
                raise ValueError("image_size: missing, expected (width, height) of the image that fx to cy are of")
            return pinhole_window(self.fx, self.fy, self.cx, self.cy, *size, first_centre=self.first_centre)
        aspect = self.aspect or default_aspect
        if self.half_fov_x_deg is not None:
            return centred_window_across(math.radians(self.half_fov_x_deg), aspect)
        return centred_window(math.radians(self.half_fov_deg), aspect)

    def scene_camera(self, handedness: str, default_aspect: float, size: tuple[int, int] | None = None) -> SceneCamera:
        """The camera in numbers.

        Args:
            handedness: of the world's axes.
            default_aspect: where none is given.
            size: (width, height) of the image that intrinsics are of, where none is given.

        Raises:
            ValueError: intrinsics of an image of unknown size.
        """
        window, far = self._window(default_aspect, size), math.inf if self.far is None else self.far
        if self.view_matrix is None:
            rotation = orientation(self._forward(), np.array(self.up), handedness)
            return SceneCamera(np.array(self.position), rotation, self.near, far, window)
        matrix = np.array(self.view_matrix, float)
        # The nearest rotation: text has few digits, and the library asks for all.
        u, _, v = np.linalg.svd(matrix[:3, :3])
        turn = u @ v
        side = 1 if self.looks_along == "+z" else -1
        position = -turn.T @ matrix[:3, 3]
        return SceneCamera(position, np.stack([turn[0], turn[1], side * turn[2]]), self.near, far, window)


class SunPath(Section):
    """The sun over a day, in solar time: it is highest at 12."""

    kind: Literal["sun"] = "sun"
    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    day: Annotated[int, Field(ge=1, le=366)] | None = None
    """Of the year; 172 is midsummer in the north."""
    declination_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    """In the place of `day`."""
    start_hour: Annotated[float, Field(ge=0, le=24)] = 6.0
    stop_hour: Annotated[float, Field(ge=0, le=24)] = 18.0
    count: Annotated[int, Field(ge=1, le=100_000)] = 13
    north: Direction = (0.0, 0.0, -1.0)
    """World direction of north."""
    up: Direction = (0.0, 1.0, 0.0)

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "SunPath":
        _exactly_one(self, ("day", "declination_deg"))
        if self.stop_hour < self.start_hour:
            raise ValueError(f"stop_hour: got {self.stop_hour}, expected at least start_hour = {self.start_hour}")
        try:
            orientation(np.array(self.north), np.array(self.up), "right")
        except ValueError:
            raise ValueError(f"north: got {self.north}, expected a direction that is not parallel to up") from None
        return self

    def declination(self) -> float:
        """In degrees; Cooper's formula, right to half a degree."""
        if self.declination_deg is not None:
            return self.declination_deg
        return 23.45 * math.sin(math.radians(360 / 365 * (284 + self.day)))


class SceneLight(Section):
    """A directional light, or its path."""

    direction: Direction | None = None
    """World direction in which the light travels."""
    path: SunPath | Annotated[list[Direction], Field(min_length=1)] | None = None
    """The sun over a day, or a list of directions."""
    from_file: Literal[True] | Annotated[int, Field(ge=0)] | str | None = None
    """A directional light of the glTF file: true for the only one, or its number or name."""

    @pydantic.field_validator("path", mode="wrap")
    @classmethod
    def _sun_or_list(cls, value: Any, handler: Any) -> Any:
        # Chosen by shape, so that a flaw is reported once and for what was meant.
        if isinstance(value, dict):
            return SunPath.model_validate(value)
        if isinstance(value, list) and value:
            return pydantic.TypeAdapter(list[Direction]).validate_python(value)
        raise ValueError("expected a table such as { kind = 'sun', latitude_deg = 48, ... } or a list of directions")

    @pydantic.model_validator(mode="after")
    def _one(self) -> "SceneLight":
        _exactly_one(self, ("direction", "path", "from_file"))
        return self


class FrustumReceivers(Section):
    """Everything that the camera could see."""


class BoxReceivers(Section):
    """What of an axis-parallel box lies in the view frustum."""

    lower: Vector
    upper: Vector

    @pydantic.field_validator("upper")
    @classmethod
    def _above(cls, upper: Triple, info: pydantic.ValidationInfo) -> Triple:
        lower = info.data.get("lower")
        if lower is not None and not all(u >= v for u, v in zip(upper, lower, strict=True)):
            raise ValueError(f"expected at least the lower corner {lower}")
        return upper


class PlaneReceivers(Section):
    """What of a convex body lies in the view frustum: world half-spaces a x + b y + c z + d >= 0."""

    planes: Annotated[list[tuple[float, float, float, float]], Field(min_length=1, max_length=64)]

    @pydantic.field_validator("planes")
    @classmethod
    def _normals(cls, planes: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
        if not all(any(plane[:3]) for plane in planes):
            raise ValueError("expected normals (the first three numbers) that are not zero")
        return planes


class DepthReceivers(Section):
    """The depth buffer of the frame: one `.npy`, `.npz`, OpenEXR, PFM or 16-bit PNG file for each camera."""

    files: Annotated[list[Path], pydantic.BeforeValidator(listed), Field(min_length=1)]
    encoding: Literal["linear", "standard", "reversed"] = "linear"
    channel: str | None = None
    """Of an OpenEXR file; Z, or the only layer's, by default."""
    part: int | str | None = None
    """Of an OpenEXR file of several parts, by number or name."""
    key: str | None = None
    """Of a `.npz` with more than one array."""
    scale: Positive | None = None
    """What the file's values are multiplied by, 0.001 for millimetres; integers need one."""
    background: float | None = None
    """Values at or beyond it are background; the camera's far plane by default. inf, 0 and less always are."""
    nan_is_background: bool = False
    rows: Literal["top_down", "bottom_up"] = "top_down"
    distance: Literal["planar", "ray"] = "planar"
    """ray: along each pixel's ray, as AirSim and CARLA write it."""
    size: Resolution | None = None
    """(width, height) that the files must have. The camera's aspect is expected in any case."""


class _Rasterised(Section):
    width: Annotated[int, Field(ge=8, le=8192)] = 480
    """Pixels across of the depth image that the camera is given; the height follows from its aspect."""


class GltfReceivers(_Rasterised):
    """The visible surfaces of a glTF file, and its camera if there is no [camera]."""

    file: Path
    camera: Annotated[int, Field(ge=0)] | str = 0
    """Which of the file's cameras, by number or name."""
    far: Positive | None = None
    """Far plane in the place of the file's camera's own, which may have none."""
    include: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])
    """Patterns such as "Terrain*" of names of nodes (with all below them) and materials: only what matches counts."""
    exclude: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])
    """Likewise what is left out: skies, clouds."""


class LandscapeReceivers(_Rasterised):
    """The visible ground of a landscape made from a seed: a square about the origin, y up."""

    seed: Annotated[int, Field(ge=0)] = 1
    size: Positive = 2000.0
    """Length of a side."""
    relief: Positive = 150.0
    """Height of the highest hill over the lowest ground, which is at y = 0."""
    cells: Annotated[int, Field(ge=2, le=2048)] = 256
    """Quads along a side."""


class ReceiverConfig(Section):
    """What must be resolved; exactly one kind."""

    whole_frustum: FrustumReceivers | None = None
    box: BoxReceivers | None = None
    planes: PlaneReceivers | None = None
    depth: DepthReceivers | None = None
    gltf: GltfReceivers | None = None
    landscape: LandscapeReceivers | None = None

    @pydantic.model_validator(mode="after")
    def _one(self) -> "ReceiverConfig":
        _exactly_one(self, tuple(type(self).model_fields))
        return self

    @property
    def kind(self) -> str:
        """Which, in words."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None).replace("_", " ")


class SceneObjective(Section):
    """What is minimised: every metric in every norm, each a problem of its own."""

    metrics: Annotated[
        list[Literal[*METRICS]],  # pyright: ignore[reportInvalidTypeForm]
        pydantic.BeforeValidator(listed),
        Field(min_length=1),
        Distinct,
    ] = Field(default=["p"])
    norms: Annotated[list[Norm], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct] = Field(["inf"])
    measure: Measure = "screen"
    """What L_P norms are taken over: of the whole frustum any, of a box or planes any but axis."""
    screen: Resolution | None = None
    """(width, height) in pixels, and"""
    shadow_map: Resolution | None = None
    """texels along (t, s): errors are then pixels per texel. Both or neither."""
    min_eta: Annotated[float, Field(gt=0, lt=1)] = 1e-4
    """The smallest eta, for E_q, whose infimum may be at eta = 0."""

    @pydantic.model_validator(mode="after")
    def _possible(self) -> "SceneObjective":
        if (self.screen is None) != (self.shadow_map is None):
            raise ValueError("got one of screen and shadow_map, expected both or neither")
        for metric, norm in itertools.product(self.metrics, self.norms):
            if metric == "max" and norm != "inf":
                raise ValueError(f"norms: got {norm!r}, expected only 'inf' with metric 'max'")
            objective = Objective(metric, norm, self.measure)
            if not objective.supremum and objective.blend_degree % 1:
                raise ValueError(
                    f"norms: got order {norm}, expected one that makes {objective.metric.blend_power:g} times it an "
                    f"integer for metric {metric!r}"
                )
        return self

    def objectives(self) -> list[Objective]:
        """Every metric in every norm."""
        return [Objective(*each, self.measure) for each in itertools.product(self.metrics, self.norms)]


class SceneSettings(Section):
    """A scene and what is minimised over it. Paths of scene files are relative to the TOML file."""

    handedness: Literal["right", "left"] = "right"
    """Of the world's axes (OpenGL, Vulkan and glTF: right; Direct3D: left)."""
    camera: Annotated[list[CameraConfig], pydantic.BeforeValidator(listed)] = Field(default=[])
    light: SceneLight
    receivers: ReceiverConfig
    objective: SceneObjective = SceneObjective()

    @pydantic.model_validator(mode="after")
    def _fits(self) -> "SceneSettings":
        gltf, depth = self.receivers.gltf, self.receivers.depth
        if not self.camera and gltf is None:
            raise ValueError("camera: missing (only a glTF file may bring its own)")
        if gltf is not None and self.handedness == "left":
            raise ValueError("handedness: got 'left', expected 'right' with glTF, whose axes are right-handed")
        if self.light.from_file is not None and gltf is None:
            raise ValueError("light.from_file: got one without receivers.gltf, expected a glTF file to read it from")
        if self.receivers.whole_frustum is not None and any(camera.far is None for camera in self.camera):
            raise ValueError("camera.far: missing or inf, expected a far plane with receivers.whole_frustum")
        measure, receivers = self.objective.measure, self.receivers
        body = receivers.box is not None or receivers.planes is not None
        if receivers.whole_frustum is None and measure != "screen" and not (body and measure != "axis"):
            expected = "any measure but 'axis'" if body else "'screen': the pixels have their own weights"
            raise ValueError(f"objective.measure: got {measure!r} with {receivers.kind}, expected {expected}")
        if depth is not None and len(depth.files) != len(self.camera):
            raise ValueError(
                f"receivers.depth.files: got {len(depth.files)} for {len(self.camera)} camera(s), expected one for each"
            )
        return self

    def default_aspect(self) -> float:
        """For cameras that give none."""
        screen = self.objective.screen
        return screen[0] / screen[1] if screen else 1.0

"""A scene in a configuration: light, receivers, objective. Does not import JAX."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from warpopt.objective import METRICS, MOST_MOMENTS, Measure, Objective

from ...scene_files.scene_camera import orientation
from ..common.settings import Distinct, FileName, Norm, Positive, Section, listed, read_data, validated
from .camera_settings import Bound, CameraConfig, CameraPath, Direction, Four, Resolution, Triple, exactly_one

_PIXELS = "a depth image, glTF, a landscape or a made scene"
Index = Annotated[int, Field(ge=0)]


def _file_s_light(value: Any) -> Any:
    whole = isinstance(value, int) and value >= 0 and value is not False
    if not (value is True or whole or isinstance(value, str) or value is None):
        raise ValueError("expected true, the number of a light or its name")
    return value


class SunPath(Section):
    """The sun over a day, in solar time: it is highest at 12."""

    kind: Literal["sun"] = "sun"
    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    day: Annotated[int, Field(ge=1, le=366)] | None = None
    """Day of the year; 172 is midsummer in the north."""
    declination_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    """The sun's declination, instead of `day`."""
    start_hour: Annotated[float, Field(ge=0, le=24)] = 6.0
    stop_hour: Annotated[float, Field(ge=0, le=24)] = 18.0
    count: Annotated[int, Field(ge=1, le=100_000)] = 13
    north: Direction = (0.0, 0.0, -1.0)
    """World direction of north."""
    up: Direction = (0.0, 1.0, 0.0)

    @pydantic.model_validator(mode="after")
    def _complete(self) -> "SunPath":
        exactly_one(self, ("day", "declination_deg"))
        if self.stop_hour < self.start_hour:
            raise ValueError(f"stop_hour: got {self.stop_hour}, expected at least start_hour = {self.start_hour}")
        try:
            orientation(np.array(self.north), np.array(self.up), "right")
        except ValueError:
            raise ValueError(f"north: got {self.north}, expected a direction that is not parallel to up") from None
        return self

    def declination(self) -> float:
        """In degrees; Cooper's formula, accurate to half a degree."""
        if self.declination_deg is not None:
            return self.declination_deg
        assert self.day is not None  # one of the two
        return 23.45 * math.sin(math.radians(360 / 365 * (284 + self.day)))


class SceneLight(Section):
    """A directional light, or its path."""

    direction: Direction | None = None
    """World direction in which the light travels."""
    path: SunPath | Annotated[list[Direction], Field(min_length=1)] | None = None
    """The sun over a day, or a list of directions."""
    from_file: Annotated[Index | Literal[True] | str | None, pydantic.BeforeValidator(_file_s_light)] = None
    """A directional light of the glTF file: true for the only one, or its number or name."""

    @pydantic.field_validator("path", mode="wrap")
    @classmethod
    def _sun_or_list(cls, value: Any, handler: Any) -> Any:
        # Chosen by type, so that an error is reported only once, for the intended form.
        if isinstance(value, dict):
            return SunPath.model_validate(value)
        if isinstance(value, list) and value:
            return pydantic.TypeAdapter(list[Direction]).validate_python(value)
        raise ValueError("expected a table such as { kind = 'sun', latitude_deg = 48, ... } or a list of directions")

    @pydantic.model_validator(mode="after")
    def _one(self) -> "SceneLight":
        exactly_one(self, ("direction", "path", "from_file"))
        return self


class FrustumReceivers(Section):
    """Everything that the camera could see."""


class BoxReceivers(Section):
    """The part of an axis-parallel box in the view frustum."""

    lower: Bound
    upper: Bound

    @pydantic.field_validator("upper")
    @classmethod
    def _above(cls, upper: Triple, info: pydantic.ValidationInfo) -> Triple:
        lower = info.data.get("lower")
        if lower is not None and not all(u >= v for u, v in zip(upper, lower, strict=True)):
            raise ValueError(f"expected at least the lower corner {lower}")
        return upper


class PlaneReceivers(Section):
    """The part of a convex body in the view frustum: world half-spaces a x + b y + c z + d >= 0."""

    planes: Annotated[list[Four], Field(min_length=1, max_length=64)]

    @pydantic.field_validator("planes")
    @classmethod
    def _normals(cls, planes: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
        if not all(any(plane[:3]) for plane in planes):
            raise ValueError("expected normals (the first three numbers) that are not zero")
        return planes


class DepthReceivers(Section):
    """The depth buffer of the frame: one `.npy`, `.npz`, OpenEXR, PFM or 16-bit PNG file for each camera."""

    files: Annotated[list[FileName], pydantic.BeforeValidator(listed), Field(min_length=1)]
    encoding: Literal["linear", "standard", "reversed"] = "linear"
    channel: str | None = None
    """Channel of an OpenEXR file; by default Z, or the only layer's Z."""
    part: Index | str | None = None
    """Part of an OpenEXR file with several parts, by number or name."""
    key: str | None = None
    """Array of a `.npz` with more than one."""
    scale: Positive | None = None
    """Factor for the file's values, such as 0.001 for millimetres; required for integers."""
    background: float | None = None
    """Values at or beyond it are background; the camera's far plane by default. inf and values <= 0 always are."""
    nan_is_background: bool = False
    rows: Literal["top_down", "bottom_up"] = "top_down"
    distance: Literal["planar", "ray"] = "planar"
    """ray: distance along each pixel's ray, as in AirSim and CARLA."""
    size: Resolution | None = None
    """(width, height) that the files must have. The aspect must always match the camera."""


class _Rasterised(Section):
    width: Annotated[int, Field(ge=8, le=8192)] = 480
    """Width in pixels of the rasterised depth image; the height follows from the camera's aspect."""


class GltfReceivers(_Rasterised):
    """The visible surfaces of a glTF file, and its camera if there is no [camera]."""

    file: FileName
    camera: Index | str = 0
    """Which of the file's cameras, by number or name."""
    far: Positive | None = None
    """Far plane, instead of that of the file's camera, which may have none."""
    include: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])
    """Patterns such as "Terrain*" for names of nodes (with all below them) and materials: only matches are read."""
    exclude: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])
    """Patterns for parts to leave out, such as skies and clouds."""


class LandscapeReceivers(_Rasterised):
    """The visible ground of a landscape from a seed: a square around the origin, y up."""

    seed: Annotated[int, Field(ge=0)] = 1
    size: Positive = 2000.0
    """Length of a side."""
    relief: Positive = 150.0
    """Height of the highest hill over the lowest ground, which is at y = 0."""
    cells: Annotated[int, Field(ge=2, le=2048)] = 256
    """Quads along a side."""


class MadeReceivers(_Rasterised):
    """The visible surfaces of a scene from a seed, in metres, y up; without [camera], cameras from the seed too."""

    scene: Literal["hills", "city", "forest", "corridor"]
    """Hills with trees, a city of boxes, a forest, a corridor with columns."""
    seed: Annotated[int, Field(ge=0)] = 1
    views: Annotated[int, Field(ge=1, le=64)] = 1
    """Cameras without [camera], at places where a walker could stand."""


class ReceiverConfig(Section):
    """The receivers; exactly one kind."""

    whole_frustum: FrustumReceivers | None = None
    box: BoxReceivers | None = None
    planes: PlaneReceivers | None = None
    depth: DepthReceivers | None = None
    gltf: GltfReceivers | None = None
    landscape: LandscapeReceivers | None = None
    made: MadeReceivers | None = None

    @pydantic.model_validator(mode="after")
    def _one(self) -> "ReceiverConfig":
        exactly_one(self, tuple(type(self).model_fields))
        return self

    @property
    def pixels(self) -> bool:
        """Whether they are the pixels of a depth image."""
        return bool(self.depth or self.gltf or self.landscape or self.made)

    @property
    def kind(self) -> str:
        """The kind, as text."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None).replace("_", " ")


class SceneObjective(Section):
    """What is minimised: every metric in every norm, each a separate problem."""

    metrics: Annotated[
        list[Literal[*METRICS]],  # pyright: ignore[reportInvalidTypeForm]
        pydantic.BeforeValidator(listed),
        Field(min_length=1),
        Distinct,
    ] = Field(default=["p"])
    norms: Annotated[list[Norm], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct] | None = None
    """By default each metric's own: l1, the mean, for edge and band, and inf for the others."""
    measure: Measure = "screen"
    """Measure of L_P norms: any for the whole frustum, any except axis for a box or planes."""
    screen: Resolution | None = None
    """(width, height) in pixels."""
    shadow_map: Resolution | None = None
    """Texels along (t, s): errors are then in pixels per texel. Requires `screen`, and vice versa."""
    min_eta: Annotated[float, Field(gt=0, lt=1)] = 1e-4
    """The smallest eta, for E_q, whose infimum may be at eta = 0."""

    @pydantic.model_validator(mode="after")
    def _possible(self) -> "SceneObjective":
        if (self.screen is None) != (self.shadow_map is None):
            raise ValueError("got one of screen and shadow_map, expected both or neither")
        for metric, norm in itertools.product(self.metrics, self.norms or [None]):
            objective = Objective(metric, norm, self.measure)
            if objective.over_receivers:
                continue
            if objective.blend_degree % 1:
                raise ValueError(
                    f"norms: got order {norm}, expected one that makes {objective.metric.blend_power:g} times it an "
                    f"integer for metric {metric!r}"
                )
            largest = MOST_MOMENTS / objective.metric.blend_power
            raise ValueError(f"norms: got order {norm}, expected at most {largest:g} for metric {metric!r}, or 'inf'")
        return self

    def objectives(self) -> list[Objective]:
        """Every metric in every norm."""
        return [Objective(*each, self.measure) for each in itertools.product(self.metrics, self.norms or [None])]


class WeightSettings(Section):
    """What each pixel counts for in means and other L_P norms."""

    by: Literal["uniform", "depth", "edges"] = "uniform"
    """depth: the eye depth, which stands for shadow edges where none are known. edges: 1 beside a shadow edge of `lit`,
    0 elsewhere; by depth if there is none."""
    lit: Annotated[list[FileName], pydantic.BeforeValidator(listed), Field(min_length=1)] | None = None
    """For each camera a `.npy` or PNG image of the pixels that the light reaches; others have the weight 0."""

    @pydantic.model_validator(mode="after")
    def _known(self) -> "WeightSettings":
        if self.by == "edges" and self.lit is None:
            raise ValueError("lit: missing, expected the images whose edges count with by = 'edges'")
        return self


class WarpSettings(Section):
    """The direction of the warp, the aspect of its map, and where its axis is across the warp."""

    direction: Literal["view", "gradient", "middle", "best", "steady"] | Direction | None = None
    """The view direction; where the receivers' depth rises; the middle vector of SC; the one of least error; the view's
    or, where no warp is better, the screen's rows or columns; or a world vector. By default "best" with edge and band,
    whose error predicts wrong pixels, and "view" with the others. E_p, E_q and their maximum do not compare directions:
    with them "best" is refused."""
    turn_only_if: Annotated[float, Field(ge=1)] = 1.1
    """With "best", the gain in the error below which the map is warped along the view."""
    aspect: Literal["best"] | Positive = 1.0
    """Texels along t over texels along s, times that of shadow_map, with as many texels in all; "best" with max, edge
    and band."""
    lateral: Literal["eye", "free"] = "eye"
    """free: the axis with the narrowest map, for maxima and products of E_p and E_q."""

    def direction_of(self, objective: Objective) -> str | Triple:
        """The direction for an objective."""
        if self.direction is not None:
            return self.direction
        return "best" if objective.kernel in ("edge", "band") else "view"


class SceneSettings(Section):
    """A scene and what is minimised over it. Paths of scene files are relative to the TOML file."""

    handedness: Literal["right", "left"] = "right"
    """Handedness of the world's axes (OpenGL, Vulkan and glTF: right; Direct3D: left)."""
    camera: Annotated[list[CameraConfig], pydantic.BeforeValidator(listed)] = Field(default=[])
    camera_path: CameraPath | None = None
    light: SceneLight
    receivers: ReceiverConfig
    objective: SceneObjective = SceneObjective()
    weights: WeightSettings = WeightSettings()
    warp: WarpSettings = WarpSettings()

    @pydantic.model_validator(mode="after")
    def _turns(self) -> "SceneSettings":
        for objective in self.objective.objectives():
            if self.warp.direction == "best" and not objective.in_any_direction:
                raise ValueError(
                    f"warp.direction: got 'best' with metric {objective.name!r}, which does not compare directions, "
                    "expected 'pxq', 'storage', 'edge' or 'band'"
                )
            if self.warp.aspect == "best" and not objective.in_any_aspect:
                raise ValueError(
                    f"warp.aspect: got 'best' with metric {objective.name!r}, which a map of slivers minimises, "
                    "expected 'max', 'edge' or 'band'"
                )
            if self.warp.lateral == "free" and objective.kernel is not None:
                raise ValueError(
                    f"warp.lateral: got 'free' with a mean of {objective.name!r}, whose shear would change with the "
                    "axis, expected 'eye'"
                )
        return self

    @pydantic.model_validator(mode="after")
    def _fits(self) -> "SceneSettings":
        gltf, depth = self.receivers.gltf, self.receivers.depth
        made = self.receivers.made
        if self.camera_path is not None:
            if depth is not None:
                raise ValueError("camera_path: got one with receivers.depth, expected a camera for each of its files")
            if self.camera_path.animation is not None and (gltf is None or self.camera):
                raise ValueError("camera_path.animation: expected receivers.gltf, whose camera moves, and no [camera]")
            if self.camera_path.file is not None and len(self.camera) != 1:
                raise ValueError(
                    f"camera_path.file: got {len(self.camera)} camera(s), expected one, whose planes and window it has"
                )
        if not self.camera and gltf is None and made is None:
            raise ValueError("camera: missing (only a glTF file may contain one)")
        if self.camera and made is not None and "views" in made.model_fields_set:
            raise ValueError("receivers.made.views: got it with [camera], expected one or the other")
        if made is not None and self.handedness == "left":
            raise ValueError("handedness: got 'left', expected 'right' with made scenes, whose axes are right-handed")
        own = sorted({"camera", "far"} & gltf.model_fields_set) if gltf is not None and self.camera else []
        if own:
            raise ValueError(f"receivers.gltf.{own[0]}: got one with [camera], expected one or the other")
        if gltf is not None and self.handedness == "left":
            raise ValueError("handedness: got 'left', expected 'right' with glTF, whose axes are right-handed")
        if self.light.from_file is not None and gltf is None:
            raise ValueError("light.from_file: got one without receivers.gltf, expected a glTF file to read it from")
        if self.receivers.whole_frustum is not None and any(camera.far is None for camera in self.camera):
            raise ValueError("camera.far: missing or inf, expected a far plane with receivers.whole_frustum")
        measure, receivers = self.objective.measure, self.receivers
        body = receivers.box is not None or receivers.planes is not None
        if receivers.whole_frustum is None and measure != "screen" and not (body and measure != "axis"):
            expected = "any measure but 'axis'" if body else "'screen': the pixels have weights"
            raise ValueError(f"objective.measure: got {measure!r} with {receivers.kind}, expected {expected}")
        if not receivers.pixels:
            if self.weights != WeightSettings():
                raise ValueError(f"weights: got some with {receivers.kind}, expected {_PIXELS}")
            means = [o.name for o in self.objective.objectives() if o.kernel is not None]
            if means:
                raise ValueError(
                    f"objective.metrics: got a mean of {means[0]!r} with {receivers.kind}, expected {_PIXELS}, whose "
                    "pixels have weights"
                )
        if depth is not None and len(depth.files) != len(self.camera):
            raise ValueError(
                f"receivers.depth.files: got {len(depth.files)} for {len(self.camera)} camera(s), expected one for each"
            )
        return self

    def default_aspect(self) -> float:
        """The aspect for cameras without one."""
        screen = self.objective.screen
        return screen[0] / screen[1] if screen else 1.0


def read_settings(path: Path) -> SceneSettings:
    """The scene of a TOML file of `warpopt scene`, without its [output] and [casters].

    Raises:
        ConfigError: a file that is missing or not TOML, or invalid settings; a line for each error.
    """
    data = read_data(path, [])
    for own in ("output", "casters"):  # of that command's matrices
        data.pop(own, None)
    return validated(SceneSettings, data, str(path))

"""The configuration of `warpopt frames`. Does not import JAX."""

from collections.abc import Callable
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from warpopt.frames import NoRayCaster, Reading, ray_caster
from warpopt.frames.names import DEFAULT, refuse_unknown, warp_of_method

from ..common.settings import ConfigError, Distinct, FileName, Positive, Section, listed
from ..inputs.camera_settings import Resolution
from ..inputs.scene_files import SceneInput
from ..inputs.scene_settings import SceneSettings


def _known(name: str) -> str:
    return _checked_by(refuse_unknown, name)


def _known_method(name: str) -> str:
    return _checked_by(warp_of_method, name)


def _checked_by(check: Callable[[str], object], name: str) -> str:
    try:
        check(name)
    except ValueError as error:
        raise ValueError(str(error).partition(", ")[2]) from None
    return name


class PathSection(Section):
    """A path from the first camera under the first light."""

    kind: Literal["walk", "turn", "look", "sun", "cameras"]
    """Walking forwards, turning by 45 degrees a second, walking and looking about, a sun that moves; or the cameras of
    [camera_path], of which the first alone is rendered under every warp."""
    count: Annotated[int, Field(ge=2, le=3600)] = 30
    rate: Positive = 30.0
    """Frames a second."""
    methods: Annotated[
        list[Annotated[str, pydantic.AfterValidator(_known_method)]],
        pydantic.BeforeValidator(listed), Field(min_length=1), Distinct,
    ] = Field(default=[
        "none", "lispsm", "turned-edge", "sphere", "sphere-receivers", "window-none", "window-turned-edge",
    ])  # fmt: skip
    """A warp fitted each frame; "held-" and a warp, fitted every 8 frames; "sphere" and "sphere-receivers", snapped;
    "window-" and an objective's warp or none, in a stable window."""


class FramesSection(Section):
    """Which warps are rendered, and how their maps are read."""

    warps: Annotated[
        list[Annotated[str, pydantic.AfterValidator(_known)]],
        pydantic.BeforeValidator(listed), Field(min_length=1), Distinct,
    ] = Field(default=list(DEFAULT))  # fmt: skip
    """"none", a rule's name, "edge", "band", METRIC-NORM such as "p-inf", and "best": a scan over eta. "turned-" before
    edge, band, storage-inf or pxq's: along the best direction; "shaped-": with the best aspect too. COUNT-SPLITS-WARP,
    such as "4-logarithmic-turned-edge": so many cascades, with as many texels together."""
    fit: Literal["receivers", "engine"] = "receivers"
    """Rules and norms inf over the depth buffer of the frame, or over the view frustum cut by the scene's box."""
    screen: Resolution = (640, 400)
    """(width, height) in pixels."""
    shadow_map: Resolution = (1024, 1024)
    """Texels along (t, s)."""
    filter: Literal["nearest", "pcf2", "pcf3", "eye_blur", "eye_blur_depth"] = "nearest"
    bias: Literal["slope", "constant", "plane", "second_depth", "back_faces"] = "slope"
    bias_amount: Annotated[float, Field(ge=0)] | None = None
    """Texels of slope, or share of the depth range for "constant"; by default what suits the filter."""
    warped_depth: bool = False
    """Bias the depth z/w of the map, not the distance along the light."""
    blur_pixels: Positive = 3.0
    """Width of the blurs on the screen."""
    crops: Annotated[int, Field(ge=0, le=4)] = 1
    """Worst places that are enlarged beside each picture."""
    path: PathSection | None = None
    """Static error and false flicker along a path, besides the frames themselves."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the grids' shifts."""

    def reading(self) -> Reading:
        """Filter and bias."""
        return Reading(self.filter, self.bias, self.bias_amount, self.warped_depth, self.blur_pixels)


class FramesOutput(Section):
    """Output folder."""

    directory: FileName
    figures: bool = True


class FramesConfig(SceneSettings):
    """One run of `warpopt frames`: every camera under every light is a frame."""

    frames: FramesSection = FramesSection()
    output: FramesOutput

    @pydantic.model_validator(mode="after")
    def _has_casters(self) -> "FramesConfig":
        if "objective" in self.model_fields_set:
            raise ValueError("objective: got one, expected objectives by name in frames.warps, such as 'pxq-l2'")
        if "weights" in self.model_fields_set:
            raise ValueError("weights: got some, expected none: frames finds the edges of what it renders")
        if self.warp.model_fields_set - {"turn_only_if"}:
            raise ValueError(
                "warp: got a direction, an aspect or a lateral fit, expected turn_only_if alone: frames.warps names "
                "turned warps, such as 'turned-edge'"
            )
        path = self.frames.path
        if (self.camera_path is not None) != (path is not None and path.kind == "cameras"):
            raise ValueError("camera_path: expected [camera_path] and frames.path.kind = 'cameras', or neither")
        if not (self.receivers.gltf or self.receivers.landscape or self.receivers.made):
            raise ValueError(
                f"receivers: got {self.receivers.kind} without a shadow caster, expected gltf, landscape or made"
            )
        return self

    def default_aspect(self) -> float:
        """The aspect for cameras without one."""
        return self.frames.screen[0] / self.frames.screen[1]


def check_casts(scene: SceneInput) -> None:
    """Refuse a scene in which nothing casts a shadow.

    Raises:
        ConfigError: no triangle, or no light.
    """
    if scene.triangles is None or not len(scene.triangles):
        raise ConfigError("receivers: got no triangle, expected at least one shadow caster")
    if not scene.lights:
        raise ConfigError("light: got a sun that is below the horizon all the time, expected one that shines")


def check_ray_caster() -> None:
    """Refuse to start without the package that casts rays.

    Raises:
        ConfigError: one sentence with the command that installs it.
    """
    try:
        ray_caster()
    except NoRayCaster as error:
        raise ConfigError(str(error)) from None

"""The configuration of `warpopt scene`: a scene, and its output. Does not import JAX."""

from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from ..common.settings import FileName, Section
from ..inputs.camera_settings import Four
from ..inputs.scene_settings import SceneSettings
from .casters import CasterSettings

_TABLES = ("receivers", "objective", "weights")


class SceneOutput(Section):
    """Output folder, and the graphics API of the matrices."""

    directory: FileName
    figures: bool = True
    convention: Literal["opengl", "direct3d", "vulkan"] = "opengl"
    """direct3d: for row vectors; the others for column vectors."""
    reversed_z: bool = False


class StableSettings(Section):
    """A map that stays where it is in the world along the light's path, or the camera's: see docs/stability.md."""

    margin: Annotated[float, Field(ge=0.01, le=10)] = 0.1
    """By how much the map is larger than the receivers."""
    tolerance: Annotated[float, Field(ge=1)] = 1.1
    """The error over a new window's, above which it is fitted anew."""
    scroll: bool = True
    """Whether the map follows its receivers by whole texels."""
    anchor: Literal["fit", "light"] | Four = "fit"
    """The plane on which texels stay where they are while the light turns: through the receivers, across the light, or
    (normal x, y, z, offset), normal . p + offset = 0."""
    ahead: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the free texels on the side to which the map moves."""
    hold: Annotated[int, Field(ge=1)] = 8
    """Frames that a map is held before it is fitted anew for its error alone."""
    check_every: Annotated[int, Field(ge=1)] = 1
    """Frames from one optimum for the tolerance to the next."""
    padding: Annotated[int, Field(ge=0, le=1024)] = 1
    """Texels left free at each edge."""
    jump: Annotated[float, Field(ge=0.01)] = 0.5
    """A move of the camera, over the map's size, after which the map is fitted anew."""
    forget_after: Annotated[int, Field(ge=0)] = 30
    """Frames without receivers after which the map is forgotten."""
    warp: bool = True
    """Off: engines' stable fit, without a warp."""


class SceneConfig(SceneSettings):
    """One run of `warpopt scene`. Paths of scene files are relative to the TOML file."""

    casters: CasterSettings = CasterSettings()
    stable: StableSettings | None = None
    output: SceneOutput

    @pydantic.model_validator(mode="after")
    def _casters_known(self) -> "SceneConfig":
        asked = self.casters.gltf
        if asked is not None and asked.file is None and self.receivers.gltf is None:
            raise ValueError("casters.gltf.file: missing, expected a glTF file (without receivers.gltf)")
        return self

    @pydantic.model_validator(mode="after")
    def _in_pixels(self) -> "SceneConfig":
        if self.stable is not None and self.objective.shadow_map is None:
            raise ValueError("stable: expected objective.screen and objective.shadow_map, whose texels it counts")
        return self

    @pydantic.model_validator(mode="before")
    @classmethod
    def _by_what_is_known(cls, data: Any) -> Any:
        """Without metrics and norms: edges where a mask tells them; else, over pixels, depths stand for them."""
        if not isinstance(data, dict) or not all(isinstance(data.get(k, {}), dict) for k in _TABLES):
            return data
        receivers, objective, weights = (dict(data.get(key, {})) for key in _TABLES)
        if {"metrics", "norms"} & set(objective) or not {"depth", "gltf", "landscape", "made"} & set(receivers):
            return data
        edges = "lit" in weights and weights.get("by", "edges") == "edges"
        if edges:
            objective["metrics"], weights["by"] = "edge", "edges"
        else:
            objective["metrics"] = "band"
            weights.setdefault("by", "depth")
        return data | {"objective": objective, "weights": weights}

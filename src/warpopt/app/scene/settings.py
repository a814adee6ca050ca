"""The configuration of `warpopt scene`: a scene, and its output. Does not import JAX."""

from typing import Any, Literal

import pydantic

from ..common.settings import FileName, Section
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


class SceneConfig(SceneSettings):
    """One run of `warpopt scene`. Paths of scene files are relative to the TOML file."""

    casters: CasterSettings = CasterSettings()
    output: SceneOutput

    @pydantic.model_validator(mode="after")
    def _casters_known(self) -> "SceneConfig":
        asked = self.casters.gltf
        if asked is not None and asked.file is None and self.receivers.gltf is None:
            raise ValueError("casters.gltf.file: missing, expected a glTF file (without receivers.gltf)")
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

"""The configuration of `warpopt scene`: a scene, and its output. Does not import JAX."""

from typing import Literal

from ..common.settings import FileName, Section
from ..inputs.scene_settings import SceneSettings


class SceneOutput(Section):
    """Output folder, and the graphics API of the matrices."""

    directory: FileName
    figures: bool = True
    convention: Literal["opengl", "direct3d", "vulkan"] = "opengl"
    """direct3d: for row vectors; the others for column vectors."""
    reversed_z: bool = False


class SceneConfig(SceneSettings):
    """One run of `warpopt scene`. Paths of scene files are relative to the TOML file."""

    output: SceneOutput

"""The shadow casters of a scene: what `[casters]` names, or the receivers' own surfaces. Does not import JAX."""

from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic
from pydantic import Field

from ...scene_files.gltf import read_geometry
from ..common.settings import FileName, Section, listed
from ..inputs.camera_settings import Vector, exactly_one
from ..inputs.scene_files import SceneInput, told_of
from ..inputs.scene_settings import BoxReceivers, SceneSettings


class GltfCasters(Section):
    """Nodes of a glTF file."""

    file: FileName | None = None
    """By default that of `receivers.gltf`."""
    include: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])
    """As of `receivers.gltf`, whose own patterns do not count here."""
    exclude: Annotated[list[str], pydantic.BeforeValidator(listed)] = Field([])


class CasterSettings(Section):
    """The shadow casters, where they are not the receivers' own surfaces; at most one kind."""

    box: BoxReceivers | None = None
    """A box that contains them."""
    points: Annotated[list[Vector], Field(min_length=1)] | None = None
    """World points that bound them."""
    gltf: GltfCasters | None = None
    depth_clamp: bool = False
    """The map's depth begins at the receivers: the engine clamps nearer casters to it (pancaking)."""

    @pydantic.model_validator(mode="after")
    def _one(self) -> "CasterSettings":
        if self.model_fields_set - {"depth_clamp"}:
            exactly_one(self, ("box", "points", "gltf"))
        return self


def points_of(casters: np.ndarray | BoxReceivers | None) -> np.ndarray | None:
    """(N, 3) points that bound what `caster_shape` found; None for none, and for a box without ends."""
    if isinstance(casters, BoxReceivers):
        corners = np.stack(np.meshgrid(*zip(casters.lower, casters.upper, strict=True)), -1).reshape(-1, 3)
        return corners if np.isfinite(corners).all() else None
    return None if casters is None else casters.reshape(-1, 3)


def caster_shape(asked: CasterSettings, config: SceneSettings, scene: SceneInput, folder: Path):
    """Points (N, 3), triangles (T, 3, 3), a box's settings, or None.

    Raises:
        ConfigError: a glTF file that cannot be read.
    """
    if asked.depth_clamp:
        return None
    if asked.points is not None:
        return np.array(asked.points)
    if asked.gltf is not None:
        own = config.receivers.gltf
        file = asked.gltf.file or (own and own.file)
        assert file is not None  # required by the settings
        with told_of("casters.gltf"):
            return read_geometry(folder / file, include=asked.gltf.include, exclude=asked.gltf.exclude).triangles
    if asked.box is not None:
        return asked.box
    return scene.triangles if scene.triangles is not None else config.receivers.box

"""The configuration of `warpopt cascades`: over a view frustum or over a scene's receivers. Does not import JAX."""

from pathlib import Path
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from ..common.settings import (
    ConfigError,
    Distinct,
    OneObjective,
    OneView,
    OutputConfig,
    Positive,
    Section,
    ThetaDeg,
    listed,
    read_data,
    validated,
)
from ..inputs.scene_settings import SceneSettings

Count = Annotated[int, Field(ge=1, le=16)]
Scheme = Literal["uniform", "logarithmic", "practical", "godot", "unity", "unreal", "bevy", "three", "filament"]


class CascadeSettings(Section):
    """How many maps, and which other splits they are compared with."""

    count: Count = 4
    overlap: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Each cascade but the first begins at (1 - overlap) of its split."""
    shares: Annotated[list[Positive], Field(min_length=1, max_length=16)] | None = None
    """Each cascade's linear resolution; equal by default."""
    warp: bool = True
    step: Annotated[float, Field(gt=1, le=10)] | None = None
    """The best splits are also put at powers of this, so that they move seldom: 1.1 is a tenth."""
    beside: Annotated[list[Scheme], pydantic.BeforeValidator(listed), Distinct] = Field(
        default=["logarithmic", "practical", "uniform", "godot", "unity", "unreal", "bevy", "three", "filament"]
    )
    """Other splits of as many maps, over the camera's planes and over the receivers' range; those of engines that have
    no default for this number are left out."""

    @pydantic.model_validator(mode="after")
    def _one_each(self) -> "CascadeSettings":
        if self.shares is not None and len(self.shares) != self.count:
            raise ValueError(f"shares: got {len(self.shares)}, expected {self.count}, one for each cascade")
        return self


class Angle(Section):
    """The angle between light and view direction."""

    theta_deg: ThetaDeg


class CascadesConfig(Section):
    """Cascades of a view frustum."""

    view: OneView
    light: Angle
    objective: OneObjective = OneObjective()
    cascades: CascadeSettings = CascadeSettings()
    output: OutputConfig

    @pydantic.model_validator(mode="after")
    def _thick(self) -> "CascadesConfig":
        if not self.view.far / self.view.near * (1 - self.cascades.overlap) > 1:
            raise ValueError("cascades.overlap: expected far/near (1 - overlap) > 1")
        return self


class SceneCascadesConfig(SceneSettings):
    """Cascades of a scene's receivers, with [camera], [light] and [receivers] as for `scene`."""

    cascades: CascadeSettings = CascadeSettings()
    output: OutputConfig

    @pydantic.model_validator(mode="after")
    def _alone(self) -> "SceneCascadesConfig":
        if len(self.objective.objectives()) > 1:
            raise ValueError("objective: got several metrics or norms, expected one")
        return self


def read_cascades_config(path: Path, overrides: list[str]) -> CascadesConfig | SceneCascadesConfig:
    """The configuration; for a scene if the file has a table [camera] or [receivers].

    Raises:
        ConfigError: as `read_config`.
    """
    data = read_data(path, overrides)
    scene = bool({"camera", "receivers"} & set(data))
    if scene and "view" in data:
        raise ConfigError(f"{path}: got [view] with a scene, expected a view frustum ([view]) or a scene ([receivers])")
    return validated(SceneCascadesConfig if scene else CascadesConfig, data, str(path))

"""The configuration of `warpopt cascades`: over a view frustum or over a scene's receivers. Does not import JAX."""

from pathlib import Path
from typing import Annotated

import pydantic
from pydantic import Field

from ..common.settings import (
    ConfigError,
    OneObjective,
    OneView,
    OutputConfig,
    Section,
    ThetaDeg,
    read_data,
    validated,
)
from ..inputs.scene_settings import SceneSettings
from ..splits.settings import SplitSettings


class CascadeSettings(SplitSettings):
    """How many maps, which other splits they are compared with, and what is said of the number of maps."""

    step: Annotated[float, Field(gt=1, le=10)] | None = None
    """The best splits are also put at powers of this, so that they move seldom: 1.1 is a tenth."""
    price: Annotated[float, Field(ge=0)] | None = None
    """Cost of one more map in units of the lower bound on texels; the report then says how many are worth it. Over a
    frustum 0 by default; over a scene none, as it takes 136 optimal warps a light."""


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
        self.cascades.refuse_thin(self.view.near, self.view.far)
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

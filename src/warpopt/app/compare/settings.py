"""The configuration of `warpopt compare`: over a view frustum or over a scene's receivers. Does not import JAX."""

import itertools
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pydantic
from pydantic import Field

from warpopt.rules.registry import EVERY

from ..common.settings import (
    ConfigError,
    Distinct,
    LightAngles,
    ObjectiveConfig,
    OneView,
    OutputConfig,
    Section,
    listed,
    read_data,
    validated,
)
from ..inputs.scene_settings import SceneSettings
from ..splits.settings import SplitSettings

if TYPE_CHECKING:
    RuleName = str
else:
    RuleName = Literal[*EVERY]
_PLACE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


def _place(value: str) -> str:
    if not _PLACE.fullmatch(value):
        raise ValueError("expected module:function, such as my_rules:half_way")
    return value


class RulesConfig(Section):
    """Which rules are compared."""

    names: Annotated[list[RuleName], pydantic.BeforeValidator(listed), Distinct] = Field(default=list(EVERY))
    """Rules of warpopt, published or from engines."""
    own: dict[
        Annotated[str, Field(pattern=r"^\w[\w ./-]*$", max_length=40)], Annotated[str, pydantic.AfterValidator(_place)]
    ] = Field(default={})
    """Yours: name = "module:function", a callable (frustum, theta) -> warpopt.Warp, in a module that is installed or
    next to the TOML file. theta is an array in radians, or a single angle if the function cannot take an array."""

    @pydantic.model_validator(mode="after")
    def _some(self) -> "RulesConfig":
        if not self.names and not self.own:
            raise ValueError("names: got none, expected at least one, or one in rules.own")
        both = sorted(set(self.own) & set(EVERY))
        if both:
            raise ValueError(f"own: got {both[0]!r}, expected a name that no rule of warpopt has")
        return self


class CompareLight(LightAngles):
    """Angles between light and view direction, in increasing order."""

    @pydantic.field_validator("theta_deg")
    @classmethod
    def _increasing(cls, value: Any) -> Any:
        given = value if isinstance(value, list) else [value.start, value.stop][: value.count]
        if any(second <= first for first, second in itertools.pairwise(given)):
            raise ValueError("expected increasing angles")
        return value


class CompareConfig(Section):
    """Rules over a view frustum: `warpopt compare`."""

    view: OneView
    light: CompareLight
    rules: RulesConfig = RulesConfig()
    cascades: SplitSettings | None = None
    """Ways of splitting into several maps are compared too."""
    objective: ObjectiveConfig = ObjectiveConfig()
    output: OutputConfig

    @pydantic.model_validator(mode="after")
    def _thick(self) -> "CompareConfig":
        if self.cascades is not None:
            self.cascades.refuse_thin(self.view.near, self.view.far)
        return self


class SceneCompareConfig(SceneSettings):
    """Rules over the receivers of a scene: `warpopt compare` with [camera], [light] and [receivers] as for `scene`."""

    output: OutputConfig  # no matrices are written, so no clip-space convention is needed
    rules: RulesConfig = RulesConfig()
    cascades: SplitSettings | None = None


def read_compare_config(path: Path, overrides: list[str]) -> CompareConfig | SceneCompareConfig:
    """The configuration; for a scene if the file has a table [camera] or [receivers].

    Raises:
        ConfigError: as `read_config`.
    """
    data = read_data(path, overrides)
    scene = bool({"camera", "receivers"} & set(data))
    if scene and "view" in data:
        beside = " and ".join(f"[{name}]" for name in ("camera", "receivers") if name in data)
        raise ConfigError(
            f"{path}: got [view] with {beside}, expected a view frustum ([view], as in configs/compare.toml) or a "
            "scene ([camera] and [receivers], as in configs/compare_landscape.toml)"
        )
    return validated(SceneCompareConfig if scene else CompareConfig, data, str(path))

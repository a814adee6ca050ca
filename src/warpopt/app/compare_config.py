"""The configuration of `warpopt compare`: over a view frustum or over a scene's receivers. Knows nothing of JAX."""

import contextlib
import importlib
import importlib.util
import itertools
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import pydantic
from pydantic import Field

from .config import (
    ConfigError,
    Distinct,
    LightConfig,
    ObjectiveConfig,
    OneView,
    OutputConfig,
    Section,
    listed,
    read_data,
    validated,
)
from .scene_config import SceneConfig

RuleName = Literal[
    "ssm", "psm", "lispsm", "tsm", "tsm_alternative", "minimum_norm", "scherzer", "lispsm_paper", "filament",
    "osg_lispsm", "osg_lispsm_corrected", "osg_vdsm", "openmw", "ogre", "veloren", "tsm_xray", "tsm_dagor",
]  # fmt: skip
_PLACE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


def _place(value: str) -> str:
    if not _PLACE.fullmatch(value):
        raise ValueError("expected module:function, such as my_rules:half_way")
    return value


class RulesConfig(Section):
    """Which rules are compared."""

    names: Annotated[list[RuleName], pydantic.BeforeValidator(listed), Distinct] = Field(list(get_args(RuleName)))
    """Of warpopt's own, published and engines'."""
    own: dict[
        Annotated[str, Field(pattern=r"^\w[\w ./-]*$", max_length=40)], Annotated[str, pydantic.AfterValidator(_place)]
    ] = Field({})
    """Yours: name = "module:function", a callable (frustum, theta) -> warpopt.Warp, in a module that is installed or
    beside the TOML file. theta is an array, radians; where the function cannot take one, a single angle at a time."""

    @pydantic.model_validator(mode="after")
    def _some(self) -> "RulesConfig":
        if not self.names and not self.own:
            raise ValueError("names: got none, expected at least one, or one in rules.own")
        both = sorted(set(self.own) & set(get_args(RuleName)))
        if both:
            raise ValueError(f"own: got {both[0]!r}, expected a name that is none of warpopt's own rules")
        return self


class CompareLight(LightConfig):
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
    objective: ObjectiveConfig = ObjectiveConfig()
    output: OutputConfig


class SceneCompareConfig(SceneConfig):
    """Rules over the receivers of a scene: `warpopt compare` with [camera], [light] and [receivers] as for `scene`."""

    rules: RulesConfig = RulesConfig()
    output: OutputConfig  # no matrices are written, so no convention is asked for


def read_compare_config(path: Path, overrides: list[str]) -> CompareConfig | SceneCompareConfig:
    """The configuration; a scene's if the file has a table [camera] or [receivers].

    Raises:
        ConfigError: as `read_config`.
    """
    data = read_data(path, overrides)
    scene = bool({"camera", "receivers"} & set(data))
    if scene and "view" in data:
        beside = " and ".join(f"[{name}]" for name in ("camera", "receivers") if name in data)
        raise ConfigError(
            f"{path}: got [view] beside {beside}, expected a view frustum ([view], as in configs/compare.toml) or a "
            "scene ([camera] and [receivers], as in configs/compare_landscape.toml)"
        )
    return validated(SceneCompareConfig if scene else CompareConfig, data, str(path))


def check_modules(rules: RulesConfig, folder: Path) -> None:
    """Refuse, before any work, modules that are nowhere; what they hold is known when they are imported.

    Raises:
        ConfigError: naming the rule and the module.
    """
    with _beside(folder):
        for name, place in rules.own.items():
            module = place.partition(":")[0]
            package = module.partition(".")[0]  # to look for a submodule would import its package
            if importlib.util.find_spec(package) is None:
                raise ConfigError(
                    f"rules.own.{name}: got module {package!r}, which is neither installed nor in {folder}"
                )


def own_rules(rules: RulesConfig, folder: Path) -> dict[str, Callable]:
    """The user's functions. Imports their modules, which may import JAX.

    Raises:
        ConfigError: a module that cannot be imported, or that has no such function.
    """
    found = {}
    with _beside(folder):
        for name, place in rules.own.items():
            module_name, _, function = place.partition(":")
            try:
                module = importlib.import_module(module_name)
            except Exception as error:  # whatever a stranger's module may raise
                words = f"{type(error).__name__}: {error}".splitlines()[0]
                raise ConfigError(f"rules.own.{name}: module {module_name!r} cannot be imported: {words}") from error
            rule = getattr(module, function, None)
            if rule is None:
                raise ConfigError(f"rules.own.{name}: got {function!r}, which module {module_name!r} does not have")
            if not callable(rule):
                expected = "expected a callable (frustum, theta) -> warpopt.Warp"
                raise ConfigError(f"rules.own.{name}: got {place}, of type {type(rule).__name__}; {expected}")
            found[name] = rule
    return found


@contextlib.contextmanager
def _beside(folder: Path) -> Iterator[None]:
    """The folder first among the places where modules are looked for."""
    entry = str(folder.resolve())
    sys.path.insert(0, entry)
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(entry)

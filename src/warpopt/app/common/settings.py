"""The configuration tables shared by commands, and the reading of file and command line. Does not import JAX."""

import copy
import itertools
import math
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from warpopt.objective import PRODUCTS, Measure, Objective, norm_name, order_of


class ConfigError(Exception):
    """Bad input; the message lists every error, one per line."""


class Section(pydantic.BaseModel):
    """A table of a configuration: frozen, without unknown keys, all numbers finite.

    Strict: a number is not true and not "30", and true is not 1 or "yes".
    """

    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


FileName = Annotated[Path, Field(strict=False)]  # TOML has text for it
Positive = Annotated[float, Field(gt=0)]
HalfFovDeg = Annotated[float, Field(gt=0, lt=90)]
ThetaDeg = Annotated[float, Field(ge=0, le=180)]
if TYPE_CHECKING:
    Metric = str
else:
    Metric = Literal[*PRODUCTS]


def _norm(value: Any) -> Any:
    """Orders may be numbers or, from the command line, text; gives one name per norm."""
    try:
        order = order_of(value)
    except ValueError as error:
        raise ValueError(str(error).partition(", ")[2]) from None
    name = norm_name(order)
    return name if name in ("inf", "l1", "l2") else order


Norm = Annotated[Literal["inf", "l1", "l2"] | float, pydantic.BeforeValidator(_norm)]


def listed(value: Any) -> Any:
    """A single value as a list of one."""
    return value if isinstance(value, list | tuple) else [value]


def _distinct(values: list) -> list:
    if len(set(values)) < len(values):
        raise ValueError("expected distinct values")
    return values


Distinct = pydantic.AfterValidator(_distinct)


LARGEST_RATIO = 0.25 / sys.float_info.min
"""Of far/near, as `theory.ViewFrustum` takes it."""


class NearFar(Section):
    """A near plane, and far planes beyond it: one, several or none."""

    @pydantic.field_validator("far", check_fields=False)
    @classmethod
    def _beyond_near(cls, far: Any, info: pydantic.ValidationInfo) -> Any:
        near = info.data.get("near")
        if near is None:
            return far
        planes = [value for value in listed(far) if value is not None]
        if not all(value > near for value in planes):
            raise ValueError(f"expected more than near = {near}")
        if any(near * LARGEST_RATIO < value < math.inf for value in planes):
            raise ValueError(f"expected far/near of at most {LARGEST_RATIO:.3g}")
        return far


def _has_an_end(far: Any) -> Any:
    if any(isinstance(value, float) and value == math.inf for value in listed(far)):
        raise ValueError(
            "expected a finite number: give the farthest receiver's depth; the limits without a far plane are "
            "warpopt.theory.far_limit's"
        )
    return far


FarEnd = pydantic.BeforeValidator(_has_an_end)


class OneView(NearFar):
    """One view frustum."""

    near: Positive = 1.0
    far: Annotated[Positive, FarEnd]
    half_fov_deg: HalfFovDeg


class ThetaRange(Section):
    """Evenly spaced directions."""

    start: ThetaDeg
    stop: ThetaDeg
    count: Annotated[int, Field(ge=1, le=10_000_000)]

    def values(self) -> np.ndarray:
        return np.linspace(self.start, self.stop, self.count)


class LightAngles(Section):
    """Angles between light and view direction."""

    theta_deg: ThetaRange | Annotated[list[ThetaDeg], Field(min_length=1)]

    @pydantic.field_validator("theta_deg", mode="wrap")
    @classmethod
    def _range_or_list(cls, value: Any, handler: Any) -> Any:
        # Chosen by type, so that an error is reported only once, for the intended form.
        if isinstance(value, dict):
            return ThetaRange.model_validate(value)
        return handler(listed(value))

    def values(self) -> np.ndarray:
        return self.theta_deg.values() if isinstance(self.theta_deg, ThetaRange) else np.array(self.theta_deg)


class ObjectiveConfig(Section):
    """What is minimised: every metric in every norm, over one measure."""

    metrics: Annotated[list[Metric], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct] = ["p"]
    norms: Annotated[list[Norm], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct] = ["inf"]
    measure: Measure = "screen"

    def objectives(self) -> list[Objective]:
        """Every metric in every norm."""
        return [Objective(*each, self.measure) for each in itertools.product(self.metrics, self.norms)]


class OutputConfig(Section):
    """Where the results go."""

    directory: FileName
    figures: bool = True


class OneObjective(Section):
    """One metric in one norm over one measure."""

    metric: Metric = "p"
    norm: Norm = "inf"
    measure: Measure = "screen"

    def objective_value(self) -> Objective:
        """The library's objective."""
        return Objective(self.metric, self.norm, self.measure)


def validated(model: type[pydantic.BaseModel], data: dict[str, Any], source: str) -> Any:
    """The validated model of the data.

    Raises:
        ConfigError: names the source and, with its dotted path, each error: what was got, what was expected.
    """
    try:
        return model.model_validate(data)
    except pydantic.ValidationError as error:
        lines = [_flaw(flaw) for flaw in error.errors()]
        raise ConfigError("\n".join([f"{source}: {len(lines)} error{'s' * (len(lines) > 1)}", *lines])) from None


def _flaw(flaw: Any) -> str:
    path = ".".join(
        str(part) for part in flaw["loc"] if not str(part).startswith(("function-", "constrained-", "list["))
    )
    message = flaw["msg"].removeprefix("Value error, ")
    if flaw["type"] == "extra_forbidden":
        return f"  {path}: unknown key"
    if flaw["type"] == "missing":
        return f"  {path}: missing"
    # Errors from a whole section's validator already name the key and the value, better than the section's text.
    if message.startswith("got "):
        return f"  {path}: {message}" if path else f"  {message}"
    if ": got " in message:
        return f"  {path}.{message}" if path else f"  {message}"
    got = flaw["input"]
    return f"  {path}: got {got!r}, {_expectation(message)}" if path else f"  {_expectation(message)}"


def _expectation(message: str) -> str:
    """pydantic's message in the style of warpopt's."""
    if message.startswith(("List should have at least", "Value should have at least 1 item")):
        return "expected at least one item"
    if "not a valid path" in message:
        return "expected a path"
    if message.endswith("exceeded maximum size") or "parse string" in message:
        return "expected a valid integer" if "integer" in message else "expected a valid number"
    if "valid boolean" in message:
        return "expected true or false"
    if "valid dictionary" in message:
        return "expected a table of keys"
    return message.replace("Input should be", "expected").replace("Input should have", "expected")


def read_config(path: Path, overrides: list[str], model: type[pydantic.BaseModel]) -> Any:
    """The configuration, a `model`, from a TOML file, overridden by `--section.key value` pairs.

    Raises:
        ConfigError: a file that is missing or not TOML, a malformed override, or an invalid configuration.
    """
    return validated(model, read_data(path, overrides), str(path))


def read_data(path: Path, overrides: list[str]) -> dict[str, Any]:
    """The file's tables with the overrides applied, not validated.

    Raises:
        ConfigError: a file that is missing or not TOML, or a malformed override.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not a TOML file: {error}") from None
    return _overridden(data, overrides)


# tyro is not used here: it requires every default to be valid before it is overridden, and each element of a list as a
# separate word (`--view.far 10 500`, where TOML says [10, 500]), and makes a key with a table or a list a subcommand.
def _overridden(data: dict[str, Any], overrides: list[str]) -> dict[str, Any]:
    data = copy.deepcopy(data)
    words = list(overrides)
    while words:
        word = words.pop(0)
        if not word.startswith("--"):
            raise ConfigError(f"{word}: got a stray word, expected --section.key value")
        name, given, text = word[2:].partition("=")
        if not given:
            if not words:
                raise ConfigError(f"{word}: got no value, expected --section.key value")
            text = words.pop(0)
        *sections, key = name.replace("-", "_").split(".")
        target = data
        for section in sections:
            match target.get(section):
                case [dict() as only]:  # a single [[section]]
                    target = only
                    continue
                case [dict(), *_] as several:
                    raise ConfigError(f"--{name}: got {len(several)} tables [[{section}]], expected one to override")
            if not isinstance(target.get(section, {}), dict):
                target[section] = {}
            target = target.setdefault(section, {})
        target[key] = _toml_value(text)
    return data


def _toml_value(text: str) -> Any:
    """A TOML value if the text is one (500, true, [1, 2]), else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text

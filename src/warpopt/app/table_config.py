"""The configuration of `warpopt table`: view, light, objective, promise. Knows nothing of JAX."""

from pathlib import Path
from typing import Annotated

import pydantic
from pydantic import Field

from .config import HalfFovDeg, Measure, Metric, Norm, Positive, Section, beyond


class TableView(Section):
    """One view frustum; only far/near and the field of view matter."""

    near: Positive = 1.0
    far: Positive
    half_fov_deg: HalfFovDeg

    @pydantic.field_validator("far")
    @classmethod
    def _beyond_near(cls, far: float, info: pydantic.ValidationInfo) -> float:
        return beyond([far], info)[0]


class ThetaSpan(Section):
    """First and last angle between light and view direction; beyond 90 degrees a look-up folds them."""

    start: Annotated[float, Field(ge=0, lt=90, strict=True)] = 0.0
    stop: Annotated[float, Field(gt=0, le=90, strict=True)] = 90.0

    @pydantic.field_validator("stop")
    @classmethod
    def _after_start(cls, stop: float, info: pydantic.ValidationInfo) -> float:
        start = info.data.get("start")
        if start is not None and stop <= start:
            raise ValueError(f"expected more than start = {start}")
        return stop


class TableLight(Section):
    """The directions that the table covers."""

    theta_deg: ThetaSpan = ThetaSpan()


class TableObjective(Section):
    """What is minimised, and how much of it a look-up may lose."""

    metric: Metric = "p"
    norm: Norm = "inf"
    measure: Measure = "screen"
    max_regret: Positive = 1e-3
    """The promise: value/minimum - 1 stays below it in every direction."""


ENDINGS = (".npz", ".csv", ".json")


class TableOutput(Section):
    """Where the table goes."""

    file: Path
    """Ends in .npz, .csv or .json."""

    @pydantic.field_validator("file")
    @classmethod
    def _ending(cls, file: Path) -> Path:
        if file.suffix not in ENDINGS:
            raise ValueError(f"expected an ending of {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")
        return file


class TableConfig(Section):
    """One table: `warpopt table`."""

    view: TableView
    light: TableLight = TableLight()
    objective: TableObjective = TableObjective()
    output: TableOutput

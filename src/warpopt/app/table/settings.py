"""The configuration of `warpopt table`: view, light, objective, promise. Does not import JAX."""

from pathlib import Path
from typing import Annotated

import pydantic
from pydantic import Field

from ..common.output import TABLE_ENDINGS
from ..common.settings import LARGEST_RATIO, FarEnd, FileName, HalfFovDeg, NearFar, OneObjective, Positive, Section


class Rising(Section):
    """A start, and a stop beyond it."""

    @pydantic.field_validator("stop", check_fields=False)
    @classmethod
    def _after_start(cls, stop: float, info: pydantic.ValidationInfo) -> float:
        start = info.data.get("start")
        if start is not None and stop <= start:
            raise ValueError(f"expected more than start = {start}")
        return stop


class Span(Rising):
    """The smallest and largest value that a table covers."""

    start: Positive
    stop: Positive


class TableView(NearFar):
    """One view frustum, given by far/near and the field of view; or ranges of either."""

    near: Positive = 1.0
    far: Annotated[Positive | None, FarEnd] = None
    half_fov_deg: HalfFovDeg | None = None
    far_over_near: Span | None = None
    """Instead of `far`: the table has an axis far/near."""
    half_fov_deg_range: Span | None = None
    """Instead of `half_fov_deg`: the table has an axis for the field of view."""

    @pydantic.model_validator(mode="after")
    def _one_of_each(self) -> "TableView":
        for one, other in (("far", "far_over_near"), ("half_fov_deg", "half_fov_deg_range")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(f"expected one of {one} and {other}")
        if self.far_over_near is not None and self.far_over_near.start <= 1:
            raise ValueError(f"far_over_near.start: got {self.far_over_near.start:g}, expected more than 1")
        if self.far_over_near is not None and self.far_over_near.stop > LARGEST_RATIO:
            most = f"at most {LARGEST_RATIO:.3g}"
            raise ValueError(f"far_over_near.stop: got {self.far_over_near.stop:g}, expected {most}")
        if self.half_fov_deg_range is not None and self.half_fov_deg_range.stop >= 90:
            raise ValueError(f"half_fov_deg_range.stop: got {self.half_fov_deg_range.stop:g}, expected less than 90")
        return self


class ThetaSpan(Rising):
    """First and last angle between light and view direction; a lookup mirrors angles beyond 90 degrees."""

    start: Annotated[float, Field(ge=0, lt=90)] = 0.0
    stop: Annotated[float, Field(gt=0, le=90)] = 90.0


class TableLight(Section):
    """The directions that the table covers."""

    theta_deg: ThetaSpan = ThetaSpan()


class TableObjective(OneObjective):
    """What is minimised, and the maximum regret of a lookup."""

    max_regret: Positive = 1e-3
    """The promise: value/minimum - 1 stays below it in every direction."""
    max_slope: Positive | None = None
    """Bound on |d log(eta) / d theta| per radian, under which the largest regret is close to the least possible."""


class TableOutput(Section):
    """The output file."""

    file: FileName
    """Ends in .npz, .csv or .json."""

    @pydantic.field_validator("file")
    @classmethod
    def _ending(cls, file: Path) -> Path:
        if file.suffix not in TABLE_ENDINGS:
            raise ValueError(f"expected an ending of {', '.join(TABLE_ENDINGS[:-1])} or {TABLE_ENDINGS[-1]}")
        return file


class TableConfig(Section):
    """One table: `warpopt table`."""

    view: TableView
    light: TableLight = TableLight()
    objective: TableObjective = TableObjective()
    output: TableOutput

"""Which splits are compared. Does not import JAX."""

from typing import Annotated, Literal

import pydantic
from pydantic import Field

from ..common.settings import Distinct, Positive, Section, listed

Count = Annotated[int, Field(ge=1, le=16)]
Scheme = Literal["uniform", "logarithmic", "practical", "godot", "unity", "unreal", "bevy", "three", "filament"]
BEST, STEPPED = "best", "stepped"
TITLES = {
    BEST: "the best", STEPPED: "the best, in steps", "logarithmic": "logarithmic", "practical": "practical, 0.5",
    "uniform": "uniform", "godot": "Godot's fractions", "unity": "Unity's fractions",
    "unreal": "Unreal's exponent 3", "bevy": "Bevy's, first to 10", "three": "three.js's practical split",
    "filament": "Filament's halvings",
}  # fmt: skip


class SplitSettings(Section):
    """How many maps, and which other splits they are compared with."""

    count: Count = 4
    overlap: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Each cascade but the first begins at (1 - overlap) of its split."""
    shares: Annotated[list[Positive], Field(min_length=1, max_length=16)] | None = None
    """Each cascade's linear resolution; equal by default."""
    warp: bool = True
    beside: Annotated[list[Scheme], pydantic.BeforeValidator(listed), Distinct] = Field(
        default=["logarithmic", "practical", "uniform", "godot", "unity", "unreal", "bevy", "three", "filament"]
    )
    """Other splits of as many maps, over the camera's planes and over the receivers' range; those of engines that have
    no default for this number are left out."""

    @pydantic.model_validator(mode="after")
    def _one_each(self) -> "SplitSettings":
        if self.shares is not None and len(self.shares) != self.count:
            raise ValueError(f"shares: got {len(self.shares)}, expected {self.count}, one for each cascade")
        return self

    def refuse_thin(self, near: float, far: float) -> None:
        """Refuse a frustum that is too thin for the bands.

        Raises:
            ValueError: far/near (1 - overlap) <= 1.
        """
        if not far / near * (1 - self.overlap) > 1:
            raise ValueError("cascades.overlap: expected far/near (1 - overlap) > 1")

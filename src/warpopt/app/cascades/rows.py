"""One split of one view, and what it is compared by."""

import dataclasses

import numpy as np

import warpopt
from warpopt.cascades import Plan

from .settings import CascadesConfig, SceneCascadesConfig

Config = CascadesConfig | SceneCascadesConfig
BEST, STEPPED = "best", "stepped"


@dataclasses.dataclass(frozen=True, eq=False)
class Row:
    """One split of one view.

    Attributes:
        camera, light: their numbers; 0 for a frustum.
        name: of the split: "best", "stepped" (the best at whole steps), or one of `splits`.
        over: what was split: "planes", from the camera's near plane to its far plane, or "receivers".
        warped: whether each cascade has its best warp.
        plan: the cascades.
        best: the least value of as many, warped, over the receivers.
    """

    camera: int
    light: int
    name: str
    over: str
    warped: bool
    plan: Plan
    best: float

    @property
    def lost(self) -> float:
        """The value over the best; 1 where both are 0."""
        value = float(self.plan.value)
        return value / self.best if self.best > 0 else 1.0 if value == 0 else float("inf")

    @property
    def largest_ratio(self) -> float:
        """far/near of the longest cascade."""
        ends, starts = np.asarray(self.plan.splits)[1:], np.asarray(self.plan.starts)
        return float((ends / starts).max())

    @property
    def balanced_from(self) -> float:
        """The nearest receiver for which a whole-frustum split would be balanced: theory2's (d)."""
        ratios = np.asarray(self.plan.splits)[1:] / np.asarray(self.plan.splits)[:-1]
        return float(self.plan.splits[1] / ratios[1:].max()) if len(ratios) > 1 else float(self.plan.splits[0])


def objective_of(config: Config) -> "warpopt.Objective":
    """The only one."""
    if isinstance(config, CascadesConfig):
        return config.objective.objective_value()
    return config.objective.objectives()[0]

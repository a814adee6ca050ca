"""One split of one view, and what it is compared by."""

import dataclasses

import numpy as np

import warpopt

from ..splits.plans import Split, lost_by
from .settings import CascadesConfig, SceneCascadesConfig

Config = CascadesConfig | SceneCascadesConfig


@dataclasses.dataclass(frozen=True, eq=False)
class Row(Split):
    """One split of one view.

    Attributes:
        camera, light: their numbers; 0 for a frustum.
        best: the least value of as many, warped, over the receivers.
    """

    camera: int
    light: int
    best: float

    @property
    def lost(self) -> float:
        """The value over the best."""
        return float(lost_by(np.asarray(self.plan.value), np.asarray(self.best)))

    @property
    def largest_ratio(self) -> float:
        """far/near of the longest cascade."""
        ends, starts = np.asarray(self.plan.splits)[1:], np.asarray(self.plan.starts)
        return float((ends / starts).max())

    @property
    def balanced_from(self) -> float:
        """The nearest receiver for which the first ratio is no larger than the others (docs/cascades.md)."""
        ratios = np.asarray(self.plan.splits)[1:] / np.asarray(self.plan.splits)[:-1]
        return float(self.plan.splits[1] / ratios[1:].max()) if len(ratios) > 1 else float(self.plan.splits[0])


def objective_of(config: Config) -> "warpopt.Objective":
    """The only one."""
    if isinstance(config, CascadesConfig):
        return config.objective.objective_value()
    return config.objective.objectives()[0]

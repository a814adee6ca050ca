"""Comparison of rules with the optimum and the limit: per objective, over a view frustum or each camera of a scene."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

import warpopt
from warpopt.compare.comparison import Comparison
from warpopt.objective import Objective

from ..common.of_objective import OfObjective
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import views_of
from .settings import CompareConfig, SceneCompareConfig


@dataclasses.dataclass(frozen=True, eq=False)
class Compared(OfObjective):
    """One objective, over a view frustum or a scene's camera.

    Attributes:
        objective: what was minimised.
        camera: index among the scene's distinct cameras; None over a view frustum.
        result: the numbers.
    """

    objective: Objective
    camera: int | None
    result: Comparison

    @property
    def title(self) -> str:
        where = "" if self.camera is None else f", camera {self.camera}"
        return f"{self.objective.title}{where}"


def compare_over_frustum(
    config: CompareConfig, rules: dict[str, Callable], progress: Callable[[str], None]
) -> list[Compared]:
    """Every objective over the view frustum."""
    seen, compared = frustum_view(config), []
    for objective in config.objective.objectives():
        compared.append(Compared(objective, None, warpopt.compare_rules(seen, rules, objective)))
        progress(compared[-1].title)
    return compared


def frustum_view(config: CompareConfig) -> "warpopt.FrustumView":
    """The view frustum under every angle."""
    view = config.view
    frustum = warpopt.ViewFrustum(view.near, view.far, math.radians(view.half_fov_deg))
    return warpopt.FrustumView(frustum, np.deg2rad(config.light.values()))


def compare_over_scene(
    config: SceneCompareConfig, scene: SceneInput, rules: dict[str, Callable], progress: Callable[[str], None]
) -> list[Compared]:
    """Every objective over the receivers of each distinct camera."""
    if not scene.lights:
        return []
    asked, compared = config.objective, []
    for objective in asked.objectives():
        for i, view in enumerate(views_of(config, scene, objective)):
            result = warpopt.compare_rules(view, rules, objective, min_eta=asked.min_eta)
            compared.append(Compared(objective, i, result))
            progress(compared[-1].title)
    return compared

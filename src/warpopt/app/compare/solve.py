"""Rules beside the optimum and the limit: for each objective, over a view frustum or each camera of a scene."""

import dataclasses
import itertools
import math
from collections.abc import Callable

import jax
import numpy as np

import warpopt

from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import camera_of, receivers_of
from .settings import CompareConfig, SceneCompareConfig


@dataclasses.dataclass(frozen=True, eq=False)
class Compared:
    """One objective, over a view frustum or a scene's camera.

    Attributes:
        metric, norm: the objective.
        camera: index of the scene's distinct ones; None over a view frustum.
        result: the numbers.
    """

    metric: str
    norm: str
    camera: int | None
    result: "warpopt.Comparison"

    @property
    def title(self) -> str:
        where = "" if self.camera is None else f", camera {self.camera}"
        return f"E_{self.metric}, norm {self.norm}{where}"


def compare_over_frustum(
    config: CompareConfig, rules: dict[str, Callable], progress: Callable[[str], None]
) -> list[Compared]:
    """Every objective over the view frustum."""
    view, objective = config.view, config.objective
    frustum = warpopt.ViewFrustum(view.near, view.far, math.radians(view.half_fov_deg))
    theta = np.deg2rad(config.light.values())
    compared = []
    for metric, norm in itertools.product(objective.metrics, objective.norms):
        result = warpopt.compare_rules(frustum, theta, rules, metric, norm, objective.measure)
        compared.append(Compared(metric, str(norm), None, result))
        progress(compared[-1].title)
    return compared


def compare_over_scene(
    config: SceneCompareConfig, scene: SceneInput, rules: dict[str, Callable], progress: Callable[[str], None]
) -> list[Compared]:
    """Every objective over the receivers of each distinct camera."""
    if not scene.lights:
        return []
    objective = config.objective
    lights = jax.vmap(warpopt.DirectionalLight)(np.array(scene.lights, float))
    compared = []
    for metric, norm in itertools.product(objective.metrics, objective.norms):
        for i, camera in enumerate(scene.cameras):
            result = warpopt.compare_scene_rules(
                camera_of(camera), lights, receivers_of(config, scene, i), rules, metric, norm,
                screen=objective.screen, shadow_map=objective.shadow_map, min_eta=objective.min_eta,
            )  # fmt: skip
            compared.append(Compared(metric, str(norm), i, result))
            progress(compared[-1].title)
    return compared

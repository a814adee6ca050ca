"""Ways of splitting into cascades beside the best: per objective, over a view frustum or each camera of a scene."""

import dataclasses
from collections.abc import Callable

import numpy as np

from warpopt.objective import Objective

from ..common.of_objective import OfObjective
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import under_light, views_of
from ..splits.plans import Split, lost_by, splits_of
from ..splits.settings import SplitSettings
from .settings import CompareConfig, SceneCompareConfig
from .solve import frustum_view


@dataclasses.dataclass(frozen=True, eq=False)
class SplitsCompared(OfObjective):
    """One objective, over a view frustum or a scene's camera, under all lights.

    Attributes:
        objective: what was minimised.
        camera: index among the scene's distinct cameras; None over a view frustum.
        theta: (T,) angles between light and view direction, radians.
        keys: (name, over, warped) of each way of splitting; the first is the best.
        values: (S, T) errors.
    """

    objective: Objective
    camera: int | None
    theta: np.ndarray
    keys: list[tuple[str, str, bool]]
    values: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """(S, T) of the errors over the best's."""
        return lost_by(self.values, self.values[0])

    def warped_and_not(self, name: str, over: str) -> list[np.ndarray | None]:
        """(T,) ratios with a warp in each cascade, and without; None where that was not asked for."""
        rows = dict(zip(self.keys, self.ratio, strict=True))
        return [rows.get((name, over, warped)) for warped in (True, False)]


def compare_splits(
    config: CompareConfig | SceneCompareConfig, scene: SceneInput | None, progress: Callable[[str], None]
) -> list[SplitsCompared]:
    """Every objective; none if no cascades are asked for.

    Raises:
        ConfigError: a view that cannot be split.
    """
    asked = config.cascades
    if asked is None:
        return []
    made = []
    for objective in config.objective.objectives():
        if isinstance(config, CompareConfig):
            view = frustum_view(config)
            made.append(_compared(objective, None, np.asarray(view.theta), splits_of(view, asked, objective, None)))
        else:
            assert scene is not None  # given with a scene's configuration
            made += _over_scene(config, scene, asked, objective)
        progress(f"{made[-1].objective.title}, cascades")
    return made


def _over_scene(
    config: SceneCompareConfig, scene: SceneInput, asked: SplitSettings, objective: Objective
) -> list[SplitsCompared]:
    made = []
    for i, view in enumerate(views_of(config, scene, objective) if scene.lights else []):
        seen = [under_light(view, k) for k in range(len(scene.lights))]
        each = [splits_of(one, asked, objective, scene.cameras[i]) for one in seen]
        theta = np.array([float(one.frame_along("view").theta) for one in seen])
        # The range of depths is the same under every light, and so are the names of the splits.
        made.append(_compared(objective, i, theta, *each))
    return made


def _compared(objective: Objective, camera: int | None, theta: np.ndarray, *each: list[Split]) -> SplitsCompared:
    keys = [(one.name, one.over, one.warped) for one in each[0]]
    values = np.stack([np.stack([np.asarray(one.plan.value) for one in splits]) for splits in each], -1)
    return SplitsCompared(objective, camera, theta, keys, values.reshape(len(keys), -1))

"""Cascades by name, fitted to a frame: splits of a scheme, of an engine, or the best ones, each with its warp."""

import dataclasses

import numpy as np

from .. import cascades
from ..objective import Objective
from ..solve.solution import SceneSolution
from ..views import SceneView
from .cascaded_map import CascadedMap
from .fits import Fitted, Fitting, of_aspect
from .names import ENGINES, SCHEMES, Cascades, cascades_of, objective_of, turn_of
from .seen import Frame


@dataclasses.dataclass(frozen=True, eq=False)
class Cascaded:
    """Cascades, fitted to a frame.

    Attributes:
        name: COUNT-SPLITS-WARP.
        splits: count + 1 view depths.
        parts: each cascade's warp; None for one that holds nothing.
        defined: always.
    """

    name: str
    splits: tuple[float, ...]
    parts: tuple[Fitted | None, ...]
    defined: bool = True

    @property
    def eta(self) -> tuple[float | None, ...]:
        """Each cascade's."""
        return tuple(None if part is None else part.eta for part in self.parts)


class Moved:
    """Splits along a path: at powers of a step, where they stay while they can.

    Args:
        step: > 1.
    """

    def __init__(self, step: float):
        self._step = step
        self._before: np.ndarray | None = None

    def __call__(self, splits: np.ndarray) -> np.ndarray:
        self._before = np.asarray(cascades.splits.stepped(splits, self._step, self._before))
        return self._before


def fit_cascades(fitting: Fitting, name: str, moved: Moved | None = None) -> Cascaded:
    """The cascades of a name: together they have as many texels as the fitting's map.

    Args:
        moved: puts splits at whole steps, if given.

    Raises:
        ValueError: an unknown name, a single map's, or an engine that has no default for this number.
    """
    asked = cascades_of(name)
    if asked is None:
        raise ValueError(f"cascades: got {name!r}, expected COUNT-SPLITS-WARP, such as '4-logarithmic-turned-edge'")
    size = size_of_each(fitting.size, asked.count)
    objective = None if asked.warp == "sphere" else objective_of(asked.warp)
    view = _view(fitting, asked.warp, objective, size)
    goal = objective or Objective()
    plan = cascades.errors(view, _splits(fitting, asked, moved), goal, warp=objective is not None)
    casters = fitting.scene.corners_all
    if asked.warp == "sphere":
        matrices, _ = plan.matrices(casters=casters, fit="sphere", texels=min(size))
        size = min(size), min(size)
    else:
        matrices, _ = plan.matrices(casters=casters)
    assert isinstance(plan.solutions, SceneSolution)  # over a scene
    shares, etas = np.asarray(plan.solutions.shares, float), np.asarray(plan.warps.eta, float)
    made = []
    for matrix, eta, share in zip(np.asarray(matrices, float), etas, shares, strict=True):
        texels = of_aspect(size, float(share[0])) if asked.warp.startswith("shaped-") else size
        made.append(Fitted(name, float(eta), matrix, size=texels) if np.isfinite(matrix).all() else None)
    return Cascaded(name, tuple(map(float, plan.splits)), tuple(made))


def maps_of(fitting: Fitting, made: Cascaded) -> CascadedMap:
    """The shadow maps rendered with the fitted matrices."""
    maps = tuple(None if part is None else fitting.map_of(part) for part in made.parts)
    return CascadedMap(fitting.frame.camera, maps, made.splits[1:])


def size_of_each(size: tuple[int, int], count: int) -> tuple[int, int]:
    """The size of each of several maps that have as many texels as one, up to rounding."""
    across, along = (max(2, round(side / np.sqrt(count))) for side in size)
    return across, along


def _view(fitting: Fitting, warp: str, objective: Objective | None, size: tuple[int, int]) -> SceneView:
    """The frame's view for one warp and maps of a size."""
    prefix, kind = turn_of(warp)
    base = fitting.view(kind) if kind in ("edge", "band") else fitting.whole(objective)
    own = prefix == "shaped-" and objective is not None and objective.kernel is not None
    return SceneView(
        base.camera, base.light, base.receivers, screen=base.screen, shadow_map=size,
        warp_direction="best" if prefix else "view", map_aspect="best" if own else 1.0,
        turn_only_if=fitting.turn_only_if,
    )  # fmt: skip


def splits_by_scheme(frame: Frame, asked: Cascades, moved: Moved | None = None) -> np.ndarray:
    """Splits that need no objective: of the range that is seen, or by an engine of the camera's.

    Args:
        moved: puts those of what is seen at whole steps, if given.

    Raises:
        ValueError: an engine that has no default for this number.
    """
    camera, seen = frame.camera, frame.depth[np.isfinite(frame.depth)]
    near, far = float(seen.min()), float(seen.max())
    if asked.splits in ENGINES:
        scheme = cascades.splits.ENGINES[asked.splits]
        return np.asarray(scheme(camera.near, camera.far if np.isfinite(camera.far) else far, asked.count))
    if not near < far:
        return np.array([near, *[far] * asked.count])
    made = np.asarray(cascades.splits.SCHEMES[asked.splits](near, far, asked.count))
    return made if moved is None else moved(made)


def _splits(fitting: Fitting, asked: Cascades, moved: Moved | None) -> np.ndarray:
    if asked.splits in (*SCHEMES, *ENGINES):
        return splits_by_scheme(fitting.frame, asked, moved)
    key = asked.count, asked.splits, asked.warp not in ("none", "sphere")
    if key not in fitting.best_splits:
        objective = objective_of(asked.splits)
        view = _view(fitting, asked.splits, objective, size_of_each(fitting.size, asked.count))
        fitting.best_splits[key] = np.asarray(cascades.plan(view, asked.count, objective, warp=key[-1]).splits)
    made = fitting.best_splits[key]
    return made if moved is None else moved(made)

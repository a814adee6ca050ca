"""The best plan of a view, and what other splits of as many maps make of it."""

import dataclasses
from typing import Any

import numpy as np

import warpopt
from warpopt.cascades import Plan, splits
from warpopt.objective import Objective
from warpopt.scene_files.scene_camera import SceneCamera

from ..common.settings import ConfigError
from .settings import BEST, STEPPED, SplitSettings


@dataclasses.dataclass(frozen=True, eq=False)
class Split:
    """One way of splitting a view.

    Attributes:
        name: "best", "stepped" (the best at whole steps), or one of `splits`.
        over: what was split: "planes", from the camera's near plane to its far plane, or "receivers".
        warped: whether each cascade has its best warp.
        plan: the cascades.
    """

    name: str
    over: str
    warped: bool
    plan: Plan


def split_of(name: str, near: float, far: float, count: int) -> np.ndarray | None:
    """None where an engine has no default for this number of cascades, or this range."""
    scheme = (splits.SCHEMES | splits.ENGINES)[name]
    try:
        return np.asarray(scheme(near, far, count))
    except ValueError:
        return None


def lost_by(values: np.ndarray, best: np.ndarray) -> np.ndarray:
    """The values over the best; 1 where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(best > 0, values / best, np.where(values == 0, 1, np.inf))


def splits_of(
    view: Any, asked: SplitSettings, objective: Objective, camera: SceneCamera | None, step: float | None = None
) -> list[Split]:
    """The best first, and with it what it is without warps; then the others.

    Args:
        view: a `SceneView` of the camera, or a `FrustumView` of one frustum and any number of angles.
        camera: of a scene.
        step: of the best splits at whole steps, which are left out by default.

    Raises:
        ConfigError: a view that cannot be split.
    """
    more = {"overlap": asked.overlap, "shares": asked.shares}
    both = (True, False) if asked.warp else (False,)
    try:
        made = [
            Split(BEST, "receivers", warp, warpopt.cascades.plan(view, asked.count, objective, warp=warp, **more))
            for warp in both
        ]
    except ValueError as error:
        raise ConfigError(f"cascades: {error}") from None
    best = np.asarray(made[0].plan.splits)
    near, far = (float(best.reshape(-1, best.shape[-1])[0, k]) for k in (0, -1))
    ranges = {"receivers": (near, far)}
    if camera is not None and (camera.near < near * (1 - 1e-9) or far * (1 + 1e-9) < camera.far < np.inf):
        ranges["planes"] = camera.near, (camera.far if np.isfinite(camera.far) else far)
    if not near < far:
        return made
    others = {
        (name, over): split_of(name, *ends, asked.count) for over, ends in ranges.items() for name in asked.beside
    }
    if step is not None:
        stepped = np.asarray(splits.stepped(best, step))
        others = {(STEPPED, "receivers"): stepped if camera is not None else np.clip(stepped, near, far)} | others
    for (name, over), at in others.items():
        if at is not None:
            told = (warpopt.cascades.errors(view, at, objective, warp=warp, **more) for warp in both)
            made += [Split(name, over, warp, plan) for warp, plan in zip(both, told, strict=True)]
    return made

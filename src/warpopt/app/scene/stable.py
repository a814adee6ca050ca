"""`[stable]`: a window that follows the light's path, or the camera's."""

from collections.abc import Callable
from typing import Any

import numpy as np

import warpopt
from warpopt.stable import Action, Reason
from warpopt.theory.camera import camera_of

from ..common.record import finite_or_none
from ..common.settings import ConfigError
from ..inputs.scene_files import SceneInput
from ..inputs.scene_settings import BoxReceivers
from ..inputs.scene_values import receivers_of
from .casters import points_of
from .settings import SceneConfig
from .solve import clip_space

COLUMNS = (
    "path", "frame", "camera", "light", "action", "scroll_t", "scroll_s", "reason", "loss", "refits", "eta", "lambda",
)  # fmt: skip


def courses(config: SceneConfig, scene: SceneInput) -> list[list[tuple[int, int]]]:
    """(camera, light) of each frame of each path: along the light's for every camera, or along the camera's.

    Raises:
        ConfigError: paths of a camera and of a light that are not equally long.
    """
    lights = [step.light for step in scene.steps if step.light is not None]
    if config.camera_path is None:
        return [[(camera, light) for light in lights] for camera in range(len(scene.cameras))] if lights else []
    cameras = scene.camera_of
    if len(lights) not in (0, 1, len(cameras)):
        raise ConfigError(
            f"light.path: got {len(lights)} steps with {len(cameras)} poses of camera_path, expected one, or as many"
        )
    return [list(zip(cameras, lights * (1 if len(lights) > 1 else len(cameras)), strict=True))] if lights else []


def followed(
    config: SceneConfig, scene: SceneInput, casters: np.ndarray | BoxReceivers | None, progress: Callable[[str], None]
) -> list[dict[str, Any]]:
    """A row for each frame of each path, for the first objective, with what `caster_shape` found."""
    asked, objective = config.stable, config.objective.objectives()[0]
    assert asked is not None  # only called with [stable]
    assert config.objective.shadow_map is not None  # required by the settings
    assert config.objective.screen is not None
    window = warpopt.StableWindow(
        margin=asked.margin, tolerance=asked.tolerance, objective=objective, scroll=asked.scroll, anchor=asked.anchor,
        ahead=asked.ahead, hold=asked.hold, check_every=asked.check_every, padding=asked.padding, jump=asked.jump,
        forget_after=asked.forget_after, warp=asked.warp, warp_direction=config.warp.direction_of(objective),
        map_aspect=config.warp.aspect, lateral=config.warp.lateral, turn_only_if=config.warp.turn_only_if,
        shadow_map=config.objective.shadow_map, screen=config.objective.screen, clip_space=clip_space(config),
    )  # fmt: skip
    rows = []
    for path, course in enumerate(courses(config, scene)):
        state = window.start()
        for frame, (camera, light) in enumerate(course):
            update, state = window.update(
                state, camera_of(scene.cameras[camera]), warpopt.DirectionalLight(scene.lights[light]),
                receivers_of(config, scene, camera), casters=points_of(casters),
            )  # fmt: skip
            rows.append(_row(update, state, path, frame, camera, light))
            progress(f"stable window, frame {frame + 1} of {len(course)}")
    return rows


def _row(update: Any, state: Any, path: int, frame: int, camera: int, light: int) -> dict[str, Any]:
    matrix = np.asarray(update.matrix, float)
    there = bool(np.isfinite(matrix).all())
    scroll = np.asarray(update.scroll).tolist()
    return {
        "path": path, "frame": frame, "camera": camera, "light": light, "action": Action(int(update.action)).name,
        "scroll_t": scroll[0], "scroll_s": scroll[1], "reason": Reason(int(update.reason)).sentence,
        "loss": finite_or_none(update.loss), "refits": int(state.refits),
        "eta": finite_or_none(update.warp.eta) if there else None,
        "lambda": finite_or_none(update.warp.lam) if there else None,
        "texels": np.asarray(update.texels).tolist(), "matrix": matrix.tolist() if there else None,
    }  # fmt: skip


def stable_words(rows: list[dict[str, Any]]) -> str:
    """What the window did, in a paragraph."""
    counts = {action.name: sum(row["action"] == action.name for row in rows) for action in Action}
    losses = [row["loss"] for row in rows if row["loss"] is not None and row["action"] != Action.EMPTY.name]
    told = ", ".join(f"{count} {name.lower()}" for name, count in counts.items() if count)
    reasons = [row["reason"] for row in rows if row["action"] == Action.REFITTED.name]
    why = {reason: reasons.count(reason) for reason in dict.fromkeys(reasons)}
    words = f"Of {len(rows)} frames: {told}. "
    if losses:
        words += f"The error is at most {max(losses):.3g} times that of a window fitted to the frame. "
    if why:
        words += "Fitted anew: " + " ".join(f"{count} times: {reason}" for reason, count in why.items())
    return words.strip() + " `window.csv` has every frame, `scene.json` the matrices.\n"

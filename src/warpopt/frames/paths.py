"""Frames in motion: paths of a camera and a sun, stable fits, and how many verdicts flip from frame to frame."""

import dataclasses
from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ..scene_files.scene_camera import SceneCamera, unit
from .cascaded_map import CascadedMap
from .light_rays import LitScene
from .seen import Frame
from .shadow_map import Reading, ShadowMap

Motion = Literal["walk", "turn", "look", "sun"]
MOTIONS: tuple[str, ...] = ("walk", "turn", "look", "sun")
SPEED, TURN, SWAY, SUN = 1.4, 45.0, 30.0, 1.0
"""Metres a second; degrees a second of a turn; degrees of looking about; degrees a second of the sun."""
_STEP = 1.1  # the sphere to the farthest receiver grows in steps of 10 %, so that it seldom changes
_UP = np.array([0.0, 1.0, 0.0])


def path(
    kind: Motion, camera: SceneCamera, light: Float[np.ndarray, "3"], count: int, rate: float
) -> list[tuple[SceneCamera, Float[np.ndarray, "3"]]]:
    """(camera, light) of each frame; y is up.

    Args:
        kind: "walk" forwards; "turn" about the vertical; "look", walking and looking about; "sun", a sun that moves.
        camera, light: of the first frame.
        count: frames.
        rate: frames a second.

    Raises:
        ValueError: an unknown kind, no frame, or a rate that is not positive.
    """
    if kind not in MOTIONS:
        raise ValueError(f"path: got {kind!r}, expected one of {', '.join(MOTIONS)}")
    if count < 1 or not rate > 0:
        raise ValueError(f"path: got {count} frames at {rate} a second, expected at least one, and a positive rate")
    forward = camera.rotation[2]
    level = unit(forward - (forward @ _UP) * _UP + 1e-12 * camera.rotation[1])
    made = []
    for time in np.arange(count) / rate:
        position, angle, sun = camera.position, 0.0, np.asarray(light, float)
        if kind in ("walk", "look"):
            position = position + SPEED * time * level
        if kind == "turn":
            angle = np.deg2rad(TURN) * time
        if kind == "look":
            angle = np.deg2rad(SWAY) * np.sin(np.pi * time)
        if kind == "sun":
            sun = _about_up(sun, np.deg2rad(SUN) * time)
        turn = np.stack([_about_up(row, angle) for row in camera.rotation])  # with its own roll and handedness
        made.append((dataclasses.replace(camera, position=position, rotation=turn), sun))
    return made


def _about_up(vector: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ vector


def widened(camera: SceneCamera, factor: float) -> SceneCamera:
    """The camera with a window larger by a factor: what it sees stays in the map for a while."""
    return dataclasses.replace(camera, window=tuple(factor * side for side in camera.window))


def stepped_far(frame: Frame) -> float:
    """The farthest receiver, rounded up to a power of 1.1, so that it changes seldom."""
    farthest = frame.depth[np.isfinite(frame.depth)].max()
    return float(min(_STEP ** np.ceil(np.log(farthest) / np.log(_STEP)), frame.camera.far))


@dataclasses.dataclass(frozen=True, eq=False)
class Moment:
    """One frame of a path under one method.

    Attributes:
        scene, frame: as they were read.
        shadow_map: the method's map in this frame, in the place where it lies.
    """

    scene: LitScene
    frame: Frame
    shadow_map: ShadowMap | CascadedMap


def seen_again(before: Moment, after: Moment) -> Bool[np.ndarray, " P"]:
    """Which judged receivers of a frame the next frame sees too: on its screen, and behind nothing."""
    frame, camera = before.frame, after.frame.camera
    points = before.scene.world(np.column_stack([frame.places, frame.heights]))
    eye = camera.to_eye(points)
    z = np.maximum(eye[:, 2], camera.near)
    slopes = camera.on_window(np.column_stack([eye[:, :2], z]))
    left, right, bottom, top = camera.window
    inside = (eye[:, 2] >= camera.near) & (slopes[:, 0] > left) & (slopes[:, 0] < right)
    inside &= (slopes[:, 1] > bottom) & (slopes[:, 1] < top)
    begin, rays = (v @ camera.rotation @ after.scene.axes.T for v in camera.rays_at(slopes))
    begin = begin + after.scene.coordinates(camera.position)
    depth, which = after.scene.seen_from(begin, rays, camera.near, camera.far)
    # The ray ends on the same triangle, or within what single precision cannot tell from it.
    return inside & ((which == frame.triangles) | (np.abs(depth - z) < 1e-5 * z))


def flips(before: Moment, after: Moment, reading: Reading) -> tuple[int, int]:
    """(verdicts that change though the truth does not, world points compared): the false flicker of two frames.

    Args:
        before, after: of the same triangles.
        reading: how both maps are read; a verdict is lit from a share of one half.
    """
    again = seen_again(before, after)
    points = before.frame.only(again)
    if before.scene is not after.scene:
        points = _under(before, after, points)
        kept = points.judged[0]
        one = before.shadow_map.visibility(before.frame.only(again), reading)[kept] >= 0.5
    else:
        one = before.shadow_map.visibility(points, reading) >= 0.5
    other = after.shadow_map.visibility(points, reading) >= 0.5
    return int((one != other).sum()), len(one)


def _under(before: Moment, after: Moment, points: Frame) -> Frame:
    """The points under the next frame's light: those that face it and whose truth is unchanged."""
    scene = after.scene
    at = scene.coordinates(before.scene.world(np.column_stack([points.places, points.heights])))
    slopes = scene.slopes[points.triangles]
    first, blocker = scene.first_hits(at[:, :2])
    lit = (blocker == points.triangles) | ~(first < at[:, 2] - scene.tolerance(np.abs(slopes).sum(1)))
    kept = (lit == points.lit) & np.isfinite(slopes).all(1)
    return dataclasses.replace(
        points, judged=kept[None], places=at[kept, :2], heights=at[kept, 2], slopes=slopes[kept],
        triangles=points.triangles[kept], lit=lit[kept],
    )  # fmt: skip


Method = Callable[[int, LitScene, Frame], ShadowMap | CascadedMap]
"""The map or maps of a frame, from its number, scene and pixels: a fit, refitted or held."""

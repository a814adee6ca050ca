"""Ways of fitting a map along a path: a warp refitted each frame, one held for some frames, and snapped spheres."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from ..receivers.depth_buffer import DepthBuffer
from ..render.sphere_fit import sphere_matrix
from ..stable.update import Update
from ..stable.window import StableWindow
from ..theory.camera import DirectionalLight, camera_of
from ..views import SceneView
from .fits import Fitting
from .light_rays import LitScene
from .names import WINDOW, objective_of, title_of, turn_of, warp_of_method
from .paths import Method, stepped_far, widened
from .seen import Frame, see

HELD = 8  # frames between two fits of "held-NAME"
_WIDER = 1.25  # of its window: what comes into view in eight frames of a walk or a turn


def method_title(name: str) -> str:
    """A method's name in reports.

    Example:
        >>> method_title("held-p-inf")
        'E_p, norm inf, fitted every 8 frames'
    """
    if name == "sphere":
        return "sphere to the far plane, snapped"
    if name == "sphere-receivers":
        return "sphere to the farthest receiver, snapped"
    if name.startswith(WINDOW):
        return f"{title_of(name.removeprefix(WINDOW))}, in a stable window"
    if name.startswith("held-"):
        return f"{title_of(name.removeprefix('held-'))}, fitted every {HELD} frames"
    return f"{title_of(name)}, fitted each frame"


def method_of(name: str, texels: int) -> Method:
    """A method by name: "sphere", "sphere-receivers", the name of a warp, or "held-" and the name of a warp.

    Args:
        texels: along each side of the map.

    Raises:
        ValueError: an unknown name, or "best", which no engine could search.
    """
    try:
        warp = warp_of_method(name)
    except ValueError as error:
        raise ValueError(f"method: {error}") from None
    if warp is None:

        def sphere(number: int, scene: LitScene, frame: Frame) -> Float[np.ndarray, "4 4"]:
            far = frame.camera.far if name == "sphere" else stepped_far(frame)
            return snapped_sphere(scene, frame, min(far, 2 * scene.size + 1), texels)

        return sphere
    if name.startswith(WINDOW):
        return Windowed(warp, texels)
    held: dict[str, Any] = {}

    def fitted(number: int, scene: LitScene, frame: Frame) -> Float[np.ndarray, "4 4"]:
        if warp == name:
            return Fitting(scene, frame, (texels, texels)).fitted(warp).matrix
        if number % HELD == 0 or held.get("scene") is not scene:  # a light that moved has other rays
            held["scene"] = scene
            wide = see(scene, widened(frame.camera, _WIDER), *frame.judged.shape)
            held["matrix"] = Fitting(scene, wide, (texels, texels)).fitted(warp).matrix
        return held["matrix"]

    return fitted


def snapped_sphere(scene: LitScene, frame: Frame, far: float, texels: int) -> Float[np.ndarray, "4 4"]:
    """`sphere_matrix` about what the frame's camera can see up to `far`."""
    camera = camera_of(dataclasses.replace(frame.camera, far=far))
    view = SceneView(camera, DirectionalLight(scene.axes[2]), DepthBuffer(frame.depth))
    return np.asarray(sphere_matrix(view, texels, casters=scene.corners_all), float)


class Windowed:
    """A stable window by the name of its warp: "none", or that of an objective, with "turned-" or "shaped-" before it.

    Args:
        texels: along each side of the map.
        settings: of the `StableWindow`, in place of its own.

    Attributes:
        updates: what it did in each frame.
    """

    def __init__(self, name: str, texels: int, **settings: Any):
        prefix, self._kind = turn_of(name)
        self._settings: dict[str, Any] = {
            "objective": objective_of(name), "warp": name != "none", "warp_direction": "best" if prefix else "view",
            "map_aspect": "best" if prefix == "shaped-" else 1.0, "shadow_map": (texels, texels),
        } | settings  # fmt: skip
        self._texels = texels, texels
        self._window: StableWindow | None = None
        self.updates: list[Update] = []

    def __call__(self, number: int, scene: LitScene, frame: Frame) -> Float[np.ndarray, "4 4"]:
        if self._window is None:
            height, width = frame.judged.shape
            settings: dict[str, Any] = self._settings | {"screen": (width, height)}
            self._window = StableWindow(**settings)
            self._state = self._window.start()
        fitting = Fitting(scene, frame, self._texels)
        view = fitting.view(self._kind) if self._kind in ("edge", "band") else fitting.uniform()
        update, self._state = self._window.update(
            self._state, view.camera, view.light, view.receivers, casters=scene.corners_all
        )
        self.updates.append(update)
        return np.asarray(update.matrix, float)

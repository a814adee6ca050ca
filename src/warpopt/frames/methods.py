"""Ways of fitting a map along a path: a warp refitted each frame, one held for some frames, and snapped spheres."""

import dataclasses
import itertools
from typing import Any

import numpy as np
from jaxtyping import Float

from ..receivers.depth_buffer import DepthBuffer
from ..render.sphere_fit import sphere_matrix
from ..stable.update import Action, Update
from ..stable.window import StableWindow
from ..theory.camera import DirectionalLight, camera_of
from ..views import SceneView
from .cascade_fits import Moved, fit_cascades, maps_of, size_of_each, splits_by_scheme
from .cascaded_map import CascadedMap
from .fits import Fitting
from .light_rays import LitScene
from .names import WINDOW, Cascades, cascades_of, objective_of, title_of, turn_of, warp_of_method
from .paths import Method, stepped_far, widened
from .seen import Frame, see
from .shadow_map import ShadowMap

HELD = 8  # frames between two fits of "held-NAME"
STEP = 1.1
"""Cascades' splits along a path are at powers of this, so that they move seldom."""
_MARGIN = 0.2  # of a cascade's window: more than a single map's, as a split moves by a step at once
_WIDER = 1.25  # of its window: what comes into view in eight frames of a walk or a turn


def method_title(name: str) -> str:
    """A method's name in reports and figures.

    Example:
        >>> method_title("held-p-inf")
        'E_p, norm inf, fitted every 8 frames'
    """
    if name == "sphere":
        return "sphere to the far plane, snapped"
    if name == "sphere-receivers":
        return "sphere to the farthest receiver, snapped"
    if name.startswith(WINDOW):
        each = ", each in a stable window" if cascades_of(name.removeprefix(WINDOW)) else ", in a stable window"
        return title_of(name.removeprefix(WINDOW)) + each
    cascades = cascades_of(name)
    if cascades is not None and cascades.warp == "sphere":
        return title_of(name)
    if name.startswith("held-"):
        return f"{title_of(name.removeprefix('held-'))}, fitted every {HELD} frames"
    return f"{title_of(name)}, fitted each frame"


def method_of(name: str, texels: int) -> Method:
    """A method by name: "sphere", "sphere-receivers", a warp's or cascades', with "held-" or "window-" before it.

    Args:
        texels: along each side of the map, or of one map with as many as the cascades.

    Raises:
        ValueError: an unknown name, or "best", which no engine could search.
    """
    size = texels, texels
    try:
        warp = warp_of_method(name)
    except ValueError as error:
        raise ValueError(f"method: {error}") from None
    if warp is None:

        def sphere(number: int, scene: LitScene, frame: Frame) -> ShadowMap:
            far = frame.camera.far if name == "sphere" else stepped_far(frame)
            return ShadowMap(scene, snapped_sphere(scene, frame, min(far, 2 * scene.size + 1), texels), size)

        return sphere
    cascades = cascades_of(warp)
    if name.startswith(WINDOW):
        return Windowed(warp, texels) if cascades is None else WindowedCascades(cascades, texels)
    if cascades is not None:
        moved = Moved(STEP)

        def several(number: int, scene: LitScene, frame: Frame) -> CascadedMap:
            fitting = Fitting(scene, frame, size)
            return maps_of(fitting, fit_cascades(fitting, warp, moved))

        return several
    held: dict[str, Any] = {}

    def fitted(number: int, scene: LitScene, frame: Frame) -> ShadowMap:
        if warp == name:
            fitting = Fitting(scene, frame, size)
            return fitting.map_of(fitting.fitted(warp))
        if number % HELD == 0 or held.get("scene") is not scene:  # a light that moved has other rays
            held["scene"] = scene
            wide = see(scene, widened(frame.camera, _WIDER), *frame.judged.shape)
            fitting = Fitting(scene, wide, size)
            held["map"] = fitting.map_of(fitting.fitted(warp))
        return held["map"]

    return fitted


def snapped_sphere(scene: LitScene, frame: Frame, far: float, texels: int) -> Float[np.ndarray, "4 4"]:
    """`sphere_matrix` about what the frame's camera can see up to `far`."""
    camera = camera_of(dataclasses.replace(frame.camera, far=far))
    view = SceneView(camera, DirectionalLight(scene.axes[2]), DepthBuffer(frame.depth))
    return np.asarray(sphere_matrix(view, texels, casters=scene.corners_all), float)


def refitted(method: Method) -> bool:
    """Whether a method with stable windows fitted one anew in the last frame; of others False."""
    return isinstance(method, (Windowed, WindowedCascades)) and method.refitted


def _window_of(name: str, size: tuple[int, int], frame: Frame, settings: dict[str, Any]) -> StableWindow:
    """The window of a warp by name: "none", or an objective's, with "turned-" or "shaped-" before it."""
    prefix, height, width = turn_of(name)[0], *frame.judged.shape
    own: dict[str, Any] = {
        "objective": objective_of(name), "warp": name != "none", "warp_direction": "best" if prefix else "view",
        "map_aspect": "best" if prefix == "shaped-" else 1.0, "shadow_map": size, "screen": (width, height),
    } | settings  # fmt: skip
    return StableWindow(**own)


def _seen_by(name: str, scene: LitScene, frame: Frame, size: tuple[int, int]) -> SceneView:
    """The frame's view, with what the objective of a warp's name weighs."""
    kind, fitting = turn_of(name)[1], Fitting(scene, frame, size)
    return fitting.view(kind) if kind in ("edge", "band") else fitting.uniform()


class Windowed:
    """A stable window by the name of its warp: "none", or that of an objective, with "turned-" or "shaped-" before it.

    Args:
        texels: along each side of the map.
        settings: of the `StableWindow`, in place of its own.

    Attributes:
        updates: what it did in each frame.
    """

    def __init__(self, name: str, texels: int, **settings: Any):
        self._name, self._settings, self._size = name, settings, (texels, texels)
        self._window: StableWindow | None = None
        self.updates: list[Update] = []

    @property
    def refitted(self) -> bool:
        """Whether the last frame's map was fitted anew."""
        return int(self.updates[-1].action) == Action.REFITTED

    def __call__(self, number: int, scene: LitScene, frame: Frame) -> ShadowMap:
        if self._window is None:
            self._window = _window_of(self._name, self._size, frame, self._settings)
            self._state = self._window.start()
        view = _seen_by(self._name, scene, frame, self._size)
        update, self._state = self._window.update(
            self._state, view.camera, view.light, view.receivers, casters=scene.corners_all
        )
        self.updates.append(update)
        return ShadowMap(scene, np.asarray(update.matrix, float), self._size)


class WindowedCascades:
    """Cascades of a scheme's splits, moved in steps, each in a stable window of its own.

    Args:
        asked: splits of `SCHEMES` or `ENGINES`, and a warp as for `Windowed`.
        texels: along each side of one map with as many as the cascades together.
        settings: of each `StableWindow`, in place of its own.

    Attributes:
        updates: what each did in the last frame.
    """

    def __init__(self, asked: Cascades, texels: int, **settings: Any):
        self._asked, self._settings = asked, {"margin": _MARGIN} | settings
        self._size = size_of_each((texels, texels), asked.count)
        self._moved = Moved(STEP)
        self._window: StableWindow | None = None
        self.updates: list[Update] = []

    @property
    def refitted(self) -> bool:
        """Whether some cascade's map was fitted anew in the last frame."""
        return any(int(update.action) == Action.REFITTED for update in self.updates)

    def __call__(self, number: int, scene: LitScene, frame: Frame) -> CascadedMap:
        if self._window is None:
            self._window = _window_of(self._asked.warp, self._size, frame, self._settings)
            self._states = [self._window.start()] * self._asked.count
        view = _seen_by(self._asked.warp, scene, frame, self._size)
        splits = splits_by_scheme(frame, self._asked, self._moved)
        self.updates, maps = [], []
        for k, (start, end) in enumerate(itertools.pairwise(splits.tolist())):
            _, part = view.receivers.between(view.camera, start, end)
            update, self._states[k] = self._window.update(
                self._states[k], view.camera, view.light, part, casters=scene.corners_all
            )
            self.updates.append(update)
            matrix = np.asarray(update.matrix, float)
            maps.append(ShadowMap(scene, matrix, self._size) if np.isfinite(matrix).all() else None)
        return CascadedMap(frame.camera, tuple(maps), tuple(splits[1:].tolist()))

"""A stable window: fitted once with a margin, then kept or moved by whole texels, and fitted anew where it must be."""

import dataclasses
import functools
import zlib
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._checks import Numbers, float_arrays, instance, is_traced, points_of
from .._words import flag, one_of, shown, whole_number
from ..objective import Objective
from ..receivers.one_by_one import OneByOne
from ..receivers.receivers import Receivers
from ..receivers.weighted.weights import Weighting
from ..render.shadow_matrix import ClipSpace, checked_clip_space
from ..solve.scene import settled_scene
from ..theory.camera import Camera, DirectionalLight
from ..views import DIRECTIONS, LATERAL, SceneView
from .state import WindowState
from .steps import Settings, update_window
from .update import Update

ANCHORS = ("fit", "light")


@dataclasses.dataclass(frozen=True)
class StableWindow:
    """Settings of maps that stay where they are in the world; hashable. Pure functions take a state to the next.

    A warp is fitted to the receivers with a margin and frozen in the world. As long as they are in the map, nothing
    changes; when they leave it, the map moves by whole texels, after the projection, so that every texel stays where it
    is at every depth. It is fitted anew when the receivers are larger than the map or too near its horizon, when its
    error passes the tolerance, when the light turned too far, or the camera jumped.

    Args:
        margin: by how much the map is larger than the receivers along each axis, >= 0.01: both errors are (1 + margin)
            times larger. At the far end it ends before the warp's horizon. Where receivers outgrow a map within 8
            frames, the next one has twice the margin, up to 8 times this; after 30 frames the loss is against this one.
        tolerance: the error over that of a window fitted to this frame, with its margin, above which it is fitted anew;
            >= 1, inf for never.
        objective: what is minimised. None: "edge" if edges are given; else "band" over points and pixels, by their
            depths if they have no weights; "storage" over bodies.
        warp_direction, map_aspect, lateral, turn_only_if: as for `SceneView`.
        scroll: whether the map moves; if not, it is fitted anew when receivers leave it.
        warp: False for maps without a warp, engines' stable fit of any receivers.
        shadow_map: texels along (t, s); with an aspect that is searched for as many in all: see `Update.texels`.
        screen: (width, height) in pixels.
        padding: texels that receivers leave free at each edge, for filters.
        ahead: the share of the free texels that lies on the side to which the map moves.
        anchor: the plane on which texels stay where they are while the light turns: "fit", through the receivers;
            "light", across the light; or (normal x, y, z, offset) in the world, normal . p + offset = 0 as of
            `GroundPlane`, if the light does not graze it.
        jump: a move of the camera in one frame, over the larger of the map's lengths along and across the warp, after
            which it is fitted anew.
        hold: frames that a map is held before it is fitted anew for its error alone, unless that is twice what is
            tolerated.
        check_every: frames from one optimum for the loss to the next.
        forget_after: frames without receivers after which the map is forgotten.
        clip_space: OpenGL's by default.

    Raises:
        ValueError: a setting out of its range, naming it.

    Example:
        >>> import numpy as np, warpopt
        >>> window = warpopt.StableWindow(objective=warpopt.Objective("storage"), warp_direction="view")
        >>> light, state = warpopt.DirectionalLight((0.2, -1, -0.3)), window.start()
        >>> ground = warpopt.receivers.PointReceivers([(x, 0, z) for x in (-9, 9) for z in (-2, -9, -50)])
        >>> for step in (0.0, 0.01, 0.8):
        ...     camera = warpopt.Camera((step, 2, 4), (0, -0.1, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=1.2)
        ...     update, state = window.update(state, camera, light, ground)
        ...     print(update.words)
        FIRST. There was no map.
        KEPT. The receivers are in the map.
        KEPT. The receivers are in the map.
    """

    margin: float = 0.1
    tolerance: float = 1.1
    objective: Objective | None = None
    warp_direction: str | tuple[float, float, float] = "best"
    scroll: bool = True
    warp: bool = True
    map_aspect: str | float = 1.0
    lateral: str = "eye"
    turn_only_if: float = 1.0
    shadow_map: tuple[int, int] = (1024, 1024)
    screen: tuple[int, int] = (1920, 1080)
    padding: int = 1
    ahead: float = 0.5
    anchor: str | tuple[float, float, float, float] = "fit"
    jump: float = 0.5
    hold: int = 8
    check_every: int = 1
    forget_after: int = 30
    clip_space: ClipSpace | None = None

    def __post_init__(self):
        for name in ("scroll", "warp"):
            flag(name, getattr(self, name))
        for name, least, most in (
            ("margin", 0.01, 10), ("tolerance", 1, np.inf), ("turn_only_if", 1, np.inf), ("ahead", 0, 1),
            ("jump", 0.01, np.inf),
        ):  # fmt: skip
            self._set(name, _number(name, getattr(self, name), least, most))
        whole_number("padding", self.padding, 0, 1024)
        whole_number("hold", self.hold, 1, 10**6)
        whole_number("check_every", self.check_every, 1, 10**6)
        whole_number("forget_after", self.forget_after, 0, 10**6)
        for name in ("shadow_map", "screen"):
            self._set(name, _size(name, getattr(self, name)))
        if 2 * self.padding >= min(self.shadow_map):
            raise ValueError(f"padding: got {self.padding}, expected less than half of the map's {self.shadow_map}")
        if self.objective is not None:
            instance("objective", self.objective, Objective)
        self._set("clip_space", checked_clip_space(self.clip_space))
        one_of("lateral", self.lateral, LATERAL)
        if isinstance(self.warp_direction, str):
            one_of("warp_direction", self.warp_direction, DIRECTIONS)
        else:
            self._set("warp_direction", _vector("warp_direction", self.warp_direction, 3, f"or one of {DIRECTIONS}"))
        if self.turn_only_if == np.inf:
            raise ValueError("turn_only_if: got inf, expected a finite number >= 1")
        if self.objective is not None:
            self._refuse_contradictions(self.objective)
        if self.map_aspect != "best":
            self._set("map_aspect", _number("map_aspect", self.map_aspect, 1e-3, 1e3))
        if isinstance(self.anchor, str):
            one_of("anchor", self.anchor, ANCHORS)
        else:
            anchor = _vector("anchor", self.anchor, 4, f"or one of {ANCHORS}")
            length = float(np.linalg.norm(anchor[:3]))
            if not length > 0:
                raise ValueError(f"anchor: got {anchor}, expected a normal that is not zero")
            self._set("anchor", tuple(v / length for v in anchor))

    def _refuse_contradictions(self, objective: Objective) -> None:
        """What no receivers could be fitted with."""
        for name, value, fine in (
            ("warp_direction", "best", objective.in_any_direction or not self.warp),
            ("map_aspect", "best", objective.in_any_aspect), ("lateral", "free", objective.kernel is None),
        ):  # fmt: skip
            if getattr(self, name) == value and not fine:
                raise ValueError(f"{name}: got {value!r} with {objective.title}, which does not compare such maps")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    @property
    def checksum(self) -> int:
        """Of all settings: a state of others is fitted anew."""
        return zlib.crc32(repr(self).encode())

    def start(self, dtype: Any = float) -> WindowState:
        """The state before the first frame.

        Args:
            dtype: of its numbers, the cameras' own: what `jax.lax.scan` carries keeps its dtype.

        Raises:
            ValueError: a dtype that is not of floating-point numbers.
        """
        try:
            kind = jnp.dtype(dtype).kind
        except TypeError:
            kind = ""
        if kind != "f":
            raise ValueError(f"dtype: got {shown(dtype)}, expected float32 or float64")
        return WindowState.empty(self.shadow_map, self.checksum, dtype)

    def update(
        self,
        state: WindowState,
        camera: Camera,
        light: DirectionalLight,
        receivers: Receivers | None = None,
        edges: Weighting | None = None,
        *,
        casters: Numbers | None = None,
        may_refit: bool | Bool[Array, ""] = True,
    ) -> tuple[Update, WindowState]:
        """(the map of one frame, the next state): pure, for `jax.jit`, `jax.lax.scan` and `jax.vmap` over cascades.

        An update that keeps or scrolls takes one pass over the receivers' extents; every `check_every` frames the
        optimum is found too, for the loss. (Under `jax.vmap` it always is.)

        Args:
            state: from `start`, or from the last frame.
            camera, light, receivers: as for `SceneView`.
            edges: weights of a `DepthBuffer` or of points, as their own `weights`: such as `edge_weights` of the last
                frame. They are used where an optimum is found; the map holds all receivers.
            casters: (N, 3) world points that bound what casts shadows, as for `shadow_matrix`. They change the map's
                depth range alone.
            may_refit: False puts off fits whose only reason is the tolerance; see `stagger`.

        Raises:
            ValueError: arguments of another kind, NaN, an objective that the receivers do not support.
        """
        instance("state", state, WindowState)
        if state.loss.ndim:
            raise ValueError(f"state: got {state.loss.shape} of them, expected one; use jax.vmap over more")
        receivers = _weighed(receivers, edges)
        objective = self._objective_for(receivers, edges)
        view = SceneView(
            camera, light, receivers, screen=self.screen, shadow_map=self.shadow_map,
            warp_direction=self.warp_direction if self.warp else "view", lateral=self.lateral,
            map_aspect=self.map_aspect, turn_only_if=self.turn_only_if,
        )  # fmt: skip
        view = settled_scene(view, objective)
        dtype = camera.position.dtype
        above = np.asarray(np.inf, dtype) if casters is None else _nearest(casters, camera, light)
        if not is_traced(may_refit) and np.asarray(may_refit).dtype != bool:
            raise ValueError(f"may_refit: got {shown(may_refit)}, expected True or False")
        return update_window(self._as_arrays(dtype), objective, state, view, above, jnp.asarray(may_refit))

    def stagger(self, states: WindowState) -> Bool[Array, " K"]:
        """Which of several windows may refit for its tolerance in this frame: the one with the largest loss.

        Args:
            states: of K windows, stacked.

        Returns:
            What `update` takes as `may_refit`, under `jax.vmap`. Urgent fits, such as of receivers larger than the map,
            are not put off.

        Raises:
            ValueError: what is no `WindowState`, or of a shape other than (K,).
        """
        instance("states", states, WindowState)
        if states.loss.ndim != 1:
            raise ValueError(f"states: got shape {states.loss.shape}, expected (K,): several states, stacked")
        usable = states.fitted & (states.missed == 0)
        first = jnp.argmax(jnp.where(usable, states.loss, -jnp.inf))
        return (jnp.arange(len(usable)) == first) & usable

    def _as_arrays(self, dtype: Any) -> Settings:
        # On the host: they go to the device with the call.
        real: Any = functools.partial(np.asarray, dtype=dtype)
        whole: Any = functools.partial(np.asarray, dtype=np.int32)
        truth: Any = functools.partial(np.asarray, dtype=bool)
        plane = np.zeros(4) if isinstance(self.anchor, str) else self.anchor
        return Settings(
            margin=real(self.margin), tolerance=real(self.tolerance), ahead=real(self.ahead), jump=real(self.jump),
            padding=whole(self.padding), hold=whole(self.hold), check_every=whole(self.check_every),
            forget_after=whole(self.forget_after), plane=real(plane), across_light=truth(self.anchor == "light"),
            scroll=truth(self.scroll), warp=truth(self.warp), checksum=np.asarray(self.checksum, np.uint32),
            clip_space=checked_clip_space(self.clip_space),
        )  # fmt: skip

    def _objective_for(self, receivers: Receivers | None, edges: Weighting | None) -> Objective:
        if self.objective is not None:
            return self.objective
        if edges is not None:
            return Objective("edge")
        return Objective("band" if isinstance(receivers, OneByOne) else "storage")


def _weighed(receivers: Receivers | None, edges: Weighting | None) -> Receivers | None:
    """The receivers with these weights; by depth where nothing weighs them."""
    if not isinstance(receivers, OneByOne):
        if edges is not None:
            raise ValueError(f"edges: got some with {shown(receivers)}, expected a DepthBuffer or PointReceivers")
        return receivers
    if edges is None:
        if not receivers.weights.uniform:
            return receivers
        edges = "depth"
    return receivers.reweighed(edges)


def _nearest(casters: Numbers, camera: Camera, light: DirectionalLight) -> Any:
    """The casters' least l . c from the eye: one number, so that other casters compile nothing anew."""
    points = points_of(camera.position.dtype, "casters", casters).reshape(-1, 3)
    if is_traced(points, camera, light):
        return ((points - camera.position) @ light.direction.astype(points.dtype)).min(initial=jnp.inf)
    if not np.isfinite(points).all():
        raise ValueError("casters: got one that is not finite, expected finite numbers")
    along = (np.asarray(points) - np.asarray(camera.position)) @ np.asarray(light.direction, points.dtype)
    return np.asarray(along.min(initial=np.inf), points.dtype)


def _number(name: str, value: Any, least: float, most: float) -> float:
    try:
        (number,) = float_arrays(**{name: value})
        made = float(number) if not number.shape else np.nan
    except (ValueError, TypeError):
        made = np.nan
    if not least <= made <= most:
        raise ValueError(f"{name}: got {shown(value)}, expected a number >= {least:g} and <= {most:g}")
    return float(value)


def _size(name: str, value: Any) -> tuple[int, int]:
    try:
        one, other = value
        whole_number(name, int(one), 1, 2**20)
        whole_number(name, int(other), 1, 2**20)
        if one != int(one) or other != int(other):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: got {shown(value)}, expected two whole numbers > 0") from None
    return int(one), int(other)


def _vector(name: str, value: Any, length: int, otherwise: str) -> tuple[float, ...]:
    try:
        made = tuple(float(v) for v in value)
    except (TypeError, ValueError):
        made = ()
    if len(made) != length or not np.isfinite(made).all():
        raise ValueError(f"{name}: got {shown(value)}, expected {length} finite numbers, {otherwise}")
    return made

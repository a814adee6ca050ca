"""What a stable window did in a frame."""

import enum

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ..theory.warp import Warp


class Action(enum.IntEnum):
    """What became of the map.

    Example:
        >>> Action.SCROLLED.name
        'SCROLLED'
    """

    KEPT = 0
    """The matrix is the last frame's, to the bit."""
    SCROLLED = 1
    """The map moved by whole texels, or its depth range or its light changed: texels stay where they are."""
    REFITTED = 2
    """A new map: every texel is elsewhere."""
    FIRST = 3
    """The first map."""
    EMPTY = 4
    """No receivers, or none that can be used: the last map, if there is one."""


class Reason(enum.IntEnum):
    """Why. `Reason(int(update.reason)).sentence` says it in words.

    Example:
        >>> Reason.LOSS.sentence
        'The error passed the tolerance.'
    """

    FITS = 0
    FIRST = 1
    LEFT = 2
    DEPTH = 3
    LIGHT = 4
    RANGE = 5
    HORIZON = 6
    LOSS = 7
    TURNED = 8
    JUMP = 9
    SETTINGS = 10
    EMPTY = 11
    UNSOLVED = 12
    WAITS = 13

    @property
    def sentence(self) -> str:
        """The reason in words."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.FITS: "The receivers are in the map.",
    Reason.FIRST: "There was no map.",
    Reason.LEFT: "Receivers left the map.",
    Reason.DEPTH: "The depth range no longer fits.",
    Reason.LIGHT: "The light turned; texels on the anchor plane stay where they are.",
    Reason.RANGE: "The receivers are larger than the map.",
    Reason.HORIZON: "The receivers are too near the warp's horizon or its apex.",
    Reason.LOSS: "The error passed the tolerance.",
    Reason.TURNED: "The light turned too far from the anchor plane.",
    Reason.JUMP: "The camera jumped.",
    Reason.SETTINGS: "The state is of another window's settings or resolution.",
    Reason.EMPTY: "There are no receivers.",
    Reason.WAITS: "The error passed the tolerance; a fit is put off.",
    Reason.UNSOLVED: "No optimum was found; the last map is kept.",
}


class Update(eqx.Module):
    """The map of one frame.

    Attributes:
        matrix: (4, 4) world to clip space, as `shadow_matrix` makes it; NaN before the first receivers.
        local: (4, 4) the same for points relative to `origin`: in single precision far from the world's origin, give
            it p - origin.
        origin: (3,) world point near the camera.
        warp: the `Warp` of the map as it lies, over its own extent; its `start` is from the eye.
        direction: (3,) world unit vector of the map's axis.
        texels: (2,) along (t, s): the map's size.
        action, reason: `Action` and `Reason` as integers.
        scroll: (2,) whole texels (i, j) by which the map moved: a world point at texel coordinates (u, v) is now at
            (u - i, v - j). (0, 0) unless SCROLLED.
        loss: the objective over that of a window fitted to this frame, as last computed.
        refit_rate: refits a frame, so far.

    `words` is for printing, outside of compiled programs.

    Example:
        >>> import warpopt
        >>> window = warpopt.StableWindow(objective=warpopt.Objective("storage"), warp_direction="view")
        >>> camera = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.5)
        >>> light, nothing = warpopt.DirectionalLight((0, -1, 0)), warpopt.receivers.PointReceivers([(0, 0, 9)])
        >>> window.update(window.start(), camera, light, nothing)[0].words   # behind the camera
        'EMPTY. There are no receivers.'
    """

    matrix: Float[Array, "4 4"]
    local: Float[Array, "4 4"]
    origin: Float[Array, "3"]
    warp: Warp
    direction: Float[Array, "3"]
    texels: Int[Array, "2"]
    action: Int[Array, ""]
    reason: Int[Array, ""]
    scroll: Int[Array, "2"]
    loss: Float[Array, ""]
    refit_rate: Float[Array, ""]

    @property
    def words(self) -> str:
        """The action and its reason in a line."""
        action = Action(int(self.action))
        moved = f" by ({', '.join(map(str, np.asarray(self.scroll).tolist()))})" if action == Action.SCROLLED else ""
        return f"{action.name}{moved}. {Reason(int(self.reason)).sentence}"

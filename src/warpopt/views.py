"""Camera, receivers and light: the first argument of the main functions."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ._checks import Numbers, assembled, checked, float_arrays, instance, is_traced
from ._words import one_of, shown
from .objective import Objective, objective_or_default
from .receivers.answers import extent_if_any, footprint_of, refuse_answers, to_be_checked
from .receivers.bodies.whole_frustum import WholeFrustum
from .receivers.footprint import Footprint
from .receivers.free_fit import freed
from .receivers.receivers import Receivers
from .receivers.reduced import Reduced
from .theory.camera import Camera, DirectionalLight, normalised
from .theory.direction import gradient, middle, shares_of
from .theory.light_frame import LightFrame, resolutions
from .theory.light_space import LightSpace, checked_theta
from .theory.view_frustum import ViewFrustum

DIRECTIONS = ("view", "gradient", "middle", "best", "steady")
"""What a map can be warped along, besides a vector."""
LATERAL = ("eye", "free")
"""Where a map's axis can be across the warp."""


class FrustumView(eqx.Module):
    """AT09's setting: a symmetric view frustum, fully visible, and a light in the YZ plane.

    Args:
        frustum: of any shape that broadcasts with theta.
        theta: angle between light and view direction, radians in [0, pi]; mirror-symmetric about pi/2.

    Raises:
        ValueError: theta outside [0, pi] or NaN, shapes that do not broadcast, or not a `ViewFrustum`.

    Example:
        >>> import warpopt
        >>> view = warpopt.FrustumView(warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236), theta=1.5707963)
        >>> round(float(view.start), 3), round(float(view.mu), 3)   # V begins 1 before the eye, is 99 long
        (1.0, 99.0)
    """

    frustum: ViewFrustum
    theta: Float[Array, "..."]

    def __init__(self, frustum: ViewFrustum, theta: Numbers):
        instance("frustum", frustum, ViewFrustum)
        self.frustum = frustum
        self.theta = checked_theta(theta, frustum)

    @property
    def start(self) -> Float[Array, "..."]:
        """Distance from the eye at which V begins along Z_w."""
        return _extent(self)[0]

    @property
    def mu(self) -> Float[Array, "..."]:
        """Depth range of V along Z_w, VN (13)."""
        return _extent(self)[1]


# Compiled: op by op, a light space's many small operations take a hundred times as long.
@jax.jit
def _extent(view: FrustumView) -> tuple[Array, Array]:
    space = LightSpace(view.frustum, view.theta)
    return space.start, space.mu


class SceneView(eqx.Module):
    """Any camera, any light, and the receivers: one of each; use `jax.vmap` for more.

    Args:
        camera, light: in world space. Only `compare_rules` accepts lights with a leading axis.
        receivers: one of `warpopt.receivers`, or a class derived from `Receivers`; None means everything that the
            camera could see.
        screen: (width, height) in pixels.
        shadow_map: texels along (t, s), across and along the warp. With `screen` and `shadow_map`, errors are in
            pixels per texel; without both, the screen has square pixels and height 2 and the map is 1 by 1, the
            units of AT09 (13), (14).
        warp_direction: what the map is warped along, projected along the light: "view", the view direction (Z_w of all
            published rules); "gradient", where the eye depth of the receivers rises, by least squares weighted with
            z^-2; "middle", the sum of the vectors from the eye to the receivers (SC 4.4); a (3,) world vector; or
            "best", the direction of least error, which `optimal_warp` finds for metrics "pxq", "storage", "edge" and
            "band": E_p and E_q alone do not compare maps of different directions; or "steady", "view" where a warp
            along it has the least error, else no warp, along the screen's rows or columns: Z_w turns with a light that
            is next to the view's direction, and a map without a warp need not.
        map_aspect: texels along t over texels along s, times that of `shadow_map`, with as many texels in all; "best",
            that of least error, between 1/8 and 8, for metrics "max", "edge" and "band" ("pxq" and "storage" are the
            same for all).
        lateral: where the map's axis is across the warp: "eye", through the eye, or as near to it as the receivers are;
            "free", the line with the least width, (T62) of docs/theory.md, which turned warps and level ground gain by;
            only for maxima and norms without shear ("p", "q", "pxq", "max", "storage").
        turn_only_if: with "best", how much less the error must be than along the view for the map to be turned: 1.1
            keeps the view's direction unless its error is above 1.1 times the best one's.

    Raises:
        ValueError: an argument of the wrong class, a resolution that is not two positive numbers, or
            only one of the two; an unknown word, a vector along the light, an aspect that is not positive, a
            `turn_only_if` below 1.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0)))
        >>> round(float(warpopt.optimal_warp(view).warp.lam), 3)   # n + sqrt(f n), LiSPSM's: the light is overhead
        11.0
    """

    camera: Camera
    light: DirectionalLight
    receivers: Receivers
    screen: Float[Array, "2"] | None
    shadow_map: Float[Array, "2"] | None
    warp_direction: str = eqx.field(static=True)
    warp_vector: Float[Array, "3"] | None
    map_aspect: Float[Array, ""] | None
    turn_only_if: Float[Array, ""]
    lateral: str = eqx.field(static=True)

    def __init__(
        self,
        camera: Camera,
        light: DirectionalLight,
        receivers: Receivers | None = None,
        *,
        screen: Numbers | None = None,
        shadow_map: Numbers | None = None,
        warp_direction: str | Numbers = "view",
        map_aspect: str | Numbers = 1.0,
        lateral: str = "eye",
        turn_only_if: Numbers = 1.0,
    ):
        instance("camera", camera, Camera)
        instance("light", light, DirectionalLight)
        receivers = WholeFrustum() if receivers is None else receivers
        if not isinstance(receivers, Receivers):
            raise ValueError(
                f"receivers: got {shown(receivers)}, expected one of warpopt.receivers, or a class of your own that "
                "derives from its Receivers"
            )
        if camera.is_orthographic:
            if not receivers.any_projection:
                raise ValueError(
                    f"camera: got an orthographic one with {type(receivers).__name__}, expected a perspective one, or "
                    "the whole frustum, a convex body, a plane, points or a depth buffer"
                )
            if isinstance(warp_direction, str) and warp_direction in ("gradient", "middle"):
                raise ValueError(
                    f"warp_direction: got {warp_direction!r} with an orthographic camera, whose errors do not depend "
                    "on the eye depth, expected 'view', 'best', 'steady' or a vector"
                )
        dtype = jnp.result_type(*jax.tree.leaves(eqx.filter((camera, light, receivers), eqx.is_inexact_array)))
        one_of("lateral", lateral, LATERAL)
        self.lateral = lateral
        self.warp_direction, vector = _direction(warp_direction, light)
        # Resolutions are whole numbers: their dtype says nothing about the precision asked for.
        parts = camera, light, receivers, *resolutions(screen, shadow_map), vector, *_ratios(map_aspect, turn_only_if)
        (
            self.camera, self.light, self.receivers, self.screen, self.shadow_map, self.warp_vector, self.map_aspect,
            self.turn_only_if,
        ) = _of_dtype(parts, dtype)  # fmt: skip

    @property
    def searched(self) -> bool:
        """Whether `optimal_warp` finds the direction or the aspect."""
        return self.warp_direction in ("best", "steady") or self.map_aspect is None

    def frame(self) -> LightFrame:
        """W's axes, and the screen's units along them.

        Raises:
            ValueError: a direction or an aspect that is searched for: `along` gives the view with those found.
        """
        if self.searched:
            name, word = "map_aspect", "best"
            if self.map_aspect is not None:
                name, word = "warp_direction", self.warp_direction
            raise ValueError(
                f"{name}: got {word!r}, which optimal_warp finds, expected its solution: view.along(solution)"
            )
        return self.frame_along(self.warp_direction)

    def frame_along(self, direction: str) -> LightFrame:
        """W's axes for another `warp_direction` of the same view, "best" for the view's; an aspect of 1 for "best".

        Args:
            direction: a word of `warp_direction`, or "vector" for the view's own.

        Returns:
            A `LightFrame`.

        Raises:
            ValueError: "gradient" or "middle" over receivers that have no places.
        """
        camera, receivers = self.camera, self.receivers
        frame = LightFrame(camera, self.light, self.screen, self.shadow_map)
        if self.map_aspect is not None:
            frame = frame.shared(shares_of(self.map_aspect))
        if direction == "vector" and self.warp_vector is not None:
            return frame.towards(camera.rotation @ self.warp_vector)
        if direction == "gradient":
            return frame.towards(gradient(frame, *receivers.places(camera)))
        if direction == "middle":
            return frame.towards(middle(*receivers.places(camera)))
        return frame

    def along(self, solution: Any) -> "SceneView":
        """The same view with the direction and the aspect of a solution, for what needs them given.

        Args:
            solution: a `SceneSolution` of this view.

        Returns:
            A `SceneView` with a given direction and aspect.

        Raises:
            ValueError: anything else.

        Example:
            >>> import warpopt
            >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4)
            >>> light = warpopt.DirectionalLight((0.3, -0.3, -1))
            >>> ground = warpopt.receivers.PointReceivers([(-2.0, 0.0, -8.0), (2.0, 0.0, -8.0), (0.0, 0.0, -80.0)])
            >>> view = warpopt.SceneView(camera, light, ground, warp_direction="best")
            >>> solution = warpopt.optimal_warp(view, warpopt.Objective("storage"))
            >>> turned = view.along(solution)
            >>> turned.warp_direction, warpopt.shadow_matrix(turned, solution).shape
            ('vector', (4, 4))
        """
        if not (hasattr(solution, "direction") and hasattr(solution, "shares")):
            raise ValueError(f"solution: got {shown(solution)}, expected a SceneSolution of this view")
        # With aspects of 1 the shares are (1, 1) to the last bit.
        aspect = solution.shares[0] / solution.shares[1]
        return assembled(
            SceneView, camera=self.camera, light=self.light, receivers=self.receivers, screen=self.screen,
            shadow_map=self.shadow_map, warp_direction="vector", warp_vector=solution.direction, map_aspect=aspect,
            turn_only_if=self.turn_only_if, lateral=self.lateral,
        )  # fmt: skip

    def footprint_in(self, frame: LightFrame, objective: Objective, receivers: Receivers | None = None) -> Footprint:
        """The footprint of the receivers, or of others in their place, in one frame and with the view's lateral fit.

        Called under `jax.jit`.

        Args:
            frame: W's axes.
            objective: whose moments or samples are needed.
            receivers: the view's own if None.
        """
        made = footprint_of(receivers or self.receivers, self.camera, frame, objective)
        return freed(made) if self.lateral == "free" and made.free is None else made

    def footprint(self, objective: Objective | None = None) -> Footprint:
        """The data of the receivers that a warp needs; for L-inf if no objective is given.

        Args:
            objective: E_p in L-inf if None.

        Raises:
            ValueError: an objective that the receivers do not support; an impossible answer of your own kind.
        """
        return _answers(self, objective_or_default(objective))[0]

    def reduced(self, objective: Objective | None = None) -> "SceneView":
        """The same view with its receivers reduced to their footprint, so that several calls share one pass over them.

        Args:
            objective: that of the calls; E_p in L-inf if None.

        Raises:
            ValueError: as `footprint`.

        Example:
            >>> import warpopt
            >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4)
            >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0.3, -1, -0.4))).reduced()
            >>> warpopt.shadow_matrix(view, warpopt.optimal_warp(view)).shape
            (4, 4)
        """
        return _reduced(self, objective_or_default(objective))


def _direction(direction: str | Numbers, light: DirectionalLight) -> tuple[str, Array | None]:
    """(the word, "vector" for a vector; the unit vector).

    Raises:
        ValueError: an unknown word, or no vector that has a direction across the light.
    """
    if isinstance(direction, str):
        one_of("warp_direction", direction, DIRECTIONS)
        return direction, None
    (vector,) = float_arrays(warp_direction=direction)
    if vector.shape != (3,):
        raise ValueError(f"warp_direction: got shape {vector.shape}, expected (3,), or one of {DIRECTIONS}")
    vector = checked("warp_direction", vector, lambda v: abs(v) < jnp.inf, "finite numbers")
    vector = normalised("warp_direction", vector)

    def across(vector: Array, light: Array) -> Array:
        square = (jnp.cross(vector, light) ** 2).sum(-1)
        return jnp.broadcast_to((square > 8 * jnp.finfo(vector.dtype).eps).all(), vector.shape)

    return "vector", checked("warp_direction", vector, across, "a vector that is not along the light", light.direction)


def _ratios(map_aspect: str | Numbers, turn_only_if: Numbers) -> tuple[Array | None, Array]:
    (least,) = float_arrays(turn_only_if=turn_only_if)
    if least.shape:
        raise ValueError(f"turn_only_if: got shape {least.shape}, expected one number")
    least = checked("turn_only_if", least, lambda v: (v >= 1) & (v < jnp.inf), "a finite number >= 1")
    if isinstance(map_aspect, str):
        if map_aspect != "best":
            raise ValueError(f"map_aspect: got {map_aspect!r}, expected 'best' or a positive number")
        return None, least
    (aspect,) = float_arrays(map_aspect=map_aspect)
    if aspect.shape:
        raise ValueError(f"map_aspect: got shape {aspect.shape}, expected one number")
    return checked("map_aspect", aspect, lambda v: (v > 0) & (v < jnp.inf), "a positive number, or 'best'"), least


def _of_dtype(parts: PyTree, dtype: Any) -> PyTree:
    """The parts with all floating-point arrays in that dtype."""
    inexact, others = eqx.partition(parts, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(lambda leaf: leaf.astype(dtype), inexact), others)


def settled(view: SceneView, objective: Objective | None) -> SceneView:
    """The view, checked; receivers of a user's own kind reduced to what they answered, unless traced.

    Args:
        objective: None if only the receivers' extents are needed.

    Raises:
        ValueError: several lights, an objective that the receivers do not support, an answer that none can have.
    """
    if to_be_checked(view.receivers) and not is_traced(view) and not view.searched:
        return _reduced(view, objective)
    one_light(view).receivers.check(view.camera, view.light, objective)
    return view


def _reduced(view: SceneView, objective: Objective | None) -> SceneView:
    made, extent = _answers(view, objective)
    kind = type(view.receivers).__name__
    receivers = Reduced(made, view.camera, view.light, objective or Objective(), kind, extent)
    return eqx.tree_at(lambda view: view.receivers, view, receivers)


def _answers(view: SceneView, objective: Objective | None) -> tuple[Footprint, tuple[Array, Array] | None]:
    """The footprint and, if the kind has one, the depth extent, checked."""
    one_light(view).receivers.check(view.camera, view.light, objective)
    objective = objective or Objective()
    frame, made, extent = _asked(view, objective)
    refuse_answers(view.receivers, view.camera, frame, objective, made, extent)
    return made, extent


@functools.partial(jax.jit, static_argnames=("objective",))
def _asked(view: SceneView, objective: Objective) -> tuple[LightFrame, Footprint, tuple[Array, Array] | None]:
    frame = view.frame()
    made = view.footprint_in(frame, objective)
    return frame, made, extent_if_any(view.receivers, view.camera)


def one_light(view: SceneView, more: str = "use jax.vmap over more") -> SceneView:
    """The view.

    Args:
        more: what to do with several.

    Raises:
        ValueError: it has several lights or cameras.
    """
    for name, value in (("light", view.light.direction), ("camera", view.camera.position)):
        if value.ndim != 1:
            raise ValueError(f"{name}: got shape {value.shape[:-1]}, expected one; {more}")
    return view


def refuse_other(view: object) -> None:
    """Refuse an object that is not a view.

    Raises:
        ValueError: names the type.
    """
    if not isinstance(view, FrustumView | SceneView):
        raise ValueError(f"view: got {type(view).__name__}, expected a warpopt.FrustumView or a warpopt.SceneView")

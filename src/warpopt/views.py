"""Camera, receivers and light: the first argument of the main functions."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ._checks import Numbers, instance, is_traced
from ._words import shown
from .objective import Objective, objective_or_default
from .receivers.answers import extent_if_any, footprint_of, refuse_answers, to_be_checked
from .receivers.footprint import Footprint
from .receivers.receivers import Receivers
from .receivers.reduced import Reduced
from .receivers.whole_frustum import WholeFrustum
from .theory.camera import Camera, DirectionalLight
from .theory.light_frame import LightFrame, resolutions
from .theory.light_space import LightSpace, checked_theta
from .theory.view_frustum import ViewFrustum


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

    Raises:
        ValueError: an argument of the wrong class, a resolution that is not two positive numbers, or
            only one of the two.

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

    def __init__(
        self,
        camera: Camera,
        light: DirectionalLight,
        receivers: Receivers | None = None,
        *,
        screen: Numbers | None = None,
        shadow_map: Numbers | None = None,
    ):
        instance("camera", camera, Camera)
        instance("light", light, DirectionalLight)
        receivers = WholeFrustum() if receivers is None else receivers
        if not isinstance(receivers, Receivers):
            raise ValueError(
                f"receivers: got {shown(receivers)}, expected one of warpopt.receivers, or a class of your own that "
                "derives from its Receivers"
            )
        dtype = jnp.result_type(*jax.tree.leaves(eqx.filter((camera, light, receivers), eqx.is_inexact_array)))
        # Resolutions are whole numbers: their dtype says nothing about the precision asked for.
        parts = camera, light, receivers, *resolutions(screen, shadow_map)
        self.camera, self.light, self.receivers, self.screen, self.shadow_map = _of_dtype(parts, dtype)

    def frame(self) -> LightFrame:
        """W's axes, and the screen's units along them."""
        return LightFrame(self.camera, self.light, self.screen, self.shadow_map)

    def footprint(self, objective: Objective | None = None) -> Footprint:
        """The data of the receivers that a warp needs; for L-inf if no objective is given.

        Raises:
            ValueError: an objective that the receivers do not support; an answer of your own kind that no receivers
                can have.
        """
        return _answers(self, objective_or_default(objective))[0]

    def reduced(self, objective: Objective | None = None) -> "SceneView":
        """The same view with its receivers reduced to their footprint, so that several calls share one pass over them.

        Example:
            >>> import warpopt
            >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4)
            >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0.3, -1, -0.4))).reduced()
            >>> warpopt.shadow_matrix(view, warpopt.optimal_warp(view)).shape
            (4, 4)
        """
        return _reduced(self, objective_or_default(objective))


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
    if to_be_checked(view.receivers) and not is_traced(view):
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
    made = footprint_of(view.receivers, view.camera, frame, objective)
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

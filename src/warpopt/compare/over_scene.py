"""Compares rules with the optimum and the lower bound, over the receivers of a scene."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._checks import assembled, trusted
from ..bound.lower_bound import lower_bound
from ..objective import Objective
from ..receivers.answers import extent_of, footprint_of
from ..receivers.footprint import Footprint
from ..rules.body import Body
from ..solve.outcome import failed_on_host
from ..solve.scene import norms_at, settled_scene, solve_scene
from ..solve.solution import SceneSolution
from ..theory.camera import DirectionalLight
from ..theory.light_frame import LightFrame
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Extent, Warp
from ..views import FrustumView, SceneView, one_light
from .comparison import Comparison
from .rule_set import KNOWN, Rule, stacked, takes_body, warps_over

_TOGETHER = 64  # lights in one batch


def compare_over_scene(
    view: SceneView, rules: dict[str, Rule], objective: Objective, min_eta: Float[Array | np.ndarray, ""]
) -> Comparison:
    """The comparison for every light of a view, whose light may have a leading axis.

    Raises:
        ValueError: a light with more axes, or a scene that cannot be solved.
    """
    if view.light.direction.ndim == 1:
        view = eqx.tree_at(lambda v: v.light.direction, view, view.light.direction[None])
    if view.light.direction.ndim != 2 or not len(view.light.direction):
        raise ValueError(
            f"light: got direction of shape {view.light.direction.shape}, expected (3,), or (T, 3), as "
            "jax.vmap(warpopt.DirectionalLight)(directions) makes it"
        )
    count = len(view.light.direction)
    one_light(_one_of(view, 0), "call compare_rules for each")
    on_host = eqx.tree_at(lambda v: v.light, view, jax.tree.map(np.asarray, view.light))
    for k in range(count):  # receivers may accept only some lights
        settled_scene(_one_of(on_host, k), objective)
    by_body = tuple(name for name, rule in rules.items() if takes_body(name, rule))
    by_apex = {name: rule for name, rule in rules.items() if name not in by_body}
    whole = _frusta(view)
    # One light at a time: a user's rule may require scalars.
    given = [warps_over(by_apex, jax.tree.map(lambda v, k=k: v[k], whole)) for k in range(count)] if by_apex else None
    apexes = None if given is None else stacked(given)
    solution, eta, defined, values = _over_lights(view, whole, apexes, by_body, objective, min_eta)
    order = [[*by_body, *by_apex].index(name) for name in rules]
    eta, defined, values = (np.asarray(v).T for v in (eta, defined, values))
    unwarped, eta, defined = values[-1], eta[order], defined[order]
    values = np.where(defined & ~failed_on_host(solution.result), values[order], np.nan)
    bound, reason = _bounds(view, objective)
    theta = np.asarray(solution.frame.theta)
    return Comparison(tuple(rules), theta, solution, bound, reason, eta, defined, values, unwarped, None, None)


def _one_of(view: SceneView, k: int) -> SceneView:
    return eqx.tree_at(lambda v: v.light, view, jax.tree.map(lambda v: v[k], view.light))


@jax.jit
def _frusta(view: SceneView) -> FrustumView:
    """For each light AT09's frustum with the window's extent along the warp, under the light's angle.

    Without a far plane, it ends at the farthest receiver.
    """
    far = _far(view)

    def one(light: DirectionalLight) -> FrustumView:
        camera, frame = view.camera, LightFrame(view.camera, light)
        # Z_w's image on the screen: perpendicular to X_w's
        along = jnp.stack([-frame.x_axis[1], frame.x_axis[0]])
        along = along / jnp.sqrt((along * along).sum())
        reach = jnp.abs(camera.corner_slopes()[:, :2] @ along).max()
        frustum = assembled(ViewFrustum, near=camera.near, far=far, half_fov=jnp.arctan(reach))
        return assembled(FrustumView, frustum=frustum, theta=jnp.clip(frame.theta, 0, jnp.pi))

    return jax.vmap(one)(view.light)


@functools.partial(jax.jit, static_argnames=("names", "objective"))
def _over_lights(
    view: SceneView, whole: FrustumView, apexes: Warp | None, names: tuple[str, ...], objective: Objective,
    min_eta: Float[Array, ""],
) -> tuple[SceneSolution, Array, Array, Array]:  # fmt: skip
    """For each light: the optimum, each rule's (eta, defined), and the norms of these and of no warp."""

    def one(inputs):
        light, frustum, given = inputs
        seen = eqx.tree_at(lambda v: v.light, view, light)
        solution = solve_scene(seen, objective, min_eta)
        footprint, ahead = solution.footprint, solution.frame
        if seen.searched or seen.warp_direction != "view" or seen.lateral != "eye":
            # Rules are for a map along the view, with its axis through the eye.
            ahead = seen.frame_along("view")
            footprint = footprint_of(seen.receivers, seen.camera, ahead, objective)
        body = _body(view, footprint, frustum.half_fov)
        with trusted():  # values of a solution need no check
            warps = [KNOWN[name](body, jnp.clip(solution.frame.theta, 0, jnp.pi)) for name in names]
        eta, defined = [warp.eta for warp in warps], [warp.defined for warp in warps]
        if given is not None:
            kept = given.over(footprint)
            eta, defined = [*eta, *jnp.where(kept.defined, kept.eta, 1)], [*defined, *kept.defined]
        dtype = footprint.mu.dtype
        every = jnp.stack([*(jnp.asarray(v, dtype) for v in eta), jnp.ones((), dtype)])
        values = norms_at(footprint, ahead, objective, every)
        return solution, every[:-1], jnp.stack([jnp.asarray(v, bool) for v in defined]), values

    together = 1 if view.receivers.one_at_a_time else min(_TOGETHER, len(view.light.direction))
    return jax.lax.map(one, (view.light, whole.frustum, apexes), batch_size=together)


def _body(view: SceneView, footprint: Footprint | Extent, half_fov: Array) -> Body:
    """The body that rules receive; without receivers, its depths are the frustum's."""
    extent, planes = extent_of(view.receivers, view.camera), (view.camera.near, _far(view))
    there = extent[0] <= extent[1]
    near, far = (jnp.where(there, v, end) for v, end in zip(extent, planes, strict=True))
    return Body(near, far, half_fov, footprint.start, footprint.mu, *planes)


def _far(view: SceneView) -> Array:
    """The camera's far plane, or the farthest receiver if there is none."""
    near, far = view.camera.near, view.camera.far
    farthest = extent_of(view.receivers, view.camera)[1]
    return jnp.where(far < jnp.inf, far, jnp.where(farthest > near, farthest, 2 * near))


def _bounds(view: SceneView, objective: Objective) -> tuple[NDArray | None, str | None]:
    """(each light's lower bound, or None and the reason as text)."""
    if objective.no_bound_because:
        return None, objective.no_bound_because
    try:
        bounds = [lower_bound(_one_of(view, k), objective) for k in range(len(view.light.direction))]
    except ValueError as error:  # receivers without a profile; all other errors were checked before
        return None, f"No lower bound is known: {error}."
    return np.array(bounds), None

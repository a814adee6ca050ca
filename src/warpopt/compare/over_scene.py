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
    parallel = view.camera.is_orthographic
    every, rules = tuple(rules), {name: rule for name, rule in rules.items() if not parallel or rule is KNOWN["ssm"]}
    by_body = tuple(name for name, rule in rules.items() if takes_body(name, rule))
    by_apex = {name: rule for name, rule in rules.items() if name not in by_body}
    half_fov, apexes = np.zeros(count), None  # parallel rays have no field of view
    if not parallel:
        whole = _frusta(view)
        half_fov = whole.frustum.half_fov
        # One light at a time: a user's rule may require scalars.
        given = [warps_over(by_apex, jax.tree.map(lambda v, k=k: v[k], whole)) for k in range(count)] if by_apex else []
        apexes = stacked(given) if given else None
    solution, eta, defined, values = _over_lights(view, half_fov, apexes, by_body, objective, min_eta)
    each = list(zip(*(np.asarray(v).T for v in (eta, defined, values)), strict=True))
    found, unwarped = dict(zip([*by_body, *by_apex], each[:-1], strict=True)), each[-1][2]
    none = np.ones_like(unwarped), np.zeros(count, bool), unwarped
    eta, defined, values = (np.stack(v) for v in zip(*(found.get(name, none) for name in every), strict=True))
    values = np.where(defined & ~failed_on_host(solution.result), values, np.nan)
    views = [_one_of(view, k) for k in range(count)]
    if view.searched:  # the bound is along the optimum's direction
        views = [one.along(jax.tree.map(lambda v, k=k: v[k], solution)) for k, one in enumerate(views)]
    bound, reason = _bounds(views, objective)
    theta = np.asarray(solution.frame.theta)
    why = None
    if len(found) < len(every):
        why = "Rules are formulas of a perspective frustum, and parallel rays have no eye."
    return Comparison(every, theta, solution, bound, reason, eta, defined, values, unwarped, None, None, why)


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
    view: SceneView, half_fov: Float[Array | np.ndarray, " T"], apexes: Warp | None, names: tuple[str, ...],
    objective: Objective, min_eta: Float[Array, ""],
) -> tuple[SceneSolution, Array, Array, Array]:  # fmt: skip
    """For each light: the optimum, and (eta, defined, the norm) of each rule and of no warp."""

    def one(inputs):
        light, half_fov, given = inputs
        seen = eqx.tree_at(lambda v: v.light, view, light)
        solution = solve_scene(seen, objective, min_eta)
        footprint, ahead = solution.footprint, solution.frame
        if seen.searched or seen.warp_direction != "view" or seen.lateral != "eye":
            # Rules are for a map along the view, with its axis through the eye.
            ahead = seen.frame_along("view")
            footprint = footprint_of(seen.receivers, seen.camera, ahead, objective)
        body = _body(view, footprint, half_fov)
        with trusted():  # values of a solution need no check
            warps = [KNOWN[name](body, jnp.clip(solution.frame.theta, 0, jnp.pi)) for name in names]
        eta, defined = [warp.eta for warp in warps], [warp.defined for warp in warps]
        if given is not None:
            kept = given.over(footprint)
            eta, defined = [*eta, *jnp.where(kept.defined, kept.eta, 1)], [*defined, *kept.defined]
        dtype = footprint.mu.dtype
        every = jnp.stack([*(jnp.asarray(v, dtype) for v in eta), jnp.ones((), dtype)])
        values = norms_at(footprint, ahead, objective, every)
        return solution, every, jnp.stack([jnp.asarray(v, bool) for v in (*defined, True)]), values

    together = 1 if view.receivers.one_at_a_time else min(_TOGETHER, len(view.light.direction))
    return jax.lax.map(one, (view.light, half_fov, apexes), batch_size=together)


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


def _bounds(views: list[SceneView], objective: Objective) -> tuple[NDArray | None, str | None]:
    """(each view's lower bound, or None and the reason as text)."""
    if objective.no_bound_because:
        return None, objective.no_bound_because
    try:
        bounds = [lower_bound(view, objective) for view in views]
    except ValueError as error:  # receivers without a profile; all other errors were checked before
        return None, f"No lower bound is known: {error}."
    return np.array(bounds), None

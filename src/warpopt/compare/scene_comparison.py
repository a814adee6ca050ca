"""Every rule beside the optimum over the receivers of a scene."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..receivers.convex_body import ConvexBody
from ..receivers.depth_buffer import DepthBuffer
from ..receivers.depth_histogram import DepthHistogram
from ..receivers.footprint import Footprint, Receivers
from ..receivers.points import PointReceivers, seen_from
from ..rules import Body, tsm_alternative
from ..solve.outcome import Outcome
from ..solve.scene_limit import scene_limit
from ..solve.scene_warp import checked_problem, norms_at, scene_warp
from ..theory.camera import Camera, DirectionalLight
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.frustum import ViewFrustum
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightSpace
from .comparison import Comparison, no_limit_because
from .rule_set import KNOWN, Rule, Rules, rule_set, warps_of

_TOGETHER = 64  # lights in one batch


def compare_scene_rules(
    camera: Camera,
    lights: DirectionalLight,
    receivers: Receivers | None = None,
    rules: Rules = None,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    *,
    screen: tuple[int, int] | None = None,
    shadow_map: tuple[int, int] | None = None,
    min_eta: float = 1e-4,
) -> Comparison:
    """Rules for lambda beside the optimum and the limit, over what is seen, for each of several lights.

    warpopt's own rules are applied as their sources apply them, to the receivers (`rules.Body`): n and f are the
    nearest and farthest eye depth (or the camera's own planes, where a source takes those), y_min and d the start and
    length of their extent along Z_w, half_fov that of the frustum with the camera's window along the warp. A rule of
    the user's, and `tsm_alternative`, whose focus region is a part of V, are given V as (frustum, theta), and their
    apex is kept in eye coordinates: lambda over the receivers is lambda + start - start of V,
    eta = lambda / (lambda + mu); not defined where that is not positive.

    Args:
        lights: `DirectionalLight` with a leading axis, as `jax.vmap(DirectionalLight)` makes it from (T, 3).
        camera, receivers, metric, norm, screen, shadow_map, min_eta: as in `scene_warp`.
        rules: as in `compare_rules`.

    Raises:
        ValueError: bad arguments, as `compare_rules` and `scene_warp`.

    `limit` is None where `scene_limit` knows none (`no_limit_because`); that of a depth buffer or of points is one over
    bins of depth, which a warp can be up to 8 % below. `regions` and `peaks` are None.

    Example:
        >>> import jax, warpopt
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.5)
        >>> lights = jax.vmap(warpopt.DirectionalLight)(jax.numpy.array([[0.0, -1.0, 0.0]]))
        >>> box = warpopt.ConvexBody.box((-20, 0, -80), (20, 2, -5))
        >>> comparison = compare_scene_rules(camera, lights, box, ["ssm", "lispsm"])   # seen from z = 5 to 80
        >>> comparison.ratio.round(3).tolist()
        [[4.0], [1.0]]
    """
    found = rule_set(rules)
    if not (isinstance(lights, DirectionalLight) and lights.direction.ndim == 2 and len(lights.direction)):
        raise ValueError(f"lights: got {lights!r}, expected jax.vmap(warpopt.DirectionalLight)(directions)")
    by_body = tuple(n for n, rule in found.items() if KNOWN.get(n) is rule and rule is not tsm_alternative)
    by_apex = {n: rule for n, rule in found.items() if n not in by_body}
    frusta, theta, starts = _frusta(camera, lights)
    apexes = _apexes(by_apex, frusta, theta, starts)
    scenes = (metric, norm, screen, shadow_map, min_eta)
    solution, eta, defined, values = _over_lights(camera, lights, receivers, frusta, apexes.T, by_body, scenes)
    order = [[*by_body, *by_apex].index(name) for name in found]
    eta, defined, values = (np.asarray(v).T for v in (eta, defined, values))
    unwarped, failed = values[-1], np.asarray(solution.result) > Outcome.empty
    eta, defined = eta[order], defined[order]
    values = np.where(defined & ~failed, values[order], np.nan)
    best, reason = _limits(camera, lights, receivers, metric, norm, screen, shadow_map)
    theta = np.asarray(solution.frame.theta)
    return Comparison(tuple(found), theta, solution, best, reason, eta, defined, values, unwarped, None, None)


@jax.jit
def _frusta(camera: Camera, lights: DirectionalLight) -> tuple[ViewFrustum, Array, Array]:
    """For each light (AT09's frustum with the window's extent along the warp, theta, where it begins along Z_w)."""

    def one(light):
        frame = LightFrame(camera, light)
        # Z_w's image on the screen: perpendicular to X_w's
        along = jnp.stack([-frame.x_axis[1], frame.x_axis[0]])
        along = along / jnp.sqrt((along * along).sum())
        reach = jnp.abs(camera.corner_slopes()[:, :2] @ along).max()
        frustum = ViewFrustum(camera.near, camera.far, jnp.arctan(reach))
        theta = jnp.clip(frame.theta, 0, jnp.pi)
        return frustum, theta, LightSpace(frustum, theta).minimum_depth

    return jax.vmap(one)(lights)


def _apexes(rules: dict[str, Rule], frusta: ViewFrustum, theta: Array, starts: Array) -> Array:
    """(rules, lights) Z_w . apex from the eye; -inf for no warp, NaN where a rule is not defined."""
    if not rules:
        return jnp.zeros((0, len(theta)), theta.dtype)
    mu = LightSpace(frusta, theta).mu
    # One light at a time: a user's rule may want a frustum of numbers.
    columns = []
    for k in range(len(theta)):
        one = jax.tree.map(lambda leaf, k=k: leaf[k], frusta)
        eta, defined = warps_of(rules, one, theta[k : k + 1])
        lam = jnp.where(eta < 1, mu[k] * eta / jnp.where(eta < 1, 1 - eta, 1), jnp.inf)
        columns.append(jnp.where(defined, starts[k] - lam, jnp.nan)[:, 0])
    return jnp.stack(columns, -1)


@functools.partial(jax.jit, static_argnames=("names", "scenes"))
def _over_lights(camera, lights, receivers, frusta, apexes, names, scenes):
    """For each light: the optimum, each rule's (eta, defined), and the norms of these and of no warp."""
    metric, norm, screen, shadow_map, min_eta = scenes
    resolutions = {"screen": screen, "shadow_map": shadow_map}
    _, norms, _ = checked_problem(camera, lights, receivers, metric, norm, screen, shadow_map)

    def one(inputs):
        light, frustum, apex = inputs
        solution = scene_warp(camera, light, receivers, metric, norm, **resolutions, min_eta=min_eta, throw=False)
        body = _body(camera, receivers, solution.footprint, frustum)
        theta = jnp.clip(solution.frame.theta, 0, jnp.pi)
        warps = [KNOWN[name](body, theta) for name in names]
        lam = body.start - apex
        positive = lam > 0
        bounded = jnp.where(positive & jnp.isfinite(lam), lam, 1)
        by_apex = jnp.where(positive & jnp.isfinite(lam), bounded / (bounded + body.mu), 1)
        eta = jnp.concatenate([jnp.asarray([warp.eta for warp in warps], body.mu.dtype), by_apex])
        defined = jnp.concatenate([jnp.asarray([warp.defined for warp in warps], bool), positive])
        every = jnp.concatenate([eta, jnp.ones(1, eta.dtype)])
        values = norms_at(solution.footprint, solution.frame, norms, every)
        return solution, eta, defined, values

    together = 1 if isinstance(receivers, DepthBuffer) else min(_TOGETHER, len(lights.direction))
    return jax.lax.map(one, (lights, frusta, apexes), batch_size=together)


def _body(camera: Camera, receivers: Receivers | None, footprint: Footprint, frustum: ViewFrustum) -> Body:
    """What the rules are told of the receivers; of none, the frustum's depths."""
    if isinstance(receivers, ConvexBody):
        points, there = receivers.vertices(camera)
        z = points[:, 2]
    elif isinstance(receivers, PointReceivers):
        points = camera.to_eye(receivers.points)
        z, there = points[:, 2], (receivers.weights > 0) & seen_from(camera, points)
    elif isinstance(receivers, DepthBuffer):
        z = receivers.eye_depth(camera)
        there = jnp.isfinite(z)
    elif isinstance(receivers, DepthHistogram):
        filled = receivers.counts > 0
        z = jnp.stack([receivers.edges[:-1], receivers.edges[1:]])
        there = filled & (receivers.edges[1:] > camera.near) & (receivers.edges[:-1] < camera.far)
        there = jnp.broadcast_to(there, z.shape)
        z = jnp.clip(z, camera.near, camera.far)
    else:
        z = jnp.stack([camera.near, camera.far])
        there = jnp.ones(2, bool)
    near, far = jnp.where(there, z, jnp.inf).min(), jnp.where(there, z, -jnp.inf).max()
    near, far = (jnp.where(there.any(), v, end) for v, end in ((near, camera.near), (far, camera.far)))
    return Body(near, far, frustum.half_fov, footprint.start, footprint.mu, camera.near, camera.far)


def _limits(camera, lights, receivers, metric, norm, screen, shadow_map) -> tuple[np.ndarray | None, str | None]:
    """(each light's limit, or None and why not in words)."""
    reason = None if metric == "max" else no_limit_because(ErrorNorm.of(metric, norm, "screen"))
    if reason:
        return None, reason
    each = (jax.tree.map(lambda leaf, k=k: leaf[k], lights) for k in range(len(lights.direction)))
    try:
        found = [
            scene_limit(camera, light, receivers, metric, norm, screen=screen, shadow_map=shadow_map) for light in each
        ]
    except ValueError as error:  # none for these receivers: all else was checked before
        return None, f"No limit is known: {error}."
    return np.array(found), None

"""The optimal warp for a camera, a light and what the camera sees."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from .._checks import checked, instance
from .._numerics import larger, power
from ..receivers.footprint import Footprint, Receivers
from ..receivers.view_frustum import WholeFrustum
from ..theory.camera import Camera, DirectionalLight
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.light_frame import LightFrame
from ..theory.light_space import Depth
from ..theory.warp import Warp
from .footprint_optimum import LogNorm, Term, minimise, value_at
from .outcome import Outcome


class SceneSolution(eqx.Module):
    """An optimal warp for a scene, and what is needed to render with it.

    Attributes:
        warp: the optimal `Warp`; its lam and mu are lengths along W's axis, over the receivers.
        value: the minimal norm, in the units of `LightFrame`'s densities; 0 for no receivers, and of E_p for receivers
            at one depth.
        result: an `Outcome`.
        residual: as `Solution.residual`.
        margin: d log(norm) / d log(eta) just below eta = 1. A warp helps iff it is positive: by how much no warp is, or
            is not, the best. 0 where there is nothing to warp (flat, empty).
        unwarped: the norm without a warp.
        excess: bound on the regret of grouping many points or pixels conservatively: `value` over a lower bound of the
            minimum that the receivers one by one would have, less 1. 0 where nothing is grouped.
        frame: W's axes.
        footprint: the receivers' extents.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> solution = warpopt.scene_warp(camera, warpopt.DirectionalLight((0, -1, 0)))
        >>> near, far = camera.to_eye([(0.0, 0.0, -1.0), (0.0, 0.0, -100.0)])
        >>> [round(float(solution.aliasing_error(point)), 2) for point in (near, far)]   # a tie: the optimum
        [17.15, 17.15]
    """

    warp: Warp
    value: Float[Array, ""]
    result: Int[Array, ""]
    residual: Float[Array, ""]
    margin: Float[Array, ""]
    unwarped: Float[Array, ""]
    excess: Float[Array, ""]
    frame: LightFrame
    footprint: Footprint

    def coordinates(self, eye_points: Float[Array, "... 3"]) -> tuple[Depth, Float[Array, "..."], Float[Array, "..."]]:
        """(depth as delta and 1 - delta, x from W's axis, eye depth z) of points in eye coordinates."""
        return self.footprint.coordinates(self.frame, eye_points)

    def aliasing_error(
        self, eye_points: Float[Array, "... 3"], metric: str | Metric = "p", eta: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """E at points in eye coordinates (`Camera.to_eye`), for the optimal warp or any other eta.

        E_p = density_p mu A^2 / (z eta), E_q = density_q width A / z: AT09 (13), (14) along W's axes. "max" is the
        larger of the two.
        """
        eta = self.warp.eta if eta is None else jnp.asarray(eta, self.warp.eta.dtype)
        depth, _, z = self.coordinates(eye_points)
        blend = depth.blend(eta)
        along = self.frame.density_p * self.footprint.mu / z * blend * (blend / eta)
        left, right = self.footprint.half_widths(eta)
        across = self.frame.density_q * (left + right) / z * blend
        if metric == "max":
            return larger(along, across)
        one = Metric.of(metric)
        return power(along, one.alpha) * power(across, one.beta)


def scene_warp(
    camera: Camera,
    light: DirectionalLight,
    receivers: Receivers | None = None,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    *,
    screen: tuple[int, int] | None = None,
    shadow_map: tuple[int, int] | None = None,
    min_eta: float = 1e-4,
    throw: bool = True,
) -> SceneSolution:
    """The warp that minimises the norm of an aliasing error over the receivers; the global minimum.

    One camera and one light of any direction; `jax.vmap` over more (with `throw=False`).

    Args:
        camera, light: in world space.
        receivers: `WholeFrustum(measure)` (the default), `ConvexBody`, `PointReceivers`, `DepthBuffer` or
            `DepthHistogram`.
        metric: "p", "q", "pxq", `Metric(alpha, beta)`, or "max", the larger of E_p and E_q (L-inf only).
        norm: "inf", "l1", "l2" or an order that makes (2 alpha + beta) order an integer.
        screen, shadow_map: resolutions, see `LightFrame`. They scale errors, and weigh E_p against E_q in "max".
        min_eta: the smallest eta, for metrics without E_p, whose infimum may be at eta = 0 (`Outcome.unbounded`).
        throw: raise if the solve failed.

    Raises:
        ValueError: bad arguments.
        RuntimeError: a failed solve, with `throw` (`equinox.EquinoxRuntimeError` when traced).

    No receivers, receivers at one depth, or a light along the view are outcomes and no errors. First derivatives in
    camera, light and receivers are those of the equation that fixed eta.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> solution = warpopt.scene_warp(camera, warpopt.DirectionalLight((0, -1, 0)))
        >>> round(float(solution.warp.lam), 3)   # n + sqrt(f n), LiSPSM's, with the light from above
        11.0
    """
    receivers, norms, resolutions = checked_problem(camera, light, receivers, metric, norm, screen, shadow_map)
    if not (isinstance(min_eta, int | float) and 0 < min_eta < 1):
        raise ValueError(f"min_eta: got {min_eta!r}, expected a number in (0, 1)")
    solution = _solve(camera, light, receivers, norms, *resolutions, float(min_eta))
    return _raised(solution) if throw else solution


def scene_error_norm(
    camera: Camera,
    light: DirectionalLight,
    receivers: Receivers | None,
    eta: ArrayLike,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    *,
    screen: tuple[int, int] | None = None,
    shadow_map: tuple[int, int] | None = None,
) -> Float[Array, "..."]:
    """The norm of an aliasing error over the receivers, for any warp: what `scene_warp` minimises.

    Args:
        eta: warps over the receivers' own depth range (`Footprint.start`, `Footprint.mu`), of any shape.
        camera, light, receivers, metric, norm, screen, shadow_map: as in `scene_warp`.

    Raises:
        ValueError: as `scene_warp`, or eta outside (0, 1].

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> light = warpopt.DirectionalLight((0, -1, 0))
        >>> unwarped, lispsm = scene_error_norm(camera, light, None, (1.0, 0.1))
        >>> round(float(unwarped / lispsm), 3)
        10.0
    """
    receivers, norms, resolutions = checked_problem(camera, light, receivers, metric, norm, screen, shadow_map)
    eta = checked("eta", jnp.asarray(eta, camera.near.dtype), lambda v: (v > 0) & (v <= 1), "numbers in (0, 1]")
    return _norm_of(camera, light, receivers, eta, norms, *resolutions)


def checked_problem(camera, light, receivers, metric, norm, screen, shadow_map):
    """(receivers, norms, resolutions), with everything refused that `scene_warp` refuses of them."""
    instance("camera", camera, Camera)
    instance("light", light, DirectionalLight)
    receivers = WholeFrustum() if receivers is None else receivers
    if not hasattr(receivers, "footprint"):
        raise ValueError(f"receivers: got {type(receivers).__name__}, expected WholeFrustum, ConvexBody or the like")
    measure = getattr(receivers, "measure", "screen")
    metrics = (Metric(1.0, 0.0), Metric(0.0, 1.0)) if metric == "max" else (Metric.of(metric),)
    norms = tuple(ErrorNorm.of(one, norm, measure) for one in metrics)
    if metric == "max" and not norms[0].supremum:
        raise ValueError(f"norm: got {norm!r}, expected 'inf' with metric 'max'")
    degree = norms[0].blend_degree
    if not (math.isinf(degree) or degree == round(degree)):
        raise ValueError(f"norm: got order {norms[0].order:g}, expected one with (2 alpha + beta) order an integer")
    return receivers, norms, tuple(tuple(r) if isinstance(r, list) else r for r in (screen, shadow_map))


def _log_norm(footprint: Footprint, frame: LightFrame, norms: tuple[ErrorNorm, ...]) -> LogNorm:
    terms = tuple(_term(footprint, frame, norm) for norm in norms)
    return LogNorm(footprint, terms, None if norms[0].supremum else norms[0])


def norms_at(footprint: Footprint, frame: LightFrame, norms: tuple[ErrorNorm, ...], eta: Array) -> Array:
    """The norm for every eta over a footprint that was made for `norms`; 0 for no receivers."""
    log_norm = _log_norm(footprint, frame, norms)
    values = jax.vmap(lambda u: value_at(log_norm, u))(jnp.log(eta).ravel())
    return jnp.where(footprint.empty, 0, values).reshape(eta.shape)


@functools.partial(jax.jit, static_argnames=("norms", "screen", "shadow_map"))
def _norm_of(camera, light, receivers, eta, norms, screen, shadow_map) -> Array:
    frame = LightFrame(camera, light, screen, shadow_map)
    return norms_at(receivers.footprint(camera, frame, norms[0]), frame, norms, eta)


@functools.partial(jax.jit, static_argnames=("norms", "screen", "shadow_map", "min_eta"))
def _solve(camera, light, receivers, norms, screen, shadow_map, min_eta) -> SceneSolution:
    frame = LightFrame(camera, light, screen, shadow_map)
    footprint = receivers.footprint(camera, frame, norms[0])
    log_norm = _log_norm(footprint, frame, norms)
    optimum = minimise(log_norm, min_eta)
    value, unwarped = value_at(log_norm, optimum.log_eta), value_at(log_norm, jnp.zeros_like(optimum.log_eta))
    excess = jnp.zeros_like(value)
    # An L_P norm of E_p has its moments from the receivers one by one: groups lose nothing.
    if footprint.grouped and (norms[0].supremum or norms[0].metric.beta):
        best_case = eqx.tree_at(lambda n: n.footprint, log_norm, footprint.at_best())
        least = value_at(best_case, minimise(best_case, min_eta).log_eta)
        excess = jnp.where(least > 0, value / jnp.where(least > 0, least, 1) - 1, 0)
        excess = jnp.where(excess > 0, excess, 0)
    value, unwarped, excess = (jnp.where(footprint.empty, 0, v) for v in (value, unwarped, excess))
    finite = jnp.isfinite(value) & jnp.isfinite(optimum.log_eta)
    outcome = jnp.where(finite, optimum.outcome, Outcome.not_finite)
    log_eta = jnp.where(finite, optimum.log_eta, jnp.nan)
    warp = Warp(jnp.exp(log_eta), -jnp.expm1(log_eta), footprint.mu, jnp.ones((), bool))
    return SceneSolution(warp, value, outcome, optimum.residual, optimum.margin, unwarped, excess, frame, footprint)


def _term(footprint: Footprint, frame: LightFrame, norm: ErrorNorm) -> Term:
    """E_p = density_p mu A^2 / (z eta) and E_q = density_q width A / z: the factors that eta does not change."""
    alpha, beta = norm.metric.alpha, norm.metric.beta
    factor = alpha * jnp.log(footprint.mu * frame.density_p) + beta * jnp.log(frame.density_q)
    if alpha:  # receivers at one depth have no texels along Z_w
        factor = jnp.where(footprint.flat, -jnp.inf, factor)
    if not norm.supremum:
        factor = factor - norm.metric.depth_power * jnp.log(footprint.unit)
    return Term(factor, alpha, beta)


def _raised(solution: SceneSolution) -> SceneSolution:
    bad = solution.result > Outcome.empty
    words = "scene_warp failed; pass throw=False to get the outcome as SceneSolution.result"
    if isinstance(bad, jax.core.Tracer):
        return eqx.error_if(solution, bad, words)
    if bad.any():
        raise RuntimeError(f"{Outcome(int(solution.result[bad].ravel()[0])).sentence} ({words})")
    return solution

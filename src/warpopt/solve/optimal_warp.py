"""The optimal warp: frustum and light in, eta with its certificate out."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from .._numerics import over, power, staged
from ..receivers.whole_frustum import Moments, moments
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.frustum import ViewFrustum
from ..theory.light_space import LightSpace, checked_theta
from ..theory.warp import Warp
from .chunks import in_blocks, in_chunks
from .outcome import Outcome, failed
from .power_mean import minimise_power_mean
from .quadrature import QuadratureMean, default_nodes, has_moments
from .supremum import in_units_of_error, minimise_supremum, supremum_norm


class Solution(eqx.Module):
    """An optimal warp and what is known about it.

    Attributes:
        warp: the optimal `Warp` (eta, lam, mu).
        value: the minimal norm.
        result: array of `Outcome`, the mechanism that fixed the optimum or the reason for failure.
        residual: by how much the equation that fixed eta is violated: |log P+ - log P-| of the stationarity condition,
            or the relative gap of the tie; 0 for a kink or no warp. Where the optimum is stationary, the condition
            changes sign once and its slope in log(eta) is at least 1 (moments, L-inf), so that log(eta) is within the
            residual, and the rounding of evaluating it, of the global optimum.

    Example:
        >>> import warpopt
        >>> solution = warpopt.optimal_warp(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 0.0)
        >>> warpopt.Outcome(int(solution.result)).name, float(solution.warp.eta), float(solution.residual)
        ('no_warp', 1.0, 0.0)
    """

    warp: Warp
    value: Float[Array, "..."]
    result: Int[Array, "..."]
    residual: Float[Array, "..."]


def optimal_warp(
    frustum: ViewFrustum,
    theta: ArrayLike,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    measure: str = "screen",
    *,
    method: str = "auto",
    quadrature_nodes: int | None = None,
    throw: bool = True,
) -> Solution:
    """The warp that minimises the norm of an aliasing error over the view frustum; the global minimum.

    Args:
        frustum: the view frustum, of any shape that broadcasts with theta.
        theta: angle between light and view direction, radians in [0, pi]; mirror-symmetric about pi/2.
        metric: "p", "q", "pxq" or `Metric(alpha, beta)`.
        norm: "inf", "l1", "l2" or any real order >= 1 (a power mean over the measure).
        measure: "volume", "screen", "log_depth", "ground" or "axis".
        method: "auto" solves in closed form what has one; "iterative" forces the root finder everywhere.
        quadrature_nodes: nodes over the depth for norms whose M = (2 alpha + beta) order is not an integer, which are
            integrated numerically (default: 64, and more for large orders, whose integrands peak; beyond an order of
            about 100 give more, or the outcome is `inaccurate`); given, it forces that for every L_P norm.
        throw: raise if any problem failed; otherwise `Solution.result` tells.

    Raises:
        ValueError: bad arguments, or a norm whose optimum could not be certified.
        RuntimeError: a failed solve, with `throw` (`equinox.EquinoxRuntimeError` when traced).

    Derivatives (jvp, grad) of eta, lam and value in near, far, half_fov and theta are implicit: of the root, the tie or
    the kink that fixed eta; zero where it is clamped to no warp.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236)
        >>> solution = warpopt.optimal_warp(frustum, 1.5707963, metric="p", norm="inf")
        >>> round(float(solution.warp.lam), 3)   # n + sqrt(f n), LiSPSM's
        11.0
    """
    if method not in ("auto", "iterative"):
        raise ValueError(f"method: got {method!r}, expected 'auto' or 'iterative'")
    error_norm = ErrorNorm.of(metric, norm, measure)
    nodes = _checked_nodes(quadrature_nodes)
    solve = functools.partial(_solve, norm=error_norm, iterative=method == "iterative", nodes=nodes)
    solution = in_blocks(solve, frustum, checked_theta(theta, frustum))
    return _raised(solution) if throw else solution


def error_norm(
    frustum: ViewFrustum,
    theta: ArrayLike,
    warp: Warp,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    measure: str = "screen",
    *,
    quadrature_nodes: int | None = None,
) -> Float[Array, "..."]:
    """The norm of an aliasing error over the view frustum, for any warp. Arguments and errors as `optimal_warp`.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236)
        >>> unwarped = error_norm(frustum, 1.5707963, warpopt.rules.ssm(frustum, 1.5707963))
        >>> best = warpopt.optimal_warp(frustum, 1.5707963).value
        >>> round(float(unwarped / best), 2)
        10.0
    """
    evaluate = functools.partial(
        _norm_of, norm=ErrorNorm.of(metric, norm, measure), nodes=_checked_nodes(quadrature_nodes)
    )
    return in_blocks(evaluate, frustum, checked_theta(theta, frustum), warp.eta)


def compare_warps(
    frustum: ViewFrustum,
    theta: ArrayLike,
    warps: Warp,
    metric: str | Metric = "p",
    norm: str | float = "inf",
    measure: str = "screen",
) -> tuple[Solution, Float[Array, "..."]]:
    """The optimal warp and the norms of other warps, in one compiled call that shares what both need.

    Args:
        warps: the warps to compare with, of the problem's shape or with axes of their own in front of it.
        frustum, theta, metric, norm, measure: as in `optimal_warp`.

    Raises:
        ValueError: as `optimal_warp`. Failed solves are told by `Solution.result`.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236)
        >>> best, value = compare_warps(frustum, 1.5707963, warpopt.rules.ssm(frustum, 1.5707963))
        >>> round(float(value / best.value), 2)
        10.0
    """
    return _compare(frustum, checked_theta(theta, frustum), warps.eta, ErrorNorm.of(metric, norm, measure))


def _checked_nodes(nodes: int | None) -> int | None:
    if nodes is not None and (isinstance(nodes, bool) or not isinstance(nodes, int) or nodes < 2):
        raise ValueError(f"quadrature_nodes: got {nodes!r}, expected an integer >= 2, or None")
    return nodes


def _prepared(frustum: ViewFrustum, theta: Array, norm: ErrorNorm, nodes: int | None):
    """The light space, and for L_P norms their few numbers."""
    space = staged(LightSpace, frustum, theta)
    if norm.supremum:
        return space, None
    if has_moments(norm) and nodes is None:
        return space, staged(functools.partial(moments, norm=norm), space)
    return space, QuadratureMean(space, norm, nodes or default_nodes(norm))


def _norm(space: LightSpace, mean, eta: Array, norm: ErrorNorm) -> Array:
    if norm.supremum:
        return supremum_norm(space, eta, norm)
    return in_units_of_error(space, eta, over(mean.power_mean(eta, norm), power(eta, norm.metric.alpha)), norm)


@functools.partial(jax.jit, static_argnames=("norm", "nodes"))
def _norm_of(frustum: ViewFrustum, theta: Array, eta: Array, norm: ErrorNorm, nodes: int | None) -> Array:
    def evaluate(frustum: ViewFrustum, theta: Array, eta: Array) -> Array:
        space, mean = _prepared(frustum, theta, norm, nodes)
        return _norm(space, mean, eta, norm)

    return in_chunks(evaluate, frustum, theta, eta)


@functools.partial(jax.jit, static_argnames=("norm", "iterative", "nodes"))
def _solve(frustum: ViewFrustum, theta: Array, norm: ErrorNorm, iterative: bool, nodes: int | None) -> Solution:
    return in_chunks(functools.partial(_solve_chunk, norm=norm, iterative=iterative, nodes=nodes), frustum, theta)


@functools.partial(jax.jit, static_argnames=("norm",))
def _compare(frustum: ViewFrustum, theta: Array, eta: Array, norm: ErrorNorm) -> tuple[Solution, Array]:
    space, mean = _prepared(frustum, theta, norm, None)
    solution, values = _solution(space, mean, norm, iterative=False), _norm(space, mean, eta, norm)
    return jax.tree.map(lambda a: jnp.broadcast_to(a, solution.value.shape), solution), values


def _solve_chunk(frustum: ViewFrustum, theta: Array, norm: ErrorNorm, iterative: bool, nodes: int | None) -> Solution:
    space, mean = _prepared(frustum, theta, norm, nodes)
    return _solution(space, mean, norm, iterative)


def _solution(space: LightSpace, mean, norm: ErrorNorm, iterative: bool) -> Solution:
    if norm.supremum:
        optimum = minimise_supremum(space, norm, iterative)
    elif isinstance(mean, Moments):
        optimum = minimise_power_mean(space, mean, norm, iterative)
    else:
        optimum = mean.minimise()
    value = _norm(space, mean, optimum.eta, norm)
    finite = jnp.isfinite(value) & jnp.isfinite(optimum.eta)
    outcome = jnp.where(optimum.eta < 1, optimum.outcome, jnp.maximum(optimum.outcome, Outcome.no_warp))
    outcome = jnp.where(finite, outcome, Outcome.not_finite).astype(jnp.int32)
    # A failure must not pass for "no warp".
    eta, one_minus_eta = (jnp.where(finite, v, jnp.nan) for v in (optimum.eta, optimum.one_minus_eta))
    return Solution(Warp(eta, one_minus_eta, space.mu, jnp.ones((), bool)), value, outcome, optimum.residual)


def _raised(solution: Solution) -> Solution:
    bad = failed(solution.result)
    words = "optimal_warp failed; pass throw=False to get Solution.result, an array of warpopt.Outcome"
    if isinstance(bad, jax.core.Tracer):
        return eqx.error_if(solution, bad, words)
    if bool(bad.any()):
        first = Outcome(int(solution.result[bad].ravel()[0]))
        raise RuntimeError(
            f"{int(bad.sum())} of {bad.size} problems failed, the first thus: {first.sentence} ({words})"
        )
    return solution

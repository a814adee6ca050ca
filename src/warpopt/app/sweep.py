"""The main job's computation: every optimum and every rule over frusta and light directions, as plain arrays."""

import concurrent.futures
import dataclasses
from collections.abc import Callable, Iterable

import jax
import numpy as np

import warpopt

RULES: dict[str, Callable] = {
    "ssm": warpopt.rules.ssm,
    "psm": warpopt.rules.psm,
    "lispsm": warpopt.rules.lispsm,
    "tsm": warpopt.rules.tsm,
    "tsm_alternative": warpopt.rules.tsm_alternative,
    "minimum_norm": warpopt.rules.minimum_norm,
    "scherzer": warpopt.rules.scherzer,
}


@dataclasses.dataclass(frozen=True)
class View:
    """One view frustum, in the units of the config."""

    near: float
    far: float
    half_fov_deg: float


@dataclasses.dataclass(frozen=True)
class Curves:
    """A warp for every view and direction: arrays of shape (views, directions)."""

    eta: np.ndarray
    lam_over_mu: np.ndarray
    lam: np.ndarray


@dataclasses.dataclass(frozen=True)
class RuleCurves(Curves):
    """A published rule's warps; `defined` is False where the rule yields no lambda > 0 (the warp there is no warp)."""

    defined: np.ndarray


@dataclasses.dataclass(frozen=True)
class OptimumCurves(Curves):
    """The optimum of one objective, and every rule's norm over the minimal one."""

    metric: str
    norm: str
    value: np.ndarray
    result: np.ndarray
    residual: np.ndarray
    ratios: dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Sweep:
    """All results of a run. `views` are the config's; `context` adds more f/n for the figures, after them."""

    views: tuple[View, ...]
    context: tuple[View, ...]
    theta_deg: np.ndarray
    measure: str
    rules: dict[str, RuleCurves]
    optima: tuple[OptimumCurves, ...]

    @property
    def all_views(self) -> tuple[View, ...]:
        return self.views + self.context


def frustum_of(views: Iterable[View]) -> "warpopt.ViewFrustum":
    """The views as one frustum of shape (views, 1), against which directions broadcast."""
    near, far, half_fov_deg = np.array([dataclasses.astuple(v) for v in views], float).T[..., None]
    return warpopt.ViewFrustum(near, far, np.deg2rad(half_fov_deg))


def objectives(metrics: Iterable[str], norms: Iterable[str | float]) -> list[tuple[str, str | float]]:
    return [(metric, norm) for metric in metrics for norm in norms]


def compute_sweep(
    views: tuple[View, ...],
    context: tuple[View, ...],
    theta_deg: np.ndarray,
    metrics: list[str],
    norms: list[str | float],
    measure: str,
    progress: Callable[[str], None] = lambda name: None,
) -> Sweep:
    """Solve everything, one batched call for each objective; `progress` is told of each one done."""
    frustum = frustum_of(views + context)
    theta = np.deg2rad(theta_deg)
    warps = jax.jit(lambda frustum, theta: [rule(frustum, theta) for rule in RULES.values()])(frustum, theta)
    warps = dict(zip(RULES, warps, strict=True))
    progress("rules")
    every = jax.tree.map(lambda *fields: np.stack(fields), *warps.values())

    def solve(objective: tuple[str, str | float]) -> OptimumCurves:
        metric, norm = objective
        solution = warpopt.optimal_warp(frustum, theta, metric, norm, measure, throw=False)
        values = np.asarray(warpopt.error_norm(frustum, theta, every, metric, norm, measure))
        ratios = {name: value / np.asarray(solution.value) for name, value in zip(warps, values, strict=True)}
        found = _arrays(solution.value, solution.result, solution.residual)
        progress(f"{metric} {norm}")
        return OptimumCurves(*_curves(solution.warp), metric, str(norm), *found, ratios)

    # Most of the time is compilation, which runs outside Python's lock.
    with concurrent.futures.ThreadPoolExecutor() as pool:
        optima = tuple(pool.map(solve, objectives(metrics, norms)))
    rules = {name: RuleCurves(*_curves(warp), np.asarray(warp.defined)) for name, warp in warps.items()}
    return Sweep(views, context, np.asarray(theta_deg), measure, rules, optima)


def _curves(warp: "warpopt.Warp") -> tuple[np.ndarray, ...]:
    lam_over_mu, lam = jax.jit(lambda w: (w.lam_over_mu, w.lam))(warp)
    return _arrays(warp.eta, lam_over_mu, lam)


def _arrays(*values) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(v) for v in values)

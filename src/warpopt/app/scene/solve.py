"""The problems of a scene: for each objective one compiled program, and for each camera one call over all lights."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import warpopt

from ..common.error_maps import Mapping
from ..common.limits import no_limit_because
from ..common.record import finite_or_none
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import camera_of, receivers_of
from .settings import SceneConfig

_TOGETHER = 64  # lights in one batch


@dataclasses.dataclass(frozen=True, eq=False)
class Solved:
    """One camera, light direction and objective.

    Attributes:
        camera, light: indices of the scene's distinct ones.
        metric, norm: the objective.
        row: what the files say of it: finite numbers, text and None.
        outcome: how the solve ended.
        mapping: what its errors depend on, for pictures.
        alone: whether the scene has no other camera.
    """

    camera: int
    light: int
    metric: str
    norm: str
    row: dict[str, Any]
    outcome: "warpopt.Outcome"
    mapping: Mapping
    alone: bool

    @property
    def title(self) -> str:
        camera = "" if self.alone else f"camera {self.camera}, "
        return f"{camera}light {self.light}, E_{self.metric}, norm {self.norm}"


def solve_scene(config: SceneConfig, scene: SceneInput, progress: Callable[[str], None]) -> list[Solved]:
    """Every metric and norm that was asked for, over every distinct camera and light."""
    if not scene.lights:
        return []
    cameras = [camera_of(camera) for camera in scene.cameras]
    receivers = [receivers_of(config, scene, i) for i in range(len(cameras))]
    lights = jax.vmap(warpopt.DirectionalLight)(np.array(scene.lights, float))
    casters = None if scene.casters is None else jax.numpy.asarray(scene.casters)  # once on the device
    solved = []
    for metric, norm in itertools.product(config.objective.metrics, config.objective.norms):
        over_lights = _over_lights(config, metric, norm)
        for i, camera in enumerate(cameras):
            found = jax.device_get(over_lights(camera, lights, receivers[i], casters))
            for k, direction in enumerate(scene.lights):
                one = jax.tree.map(lambda v, k=k: v[k], found)
                problem = _solved(one, (i, k), list(direction), metric, str(norm), len(cameras) == 1)
                problem.row.update(_limit(config, camera, direction, receivers[i], metric, norm, problem.row["value"]))
                solved.append(problem)
                progress(problem.title)
    return solved


@dataclasses.dataclass(frozen=True)
class _Found:
    """What one call computes for each light."""

    solution: "warpopt.SceneSolution"
    matrix: np.ndarray
    lam: np.ndarray
    lam_over_mu: np.ndarray
    width: np.ndarray
    plain_width: np.ndarray


jax.tree_util.register_dataclass(_Found)


def _over_lights(config: SceneConfig, metric: str, norm: str | float):
    """The compiled (camera, lights, receivers, casters) -> `_Found` of one objective."""
    objective, convention = config.objective, clip_space(config)

    def one(camera, light, receivers, casters) -> _Found:
        solution = warpopt.scene_warp(
            camera,
            light,
            receivers,
            metric,
            norm,
            screen=objective.screen,
            shadow_map=objective.shadow_map,
            min_eta=objective.min_eta,
            throw=False,
        )
        footprint, warp = solution.footprint, solution.warp
        matrix = warpopt.shadow_matrix(camera, light, footprint, warp, convention, casters=casters)
        widths = (sum(footprint.half_widths(eta)) for eta in (warp.eta, jax.numpy.ones_like(warp.eta)))
        return _Found(solution, matrix, warp.lam, warp.lam_over_mu, *widths)

    @jax.jit
    def over_lights(camera, lights, receivers, casters) -> _Found:
        # A depth buffer's passes fill the machine by themselves, and its cells are tens of megabytes a light.
        together = 1 if isinstance(receivers, warpopt.DepthBuffer) else _TOGETHER
        count = len(lights.direction)
        return jax.lax.map(
            lambda light: one(camera, light, receivers, casters), lights, batch_size=min(together, count)
        )

    return over_lights


def clip_space(config: SceneConfig) -> "warpopt.ClipSpace":
    """The convention that was asked for."""
    make = getattr(warpopt.ClipSpace, config.output.convention)
    return make(reversed_z=config.output.reversed_z)


def no_scene_limit_because(metric: str, norm: str | float) -> str | None:
    """Why an objective's results are no multiples of a limit, in words; None if they are."""
    return None if metric == "max" else no_limit_because(metric, norm)  # "max" is in L-inf alone


def _limit(config: SceneConfig, camera, direction, receivers, metric: str, norm: str | float, value) -> dict[str, Any]:
    """The part of a problem's row about the limit."""
    reason = no_scene_limit_because(metric, norm)
    least = None
    if reason is None:
        least = warpopt.scene_limit(
            camera, warpopt.DirectionalLight(direction), receivers, metric, norm,
            screen=config.objective.screen, shadow_map=config.objective.shadow_map,
        )  # fmt: skip
        reason = None if least > 0 else "There are no receivers, or all are at one depth: the limit is 0."
    over_limit = value / least if least and value is not None else None
    return {"limit": least, "over_limit": over_limit, "no_limit_because": reason}


def _solved(
    found: _Found, place: tuple[int, int], direction: list[float], metric: str, norm: str, alone: bool
) -> Solved:
    solution, matrix = found.solution, found.matrix
    outcome = warpopt.Outcome(int(solution.result))
    mapping = Mapping.of(solution, found.width, found.plain_width)
    there = outcome is not warpopt.Outcome.empty  # an empty scene has no warp and no matrix
    usable = there and bool(np.isfinite(matrix).all())
    reason = None if usable else outcome.sentence if not (there and outcome.succeeded) else "The matrix is not finite."
    row = {
        "camera": place[0],
        "light": place[1],
        "direction": direction,
        "theta_deg": finite_or_none(np.rad2deg(solution.frame.theta)),
        "metric": metric,
        "norm": norm,
        "eta": finite_or_none(solution.warp.eta) if there else None,
        "lambda": finite_or_none(found.lam) if there else None,
        "lambda_over_mu": finite_or_none(found.lam_over_mu) if there else None,
        "mu": finite_or_none(solution.warp.mu) if there else None,
        "no_warp": there and bool(np.isinf(found.lam)),
        "value": finite_or_none(solution.value),
        "unwarped": finite_or_none(solution.unwarped),
        "margin": finite_or_none(solution.margin) if there and outcome is not warpopt.Outcome.flat else None,
        "excess": finite_or_none(solution.excess),
        "outcome": outcome.name,
        "sentence": outcome.sentence,
        "matrix": matrix.tolist() if usable else None,
        "no_matrix_because": reason,
    }
    return Solved(*place, metric, norm, row, outcome, mapping, alone)

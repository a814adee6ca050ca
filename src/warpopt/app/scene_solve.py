"""The problems of a scene, solved one by one with one compiled program for each objective."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import warpopt

from .scene_config import SceneConfig
from .scene_input import SceneInput
from .single import finite_or_none


@dataclasses.dataclass(frozen=True, eq=False)
class Solved:
    """One camera, light direction and objective.

    Attributes:
        camera, light: indices of the scene's distinct ones.
        metric, norm: the objective.
        row: what the files say of it: finite numbers, text and None.
        outcome: how the solve ended.
        mapping: what its errors depend on, for pictures.
    """

    camera: int
    light: int
    metric: str
    norm: str
    row: dict[str, Any]
    outcome: "warpopt.Outcome"
    mapping: "Mapping"

    @property
    def title(self) -> str:
        return f"camera {self.camera}, light {self.light}, E_{self.metric}, norm {self.norm}"


@dataclasses.dataclass(frozen=True, eq=False)
class Mapping:
    """A warped shadow map as far as its errors are concerned, in plain numbers.

    Attributes:
        x_axis, z_axis: X_w and Z_w in eye coordinates.
        light: the light's direction in eye coordinates.
        start, mu: of the footprint.
        densities: (density_p, density_q) of the light frame.
        eta: of the warp.
        width, plain_width: what the map spans across, with the warp and without.
    """

    x_axis: np.ndarray
    z_axis: np.ndarray
    light: np.ndarray
    start: float
    mu: float
    densities: tuple[float, float]
    eta: float
    width: float
    plain_width: float


def solve_scene(config: SceneConfig, scene: SceneInput, progress: Callable[[str], None]) -> list[Solved]:
    """Every metric and norm that was asked for, over every distinct camera and light."""
    cameras = [_camera(camera) for camera in scene.cameras]
    receivers = [_receivers(config, scene, i) for i in range(len(cameras))]
    casters = None if scene.casters is None else jax.numpy.asarray(scene.casters)  # once on the device
    solved = []
    for metric in config.objective.metrics:
        for norm in config.objective.norms:
            for i, camera in enumerate(cameras):
                for k, direction in enumerate(scene.lights):
                    light = warpopt.DirectionalLight(direction)
                    solved.append(_solved(config, scene, camera, receivers[i], light, casters, (i, k), metric, norm))
                    progress(solved[-1].title)
    return solved


def clip_space(config: SceneConfig) -> "warpopt.ClipSpace":
    """The convention that was asked for."""
    make = getattr(warpopt.ClipSpace, config.output.convention)
    return make(reversed_z=config.output.reversed_z)


def _camera(camera) -> "warpopt.Camera":
    _, up, forward = camera.rotation
    return warpopt.Camera.off_centre(
        camera.position, forward, up, camera.near, camera.far, camera.window, handedness=camera.handedness
    )


def _receivers(config: SceneConfig, scene: SceneInput, i: int):
    asked = config.receivers
    if scene.depths:
        return warpopt.DepthBuffer(scene.depths[i], scene.encoding)
    if asked.box is not None:
        return warpopt.ConvexBody.box(asked.box.lower, asked.box.upper, asked.box.measure)
    if asked.planes is not None:
        return warpopt.ConvexBody(np.array(asked.planes.planes), asked.planes.measure)
    return warpopt.WholeFrustum(asked.whole_frustum.measure)


def _solved(config, scene, camera, receivers, light, casters, place, metric, norm) -> Solved:
    objective = config.objective
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
    outcome = warpopt.Outcome(int(solution.result))
    convention = clip_space(config)
    matrix, width, plain_width = _rendering(camera, light, solution, casters, convention)
    matrix = np.asarray(matrix)
    frame, footprint = solution.frame, solution.footprint
    mapping = Mapping(
        np.asarray(frame.x_axis),
        np.asarray(frame.z_axis),
        np.asarray(frame.light),
        float(footprint.start),
        float(footprint.mu),
        (float(frame.density_p), float(frame.density_q)),
        float(solution.warp.eta),
        float(width),
        float(plain_width),
    )
    there = outcome is not warpopt.Outcome.empty  # an empty scene has no warp and no matrix
    usable = there and bool(np.isfinite(matrix).all())
    reason = None if usable else outcome.sentence if not (there and outcome.succeeded) else "The matrix is not finite."
    lam = float(solution.warp.lam) if there else math.nan
    row = {
        "camera": place[0],
        "light": place[1],
        "direction": list(scene.lights[place[1]]),
        "theta_deg": finite_or_none(np.rad2deg(frame.theta)),
        "metric": metric,
        "norm": norm,
        "eta": finite_or_none(solution.warp.eta) if there else None,
        "lambda": finite_or_none(lam),
        "lambda_over_mu": finite_or_none(solution.warp.lam_over_mu) if there else None,
        "mu": finite_or_none(solution.warp.mu) if there else None,
        "no_warp": math.isinf(lam),
        "value": finite_or_none(solution.value),
        "unwarped": finite_or_none(solution.unwarped),
        "margin": finite_or_none(solution.margin) if there and outcome is not warpopt.Outcome.flat else None,
        "excess": finite_or_none(solution.excess),
        "outcome": outcome.name,
        "sentence": outcome.sentence,
        "matrix": matrix.tolist() if usable else None,
        "no_matrix_because": reason,
    }
    return Solved(*place, metric, str(norm), row, outcome, mapping)


@functools.partial(jax.jit, static_argnames=("convention",))
def _rendering(camera, light, solution, casters, convention):
    """(matrix, the map's width with the warp, and without)."""
    footprint, eta = solution.footprint, solution.warp.eta
    matrix = warpopt.shadow_matrix(camera, light, footprint, solution.warp, convention, casters=casters)
    return matrix, sum(footprint.half_widths(eta)), sum(footprint.half_widths(jax.numpy.ones_like(eta)))

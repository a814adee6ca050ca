"""The problems of a scene: one compiled program per objective, and one call per camera for all lights."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.typing import ArrayLike

import warpopt
from warpopt._checks import trusted
from warpopt.objective import Objective
from warpopt.receivers.footprint import LateralFit
from warpopt.render.casters import Casters, casters_of
from warpopt.render.map_depth import DepthCells, MapDepth, depth_cells
from warpopt.render.shadow_matrix import matrix_and_depth, refuse_no_depth

from ..common.error_maps import Mapping
from ..common.of_objective import OfObjective
from ..common.record import finite_or_none
from ..inputs.scene_files import SceneInput
from ..inputs.scene_settings import BoxReceivers
from ..inputs.scene_values import box_of, under_light, views_of
from .depth_numbers import depth_numbers
from .settings import SceneConfig

_TOGETHER = 64  # lights in one batch


@dataclasses.dataclass(frozen=True, eq=False)
class Solved(OfObjective):
    """One camera, light direction and objective.

    Attributes:
        camera, light: indices among the scene's distinct ones.
        objective: what was minimised.
        row: its values in the files: finite numbers, text and None.
        outcome: how the solve ended.
        mapping: the parameters of its errors, for pictures.
        alone: whether the scene has no other camera.
    """

    camera: int
    light: int
    objective: Objective
    row: dict[str, Any]
    outcome: "warpopt.Outcome"
    mapping: Mapping
    alone: bool

    @property
    def unmapped(self) -> str | None:
        """Why a warp that was found has no matrix; None where it has one, or none is needed."""
        needed = self.outcome.succeeded and self.outcome is not warpopt.Outcome.empty
        return self.row["no_matrix_because"] if needed and self.row["matrix"] is None else None

    @property
    def title(self) -> str:
        camera = "" if self.alone else f"camera {self.camera}, "
        return f"{camera}light {self.light}, {self.objective.title}"


def solve_scene(
    config: SceneConfig, scene: SceneInput, casters: np.ndarray | BoxReceivers | None, progress: Callable[[str], None]
) -> list[Solved]:
    """Every requested metric and norm, over every distinct camera and light, with what `caster_shape` found."""
    if not scene.lights:
        return []
    # Copied to the device once.
    shape = box_of(casters) if isinstance(casters, BoxReceivers) else casters_of(casters)
    solved = []
    for objective in config.objective.objectives():
        views = views_of(config, scene, objective)
        for i, view in enumerate(views):
            found = jax.device_get(_over_lights(view, shape, objective, clip_space(config), config.objective.min_eta))
            for k, direction in enumerate(scene.lights):
                one = jax.tree.map(lambda v, k=k: v[k], found)
                problem = _solved(one, (i, k), list(direction), objective, len(views) == 1)
                problem.row["depth"] = _depth(one, config)
                seen = under_light(view, k)
                seen = seen.along(one.solution) if view.searched else seen
                problem.row.update(_limit(seen, objective, problem.row["value"]))
                solved.append(problem)
                progress(problem.title)
    return solved


@dataclasses.dataclass(frozen=True)
class _Found:
    """What one call computes for each light."""

    solution: "warpopt.SceneSolution"
    matrix: ArrayLike
    depth: MapDepth
    cells: DepthCells
    lam: ArrayLike
    lam_over_mu: ArrayLike
    turn: ArrayLike
    warped: LateralFit
    plain: LateralFit


jax.tree_util.register_dataclass(_Found)


@functools.partial(jax.jit, static_argnames=("objective", "convention", "min_eta"))
def _over_lights(
    view: "warpopt.SceneView", casters: Casters | None, objective: Objective, convention: "warpopt.ClipSpace",
    min_eta: float,
) -> _Found:  # fmt: skip
    """Every light of a view."""

    def one(light) -> _Found:
        with trusted():  # inputs were checked when read
            seen = eqx.tree_at(lambda v: v.light, view, light)
            seen = seen if seen.searched else seen.reduced(objective)
            solution = warpopt.optimal_warp(seen, objective, min_eta=min_eta, throw=False)
            matrix, depth = matrix_and_depth(seen, solution, convention, casters=casters)
        warp = solution.warp
        cells = depth_cells(depth, solution.footprint, warp.eta, solution.frame.texels)
        warped, plain = (solution.footprint.lateral_fit(eta) for eta in (warp.eta, jax.numpy.ones_like(warp.eta)))
        return _Found(solution, matrix, depth, cells, warp.lam, warp.lam_over_mu, _turn(view, solution), warped, plain)

    together = 1 if view.receivers.one_at_a_time else _TOGETHER
    return jax.lax.map(one, view.light, batch_size=min(together, len(view.light.direction)))


def _turn(view: "warpopt.SceneView", solution: "warpopt.SceneSolution") -> jax.Array:
    """The angle between the warp's direction and the view's, on the light plane; 0 for one along the other."""
    light, axis = solution.frame.light, solution.frame.z_axis
    ahead = jax.numpy.array([0.0, 0.0, 1.0]) - light * light[2]
    turn = jax.numpy.arctan2(jax.numpy.linalg.norm(jax.numpy.cross(ahead, axis)), ahead @ axis)
    return jax.numpy.where(solution.frame.parallel | (view.warp_direction == "view"), 0, turn)


def clip_space(config: SceneConfig) -> "warpopt.ClipSpace":
    """The requested clip-space convention."""
    make = getattr(warpopt.ClipSpace, config.output.convention)
    return make(reversed_z=config.output.reversed_z)


def _limit(view: "warpopt.SceneView", objective: Objective, value: float | None) -> dict[str, Any]:
    """The part of a problem's row about the lower bound."""
    least, reason = None, objective.no_bound_because
    if reason is None:
        least = warpopt.lower_bound(view, objective)
        reason = None if least > 0 else "There are no receivers, or all are at one depth: the limit is 0."
    over_limit = value / least if least and value is not None else None
    return {"limit": least, "over_limit": over_limit, "no_limit_because": reason}


def _why_none(depth: MapDepth) -> str:
    try:
        refuse_no_depth(depth.extent)
    except ValueError as error:
        return str(error)
    return "The matrix is not finite."


def _depth(found: _Found, config: SceneConfig) -> dict[str, Any] | None:
    """The map's depth as numbers; None without a matrix."""
    if not np.isfinite(found.matrix).all() or not np.any(found.cells.there):
        return None
    return depth_numbers(found.depth, found.cells, config.output.reversed_z, config.objective.shadow_map is not None)


def _solved(found: _Found, place: tuple[int, int], direction: list[float], objective: Objective, alone: bool) -> Solved:
    solution, matrix = found.solution, np.asarray(found.matrix)
    outcome = warpopt.Outcome(int(solution.result))
    mapping = Mapping.of(solution, found.warped, found.plain)
    there = outcome is not warpopt.Outcome.empty  # an empty scene has no warp and no matrix
    usable = there and bool(np.isfinite(matrix).all())
    reason = None if usable else outcome.sentence if not (there and outcome.succeeded) else _why_none(found.depth)
    row = {
        "camera": place[0],
        "light": place[1],
        "direction": direction,
        "theta_deg": finite_or_none(np.rad2deg(solution.frame.theta)),
        "metric": objective.name,
        "norm": objective.norm,
        "eta": finite_or_none(solution.warp.eta) if there else None,
        "lambda": finite_or_none(found.lam) if there else None,
        "lambda_over_mu": finite_or_none(found.lam_over_mu) if there else None,
        "mu": finite_or_none(solution.warp.mu) if there else None,
        "no_warp": there and bool(np.isinf(found.lam)),
        "warp_direction": solution.direction.tolist() if there else None,
        "turn_deg": finite_or_none(np.rad2deg(found.turn)) if there else None,
        "shares": solution.shares.tolist(),
        "lateral": dict(
            zip(("axis", "m0", "m1"), map(finite_or_none, (solution.footprint.axis, *found.warped[:2])), strict=True)
        ),
        "unturned": finite_or_none(solution.unturned),
        "directions": int(solution.directions),
        "value": finite_or_none(solution.value),
        "unwarped": finite_or_none(solution.unwarped),
        "margin": finite_or_none(solution.margin) if there and outcome is not warpopt.Outcome.flat else None,
        "excess": finite_or_none(solution.excess),
        "gap": finite_or_none(solution.gap),
        "outcome": outcome.name,
        "sentence": outcome.sentence,
        "matrix": matrix.tolist() if usable else None,
        "no_matrix_because": reason,
    }
    return Solved(*place, objective, row, outcome, mapping, alone)

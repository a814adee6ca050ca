"""A scene's cameras and receivers as objects of the library."""

import equinox as eqx
import jax
import numpy as np

import warpopt
from warpopt.objective import Objective
from warpopt.receivers import ConvexBody, DepthBuffer, Receivers, WholeFrustum
from warpopt.theory.camera import camera_of

from ..common.settings import ConfigError
from .scene_files import SceneInput
from .scene_settings import BoxReceivers, SceneSettings


def buffer_of(scene: SceneInput, i: int) -> DepthBuffer | None:
    """What camera i sees, if the scene has depth images."""
    return DepthBuffer(scene.depths[i], scene.encoding) if scene.depths else None


def weighted(config: SceneSettings, scene: SceneInput, i: int) -> DepthBuffer | None:
    """`buffer_of` with the pixels' weights."""
    plain = buffer_of(scene, i)
    if plain is None:
        return None
    lit = scene.lit[i] if scene.lit else None
    if config.weights.by == "edges" and lit is not None:
        edges = warpopt.edge_weights(lit, plain, camera_of(scene.cameras[i]))
        return DepthBuffer(scene.depths[i], scene.encoding, edges)
    return DepthBuffer(scene.depths[i], scene.encoding, config.weights.by, lit)


def box_of(asked: BoxReceivers) -> ConvexBody:
    """The box of its settings."""
    return ConvexBody.box(asked.lower, asked.upper)


def body_of(config: SceneSettings) -> ConvexBody | None:
    """The box or the half-spaces, if they are the receivers."""
    asked = config.receivers
    if asked.box is not None:
        return box_of(asked.box)
    return None if asked.planes is None else ConvexBody(np.array(asked.planes.planes))


def receivers_of(config: SceneSettings, scene: SceneInput, i: int) -> Receivers:
    """The receivers of camera i."""
    return weighted(config, scene, i) or body_of(config) or WholeFrustum()


def views_of(config: SceneSettings, scene: SceneInput, objective: Objective | None = None) -> "list[warpopt.SceneView]":
    """For each distinct camera its view for an objective (the first), under all lights of the scene (at least one).

    Raises:
        ConfigError: receivers for which a camera's view cannot be solved.
    """
    objective = objective or config.objective.objectives()[0]
    lights = jax.vmap(warpopt.DirectionalLight)(np.array(scene.lights, float))
    views = []
    for i, seen in enumerate(scene.cameras):
        camera, receivers = camera_of(seen), receivers_of(config, scene, i)
        try:
            receivers.check(camera, lights, objective)
        except ValueError as error:
            raise ConfigError(f"receivers, seen by camera.{i}: {error}") from None
        try:
            view = warpopt.SceneView(
                camera, lights, receivers, screen=config.objective.screen, shadow_map=config.objective.shadow_map,
                warp_direction=config.warp.direction_of(objective), map_aspect=config.warp.aspect,
                lateral=config.warp.lateral, turn_only_if=config.warp.turn_only_if,
            )  # fmt: skip
        except ValueError as error:  # a vector along one of the lights
            raise ConfigError(f"warp: {error}") from None
        views.append(view)
    return views


def under_light(view: "warpopt.SceneView", k: int) -> "warpopt.SceneView":
    """The view under the k-th of its lights."""
    return eqx.tree_at(lambda v: v.light, view, jax.tree.map(lambda leaf: leaf[k], view.light))

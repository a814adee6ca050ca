"""A scene's cameras and receivers as the library's own."""

import numpy as np

import warpopt

from ...scene_files.scene_camera import SceneCamera
from .scene_files import SceneInput
from .scene_settings import SceneSettings


def camera_of(camera: SceneCamera) -> "warpopt.Camera":
    """The library's camera."""
    _, up, forward = camera.rotation
    return warpopt.Camera.off_centre(
        camera.position, forward, up, camera.near, camera.far, camera.window, handedness=camera.handedness
    )


def receivers_of(config: SceneSettings, scene: SceneInput, i: int):
    """What camera i must resolve."""
    asked = config.receivers
    if scene.depths:
        return warpopt.DepthBuffer(scene.depths[i], scene.encoding)
    if asked.box is not None:
        return warpopt.ConvexBody.box(asked.box.lower, asked.box.upper, asked.box.measure)
    if asked.planes is not None:
        return warpopt.ConvexBody(np.array(asked.planes.planes), asked.planes.measure)
    return warpopt.WholeFrustum(asked.whole_frustum.measure)

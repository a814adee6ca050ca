"""What a scene's configuration refers to, read and checked before anything is computed. Knows nothing of JAX."""

import dataclasses
from pathlib import Path

import numpy as np

from ...scene_files.depth_files import read_depth
from ...scene_files.gltf import read_camera, read_triangles
from ...scene_files.landscape import landscape
from ...scene_files.rasterise import rasterise
from ...scene_files.scene_camera import SceneCamera
from ..common.settings import ConfigError
from .light_path import Step, light_path
from .scene_settings import SceneSettings


@dataclasses.dataclass(frozen=True, eq=False)
class SceneInput:
    """A scene in numbers.

    Attributes:
        cameras: the distinct ones, and
        camera_of: for each of the configuration, which of them it is.
        depths: an image (height, width) for each distinct camera, encoded as `encoding`; empty for other receivers.
        encoding: see `warpopt.DepthBuffer`.
        casters: (N, 3) world points of what casts shadows, where more is known than the receivers.
        steps, lights: see `light_path`.
    """

    cameras: list[SceneCamera]
    camera_of: list[int]
    depths: list[np.ndarray]
    encoding: str
    casters: np.ndarray | None
    steps: list[Step]
    lights: list[tuple[float, float, float]]


def read_scene(config: SceneSettings, folder: Path) -> SceneInput:
    """Read the files, relative to `folder`, and make the depth images.

    Raises:
        ConfigError: naming the key, what was got and what was expected.
    """
    receivers = config.receivers
    steps, lights = light_path(config.light, config.handedness)
    cameras = [c.scene_camera(config.handedness, config.default_aspect()) for c in config.camera]
    if receivers.gltf is not None and not cameras:
        cameras = [_gltf_camera(config, folder / receivers.gltf.file)]
    depths, encoding, casters = [], "linear", None
    if receivers.depth is not None:
        encoding = receivers.depth.encoding
        depths = [_depth(config, i, camera, folder) for i, camera in enumerate(cameras)]
        # Two frames of one camera are two scenes.
        keys = [(camera.key, depth.tobytes()) for camera, depth in zip(cameras, depths, strict=True)]
    else:
        keys = [camera.key for camera in cameras]
    first = {key: keys.index(key) for key in keys}
    order = list(first)
    distinct = [cameras[i] for i in first.values()]
    depths = [depths[i] for i in first.values()] if depths else []
    made = receivers.gltf or receivers.landscape
    if made is not None:
        triangles = _triangles(config, folder)
        casters = triangles.reshape(-1, 3)
        sizes = [(max(1, round(made.width / camera.aspect)), made.width) for camera in distinct]
        depths = [rasterise(triangles, camera, *size) for camera, size in zip(distinct, sizes, strict=True)]
    elif receivers.box is not None:
        lower, upper = receivers.box.lower, receivers.box.upper
        casters = np.stack(np.meshgrid(*zip(lower, upper, strict=True)), -1).reshape(-1, 3)
    return SceneInput(distinct, [order.index(key) for key in keys], depths, encoding, casters, steps, lights)


def _refused(key: str, error: Exception) -> ConfigError:
    if isinstance(error, OSError):
        return ConfigError(f"{key}: {error.filename}: cannot be read: {error.strerror}")
    return ConfigError(f"{key}: {error}")


def _triangles(config: SceneSettings, folder: Path) -> np.ndarray:
    made = config.receivers.landscape
    if made is not None:
        return landscape(made.seed, made.size, made.relief, made.cells)
    try:
        return read_triangles(folder / config.receivers.gltf.file)
    except (OSError, ValueError) as error:
        raise _refused("receivers.gltf.file", error) from None


def _gltf_camera(config: SceneSettings, path: Path) -> SceneCamera:
    gltf = config.receivers.gltf
    try:
        return read_camera(path, gltf.camera, config.default_aspect(), gltf.far)
    except (OSError, ValueError) as error:
        raise _refused("receivers.gltf.file", error) from None


def _depth(config: SceneSettings, i: int, camera: SceneCamera, folder: Path) -> np.ndarray:
    asked = config.receivers.depth
    path = folder / asked.files[i]
    key = f"receivers.depth.files.{i}"
    try:
        depth = read_depth(path, asked.encoding, asked.channel)
    except (OSError, ValueError) as error:
        raise _refused(key, error) from None
    height, width = depth.shape
    if asked.size is not None and (width, height) != tuple(asked.size):
        expected = f"{asked.size[0]} x {asked.size[1]} (receivers.depth.size)"
        raise ConfigError(f"{key}: {path}: got {width} x {height} pixels, expected {expected}")
    # Square pixels, up to a size that was rounded to whole ones.
    if abs(width - camera.aspect * height) > max(1.0, camera.aspect):
        raise ConfigError(
            f"{key}: {path}: got {width} x {height} pixels, expected width / height = {camera.aspect:g}, the aspect of "
            f"camera.{i}"
        )
    return depth

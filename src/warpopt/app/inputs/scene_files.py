"""Reads and checks the files of a scene's configuration before anything is computed. Does not import JAX."""

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...scene_files.depth_files import read_mask, read_values
from ...scene_files.depth_image import Encoding, decoded_image
from ...scene_files.gltf import GltfCamera, read_geometry, read_gltf_camera, read_light
from ...scene_files.landscape import landscape
from ...scene_files.made import MadeScene, made_scene
from ...scene_files.poses import read_gltf_path, read_poses
from ...scene_files.rasterise import rasterise
from ...scene_files.scene_camera import SceneCamera
from ..common.settings import ConfigError
from .camera_settings import CameraPath
from .light_path import Step, light_path
from .scene_settings import DepthReceivers, GltfReceivers, SceneLight, SceneSettings


@dataclasses.dataclass(frozen=True, eq=False)
class SceneInput:
    """A scene as numbers.

    Attributes:
        cameras: the distinct cameras.
        camera_of: for each camera of the configuration, its index in `cameras`.
        depths: an image (height, width) for each distinct camera, encoded as `encoding`; empty for other receivers.
        lit: a mask (height, width) for each distinct camera, true where the light reaches; empty if none are given.
        encoding: see `warpopt.receivers.DepthBuffer`.
        triangles: (N, 3, 3) the surfaces, of scenes made of triangles.
        steps, lights: see `light_path`.
        notes: sentences for the user: parts of the files that were left out, and why an image is empty.
    """

    cameras: list[SceneCamera]
    camera_of: list[int]
    depths: list[np.ndarray]
    lit: list[np.ndarray]
    encoding: Encoding
    triangles: np.ndarray | None
    steps: list[Step]
    lights: list[tuple[float, float, float]]
    notes: list[str]


def read_scene(config: SceneSettings, folder: Path, images: bool = True) -> SceneInput:
    """Read the files, relative to `folder`, and make the depth images.

    Args:
        config, folder: of the configuration.
        images: whether to rasterise triangles.

    Raises:
        ConfigError: names the key, what was got and what was expected.
    """
    receivers, notes = config.receivers, []
    steps, lights = light_path(_light(config, folder), config.handedness)
    depths, triangles = [], None
    from_seed = receivers.made and made_scene(receivers.made.scene, receivers.made.seed)
    if receivers.depth is not None:
        cameras, depths = _seen_in_files(config, receivers.depth, folder, notes)
        # Two frames from one camera are two scenes.
        keys = [(camera.key, depth.tobytes()) for camera, depth in zip(cameras, depths, strict=True)]
    else:
        cameras = [_camera(config, i, None) for i in range(len(config.camera))]
        if receivers.gltf is not None and not cameras and config.camera_path is None:
            cameras = [_gltf_camera(config, folder / receivers.gltf.file)]
        if from_seed and receivers.made and not cameras:
            cameras = [from_seed.camera(i, config.default_aspect()) for i in range(receivers.made.views)]
        if config.camera_path is not None:
            cameras = _on_path(config, config.camera_path, folder, cameras)
        keys = [camera.key for camera in cameras]
    parallel = [i for i, camera in enumerate(cameras) if camera.is_orthographic]
    if parallel and not receivers.pixels:
        notes.append("An orthographic camera's section through a body is not drawn.")
    lit = _masks(config, folder)
    if lit and len(lit) != len(cameras):
        raise ConfigError(f"weights.lit: got {len(lit)} for {len(cameras)} camera(s), expected one for each")
    if lit:  # two masks are two scenes
        keys = [(key, mask.tobytes()) for key, mask in zip(keys, lit, strict=True)]
    first = {key: keys.index(key) for key in keys}
    order = list(first)
    distinct = [cameras[i] for i in first.values()]
    depths, lit = ([images[i] for i in first.values()] if images else [] for images in (depths, lit))
    made = receivers.gltf or receivers.landscape or receivers.made
    if made is not None:
        triangles = _triangles(config, folder, from_seed, notes)
        sizes = [(max(1, round(made.width / camera.aspect)), made.width) for camera in distinct]
        depths = [rasterise(triangles, camera, *size) for camera, size in zip(distinct, sizes, strict=True) if images]
    for i, (mask, depth) in enumerate(zip(lit, depths, strict=False)):
        if mask.shape != depth.shape:
            raise ConfigError(f"weights.lit: got {_size(mask)} pixels for camera.{i}, expected its {_size(depth)}")
    encoding = "linear" if receivers.depth is None else receivers.depth.encoding
    places = [order.index(key) for key in keys]
    return SceneInput(distinct, places, depths, lit, encoding, triangles, steps, lights, notes)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def _masks(config: SceneSettings, folder: Path) -> list[np.ndarray]:
    with told_of("weights.lit"):
        return [read_mask(folder / file) for file in config.weights.lit or ()]


@contextlib.contextmanager
def told_of(key: str) -> Iterator[None]:
    """Prefix a reader's error with the configuration's key."""
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{key}: {error.filename}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ConfigError(f"{key}: {error}") from None


def _light(config: SceneSettings, folder: Path) -> SceneLight:
    """The light, with a direction from a file if requested."""
    which = config.light.from_file
    if which is None:
        return config.light
    assert config.receivers.gltf is not None  # required by the settings
    with told_of("light.from_file"):
        direction = read_light(folder / config.receivers.gltf.file, None if which is True else which)
    return SceneLight(direction=direction)


def _camera(config: SceneSettings, i: int, size: tuple[int, int] | None) -> SceneCamera:
    with told_of(f"camera.{i}"):
        size = size or config.objective.screen
        return config.camera[i].scene_camera(config.handedness, config.default_aspect(), size)


def _triangles(config: SceneSettings, folder: Path, from_seed: MadeScene | None, notes: list[str]) -> np.ndarray:
    if from_seed is not None:
        return from_seed.triangles
    made = config.receivers.landscape
    if made is not None:
        return landscape(made.seed, made.size, made.relief, made.cells)
    gltf = config.receivers.gltf
    assert gltf is not None  # only called with glTF
    with told_of("receivers.gltf.file"):
        found = read_geometry(folder / gltf.file, include=gltf.include, exclude=gltf.exclude)
    notes += (f"{gltf.file}: {note}" for note in found.report.notes())
    return found.triangles


def _gltf_camera(config: SceneSettings, path: Path) -> SceneCamera:
    gltf = config.receivers.gltf
    assert gltf is not None  # only called with glTF
    with told_of("receivers.gltf.camera"):
        return _lens(config, gltf, path, read_gltf_camera(path, gltf.camera))


def _lens(config: SceneSettings, gltf: GltfReceivers, path: Path, found: GltfCamera) -> SceneCamera:
    far = gltf.far or found.far
    if not found.near < far:
        raise ValueError(f"{path}: camera {found.name!r}: got far {far:g}, expected more than {found.near:g}")
    return found.scene_camera(config.default_aspect(), far)


def _on_path(
    config: SceneSettings, asked: CameraPath, folder: Path, cameras: list[SceneCamera]
) -> list[SceneCamera]:  # fmt: skip
    """A camera for each pose."""
    gltf = config.receivers.gltf
    if asked.file is not None:
        with told_of("camera_path.file"):
            return read_poses(folder / asked.file, cameras[0], config.handedness)
    assert gltf is not None  # required by the settings, as is an animation
    assert asked.animation is not None
    path = folder / gltf.file
    with told_of("camera_path.animation"):
        found = read_gltf_path(path, gltf.camera, asked.animation, asked.rate or 30.0)
        return [_lens(config, gltf, path, each) for each in found]


def _seen_in_files(
    config: SceneSettings, asked: DepthReceivers, folder: Path, notes: list[str]
) -> tuple[list[SceneCamera], list[np.ndarray]]:
    """Each camera, and its image."""
    cameras, depths = [], []
    for i, file in enumerate(asked.files):
        path, key = folder / file, f"receivers.depth.files.{i}"
        with told_of(key):
            values, there = read_values(path, channel=asked.channel, part=asked.part, key=asked.key)
        height, width = values.shape
        if asked.size is not None and (width, height) != tuple(asked.size):
            expected = f"{asked.size[0]} x {asked.size[1]} (receivers.depth.size)"
            raise ConfigError(f"{key}: {path}: got {width} x {height} pixels, expected {expected}")
        camera = _camera(config, i, (width, height))
        pinhole = config.camera[i].fx is not None
        # Square pixels, up to rounding of the size; a pinhole camera gives its pixel sizes.
        if not pinhole and abs(width - camera.aspect * height) > max(1.0, camera.aspect):
            raise ConfigError(
                f"{key}: {path}: got {width} x {height} pixels, expected width / height = {camera.aspect:g}, the "
                f"aspect of camera.{i}"
            )
        with told_of(f"{key}: {path}"):
            image = decoded_image(
                values, there, encoding=asked.encoding, scale=asked.scale, background=asked.background,
                far=camera.far, nan_is_background=asked.nan_is_background, rows=asked.rows,
                distance="planar" if camera.is_orthographic else asked.distance,  # the same along parallel rays
                window=camera.window,
            )  # fmt: skip
        blank = image.why_blank()
        notes += [f"{file}: {blank}"] if blank else []
        if asked.encoding == "linear":
            nearer = int((image.depth < camera.near).sum())
            notes += [
                f"{file}: {nearer:,} of {image.depth.size:,} values are nearer than near = {camera.near:g}: "
                "units or encoding?"
            ] * (nearer > 0)
        cameras.append(camera)
        depths.append(image.depth)
    return cameras, depths

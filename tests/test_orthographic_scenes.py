"""Orthographic cameras on the command line: TOML, glTF, the rasteriser and the pictures."""

import json
from pathlib import Path

import numpy as np
import pytest
from gltf_cases import Builder
from scene_cases import BOX, toml

from warpopt.app.common.error_maps import errors, image_of
from warpopt.app.common.settings import ConfigError, read_config
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.scene.settings import SceneConfig
from warpopt.app.scene.solve import solve_scene
from warpopt.scene_files.rasterise import rasterise
from warpopt.scene_files.scene_camera import SceneCamera, orientation

CAMERA = """position = [0, 40, 0]
forward = [0.2, -0.7, -1]
near = 1.0
far = 150.0
half_height = 25.0
aspect = 1.5"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read(receivers: str, camera: str = CAMERA, more: str = ""):
    Path("scene.toml").write_text(toml(receivers, camera=camera, more=more))
    config = read_config(Path("scene.toml"), [], SceneConfig)
    return config, read_scene(config, Path())


def test_the_rasteriser_draws_parallel_rays():
    """Against a ray to each pixel: random triangles, in front of, across and behind the near plane."""
    rng = np.random.default_rng(3)
    rotation = orientation(np.array([0.2, -0.7, -1]), np.array([0, 1.0, 0]), "right")
    camera = SceneCamera(np.array([1.0, 2, 3]), rotation, 4.0, 30.0, (-6, 6, -4, 4), True)
    eye = rng.uniform([-8, -6, -2], [8, 6, 34], (12, 1, 3)) + rng.uniform(-4, 4, (12, 3, 3))
    found = rasterise(eye @ rotation + camera.position, camera, 30, 44)
    across, up = camera.slopes(30, 44)
    places = np.stack(np.meshgrid(across, up), -1)[..., None, :]
    a, b, c = (eye[:, i] for i in range(3))
    u, v = (b - a)[:, :2], (c - a)[:, :2]
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    w = places - a[:, :2]
    s = (w[..., 0] * v[:, 1] - w[..., 1] * v[:, 0]) / det
    t = (u[:, 0] * w[..., 1] - u[:, 1] * w[..., 0]) / det
    z = a[:, 2] + s * (b - a)[:, 2] + t * (c - a)[:, 2]
    hit = (s >= 0) & (t >= 0) & (s + t <= 1) & (z >= 4) & (z < 30)
    expected = np.where(hit, z, np.inf).min(-1)
    np.testing.assert_allclose(found, np.where(np.isfinite(expected), expected, 0), atol=1e-9)
    assert 0.2 < (found > 0).mean() < 0.95


def test_a_scene_from_toml_and_its_pictures(folder):
    """The mean over the picture's pixels is the norm, with the optimal warp and without."""
    config, scene = read(
        "made = { scene = 'city', seed = 3, width = 60 }", more="[objective]\nmetrics = 'p'\nnorms = 'l1'"
    )
    (camera,) = scene.cameras
    assert (camera.is_orthographic, camera.window) == (True, (-37.5, 37.5, -25, 25))
    (solved,) = solve_scene(config, scene, scene.triangles, lambda done: None)
    seen = image_of(camera, np.where(scene.depths[0] > 0, scene.depths[0], np.inf))
    points = (seen.depth[..., None] * seen.slopes)[np.isfinite(seen.depth)] @ camera.rotation + camera.position
    clip = np.c_[points, np.ones(len(points))] @ np.array(solved.row["matrix"]).T
    assert (np.abs(clip[:, :3] / clip[:, 3:]) <= 1 + 1e-9).all()
    assert solved.row["value"] > solved.row["limit"] > 0
    for warped, key in ((True, "value"), (False, "unwarped")):
        assert np.nanmean(errors(solved.mapping, seen, "p", warped)) == pytest.approx(solved.row[key], rel=1e-6)
    assert solved.row["value"] < solved.row["unwarped"]


def test_gltf_cameras_and_refusals(folder):
    builder = Builder()
    builder.node(mesh=builder.quad(), scale=[20, 1, 20])
    builder.data["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 6, "ymag": 4, "znear": 0, "zfar": 50}}]
    tilt = np.sin(np.pi / 8), np.cos(np.pi / 8)
    builder.node(camera=0, translation=[0, 9, 9], rotation=[-tilt[0], 0, 0, tilt[1]])
    builder.data["scenes"][0]["nodes"] = [0, 1]
    Path("plan.gltf").write_text(json.dumps(builder.done()))
    _, scene = read("gltf = { file = 'plan.gltf', width = 24 }", camera="")
    (camera,) = scene.cameras
    assert (camera.is_orthographic, camera.near, camera.far, camera.window) == (True, 50, 100, (-6, 6, -4, 4))
    z = scene.depths[0]  # a plane that tilts: linear down the image
    np.testing.assert_allclose(np.diff(z, axis=0), np.diff(z, axis=0)[0, 0], rtol=1e-6)
    assert read("gltf = { file = 'plan.gltf', width = 24, far = 60 }", camera="")[1].cameras[0].far == 110
    with pytest.raises(ConfigError, match="got half_fov_deg and half_height, expected exactly one"):
        read(BOX, camera=CAMERA + "\nhalf_fov_deg = 20")

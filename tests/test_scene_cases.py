"""Users' files that were once read wrong, through the settings and readers of `warpopt scene`, to the right warp.

Expected: lambda/mu of E_p in L-inf. Each file is compared with the same scene written out plainly too, or with the file
without what must not count.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import warpopt
from warpopt.app.common.settings import read_config
from warpopt.app.inputs.scene_files import SceneInput, read_scene
from warpopt.app.inputs.scene_values import under_light, views_of
from warpopt.app.scene.settings import SceneConfig
from warpopt.scene_files.depth_files import read_values

CASES = Path(__file__).parent / "cases"
NEAR = 0.1  # of depth.toml's camera


def scene_of(toml: str, *arguments: str, folder: Path = CASES) -> tuple[SceneConfig, SceneInput]:
    config = read_config(CASES / toml, list(arguments), SceneConfig)
    return config, read_scene(config, folder)


def lambda_over_mu(config: SceneConfig, scene: SceneInput) -> float:
    (view,) = views_of(config, scene)
    return float(warpopt.optimal_warp(under_light(view, 0)).warp.lam_over_mu)


@pytest.fixture
def folder(tmp_path):
    """Depth files made of another: eye depth, with background as inf, and reversed without a far plane."""
    depth, there = read_values(CASES / "display.exr")
    assert there.all()
    assert depth.dtype == np.float32
    seen = depth > 0
    assert 0 < seen.sum() < seen.size
    np.save(tmp_path / "display.npy", depth)
    np.save(tmp_path / "background_inf.npy", np.where(seen, depth, np.float32(np.inf)))
    np.save(tmp_path / "infinite_reversed.npy", np.where(seen, NEAR / np.where(seen, depth, 1), 0).astype(np.float32))
    for name in ("display.exr", "overscan.exr", "blender_half.exr"):
        (tmp_path / name).write_bytes((CASES / name).read_bytes())
    return tmp_path


# Half floats have 11 bits: depths, and with them the ratio, move by up to 2^-11.
DEPTHS = {
    "display.npy": 1e-12,
    "display.exr": 1e-12,
    "background_inf.npy": 1e-12,
    "overscan.exr": 1e-6,  # rendered anew, in single precision
    "blender_half.exr": 2**-11,
}


def test_depth_files_give_one_warp(folder):
    found = {}
    for name in DEPTHS:
        config, scene = scene_of("depth.toml", "--receivers.depth.files", f'["{name}"]', folder=folder)
        found[name] = lambda_over_mu(config, scene)
        assert scene.notes == []
    assert found["display.npy"] == pytest.approx(0.1266, abs=5e-5)
    for name, tolerance in DEPTHS.items():
        assert found[name] == pytest.approx(found["display.npy"], rel=tolerance), name


@pytest.mark.parametrize("far", ["inf", "unset"])
def test_reversed_depth_of_a_projection_without_a_far_plane(folder, far):
    reversed_ = ("--receivers.depth.files", '["infinite_reversed.npy"]', "--receivers.depth.encoding", "reversed")
    if far == "inf":
        config, scene = scene_of("depth.toml", *reversed_, "--camera.far", "inf", folder=folder)
    else:
        text = (CASES / "depth.toml").read_text().replace("far = 500.0\n", "")
        (folder / "endless.toml").write_text(text)
        config, scene = scene_of(folder / "endless.toml", *reversed_, folder=folder)
    assert scene.cameras[0].far == np.inf
    value = lambda_over_mu(config, scene)
    assert value == pytest.approx(0.1266, abs=5e-5)
    # near/z rounds to 24 bits, which moves z by as much.
    plain = lambda_over_mu(*scene_of("depth.toml", "--receivers.depth.files", '["display.npy"]', folder=folder))
    assert value == pytest.approx(plain, rel=1e-6)


GLTF = {
    "sparse.gltf": (7.861, "sparse_expanded.gltf"),
    "instancing.gltf": (0.947, "instancing_expanded.gltf"),
}


@pytest.mark.parametrize("name", GLTF)
def test_a_gltf_file_and_the_same_written_out_give_one_warp(name):
    expected, plain = GLTF[name]
    found, other = (
        lambda_over_mu(*scene_of("gltf_small.toml", "--receivers.gltf.file", file)) for file in (name, plain)
    )
    assert found == pytest.approx(expected, rel=5e-4)
    assert found == pytest.approx(other, rel=1e-12)


def test_a_sky_can_be_left_out():
    """0.312 without the dome; with it the far plane of the receivers is the dome's."""
    (nosky, sky, left_out) = (
        scene_of("sky.toml", "--receivers.gltf.file", file, *more)
        for file, *more in (("nosky.gltf",), ("sky.gltf",), ("sky.gltf", "--receivers.gltf.exclude", '["*sky*"]'))
    )
    assert lambda_over_mu(*nosky) == pytest.approx(0.312, rel=5e-4)
    assert lambda_over_mu(*left_out) == pytest.approx(lambda_over_mu(*nosky), rel=1e-12)
    assert lambda_over_mu(*sky) < 0.1
    assert left_out[1].notes == ["sky.gltf: excluded: 'Skybox'"]
    included = scene_of("sky.toml", "--receivers.gltf.file", "sky.gltf", "--receivers.gltf.include", '["ground", "w*"]')
    assert lambda_over_mu(*included) == pytest.approx(lambda_over_mu(*nosky), rel=1e-12)


PARTS = {
    "hidden_node.gltf": ("not visible in the file and left out: 'node 1'", 1),
    "empty_primitive.gltf": ("1 primitive without POSITION left out", 1),
}


@pytest.mark.parametrize("name", PARTS)
def test_what_shows_nothing_is_left_out_and_told(tmp_path, name):
    note, kept = PARTS[name]
    config, scene = scene_of("gltf_small.toml", "--receivers.gltf.file", name)
    assert scene.notes == [f"{name}: {note}"]
    plain = json.loads((CASES / name).read_text())
    plain["nodes"] = plain["nodes"][:kept]
    plain["scenes"] = [{"nodes": list(range(kept))}]
    (tmp_path / name).write_text(json.dumps(plain))
    _, expected = scene_of("gltf_small.toml", "--receivers.gltf.file", name, folder=tmp_path)
    assert expected.notes == []
    np.testing.assert_array_equal(scene.depths[0], expected.depths[0])
    assert lambda_over_mu(config, scene) == pytest.approx(17.857, rel=1e-4)


def test_a_file_s_camera_without_a_far_plane(tmp_path):
    """As the same camera in the configuration, and as one with a far plane behind all that is seen."""
    lens = json.loads((CASES / "poly_camera.gltf").read_text())["cameras"][0]["perspective"]
    assert "zfar" not in lens
    text = (CASES / "gltf_small.toml").read_text()
    start, end = text.index("[camera]"), text.index("[light]")
    (tmp_path / "own.toml").write_text(text[:start] + text[end:])
    own = scene_of(tmp_path / "own.toml", "--receivers.gltf.file", "poly_camera.gltf")
    assert own[1].cameras[0].far == np.inf
    value = lambda_over_mu(*own)
    assert np.isfinite(value)
    far = scene_of(
        tmp_path / "own.toml", "--receivers.gltf.file", "poly_camera.gltf", "--receivers.gltf.far", "100000.0"
    )
    assert lambda_over_mu(*far) == pytest.approx(value, rel=1e-12)
    # The node's rotation: 2 asin(-0.1) about x.
    pitch = 2 * np.arcsin(-0.1)
    camera = (
        f"[camera]\nposition = [0.0, 3.0, 4.0]\nforward = [0.0, {np.sin(pitch)}, {-np.cos(pitch)}]\n"
        f"near = {lens['znear']}\nhalf_fov_deg = {np.rad2deg(lens['yfov'] / 2)}\n"
    )
    (tmp_path / "own.toml").write_text(camera + text[end:])
    same = scene_of(tmp_path / "own.toml", "--receivers.gltf.file", "poly_camera.gltf")
    np.testing.assert_allclose(same[1].cameras[0].rotation, own[1].cameras[0].rotation, atol=1e-8)
    assert lambda_over_mu(*same) == pytest.approx(value, rel=1e-3)

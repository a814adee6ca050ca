"""Frames of orthographic cameras: against a ray caster in NumPy, and by differences of two frames."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from frame_cases import brute_truth, tables
from scene_cases import toml

from warpopt.app import cli
from warpopt.frames import LitScene, see
from warpopt.frames.paths import Moment, seen_again
from warpopt.frames.shadow_map import ShadowMap, screen_steps
from warpopt.scene_files.scene_camera import SceneCamera, orientation

pytest.importorskip("embreex")

LIGHT = np.array([0.4, -1.0, 0.3])
TURN = orientation(np.array([0.3, -1.0, -0.8]), np.array([0, 1.0, 0]), "right")
CAMERA = SceneCamera(np.array([-1.0, 6.0, 5.0]), TURN, 0.05, 40.0, (-3.2, 3.2, -2.4, 2.4), True)


def test_truth_is_that_of_a_ray_caster_in_numpy():
    triangles = tables(3)
    frame = see(LitScene(triangles, LIGHT), CAMERA, 24, 32)
    depth, lit = brute_truth(triangles, CAMERA, LIGHT, 24, 32)
    assert 0.9 < np.isfinite(depth).mean()
    np.testing.assert_allclose(frame.depth, depth, rtol=1e-6)
    # Beside an edge, rounding decides.
    assert (frame.lit == lit[frame.judged]).mean() > 0.99
    assert frame.defined


def test_a_pixels_step_in_the_map_is_the_difference_of_two_pixels():
    """On the floor, whose texture coordinates are smooth."""
    scene = LitScene(tables(3), LIGHT)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = scene.axes / 30, -scene.axes @ scene.origin / 30
    shadow_map, h = ShadowMap(scene, matrix, (64, 64)), 1e-3
    frame = see(scene, CAMERA, 24, 32)
    steps = screen_steps(shadow_map, frame, shadow_map.texture(frame.places))
    left, right, bottom, top = CAMERA.window
    for axis, (across, up) in enumerate((((right - left) / 32, 0.0), (0.0, -(top - bottom) / 24))):
        shift = h * (across * TURN[0] + up * TURN[1])
        moved = see(scene, dataclasses.replace(CAMERA, position=CAMERA.position + shift), 24, 32)
        one, other = (each.image(np.arange(each.judged.sum()), -1) for each in (frame, moved))
        both = (one >= 0) & (other >= 0)
        one, other = one[both], other[both]
        same = frame.triangles[one] == moved.triangles[other]
        one, other = one[same], other[same]
        found = (shadow_map.texture(moved.places[other]) - shadow_map.texture(frame.places[one])) / h
        np.testing.assert_allclose(found, steps[one][:, :, axis], atol=1e-7)
    assert same.mean() > 0.95


def test_receivers_are_seen_again_along_parallel_rays():
    scene = LitScene(tables(3), LIGHT)
    frame = see(scene, CAMERA, 24, 32)
    moved = see(scene, dataclasses.replace(CAMERA, position=CAMERA.position + 1.6 * TURN[0]), 24, 32)
    shown = frame.image(seen_again(Moment(scene, frame, None), Moment(scene, moved, None)), False)
    # A quarter of the window has left the screen on the left.
    assert not shown[:, :7].any()
    assert shown[:, 9:][frame.judged[:, 9:]].mean() > 0.99


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    camera = "position = [0, 30, 20]\nforward = [0.2, -1, -0.8]\nnear = 1.0\nfar = 150.0\nhalf_height = 16.0"
    section = "[frames]\nwarps = ['none', 'lispsm']\nscreen = [64, 48]\nshadow_map = [64, 64]\n"
    Path("frames.toml").write_text(toml("made = { scene = 'city', seed = 3, width = 64 }", camera=camera, more=section))
    with pytest.raises(SystemExit) as ended:
        cli.main(["frames", "frames.toml"])
    assert ended.value.code == 0
    plain, rule = csv.DictReader(Path("out/frames.csv").read_text().splitlines())
    assert (plain["wrong"], plain["eta"]) == (rule["wrong"], rule["eta"])
    assert 0 < float(plain["wrong"]) < 0.1
    assert rule["excluded"] == "the rule gives no warp"

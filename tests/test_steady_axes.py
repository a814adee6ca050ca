"""The axes of a map without a warp, under a light next to the view's direction."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scene_cases import BOX, run, strict, toml

from warpopt import Camera, DirectionalLight, Outcome, SceneView, optimal_warp
from warpopt.app import cli
from warpopt.receivers import PointReceivers

CAMERA = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 100.0, np.pi / 6, 1.6)


def view_of(theta, phi=0.0):
    """A light at theta to the view, that leans to the screen's right turned by phi."""
    light = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)])
    return SceneView(CAMERA, DirectionalLight(light), warp_direction="steady")


def test_the_error_does_not_jump_as_the_light_leaves_the_views_direction():
    """f tan(phi) 2/(n tan(phi)): 200 along the columns, 320 along the rows, whichever way the light leans."""
    before = None
    for theta in (0.0, 1e-9, 1e-6, 1e-4, 1e-3):
        for phi in (0.0, 0.7, np.pi / 2):
            solution = optimal_warp(view_of(theta, phi), previous=before)
            assert Outcome(int(solution.result)) == Outcome.no_warp
            assert float(solution.value) == pytest.approx(200, rel=0.1 * theta + 1e-9 + 2 * theta * 100)
            if before is not None:
                turned = np.abs(np.asarray(solution.direction) @ np.asarray(before.direction))
                assert turned > 1 - 1e-4
            # Along the view, it turns with the light.
            expected = 320 if phi == 0 else 200
            if 1e-6 <= theta <= 1e-4 and phi != 0.7:
                assert float(solution.unturned) == pytest.approx(expected, rel=0.02)
            before = solution


def test_a_warp_is_used_as_soon_as_its_error_is_less():
    """The value is the smaller one of both, and continuous; a warp is along the view."""
    values = []
    for theta in np.linspace(0.02, 0.55, 20):
        solution = optimal_warp(view_of(theta))
        warped = float(solution.warp.eta) < 1
        assert float(solution.value) <= float(solution.unturned) * (1 + 1e-12)
        assert warped == (float(solution.value) == float(solution.unturned))
        ahead = np.array([0, 0, -1]) - np.cos(theta) * np.array([np.sin(theta), 0, -np.cos(theta)])
        along = abs(np.asarray(solution.direction) @ (ahead / np.linalg.norm(ahead)))
        assert (along > 1 - 1e-9) == warped
        values.append(float(solution.value))
    assert np.abs(np.diff(np.log(values))).max() < 0.25
    assert float(solution.warp.eta) < 1


def test_a_warp_along_other_axes_is_none_of_the_choices():
    """It would be better along the screen's columns than along the view; without a warp these are worse."""
    solution = optimal_warp(view_of(0.6, 1.2))
    columns = SceneView(CAMERA, view_of(0.6, 1.2).light, warp_direction=(0, -1, 0))
    along = optimal_warp(columns)
    assert float(along.value) < 0.8 * float(solution.value) < float(along.unwarped)
    assert float(solution.value) <= float(solution.unturned) * (1 + 1e-12)
    assert float(solution.warp.eta) < 1


def test_the_frame_before_breaks_ties():
    """A square screen: rows and columns are as good; what was is kept, and derivatives are finite."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 100.0, np.pi / 6)
    light = DirectionalLight((1e-5, 3e-6, -1))
    view = SceneView(camera, light, warp_direction="steady")
    before = optimal_warp(view)
    for axis in ((0, -1, 0), (1, 0, 0)):
        before = eqx.tree_at(lambda s: s.direction, before, jnp.array(axis, float))
        kept = optimal_warp(view, previous=before)
        assert abs(float(kept.direction @ before.direction)) > 1 - 1e-9

    def value(direction):
        view = SceneView(camera, DirectionalLight(direction), warp_direction="steady")
        return optimal_warp(view, throw=False).value

    _, slope = jax.jvp(value, (np.array([1e-5, 0.0, -1.0]),), (np.array([1.0, 0.0, 0.0]),))
    assert np.isfinite(slope)
    for seen, bad in ((SceneView(camera, light), before), (view, 3)):
        with pytest.raises(ValueError, match="previous: got"):
            optimal_warp(seen, previous=bad)
    with pytest.raises(ValueError, match="warp_direction: got 'steady', which optimal_warp finds"):
        view.frame()


def test_the_frame_before_breaks_ties_with_the_view_s_own_axes():
    """Where eta = 1 along the view too: a light that turns about the view moves no map for 0.01 %."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 100.0, np.pi / 6)
    angle = 2 * np.pi * np.arange(64) / 64
    rings = [
        np.stack([3 * np.cos(angle + a), 3 * np.sin(angle + a), 0 * angle - z], 1) for a, z in ((0, 10), (0.05, 12))
    ]
    before, first, own = None, None, []
    for phi in np.linspace(0.02, 1.5, 6):
        light = DirectionalLight(np.array([1e-4 * np.cos(phi), 1e-4 * np.sin(phi), -1]))
        view = SceneView(camera, light, PointReceivers(np.concatenate(rings)), warp_direction="steady")
        before = optimal_warp(view, previous=before)
        first = before if first is None else first
        own.append(float(before.unturned) < float(before.value))
        assert abs(float(before.direction @ first.direction)) > 1 - 1e-6
    assert any(own)


def test_commands_take_it(tmp_path, monkeypatch):
    """With the limit along the axes that were found."""
    monkeypatch.chdir(tmp_path)
    text = toml(BOX, more="[objective]\nmetrics = 'p'\n[warp]\ndirection = 'steady'\n")
    (problem,) = run(text)["problems"]
    assert problem["over_limit"] > 0.9
    Path("compare.toml").write_text(text.replace("'out'", "'compare'"))
    with pytest.raises(SystemExit) as ended:
        cli.main(["compare", "compare.toml"])
    assert ended.value.code == 0
    (told,) = strict(Path("compare/compare.json"))["objectives"]
    assert told["limit"] == pytest.approx([problem["limit"]], rel=1e-12)

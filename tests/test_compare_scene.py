"""Rules over a scene's receivers: against the frustum's own comparison, points one by one, and raw geometry."""

import csv
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scene_cases import BOX, strict, toml

import warpopt
from warpopt.app import cli
from warpopt.compare.rule_set import KNOWN
from warpopt.rules import Body

EPS = np.finfo(float).eps
PHI = math.radians(30.0)
CAMERA = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
BODY = warpopt.ConvexBody.box((-20, 0, -80), (20, 8, -5))
LIGHTS = np.array([[0.3, -1.0, -0.2], [0.5, -1.0, 0.8], [0.1, -0.2, -1.0]])


def tenth(frustum, theta):
    return warpopt.Warp.from_eta(np.full(theta.shape, 0.1), 1.0)


def lights_of(directions):
    return jax.vmap(warpopt.DirectionalLight)(jnp.asarray(directions))


@pytest.fixture(scope="module")
def boxed():
    rules = ["lispsm_paper", "psm", tenth]
    return warpopt.compare_scene_rules(CAMERA, lights_of(LIGHTS), BODY, rules, "pxq")


def test_over_the_whole_frustum_it_is_the_frustum_s_comparison():
    """A light in the YZ plane, square pixels: another path through the code, to the rounding of theta near the kinks.

    theta comes back from the light's direction with an error of about eps; the rules' slopes in it are below 1e3.
    """
    camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=PHI)
    theta = np.deg2rad([12.0, 35.0, 60.0, 90.0])
    directions = np.stack([0 * theta, -np.sin(theta), -np.cos(theta)], -1)
    rules = KNOWN | {"tenth": tenth}
    scene = warpopt.compare_scene_rules(camera, lights_of(directions), None, rules)
    plain = warpopt.compare_rules(warpopt.ViewFrustum(1.0, 100.0, PHI), theta, rules)
    assert scene.names == plain.names
    np.testing.assert_array_equal(scene.defined, plain.defined)
    np.testing.assert_allclose(scene.eta, plain.eta, rtol=1e4 * EPS)
    np.testing.assert_allclose(scene.ratio, plain.ratio, rtol=1e4 * EPS)
    np.testing.assert_allclose(scene.over_limit, plain.over_limit, rtol=1e4 * EPS)
    assert not scene.defined.all()
    assert scene.regions is None


def vertices():
    points, there = BODY.vertices(CAMERA)
    return np.asarray(points)[np.asarray(there)]


def test_norms_are_the_largest_error_over_the_receivers(boxed):
    """L-inf over a convex body is at a vertex: the errors there, one by one, by the solution's own formula."""
    points = jnp.asarray(vertices())
    for k in range(len(LIGHTS)):
        one = jax.tree.map(lambda leaf, k=k: leaf[k], boxed.solution)
        for i in range(len(boxed.names)):
            if boxed.defined[i, k]:
                largest = one.aliasing_error(points, "pxq", boxed.eta[i, k]).max()
                assert boxed.values[i, k] == pytest.approx(float(largest), rel=100 * EPS)
        assert boxed.unwarped[k] == pytest.approx(float(one.unwarped), rel=10 * EPS)
    assert (np.nan_to_num(boxed.ratio, nan=1) >= 1 - 100 * EPS).all()
    assert (boxed.ratio > 1.01).any()
    assert boxed.limit is None


def test_scene_error_norm_is_least_at_the_optimum():
    light = warpopt.DirectionalLight(LIGHTS[0])
    best = warpopt.scene_warp(CAMERA, light, BODY, "p")
    eta = np.array([0.5, 1.0, 2.0]) * float(best.warp.eta)
    values = warpopt.scene_error_norm(CAMERA, light, BODY, eta, "p")
    expected = [float(best.aliasing_error(jnp.asarray(vertices()), "p", one).max()) for one in eta]
    np.testing.assert_allclose(values, expected, rtol=100 * EPS)
    assert values[1] == pytest.approx(float(best.value), rel=10 * EPS)
    assert values[0] > values[1] < values[2]
    with pytest.raises(ValueError, match=r"eta: got 0.0, expected numbers in \(0, 1\]"):
        warpopt.scene_error_norm(CAMERA, light, BODY, 0.0)
    with pytest.raises(ValueError, match="receivers: got int"):
        warpopt.scene_error_norm(CAMERA, light, 3, 0.5)


def test_rules_are_applied_to_the_receivers_and_a_users_keeps_its_apex(boxed):
    """From the vertices of body and frustum: n, y_min and d; and where W's apex lies along Z_w."""
    points = vertices()
    slopes = np.asarray(CAMERA.corner_slopes())
    for k in range(len(LIGHTS)):
        frame = jax.tree.map(lambda leaf, k=k: leaf[k], boxed.solution.frame)
        theta, axis = float(frame.theta), np.asarray(frame.z_axis)
        d, s = points @ axis, math.sin(theta)
        start, mu, n = d.min(), d.max() - d.min(), points[:, 2].min()
        lam = (n + math.sqrt(n * (n + mu * s))) / s
        assert boxed.eta[0, k] == pytest.approx(lam / (lam + mu), rel=1e-12)
        assert boxed.defined[1, k] == (start > 0)
        if start > 0:  # PSM: the apex at the eye
            assert boxed.eta[1, k] == pytest.approx(start / (start + mu), rel=1e-12)
        whole = np.concatenate([slopes, 100 * slopes]) @ axis  # n = 1, f = 100
        apex = whole.min() - (whole.max() - whole.min()) / 9  # eta = 1/10: lambda = mu / 9
        lam = start - apex
        assert boxed.defined[2, k] == (lam > 0)
        assert boxed.eta[2, k] == pytest.approx(lam / (lam + mu), rel=1e-12)
    assert boxed.defined[1].any()
    assert not boxed.defined[1].all()


def test_a_body_that_is_the_frustum_gives_the_frustum_s_warps():
    frustum, theta = warpopt.ViewFrustum(1.0, 100.0, PHI), np.deg2rad(np.array([35.0, 120.0]))
    space = warpopt.LightSpace(frustum, jnp.asarray(theta))
    whole = Body(frustum.near, frustum.far, frustum.half_fov, space.minimum_depth, space.mu)
    for name in ("tsm", "minimum_norm", "scherzer", "filament", "veloren"):
        got, expected = (KNOWN[name](body, theta) for body in (whole, frustum))
        np.testing.assert_allclose(got.eta, expected.eta, rtol=100 * EPS)


def test_an_empty_scene_and_bad_lights():
    away = warpopt.ConvexBody.box((-1, -1, 10), (1, 1, 20))  # behind the camera
    result = warpopt.compare_scene_rules(CAMERA, lights_of(LIGHTS[:1]), away, ["ssm", "psm"], "pxq")
    assert np.isnan(result.ratio).all()
    assert result.worst("ssm")[1] == -1
    with pytest.raises(ValueError, match="lights: got"):
        warpopt.compare_scene_rules(CAMERA, warpopt.DirectionalLight((0, -1, 0)), BODY)


def test_the_command_over_a_box(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    light = "path = [[0.3, -1, -0.2], [0.5, -1, 0.8]]"
    text = toml(BOX, light=light, more="[rules]\nnames = ['ssm', 'lispsm_paper', 'ogre']")
    Path("scene.toml").write_text(text.replace("figures = false", "figures = true"))
    with pytest.raises(SystemExit) as exit_:
        cli.main(["compare", "scene.toml"])
    assert exit_.value.code == 0
    assert {"map.png", "compare.csv", "report.md"} <= set(strict(tmp_path / "out/run.json")["files"])
    with Path("out/compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["rule"], r["light"]) for r in rows[:3]] == [("ssm", "0"), ("ssm", "1"), ("lispsm_paper", "0")]
    (told,) = strict(tmp_path / "out/compare.json")["objectives"]
    assert told["rules"]["ssm"]["value"] == told["no_warp"]
    assert told["rules"]["ssm"]["regions_deg"] is None
    for rule in told["rules"].values():
        np.testing.assert_allclose(rule["over_limit"], np.array(rule["value"]) / told["limit"], rtol=2 * EPS)
    assert "applied as engines apply them" in Path("out/report.md").read_text()

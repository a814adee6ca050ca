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
from warpopt.compare import over_scene
from warpopt.compare.rule_set import KNOWN
from warpopt.rules import Body

EPS = np.finfo(float).eps
PHI = math.radians(30.0)
CAMERA = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
BODY = warpopt.receivers.ConvexBody.box((-20, 0, -80), (20, 8, -5))
LIGHTS = np.array([[0.3, -1.0, -0.2], [0.5, -1.0, 0.8], [0.1, -0.2, -1.0]])


def tenth(frustum, theta):
    return warpopt.Warp.from_eta(np.full(theta.shape, 0.1), warpopt.FrustumView(frustum, theta))


E_PXQ = warpopt.Objective("pxq")
RULES = ["lispsm_paper", "psm", "tsm_alternative", tenth]  # one list and one kind of receivers: compiled once


def lights_of(directions):
    return jax.vmap(warpopt.DirectionalLight)(jnp.asarray(directions))


@pytest.fixture(scope="module")
def boxed():
    return warpopt.compare_rules(warpopt.SceneView(CAMERA, lights_of(LIGHTS), BODY), RULES, E_PXQ)


def test_over_the_whole_frustum_it_is_the_frustum_s_comparison():
    """A light in the YZ plane, square pixels: another path through the code, to the rounding of theta near the kinks.

    theta comes back from the light's direction with an error of about eps; the rules' slopes in it are below 1e3.
    """
    camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=PHI)
    theta = np.deg2rad([12.0, 35.0, 90.0])
    directions = np.stack([0 * theta, -np.sin(theta), -np.cos(theta)], -1)
    everything = warpopt.receivers.ConvexBody.box((-500, -500, -500), (500, 500, 500))
    scene = warpopt.compare_rules(warpopt.SceneView(camera, lights_of(directions), everything), RULES, E_PXQ)
    plain = warpopt.compare_rules(warpopt.FrustumView(warpopt.ViewFrustum(1.0, 100.0, PHI), theta), RULES, E_PXQ)
    assert scene.names == plain.names
    np.testing.assert_array_equal(scene.defined, plain.defined)
    np.testing.assert_allclose(scene.eta, plain.eta, rtol=1e4 * EPS)
    np.testing.assert_allclose(scene.ratio, plain.ratio, rtol=1e4 * EPS)
    assert not scene.defined.all()
    assert scene.regions is None


@pytest.fixture(scope="module")
def vertices():
    points, there = jax.jit(lambda: BODY.vertices(CAMERA))()
    return np.asarray(points)[np.asarray(there)]


@jax.jit
def largest(solution, points, eta):
    return jax.vmap(lambda one: solution.aliasing_error(points, "pxq", one).max())(eta)


def of_light(solution, k):
    return jax.tree.map(lambda leaf: leaf[k], solution)


def test_norms_are_the_largest_error_over_the_receivers(boxed, vertices):
    """L-inf over a convex body is at a vertex: the errors there, one by one, by the solution's own formula."""
    for k in range(len(LIGHTS)):
        expected = largest(of_light(boxed.solution, k), vertices, np.r_[boxed.eta[:, k], 1.0])
        expected = np.where(np.r_[boxed.defined[:, k], True], expected, np.nan)
        np.testing.assert_allclose(np.r_[boxed.values[:, k], boxed.unwarped[k]], expected, rtol=100 * EPS)
    np.testing.assert_allclose(boxed.unwarped, boxed.solution.unwarped, rtol=10 * EPS)
    assert (np.nan_to_num(boxed.ratio, nan=1) >= 1 - 100 * EPS).all()
    assert (boxed.ratio > 1.01).any()
    assert boxed.bound is None
    assert boxed.no_bound_because == "No lower bound is known for a product of E_p and E_q."


def test_bounds_are_those_that_are_known():
    """Each light's own; of the maximum of E_p and E_q the larger; where there is none, the reason in words."""
    views = [warpopt.SceneView(CAMERA, warpopt.DirectionalLight(direction), BODY) for direction in LIGHTS[:2]]
    each = {m: [warpopt.lower_bound(view, warpopt.Objective(m)) for view in views] for m in ("p", "q")}
    for metric, expected in (*each.items(), ("max", np.maximum(each["p"], each["q"]))):
        found, reason = over_scene._bounds(views, warpopt.Objective(metric))
        np.testing.assert_allclose(found, expected, rtol=10 * EPS)
        assert reason is None
    for metric, norm, words in (("pxq", "inf", "a product of E_p and E_q"), ("q", "l2", "E_q in L_2")):
        found = over_scene._bounds(views, warpopt.Objective(metric, norm))
        assert found == (None, f"No lower bound is known for {words}.")


def test_the_error_norm_is_least_at_the_optimum(boxed, vertices):
    light, best = warpopt.DirectionalLight(LIGHTS[0]), of_light(boxed.solution, 0)
    eta = np.array([0.5, 1.0, 2.0]) * float(best.warp.eta)
    view = warpopt.SceneView(CAMERA, light, BODY)
    values = warpopt.error_norm(view, warpopt.Warp.from_eta(eta, view.footprint(E_PXQ)), E_PXQ)
    np.testing.assert_allclose(values, largest(best, vertices, eta), rtol=100 * EPS)
    assert values[1] == pytest.approx(float(best.value), rel=10 * EPS)
    assert values[0] > values[1] < values[2]
    with pytest.raises(ValueError, match=r"eta: got 0.0, expected a number in \(0, 1\]"):
        warpopt.Warp.from_eta(0.0, view.footprint())


def test_rules_are_applied_to_the_receivers_and_a_users_keeps_its_apex(boxed, vertices):
    """From the vertices of body and frustum: n, y_min and d; and where W's apex lies along Z_w."""
    points = vertices
    slopes = np.asarray(CAMERA.corner_slopes())
    for k in range(len(LIGHTS)):
        frame = of_light(boxed.solution.frame, k)
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
        assert boxed.defined[3, k] == (lam > 0)
        assert boxed.eta[3, k] == pytest.approx(lam / (lam + mu), rel=1e-12)
    assert boxed.defined[1].any()
    assert not boxed.defined[1].all()


def test_a_body_that_is_the_frustum_gives_the_frustum_s_warps():
    frustum, theta = warpopt.ViewFrustum(1.0, 100.0, PHI), np.deg2rad(np.array([35.0, 120.0]))
    space = warpopt.theory.LightSpace(frustum, jnp.asarray(theta))
    whole = Body(frustum.near, frustum.far, frustum.half_fov, space.start, space.mu, frustum.near, frustum.far)
    every = [rule for name, rule in KNOWN.items() if name != "tsm_alternative"]  # which is of the frustum alone
    pairs = jax.jit(lambda: [[rule(body, theta) for body in (whole, frustum)] for rule in every])()
    for got, expected in pairs:
        np.testing.assert_allclose(got.eta, expected.eta, rtol=1000 * EPS)
        np.testing.assert_array_equal(got.defined, expected.defined)


@pytest.mark.parametrize(
    ("receivers", "near", "far"),
    [
        (warpopt.receivers.WholeFrustum(), 1.0, 100.0),
        (
            warpopt.receivers.DepthBuffer(np.array([[7.0, 0.0], [30.0, 200.0]])),
            7.0,
            30.0,
        ),  # 0 and beyond far: background
        (warpopt.receivers.DepthHistogram((0.5, 2.0, 9.0, 40.0), (0.0, 3.0, 1.0)), 2.0, 40.0),
        (warpopt.receivers.PointReceivers([[0, 2, -7.0], [0, 2, -30.0], [0, 2, 5.0]]), 7.0, 30.0),  # the last is behind
    ],
)
def test_rules_are_told_the_nearest_and_farthest_depth_that_is_seen(receivers, near, far):
    ahead = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45)
    footprint = warpopt.theory.Extent(start=jnp.asarray(3.0), mu=jnp.asarray(20.0))
    view = warpopt.SceneView(ahead, warpopt.DirectionalLight((0, -1, 0)), receivers)
    body = over_scene._body(view, footprint, jnp.asarray(0.45))
    assert (float(body.near), float(body.far)) == (pytest.approx(near, rel=4 * EPS), pytest.approx(far, rel=4 * EPS))
    assert (body.start, body.mu, float(body.half_fov)) == (3.0, 20.0, 0.45)
    assert (float(body.camera_near), float(body.camera_far)) == (1.0, 100.0)


def test_an_empty_scene_has_no_ratio():
    away = warpopt.receivers.ConvexBody.box((-1, -1, 10), (1, 1, 20))  # behind the camera
    result = warpopt.compare_rules(warpopt.SceneView(CAMERA, lights_of(LIGHTS), away), RULES, E_PXQ)
    assert np.isnan(result.ratio).all()
    assert result.worst("lispsm_paper").nearest == -1


def test_the_command_over_a_box(tmp_path, monkeypatch, boxed):
    """The rules and the number of lights of `boxed`, which is compiled."""
    monkeypatch.chdir(tmp_path)
    Path("own_rules_of_a_scene.py").write_text(
        "import numpy, warpopt\ndef tenth(frustum, theta):\n"
        "    return warpopt.Warp.from_eta(numpy.full(theta.shape, 0.1), warpopt.FrustumView(frustum, theta))\n"
    )
    rules = (
        "[rules]\nnames = ['lispsm_paper', 'psm', 'tsm_alternative']\nown = { tenth = 'own_rules_of_a_scene:tenth' }\n"
    )
    camera = (
        "position = [0, 2, 0]\nforward = [0, -0.1, -1]\nnear = 1.0\nfar = 100.0\naspect = 1.6\n"
        f"half_fov_deg = {math.degrees(0.45)}"
    )
    light = f"path = {LIGHTS.tolist()}"
    text = toml(BOX, light=light, camera=camera, more=f"{rules}[objective]\nmetrics = ['pxq']")
    Path("scene.toml").write_text(text.replace("figures = false", "figures = true"))
    with pytest.raises(SystemExit) as exit_:
        cli.main(["compare", "scene.toml"])
    assert exit_.value.code == 0
    assert {"map.png", "compare.csv", "report.md"} <= set(strict(tmp_path / "out/run.json")["files"])
    with Path("out/compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["rule"], r["light"]) for r in rows[2:5]] == [("lispsm_paper", "2"), ("psm", "0"), ("psm", "1")]
    (told,) = strict(tmp_path / "out/compare.json")["objectives"]
    for i, name in enumerate(boxed.names):
        ratios = np.array(told["rules"][name]["over_optimum"], float)  # None is NaN
        np.testing.assert_allclose(ratios, boxed.ratio[i], rtol=1e-12)
        assert told["rules"][name]["regions_deg"] is None
    with Path("out/ranking.csv").open() as file:
        ranked = {row["rule"]: row for row in csv.DictReader(file)}
    for name, row in ranked.items():  # of the lights given: nothing lies between them
        worst = boxed.ratio[boxed.names.index(name)]
        assert int(row["at_light_over_optimum"]) == np.nanargmax(worst)
        assert float(row["worst_over_optimum"]) == pytest.approx(np.nanmax(worst), rel=1e-12)
        assert row["worst_over_limit"] == row["at_light_over_limit"] == ""  # no limit of E_pxq is known
    assert list(ranked) == boxed.order()
    report = Path("out/report.md").read_text()
    assert "applied as in their sources" in report
    assert "PSM yields no lambda > 0 for light" in report
    assert "No lower bound is known for a product of E_p and E_q." in report
    assert told["no_limit_because"] == boxed.no_bound_because

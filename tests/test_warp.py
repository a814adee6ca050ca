"""A warp knows the body that it was made for: its apex stays where it is when the warp is used over another."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
import twin
from scenes import norms_of_points, turned
from twin import mpf

import warpopt
from warpopt import FrustumView, Objective, SceneView, ViewFrustum, Warp
from warpopt.receivers import ConvexBody, PointReceivers
from warpopt.theory import Extent

EPS = np.finfo(float).eps
NEAR, FAR, PHI = 1.0, 100.0, scenes.PHI
FRUSTUM = ViewFrustum(NEAR, FAR, PHI)
BEFORE = "apex that is not before these receivers"


def lispsms_apex(theta: float) -> float:
    """Where LiSPSM's apex over V lies along Z_w from the eye: V's start less (n + sqrt(n f)) / sin(theta)."""
    scene = twin.Scene(NEAR, FAR, PHI, theta)
    return float(scene.d0 - (NEAR + mpf(NEAR * FAR) ** mpf("0.5")) / scene.sin)


@pytest.mark.parametrize("theta", [0.7, math.pi / 2, 2.2])
def test_the_apex_of_a_rule_over_a_box_is_the_rules(theta):
    """w = 0 is the plane through W's apex across Z_w: where it cuts Z_w through the eye, by the matrix' last row.

    Killed: only eta is used (the apex is then elsewhere by tens of units), a shift of the wrong sign.
    """
    rotation, shift = turned(11)
    camera = warpopt.Camera(
        shift, rotation @ jnp.array([0, 0, -1.0]), rotation @ jnp.array([0, 1.0, 0]), NEAR, FAR, PHI
    )
    direction = np.asarray(rotation @ jnp.array([0, np.sin(theta), -np.cos(theta)]))
    # a box in the middle of V: 16 points of it, in eye coordinates that look along -z
    corners = np.array([[x, y, z] for x in (-2, 3) for y in (-3, 2) for z in (-60, -20)], float)
    points = np.asarray(shift) + corners @ np.asarray(rotation).T
    view = SceneView(camera, warpopt.DirectionalLight(direction), PointReceivers(points))
    warp = warpopt.rules.lispsm(FRUSTUM, theta)
    matrix = np.asarray(warpopt.shadow_matrix(view, warp))
    eye, ahead = (np.asarray(v) for v in (camera.position, camera.rotation[2]))
    z_w = ahead - direction * (direction @ ahead)
    z_w /= np.linalg.norm(z_w)
    along = -(matrix[3, :3] @ eye + matrix[3, 3]) / (matrix[3, :3] @ z_w)
    assert along == pytest.approx(lispsms_apex(theta), rel=1e-10)
    # and so are the norms: the points one by one, with lambda their distance from that apex
    d = (points - eye) @ z_w
    lam, mu = d.min() - lispsms_apex(theta), np.ptp(d)
    assert lam / (lam + mu) > 1.2 * float(warp.eta)  # what only eta would be
    weights = np.ones(len(points))
    for metric, order in (("p", np.inf), ("pxq", 2.0)):
        # brute force looks along -z from the origin
        turned_light = np.array([0, np.sin(theta), -np.cos(theta)])
        (expected,) = norms_of_points(corners, weights, turned_light, [lam / (lam + mu)], metric, order, np.tan(PHI))
        got = warpopt.error_norm(view, warp, Objective(metric, order))
        np.testing.assert_allclose(got, expected, rtol=1e-10)


def test_the_apex_is_kept_over_another_frustum():
    """One camera whose planes moved: LiSPSM's warp of the first over the second, by the twin's lambda.

    Killed: `aliasing_error` or `error_norm` over a frustum that takes eta alone.
    """
    theta = np.array([0.3, 0.9, np.pi / 2])
    warp = warpopt.rules.lispsm(FRUSTUM, theta)
    other = ViewFrustum(3.0, 70.0, PHI)
    values = warpopt.error_norm(FrustumView(other, theta), warp, Objective("pxq"))
    errors = warpopt.theory.aliasing_error(other, theta, warp, 0.5, 40.0, "pxq")
    _, s = warpopt.theory.texture_coordinates(other, theta, warp, 1.0, 0.5, 40.0)
    for i, angle in enumerate(theta):
        scene = twin.Scene(3.0, 70.0, PHI, angle)
        first = twin.Scene(NEAR, FAR, PHI, angle)
        lam = scene.d0 - (first.d0 - (NEAR + mpf(NEAR * FAR) ** mpf("0.5")) / first.sin)
        assert float(values[i]) == pytest.approx(float(scene.supremum(1, 1, lam)), rel=256 * EPS)
        assert float(errors[i]) == pytest.approx(float(scene.error(1, 1, lam, mpf("0.5"), mpf(40))), rel=256 * EPS)
        assert float(s[i]) == pytest.approx(float(scene.texture(lam, 1, mpf("0.5"), mpf(40))[1]), rel=256 * EPS)
        assert abs(float(lam / (lam + scene.mu)) - float(warp.eta[i])) > 0.01


def test_a_users_rule_keeps_its_apex_in_a_comparison_of_frusta():
    """A rule that returns the warp of a nearer body. Killed: `warps_of` that takes eta alone."""

    def of_a_part(frustum, theta):
        part = ViewFrustum(frustum.near, frustum.far / 2, frustum.half_fov)
        return warpopt.rules.lispsm(part, theta)

    theta = np.array([0.8, np.pi / 2])
    found = warpopt.compare_rules(FrustumView(FRUSTUM, theta), of_a_part)
    for i, angle in enumerate(theta):
        scene = twin.Scene(NEAR, FAR, PHI, angle)
        half = twin.Scene(NEAR, FAR / 2, PHI, angle)
        lam = scene.d0 - (half.d0 - (NEAR + mpf(NEAR * FAR / 2) ** mpf("0.5")) / half.sin)
        assert found.eta[0, i] == pytest.approx(float(lam / (lam + scene.mu)), rel=256 * EPS)


def test_an_apex_that_is_not_before_the_receivers_is_refused_or_nan():
    """PSM's apex of a far box lies within V. Concrete: a sentence; traced: NaN, and `defined` False.

    Killed: clipping eta to something that is positive; a NaN without a word.
    """
    theta = math.pi / 2
    view = FrustumView(FRUSTUM, theta)
    far_box = Extent(50.0, 40.0)
    bad, edge, good = (Warp.from_lam(lam, far_box) for lam in (10.0, 48.9, 49.5))
    camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), NEAR, FAR, PHI)
    scene = SceneView(camera, warpopt.DirectionalLight((0, -1, 0)))
    for warp in (bad, edge):  # lambda is -39, and -0.1
        assert np.isnan(warp.over(view).eta)
        assert not bool(warp.over(view).defined)
        for call in (
            lambda w=warp: warpopt.error_norm(view, w),
            lambda w=warp: warpopt.error_norm(scene, w),
            lambda w=warp: warpopt.error_norm(scene, w, Objective("p", "l2")),
            lambda w=warp: warpopt.shadow_matrix(scene, w),
            lambda w=warp: warpopt.theory.aliasing_error(FRUSTUM, theta, w, 0.0, 2.0),
        ):
            with pytest.raises(ValueError, match=BEFORE):
                call()
    assert float(good.over(view).lam) == pytest.approx(0.5, rel=64 * EPS)
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), bad, good)
    with pytest.raises(ValueError, match=BEFORE):
        warpopt.error_norm(view, both)
    norms = jax.jit(lambda w: (warpopt.error_norm(view, w), warpopt.error_norm(scene, w)))
    for values in norms(both):
        np.testing.assert_array_equal(np.isnan(values), [True, False])
    matrices = jax.jit(jax.vmap(lambda w: warpopt.shadow_matrix(scene, w)))(both)
    assert np.isnan(matrices[0]).any()
    assert np.isfinite(matrices[1]).all()
    kept = jax.jit(lambda w: w.over(view))(both)
    np.testing.assert_array_equal(kept.defined, [False, True])
    np.testing.assert_array_equal(np.isnan(kept.eta), [True, False])


def test_a_rule_that_is_lost_over_receivers_is_not_defined_in_a_comparison():
    """A user's warp whose apex lies within the box: no number, and no exception for the other rules."""

    def within(frustum, theta):  # the apex 30 before the eye along Z_w: behind the box' begin
        return Warp.from_lam(np.full(theta.shape, 1.0), Extent(31.0, 10.0))

    camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), NEAR, FAR, PHI)
    lights = jax.vmap(warpopt.DirectionalLight)(jnp.array([[0.0, -1.0, 0.0]]))
    near_box, far_box = (ConvexBody.box((-2, -1, -z), (2, 1, -z / 2)) for z in (20, 80))
    for box, defined in ((near_box, False), (far_box, True)):
        found = warpopt.compare_rules(SceneView(camera, lights, box), {"within": within, "lispsm": "lispsm"})
        assert found.defined[:, 0].tolist() == [defined, True]
        assert np.isfinite(found.values[1, 0])
        assert np.isnan(found.values[0, 0]) != defined
    assert found.eta[0, 0] == pytest.approx(10 / (10 + 40), rel=1e-12)  # 40 - 30 before a box that is 40 long


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_body_that_is_the_same_up_to_rounding_keeps_every_bit(dtype):
    """mu a millionth of start: the difference of two starts, rounded, would be 1e-10 of mu (0.1 in single precision).

    Killed: no test of sameness. And a body that differs by more than rounding moves eta as it should.
    """
    eps = float(np.finfo(dtype).eps)
    start, mu = dtype(1000.0), dtype(1e-3)
    warp = Warp.from_eta(dtype(0.3), Extent(start, mu))
    for factor in (1 - 4 * eps, 1 + 4 * eps):
        over = warp.over(Extent(dtype(start * factor), mu))
        assert over.eta == warp.eta
        assert over.one_minus_eta == warp.one_minus_eta
        assert over.eta.dtype == dtype
    moved = Warp.from_eta(dtype(0.3), Extent(dtype(2), dtype(5))).over(Extent(dtype(2.001), dtype(5)))
    lam = 5 * 0.3 / 0.7 + 0.001
    np.testing.assert_allclose(moved.eta, lam / (lam + 5), rtol=8 * eps)
    assert moved.eta != dtype(0.3)


def test_there_and_back_is_the_same_warp():
    body, other = Extent(2.0, 30.0), Extent(7.0, 11.0)
    warp = Warp.from_eta(np.array([1e-6, 0.2, 0.99, 1.0]), Extent(jnp.full(4, 2.0), jnp.full(4, 30.0)))
    back = warp.over(other).over(body)
    np.testing.assert_allclose(back.eta, warp.eta, rtol=1e-9)  # 5 of the shift over lambda = 3e-5
    np.testing.assert_allclose(back.eta[1:], warp.eta[1:], rtol=32 * EPS)
    assert bool(back.no_warp[3])
    assert float(warp.over(Extent(-1e9, 1.0)).eta[3]) == 1  # no warp has no apex


def test_gradients_of_a_kept_apex_are_finite_and_right():
    """d eta'/d start = -d lambda' mu' / (lambda' + mu')^2, by hand; finite at no warp and where the apex is lost."""

    def eta(start, own):
        return Warp.from_eta(own, Extent(start, 30.0)).over(Extent(7.0, 11.0)).eta

    slope = jax.vmap(jax.grad(eta, (0, 1)))(jnp.array([2.0, 7.0, 2.0, 40.0]), jnp.array([0.2, 0.4, 1.0, 0.1]))
    lam = 30 * 0.2 / 0.8 + 5
    assert float(slope[0][0]) == pytest.approx(-11 / (lam + 11) ** 2, rel=1e-12)
    assert all(np.isfinite(v).all() for v in slope)


def test_tables_keep_their_apex_too():
    """A table's warp of V over a far box is V's, moved; `LambdaTable.warp` carries V's start."""
    table = warpopt.build_table(FRUSTUM, max_regret=1e-2)
    theta = math.pi / 2
    warp = table.warp(FRUSTUM, theta)
    eta = float(table.eta_numpy(theta))
    apex = NEAR - (FAR - NEAR) * eta / (1 - eta)
    over = warp.over(Extent(40.0, 20.0))
    assert float(over.lam) == pytest.approx(40.0 - apex, rel=1e-6)

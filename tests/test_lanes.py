"""What holds in every lane: float64 or float32 as JAX's own dtype, XLA with its own settings or the command line's.

Few, and broad: each goes from a user's plain numbers to an answer, against mathematics or raw geometry in NumPy.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import norms_of_points

import warpopt
from warpopt import (
    Camera,
    DirectionalLight,
    FrustumView,
    Objective,
    SceneView,
    ViewFrustum,
    optimal_warp,
    shadow_matrix,
)
from warpopt.receivers import ConvexBody, DepthBuffer, PointReceivers

DTYPE = jnp.result_type(float)
EPS = float(jnp.finfo(DTYPE).eps)
NEAR, FAR, HALF_FOV = 1.0, 100.0, 0.5
CAMERA = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), NEAR, FAR, HALF_FOV)
LIGHT = DirectionalLight((0.3, -1.0, -0.2))


def points(count=64):
    rng = np.random.default_rng(1)
    z = np.exp(rng.uniform(np.log(2.0), np.log(50.0), count))
    return np.stack([rng.uniform(-0.5, 0.5, count) * z, rng.uniform(-0.5, 0.1, count) * z, -z], 1)


def test_an_overhead_light_has_lispsms_lambda():
    """n + sqrt(f n), in L-inf of E_p; and the value (1 + sqrt(f / n)) ... of a tie of both ends: E_p at n."""
    solution = optimal_warp(FrustumView(ViewFrustum(NEAR, FAR, HALF_FOV), np.pi / 2))
    assert solution.warp.eta.dtype == DTYPE
    assert float(solution.warp.lam) == pytest.approx(11.0, rel=32 * EPS)
    assert float(solution.value) == pytest.approx(99 * 0.1 / np.tan(HALF_FOV), rel=64 * EPS)  # mu eta / (n tan(phi))


@pytest.mark.parametrize(("metric", "norm"), [("p", "inf"), ("q", "l2"), ("pxq", "l1")])
def test_no_rule_beats_the_optimum_and_derivatives_are_finite(metric, norm):
    objective, frustum = Objective(metric, norm), ViewFrustum(NEAR, FAR, HALF_FOV)
    theta = jnp.array([0.0, 0.3, 0.5, 1.0, np.pi / 2, 2.5])
    view = FrustumView(frustum, theta)
    best = optimal_warp(view, objective).value
    for rule in (warpopt.rules.lispsm, warpopt.rules.psm, warpopt.rules.ssm):
        value = warpopt.error_norm(view, rule(frustum, theta), objective)
        assert value.dtype == DTYPE
        assert bool((value >= best * (1 - 64 * EPS)).all())
    slope = jax.grad(lambda t: optimal_warp(FrustumView(frustum, t), objective, throw=False).value.sum())(theta)
    assert bool(jnp.isfinite(slope).all())


@pytest.mark.parametrize(("metric", "order"), [("p", np.inf), ("pxq", 2.0)])
def test_points_by_brute_force_and_all_of_them_in_the_map(metric, order):
    """In float64 by NumPy: the value is the norm there, and no other eta on a grid has a lower one."""
    world = points()
    view = SceneView(CAMERA, LIGHT, PointReceivers(world))
    solution = optimal_warp(view, Objective(metric, order))
    etas = [float(solution.warp.eta), *np.geomspace(1e-3, 0.999, 500)]
    weights = np.ones(len(world))
    at, *grid = norms_of_points(world, weights, np.array([0.3, -1.0, -0.2]), etas, metric, order, np.tan(HALF_FOV))
    allowed = 400 * EPS  # A's error is eps / eta
    assert float(solution.value) == pytest.approx(at, rel=allowed)
    assert at < min(grid) * (1 + allowed)
    matrix = shadow_matrix(view, solution)
    assert matrix.dtype == DTYPE
    clip = np.c_[world, np.ones(len(world))] @ np.asarray(matrix, float).T
    assert (np.abs(clip[:, :3] / clip[:, 3:]) < 1 + allowed).all()
    assert (clip[:, 3] > 0).all()


def test_bodies_and_buffers_have_finite_answers():
    depth = np.where(np.arange(24)[:, None] < 8, 0, np.geomspace(90, 2, 24)[:, None] + 0 * np.arange(40))
    for receivers in (ConvexBody.box((-20, -3, -80), (20, 8, -5)), DepthBuffer(depth)):
        view = SceneView(CAMERA, LIGHT, receivers)
        solution = optimal_warp(view, Objective("p", "l2"))
        assert solution.value.dtype == DTYPE
        assert 0 < float(solution.value) < float(solution.unwarped)
        assert float(solution.residual) < 1e3 * EPS
        assert bool(jnp.isfinite(shadow_matrix(view, solution)).all())


def test_a_lower_bound_is_below_and_a_table_keeps_its_promise():
    """The table is built in float64 where JAX has it, and looked up in either precision."""
    frustum = ViewFrustum(NEAR, FAR, HALF_FOV)
    view = FrustumView(frustum, np.linspace(0.05, 1.5, 40))
    best = optimal_warp(view)
    assert bool((warpopt.lower_bound(view) <= best.value * (1 + 64 * EPS)).all())
    if DTYPE == np.float64:
        table = warpopt.build_table(frustum, max_regret=1e-2)
        regret = warpopt.error_norm(view, table.warp(frustum, view.theta)) / best.value - 1
        assert float(regret.max()) <= 1e-2


def test_cascades():
    """Over a frustum with bands and unequal shares, and over points for a maximum and for a mean, with matrices."""
    view = FrustumView(ViewFrustum(NEAR, FAR, HALF_FOV), 1.0)
    plan = warpopt.cascades.plan(view, 3, overlap=0.2, shares=(1, 0.5, 0.5))
    np.testing.assert_allclose(plan.errors, np.full(3, plan.value), rtol=1e3 * EPS)
    seen = SceneView(CAMERA, LIGHT, PointReceivers(points(12)))
    for goal in (Objective("p"), Objective("p", "l2")):
        made = warpopt.cascades.plan(seen, 2, goal)
        assert made.value.dtype == DTYPE
        assert np.isfinite(made.matrices(casters=points(12))[0]).all()

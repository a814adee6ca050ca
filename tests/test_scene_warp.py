"""The optimal warp for any camera and light, against the YZ plane's closed forms and against brute force."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import norms_of_points, turned

from warpopt import (
    Camera,
    DirectionalLight,
    FrustumView,
    Objective,
    Outcome,
    SceneView,
    ViewFrustum,
    Warp,
    error_norm,
    optimal_warp,
    shadow_matrix,
)
from warpopt.receivers import ConvexBody, PointReceivers, WholeFrustum

N, F, PHI = 0.5, 60.0, 0.55
OBJECTIVES = [("p", "inf", "screen"), ("q", "inf", "screen"), ("pxq", "l2", "volume"), ("p", "l1", "ground"),
              ("q", "l2", "screen"), ("pxq", "inf", "axis")]  # fmt: skip


TEXELS = {"screen": (1920, 1080), "shadow_map": (2048, 1024)}


def light_at(theta):
    """AT09's light in a right-handed world: the eye looks along -z, y is up."""
    return jnp.stack([jnp.zeros_like(theta), jnp.sin(theta), -jnp.cos(theta)], -1)


@pytest.mark.parametrize(("metric", "norm", "measure"), OBJECTIVES)
@pytest.mark.thorough("pxq-l2-volume")
def test_on_the_yz_plane_it_is_the_closed_form(metric, norm, measure):
    """Any pose: eta, value and outcome as `optimal_warp`'s, to 1e-12 (slopes of 30 eps, over the smallest a)."""
    theta = jnp.array([0.0, 0.05, 0.3, 0.9, np.pi / 2, 2.0, 2.9, np.pi])
    rotation, shift = turned(3)
    camera = Camera(shift, rotation @ jnp.array([0, 0, -1.0]), rotation @ jnp.array([0, 1.0, 0]), N, F, PHI)

    objective = Objective(metric, norm, measure)

    def solve(light):
        return optimal_warp(SceneView(camera, light), objective, throw=False)

    found = jax.vmap(solve)(jax.vmap(DirectionalLight)(light_at(theta) @ rotation.T))
    exact = optimal_warp(FrustumView(ViewFrustum(N, F, PHI), theta), objective)
    np.testing.assert_allclose(found.warp.eta, exact.warp.eta, rtol=1e-12)
    np.testing.assert_allclose(found.value, exact.value, rtol=1e-12)
    np.testing.assert_allclose(found.warp.mu, exact.warp.mu, rtol=1e-12)
    np.testing.assert_allclose(found.frame.theta, theta, atol=1e-12)
    assert float(found.residual.max()) < 64 * np.finfo(float).eps
    # Without a warp the outcomes agree; a tie that is a kink too may bear either name.
    np.testing.assert_array_equal(found.result == Outcome.no_warp, exact.result == Outcome.no_warp)
    if norm == "l2":  # one integral: nothing ties, and where the width's corners meet is a kink
        np.testing.assert_array_equal(found.result == Outcome.kink, exact.result == Outcome.kink)
        assert metric != "q" or bool((found.result == Outcome.kink).any())
    if metric == "pxq" and norm == "l2":
        # A warp helps iff the margin is positive; it is d log(norm) / d log(eta) at eta = 1, here by a step of 1e-5.
        assert ((found.margin > 0) == (found.warp.eta < 1)).all()
        view, step = FrustumView(ViewFrustum(N, F, PHI), theta[:, None]), 1e-5
        norms = np.log(error_norm(view, Warp.from_eta([1, 1 - step], view), objective)).T
        np.testing.assert_allclose(found.margin, (norms[0] - norms[1]) / step, rtol=1e-3, atol=1e-4)


def test_the_sense_of_the_light_does_not_matter():
    """Light from behind and light towards the camera give one warp: planes, not senses, define W."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI, 1.5)
    direction = np.array([0.4, -0.8, 0.3])
    one, other = (
        optimal_warp(SceneView(camera, DirectionalLight(d), **TEXELS), Objective("max"))
        for d in (direction, -direction)
    )
    np.testing.assert_allclose(one.warp.eta, other.warp.eta, rtol=1e-12)
    np.testing.assert_allclose(one.value, other.value, rtol=1e-12)


def sample(seed: int, count: int):
    rng = np.random.default_rng(seed)
    z = np.exp(rng.uniform(np.log(2.0), np.log(50.0), count))
    points = np.stack([rng.uniform(-0.5, 0.5, count) * z, rng.uniform(-0.5, 0.1, count) * z, -z], 1)
    return points, rng.uniform(0.5, 2.0, count)


@pytest.mark.parametrize(("metric", "order"), [("p", np.inf), ("q", np.inf), ("pxq", np.inf), ("max", np.inf),
                                               ("p", 2.0), ("pxq", 1.0)])  # fmt: skip
def test_no_eta_is_better_by_brute_force(metric, order):
    """For points off the YZ plane: the value is the norm there, and no other eta on a fine grid has a lower one.

    The last are all to one side of the eye. Killed: W's axis through it all the same, and a map that begins there.
    """
    around, weights = sample(1, 200)
    beside = np.c_[0.1 * -around[:, 2] + 0.8 * np.abs(around[:, 0]), around[:, 1:]]
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI)
    for points, direction in ((around, (0.3, -1.0, -0.2)), (around, (-0.6, -0.2, 0.7)), (beside, (0.0, -1.0, -0.2))):
        receivers = PointReceivers(points, weights)
        solution = optimal_warp(SceneView(camera, DirectionalLight(direction), receivers), Objective(metric, order))
        etas = [float(solution.warp.eta), *np.geomspace(1e-4, 0.999, 2000)]
        at, *grid = norms_of_points(points, weights, np.array(direction), etas, metric, order, np.tan(PHI))
        assert abs(at / float(solution.value) - 1) < 1e-12
        assert min(grid) > at * (1 - 1e-12)
        assert min(grid) < at * 1.005  # a step of the grid, 0.46 %, past a kink of slope 1: it is the same function
        everywhere = solution.aliasing_error(camera.to_eye(points), metric)
        norm = everywhere.max() if np.isinf(order) else jnp.average(everywhere**order, weights=weights) ** (1 / order)
        np.testing.assert_allclose(norm, solution.value, rtol=1e-12)


def test_resolutions_make_errors_pixels_per_texel_and_weigh_the_maximum():
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI, 16 / 9)
    light = DirectionalLight((0, -1, 0))
    plain = optimal_warp(SceneView(camera, light))
    fine = optimal_warp(SceneView(camera, light, **TEXELS))
    # NDC per map to pixels per texel: half the pixels up the screen, over the texels along s.
    np.testing.assert_allclose(fine.value, plain.value * 1080 / 2 / 1024, rtol=1e-13)
    np.testing.assert_allclose(fine.warp.eta, plain.warp.eta, rtol=1e-13)
    values = [
        optimal_warp(SceneView(camera, light, screen=(1920, 1080), shadow_map=(64, 4096)), Objective(m)).value
        for m in ("q", "max")
    ]
    assert values[0] < values[1] * (1 + 1e-12)
    with pytest.raises(ValueError, match="screen: got none with shadow_map"):
        optimal_warp(SceneView(camera, light, shadow_map=(1, 1)))
    with pytest.raises(ValueError, match="metric: got 'max' in norm l2 with WholeFrustum"):
        optimal_warp(SceneView(camera, light), Objective("max", "l2"))


def test_max_lies_between_its_two_errors():
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI)
    for direction in ((0, -1, 0), (0.5, -1, -1), (0.1, -0.1, 1)):
        view = SceneView(camera, DirectionalLight(direction), **TEXELS)
        p, q, both = (optimal_warp(view, Objective(m)) for m in ("p", "q", "max"))
        low, high = sorted([float(p.warp.eta), float(q.warp.eta)])
        assert low * (1 - 1e-9) <= both.warp.eta <= high * (1 + 1e-9)
        assert both.value >= max(p.value, q.value) * (1 - 1e-12)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_outcomes_that_are_no_errors(dtype):
    """Nothing seen, one depth, light along the view, an infimum at eta = 0: each says so, all numbers finite.

    In double precision the points alone: each kind of receivers is another program, and the others have their outcomes
    in test_receivers and above.
    """
    camera = jax.tree.map(lambda v: v.astype(dtype), Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI))
    above = DirectionalLight(np.array([0, -1, 0], dtype))
    behind = ConvexBody.box(np.array([-1, -1, 1], dtype), np.array([1, 1, 5], dtype))
    wall = PointReceivers(np.array([[-1, 0, -5], [1, 1, -5], [0, -1, -5]], dtype))
    # E_q with all receivers but those on the axis at delta > 0
    cone = PointReceivers(np.array([[0, 0, -1], [1, 0, -5], [-1, 0, -5]], dtype))
    cases = [
        (wall, "q", above, Outcome.flat), (cone, "q", above, Outcome.unbounded), (behind, "p", above, Outcome.empty),
        (WholeFrustum(), "p", DirectionalLight(np.array([0, 0, -1], dtype)), Outcome.no_warp),
        (WholeFrustum(), "p", DirectionalLight(np.array([0, 1e-12, 1], dtype)), Outcome.no_warp),
    ]  # fmt: skip
    for receivers, metric, light, expected in cases if dtype == np.float32 else cases[:2]:
        view = SceneView(camera, light, receivers)
        solution = optimal_warp(view, Objective(metric))
        assert Outcome(int(solution.result)) == expected
        # exp(log(1e-4)) carries |log| eps
        np.testing.assert_allclose(
            solution.warp.eta, 1e-4 if expected == Outcome.unbounded else 1, rtol=16 * np.finfo(dtype).eps
        )
        assert jnp.isfinite(solution.value)
        assert solution.warp.eta.dtype == dtype
        matrix = shadow_matrix(view, solution.warp)
        assert jnp.isfinite(matrix).all()
        assert Outcome(int(solution.result)).succeeded
        if expected in (Outcome.empty, Outcome.flat):
            assert solution.margin == 0
            assert (solution.value == 0) == (expected == Outcome.empty)  # a wall is as wide as it is


def test_one_call_for_an_animation():
    """vmap over cameras and lights together; one compilation for all frames."""
    frames = 7
    angle = jnp.linspace(0, 2, frames)
    forward = jnp.stack([jnp.sin(angle), -0.2 * jnp.ones(frames), -jnp.cos(angle)], 1)

    def solve(forward, direction):
        camera = Camera(jnp.zeros(3), forward, jnp.array([0.0, 1, 0]), N, F, PHI)
        body = ConvexBody.box(jnp.array([-30.0, -3, -30]), jnp.array([30.0, 2, 30]))
        view = SceneView(camera, DirectionalLight(direction), body)
        solution = optimal_warp(view, throw=False)
        return solution, shadow_matrix(view, solution)

    directions = jnp.stack([0.3 * jnp.ones(frames), -jnp.ones(frames), jnp.cos(angle)], 1)
    solutions, matrices = jax.jit(jax.vmap(solve))(forward, directions)
    one, matrix = solve(forward[3], directions[3])
    np.testing.assert_allclose(solutions.warp.eta[3], one.warp.eta, rtol=1e-13)
    np.testing.assert_allclose(matrices[3], matrix, rtol=1e-9, atol=1e-12)

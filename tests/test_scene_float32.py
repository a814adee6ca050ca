"""Scenes in single precision: the regret of each answer, judged in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Objective, SceneView, optimal_warp
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, GroundPlane, PointReceivers, WholeFrustum

EPS = float(np.finfo(np.float32).eps)
LIGHTS = np.array([[0.4, -1, -0.3], [0, -1, 0], [0.01, -0.02, 1], [0.7, 0.6, -0.2]], np.float32)


def receivers(dtype):
    rng = np.random.default_rng(2)
    z = np.exp(rng.uniform(0.5, 6, 500))
    points = np.c_[rng.uniform(-0.4, 0.4, (500, 2)) * z[:, None], -z].astype(np.float32)
    depth = np.where(np.arange(24)[:, None] < 8, 0, np.geomspace(500, 2, 24)[:, None] + np.arange(40)).astype(
        np.float32
    )
    return {
        "frustum": WholeFrustum(), "box": ConvexBody.box(*np.array([[-40, -3, -300], [50, 9, -1]], dtype)),
        "points": PointReceivers(points.astype(dtype)), "buffer": DepthBuffer(depth.astype(dtype)),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "metric", "norm"),
    [
        ("frustum", "pxq", "l2"),
        ("box", "p", "l2"),
        ("points", "pxq", "inf"),
        ("buffer", "p", "l2"),
    ],
)
@pytest.mark.thorough("frustum-pxq-l2", "points-pxq-inf")
def test_single_precision_is_as_good_as_its_rounding(kind, metric, norm):
    """f/n = 1e3. Depths along Z_w are differences of lengths of order f, so that delta has an error of eps f/mu, and A
    one of eps/eta, relatively: eta is at least 1e-3 here. The warp's value may exceed the minimum by its square.
    """
    double = Camera(
        (0, 0, 0), (0, 0, -1), (0, 1, 0), np.float32(1), np.float32(1000), np.float32(0.45), np.float32(1.5)
    )
    single = jax.tree.map(lambda v: v.astype(np.float32), double)
    objective = Objective(metric, norm)
    for direction in LIGHTS:
        light = DirectionalLight(direction.astype(float))
        exact = optimal_warp(SceneView(double, light, receivers(np.float64)[kind]), objective)
        view = SceneView(single, DirectionalLight(direction), receivers(np.float32)[kind])
        found = optimal_warp(view, objective)
        assert found.warp.eta.dtype == np.float32
        np.testing.assert_allclose(found.value, exact.value, rtol=3 * 16 * EPS / min(float(exact.warp.eta), 0.05))
        if kind in ("points", "buffer"):  # a matrix knows of receivers what their footprint says
            matrix = warpopt.shadow_matrix(view, found)
            assert matrix.dtype == np.float32
            assert np.isfinite(matrix).all()


SMALL = np.where(np.arange(8)[:, None] < 3, 0, np.geomspace(500, 2, 8)[:, None] + np.arange(9)).astype(np.float32)
EVERY_KIND = {
    "frustum": WholeFrustum(),
    "box": ConvexBody.box(*np.array([[-40, -3, -300], [50, 9, -1]], np.float32)),
    "points": PointReceivers(np.array([[0, 0, -5], [1, 0, -9], [-1, 2, -30]], np.float32)),
    "weights": PointReceivers(np.array([[0, 0, -5], [1, 0, -9]], np.float32), np.array([1, 2], np.float32)),
    "buffer": DepthBuffer(SMALL),
    "ground": GroundPlane(np.array([0, 1, 0], np.float32), np.float32(2)),
    "histogram": DepthHistogram(np.array([2, 9, 300], np.float32), np.array([1, 2], np.float32)),
}


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_single_precision_stays_single(kind):
    """Every metric and norm, with float64 allowed: no constant of the library widens what is float32.

    Nothing is compiled: traced for its dtypes alone. Killed: exponents of E_max as an array of JAX's default dtype.
    """
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), np.float32(1), np.float32(1000), np.float32(0.45))
    camera = jax.tree.map(lambda v: v.astype(np.float32), camera)
    light = DirectionalLight(LIGHTS[0])
    if kind == "points":  # resolutions are float64 here: whole numbers, whose precision decides nothing
        view = SceneView(camera, light, EVERY_KIND[kind], screen=(1920, 1080), shadow_map=(2048, 1024))
    else:
        view = SceneView(camera, light, EVERY_KIND[kind])
    every = ("p", "inf"), ("q", "inf"), ("max", "inf"), ("p", "l2"), ("q", "l2"), ("pxq", "l1")
    if kind == "weights":
        every = ("max", "l1"), ("edge", "l1"), ("band", "l2"), ("storage", "inf")
    elif kind == "ground":
        every = ("max", "inf"), ("storage", "inf")
    # Each takes a third of a second to trace: beyond the frustum the two that hold the others' terms.
    for metric, norm in every if kind in ("frustum", "weights", "ground") else every[2::3]:
        objective = Objective(metric, norm)

        def verbs(view, objective=objective):
            solution = optimal_warp(view, objective, throw=False)
            norms = warpopt.error_norm(view, solution, objective)
            return solution, norms, warpopt.shadow_matrix(view, solution, padding=(0.01, 0.02))

        shapes = jax.tree.leaves(jax.eval_shape(verbs, view))
        found = {leaf.dtype for leaf in shapes if jnp.issubdtype(leaf.dtype, jnp.floating)}
        assert found == {np.dtype(np.float32)}, (metric, norm)

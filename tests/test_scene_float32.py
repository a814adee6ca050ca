"""Scenes in single precision: the regret of each answer, judged in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Objective, SceneView, optimal_warp
from warpopt.receivers import ConvexBody, DepthBuffer, PointReceivers, WholeFrustum

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
        ("frustum", "p", "inf"),
        ("frustum", "pxq", "l2"),
        ("box", "p", "l2"),
        ("points", "pxq", "inf"),
        ("buffer", "p", "l2"),
    ],
)
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
        matrix = warpopt.shadow_matrix(view, found)
        assert matrix.dtype == np.float32
        assert jnp.isfinite(matrix).all()

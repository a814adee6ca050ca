"""Engines' stable fit: spheres from raw geometry, whole texels, and what they cost."""

import itertools

import jax
import numpy as np
import pytest

import warpopt
from warpopt import ClipSpace, SceneView
from warpopt.cascades import splits
from warpopt.receivers import PointReceivers
from warpopt.render.sphere_fit import sphere_matrix

LIGHT = warpopt.DirectionalLight((0.3, -1, -0.4))
GROUND = [(x, 0.0, -z) for z in (5.0, 9.0, 20.0, 40.0, 90.0) for x in (-1.0, 1.0)]
CASTERS = np.array(list(itertools.product((-9.0, 9.0), (0.0, 8.0), (-95.0, -2.0))))


def camera_of(place=(0.0, 2.0, 0.0), forward=(0.1, -0.05, -1.0), orthographic=False):
    if orthographic:
        return warpopt.Camera.orthographic(place, forward, (0, 1, 0), 0.5, 100.0, half_height=3.0, aspect=1.6)
    return warpopt.Camera(place, forward, (0, 1, 0), near=0.5, far=100.0, half_fov=0.4, aspect=1.6)


def view_of(camera) -> SceneView:
    return SceneView(camera, LIGHT, PointReceivers(GROUND))


def texels_of(matrix, points, size):
    clip = np.c_[points, np.ones(len(points))] @ np.asarray(matrix).T
    assert (clip[:, 3] == 1).all()
    return (clip[:, :2] + 1) / 2 * size


@pytest.mark.parametrize("orthographic", [False, True])
def test_moving_and_turning_moves_no_texel(orthographic):
    """Every point goes by the same whole number of texels, along both axes, at every depth."""
    random = np.random.default_rng(0)
    points = random.uniform(-50, 50, (64, 3))
    first = np.asarray(sphere_matrix(view_of(camera_of(orthographic=orthographic)), 512, casters=CASTERS))
    made = jax.jit(lambda camera: sphere_matrix(view_of(camera), 512, casters=CASTERS))
    went = []
    for _ in range(20):
        camera = camera_of(random.uniform(-3, 3, 3), (*random.uniform(-0.3, 0.3, 2), -1.0), orthographic)
        moved = texels_of(made(camera), points, 512) - texels_of(first, points, 512)
        went.append(np.round(moved[0]))
        np.testing.assert_allclose(moved, np.broadcast_to(went[-1], moved.shape), atol=1e-9)
    assert np.abs(went).max() > 2


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_piece_of_the_frustum_is_in_the_map_and_fills_the_sphere(orthographic):
    camera = camera_of(orthographic=orthographic)
    for near, far in ((0.5, 100.0), (0.5, 0.6), (30.0, 100.0)):
        view = view_of(camera)
        matrix = sphere_matrix(view, 256, near=near, far=far)
        left, right, bottom, top = np.asarray(camera.window)
        corners = np.array([
            (x * size, y * size, z) for z in (near, far) for size in (1 if orthographic else z,)
            for x in (left, right) for y in (bottom, top)
        ])  # fmt: skip
        world = corners @ np.asarray(camera.rotation) + np.asarray(camera.position)
        texels = texels_of(matrix, world, 256)
        assert texels.min() > -1e-9
        assert texels.max() < 256 + 1e-9
        # The least sphere about them with its centre on the axis, by a scan; a texel is left over.
        at = np.linspace(near, far, 20001)[:, None]
        reach = np.sqrt((corners[:, :2] ** 2).sum(1) + (corners[:, 2] - at) ** 2).max(1).min()
        side = 2 / np.linalg.norm(np.asarray(matrix)[0, :3])
        assert side == pytest.approx(2 * reach * 256 / 255, rel=1e-4)  # the scan's step


def test_its_depth_is_the_receivers_and_their_casters():
    points = np.array(GROUND)
    for clip, low in ((ClipSpace(), -1), (ClipSpace.vulkan(), 0)):
        z = {}
        clamped = {"casters": CASTERS, "depth_clamp": True}
        for name, more in (("none", {}), ("casters", {"casters": CASTERS}), ("clamp", clamped)):
            matrix = np.asarray(sphere_matrix(view_of(camera_of()), 64, clip, **more))
            z[name] = (np.c_[points, np.ones(len(points))] @ matrix.T)[:, 2]
        for name in ("none", "clamp"):
            assert (z[name].min(), z[name].max()) == (pytest.approx(low, abs=1e-9), pytest.approx(1))
        assert z["casters"].min() > low + 0.01
    row = sphere_matrix(view_of(camera_of()), 64, ClipSpace(row_vectors=True))
    np.testing.assert_array_equal(np.asarray(row).T, np.asarray(sphere_matrix(view_of(camera_of()), 64)))


def test_what_spheres_cost():
    """docs/cascades.md: at far/near of 5.62, four cascades of 1000: 2.0 to 4.6 times the texels of a tight unwarped
    map; 15.8, 6.8, 2.9 and 2.0 times those of a warped one, at 90, 60, 30 and 10 degrees."""
    depths = splits.logarithmic(1.0, 1000.0, 4)
    warped, plain = [], []
    for degrees, told in ((90, 15.8), (60, 6.8), (30, 2.9), (10, 2.0)):
        theta = float(np.deg2rad(degrees))
        view = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 1000.0, np.deg2rad(30.0)), theta)
        cost = np.asarray(warpopt.cascades.sphere_texels(view, depths))
        np.testing.assert_allclose(cost, cost[0])  # pieces are similar
        plain.append(cost[0])
        needs = [float(warpopt.cascades.count(view, warp=warp)[1][3]) for warp in (False, True)]
        warped.append(cost[0] * needs[0] / needs[1] / told)
    np.testing.assert_allclose(warped, 1, rtol=0.02)
    assert 2.0 < min(plain) < max(plain) < 4.6


def test_what_spheres_cost_over_a_scene():
    """Over all that a camera sees it is the frustum's; over receivers, raw geometry's."""
    theta = 1.1
    frustum = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 30.0, 0.5), theta)
    camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=30.0, half_fov=0.5)
    view = SceneView(camera, warpopt.DirectionalLight((0, -np.sin(theta), -np.cos(theta))))
    np.testing.assert_allclose(
        warpopt.cascades.sphere_texels(view, [1.0, 4.0, 30.0]),
        warpopt.cascades.sphere_texels(frustum, [1.0, 4.0, 30.0]), rtol=1e-9,
    )  # fmt: skip
    plan = warpopt.cascades.errors(view_of(camera_of()), [4.0, 15.0, 95.0, 100.0], warp=False)
    cost = warpopt.cascades.sphere_texels(view_of(camera_of()), plan.splits)
    tight, _ = plan.matrices()
    wide, ends = plan.matrices(fit="sphere", texels=101)
    np.testing.assert_array_equal(ends, plan.splits[1:])
    for k in range(2):  # one texel of the 101 is left over
        areas = [np.linalg.norm(np.asarray(m)[:2, :3], axis=1).prod() for m in (tight[k], wide[k])]
        assert float(cost[k]) == pytest.approx(areas[0] / areas[1] * (100 / 101) ** 2, rel=1e-9)
    assert np.isinf(cost[2])
    assert np.isnan(wide[2]).all()


@pytest.mark.parametrize(
    ("words", "call"),
    [
        ("texels: got 1", lambda: sphere_matrix(view_of(camera_of()), 1)),
        ("near", lambda: sphere_matrix(view_of(camera_of()), 64, near=-1.0)),
        ("far", lambda: sphere_matrix(view_of(camera_of()), 64, near=5.0, far=4.0)),
        ("splits: got shape", lambda: warpopt.cascades.sphere_texels(view_of(camera_of()), [[1.0, 2.0]])),
        ("splits", lambda: warpopt.cascades.sphere_texels(view_of(camera_of()), [1.0, np.inf])),
        ("fit: got 'cube'", lambda: two().matrices(fit="cube")),
        ("texels: got None with fit='sphere'", lambda: two().matrices(fit="sphere")),
        ("texels: got 64 with fit='tight'", lambda: two().matrices(texels=64)),
        ("padding", lambda: two().matrices(fit="sphere", texels=64, padding=(0.1, 0.1))),
    ],
)  # fmt: skip
def test_refusals(words, call):
    with pytest.raises(ValueError, match=words):
        call()


def two():
    return warpopt.cascades.errors(view_of(camera_of()), [4.0, 15.0, 95.0], warp=False)

"""Depth buffers of more pixels than cells: what reduction to cells must keep, and what it may lose."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt.receivers import DepthBuffer, depth_buffer

LIGHT = warpopt.DirectionalLight((0.3, -1, -0.4))
SHAPES = ((21, 83), (40, 53))  # of this file alone: compiled with few cells


@pytest.fixture(autouse=True)
def few_cells(monkeypatch):
    """Cells of 27 and of 33 pixels, the last of a row shorter."""
    monkeypatch.setattr(depth_buffer, "_CELLS", 64)


def camera_of(dtype=np.float64) -> warpopt.Camera:
    camera = warpopt.Camera.off_centre((0, 2, 0), (0, -0.2, -1), (0, 1, 0), 0.1, 500.0, (-0.5, 0.9, -0.4, 0.3))
    return jax.tree.map(lambda v: v.astype(dtype), camera)


def scene(shape: tuple[int, int], kind: str) -> np.ndarray:
    """Eye depths, 0 for sky: ground rising to the horizon, with posts, or noise."""
    height, width = shape
    rng = np.random.default_rng(3)
    if kind == "noise":
        return np.where(rng.random(shape) < 0.2, 0, 10 ** rng.uniform(-0.5, 2.5, shape))
    up = 0.3 - 0.7 * (np.arange(height) + 0.5) / height
    z = np.where(up < -0.02, 2 / np.maximum(1e-3, -up), 0)[:, None] * (1 + 0.05 * np.sin(np.arange(width)))
    if kind == "posts":
        z[:, ::11] = 3.0
    return z


def eye_points(camera: warpopt.Camera, z: np.ndarray) -> np.ndarray:
    points, seen = depth_buffer.eye_points(DepthBuffer(z), camera)
    return np.asarray(points)[np.asarray(seen)]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_cells_bound_every_pixel(dtype):
    """Depth exactly; width and depth along the light from outside."""
    footprint_of = jax.jit(lambda z, camera, frame: DepthBuffer(z).footprint(camera, frame, warpopt.Objective("pxq")))
    widths_of = jax.jit(lambda footprint, eta: footprint.half_widths(eta))
    shape = SHAPES[0]
    for kind in ("ground", "posts", "noise"):
        camera = camera_of(dtype)
        z = scene(shape, kind).astype(dtype)
        light = warpopt.DirectionalLight(np.array([0.3, -1, -0.4], dtype))
        frame = warpopt.theory.LightFrame(camera, light)
        footprint = footprint_of(z, camera, frame)
        widths = [widths_of(footprint, np.asarray(eta, dtype)) for eta in (1.0, 0.03)]
        footprint = jax.tree.map(np.asarray, footprint)
        points = eye_points(camera, z)
        d, x, h = (points @ np.asarray(axis) for axis in (frame.z_axis, frame.x_axis, frame.light))
        size = 8 * float(np.finfo(dtype).eps) * np.abs(points).max()
        assert abs(footprint.start - d.min()) <= size
        assert abs(footprint.start + footprint.mu - d.max()) <= size
        delta, rest = (d - d.min()) / np.ptp(d), (d.max() - d) / np.ptp(d)
        for eta, width in zip((1.0, 0.03), widths, strict=True):
            blend = rest * eta + delta
            left, right = (float(v) for v in width)
            slack = 1 + 64 * float(np.finfo(dtype).eps) / eta
            exact = ((footprint.axis - x) / blend).max(), ((x - footprint.axis) / blend).max()
            for found, needed in zip((left, right), exact, strict=True):
                assert needed <= found * slack
            assert kind == "noise" or left + right <= 1.35 * sum(exact)  # conservative, not useless
        sides = footprint.sides
        assert sides.light_least.min() <= h.min() + size
        assert np.where(np.isfinite(sides.light_least), sides.light_largest, -np.inf).max() >= h.max() - size


@pytest.mark.parametrize("kind", ["posts", "noise"])
@pytest.mark.parametrize("norm", ["inf", "l2"])
def test_what_cells_lose_is_bounded_and_small(norm, kind):
    """Brute force over all pixels and 4,000 warps. Posts before the ground share cells with it; noise shares all."""
    camera, z = camera_of(), scene(SHAPES[0], kind)
    view = warpopt.SceneView(camera, LIGHT, DepthBuffer(z))
    solution = warpopt.optimal_warp(view, warpopt.Objective("pxq", norm))
    points = eye_points(camera, z)
    e_p, e_q = [], []
    etas = np.append(np.geomspace(1e-4, 1, 4000), float(solution.warp.eta))
    d, x = points @ np.asarray(solution.frame.z_axis), points @ np.asarray(solution.frame.x_axis)
    axis, depth = float(solution.footprint.axis), points[:, 2]
    delta, rest = (d - d.min()) / np.ptp(d), (d.max() - d) / np.ptp(d)
    for eta in etas:
        blend = rest * eta + delta
        width = ((axis - x) / blend).max() + ((x - axis) / blend).max()
        e_p.append(float(solution.frame.density_p) * np.ptp(d) / depth * blend * (blend / eta))
        e_q.append(float(solution.frame.density_q) * width / depth * blend)
    errors = np.array(e_p) * np.array(e_q)
    values = errors.max(1) if norm == "inf" else np.sqrt((errors**2).mean(1))
    regret = values[-1] / values.min() - 1
    assert regret <= solution.excess + 1e-6
    assert values[-1] <= solution.value * (1 + 1e-9)  # what is promised holds for the pixels
    if kind != "noise":
        assert regret < 0.1
        assert solution.excess < 1.5  # cells as wide as 40 % of the screen, E squared


@pytest.mark.thorough
def test_gradients_of_split_cells_and_deep_sky_are_finite():
    z = scene(SHAPES[1], "posts")
    n, f = 0.01, 1e6
    standard = np.where(z > 0, f * (np.maximum(z, 1) - n) / (np.maximum(z, 1) * (f - n)), 1.0).astype(np.float32)
    deep = warpopt.Camera((0, 2, 0), (0, -0.2, -1), (0, 1, 0), np.float32(n), np.float32(f), 0.4)
    deep = jax.tree.map(lambda v: v.astype(np.float32), deep)

    def value(depth, camera):
        light = warpopt.DirectionalLight(jnp.array([0.3, -1, -0.4], jnp.float32))
        buffer = DepthBuffer(depth, "standard")
        view = warpopt.SceneView(camera, light, buffer)
        return warpopt.optimal_warp(view, warpopt.Objective("p", "l2"), throw=False).value

    by_depth, by_camera = jax.jit(jax.grad(value, (0, 1)))(standard, deep)
    assert np.isfinite(by_depth).all()
    assert (np.asarray(by_depth)[z == 0] == 0).all()
    assert all(np.isfinite(v).all() for v in jax.tree.leaves(by_camera))

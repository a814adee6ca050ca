"""What runs otherwise on devices of many threads, on the CPU: the same warps, bounds that hold, derivatives.

Oracle: the path of a CPU, itself held against brute force elsewhere.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Objective, SceneView
from warpopt._parallel import extremes, raised
from warpopt.receivers import DepthBuffer
from warpopt.receivers.weighted import cells
from warpopt.solve import chunks
from warpopt.solve.frusta import Method, solve_frusta
from warpopt.solve.means.sample_norm import Touch
from warpopt.solve.means.weak_convexity import least, longest_interval
from warpopt.solve.scene import solve_scene
from warpopt.solve.scene_norm import log_norm_of

CAMERA = Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4, aspect=1.6)
LIGHTS = jnp.array([(0.3, -1.0, -0.5), (0.0, -0.7, -0.7), (0.5, -0.6, -1.0), (0.3, -1.0, -0.5)])


@pytest.fixture
def wide(monkeypatch):
    """As on a GPU, for what is traced from now on; what was compiled before is not used: each test makes its own."""
    return lambda: monkeypatch.setattr(jax, "default_backend", lambda: "gpu")


def depths() -> jax.Array:
    """Ground with posts, ground alone, noise, and nothing."""
    up = (1 - (np.arange(25) + 0.5) / 25 * 2)[:, None] * np.tan(0.4)
    ground = np.where(up < -0.005, 2 / np.maximum(-up, 1e-9), 0.0) + np.zeros(40)
    posts = ground.copy()
    posts[5:20, 7:9], posts[8:22, 30] = 6.0, 3.0
    noise = np.exp(np.random.default_rng(0).uniform(0, 5, ground.shape))
    return jnp.stack([jnp.asarray(v) for v in (posts, ground, noise, 0 * ground)])


# Moments with grouped sides, and cells; every program takes seconds.
@pytest.mark.parametrize("objective", [Objective("pxq", "l2"), Objective("edge")], ids=lambda o: o.title)
@pytest.mark.thorough("edge, norm l1")
def test_buffers_have_the_same_warps(objective, wide, monkeypatch):
    monkeypatch.setattr(cells, "EXACT", 64)

    def solve(depth, light):
        buffer = DepthBuffer(depth, weights="depth" if objective.kernel else None)
        view = SceneView(CAMERA, DirectionalLight(light), buffer, screen=(1280, 800), shadow_map=(1024, 1024))
        return solve_scene.__wrapped__(view, objective, jnp.asarray(1e-4))

    one = jax.jit(jax.vmap(lambda *v: solve(*v)))(depths(), LIGHTS)
    wide()
    many = jax.jit(jax.vmap(lambda *v: solve(*v)))(depths(), LIGHTS)
    # Both end with one Newton step on the same condition, from starts within sqrt(eps): equal to its rounding.
    np.testing.assert_allclose(many.warp.eta, one.warp.eta, rtol=1e-10)
    np.testing.assert_allclose(many.value, one.value, rtol=1e-12)
    np.testing.assert_array_equal(many.result, one.result)
    if objective.kernel is None:
        np.testing.assert_allclose(many.excess, one.excess, rtol=1e-6, atol=1e-12)
    else:  # two bounds of the same regret, of two searches: neither is below the other's by more than its gap
        np.testing.assert_allclose(many.excess, one.excess, rtol=0.05, atol=1e-5)
        assert (np.asarray(many.gap) <= 1e-5).all()


def test_frusta_have_the_same_warps_in_one_call(wide, monkeypatch):
    rng = np.random.default_rng(0)
    frustum = warpopt.ViewFrustum(1.0, np.exp(rng.uniform(0.05, 9, 600)), 0.5)
    theta, objective = rng.uniform(0.02, 1.57, 600), Objective("p", "l2")
    one = warpopt.optimal_warp(warpopt.FrustumView(frustum, theta), objective)
    monkeypatch.setattr(chunks, "_BLOCK", 64)
    monkeypatch.setattr(chunks, "_CHUNK_ELSEWHERE", 256)
    wide()
    compiled, calls = jax.jit(solve_frusta.__wrapped__, static_argnums=(2, 3)), []

    def counted(*args):
        calls.append(args)
        return compiled(*args)

    many = chunks.in_blocks(counted, (frustum, jnp.asarray(theta)), objective, Method())
    assert len(calls) == 1
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(many))
    np.testing.assert_allclose(many.warp.eta, one.warp.eta, rtol=1e-14)
    np.testing.assert_array_equal(many.result, one.result)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_extremes_of_groups(wide, dtype):
    """Of negative numbers, zeros of both signs, infinities and ties; the derivatives are those of the values kept."""
    rng = np.random.default_rng(0)
    which = jnp.asarray(rng.integers(0, 7, 400))
    which = jnp.where(which == 5, 4, which)  # 5 stays empty
    a, b = (jnp.asarray(rng.normal(size=400) * 10.0 ** rng.integers(-20, 20, 400), dtype) for _ in range(2))
    a = a.at[:8].set(jnp.asarray([0.0, -0.0, np.inf, -np.inf, 1.0, 1.0, -1.0, -1.0], dtype))

    def both(values):
        return extremes({"low": values, "high": b}, {"low": 1, "high": -1}, which, 7)

    def total(values):
        found = raised(jnp.zeros((7, 1), dtype), which, values[:, None])
        return (found * jnp.arange(1, 8, dtype=dtype)[:, None]).sum()

    def of_all(values, others):
        return both(values), jax.grad(total)(others), jax.vmap(both)(jnp.stack([values, -values]))["low"][0]

    expected, slopes, _ = jax.jit(lambda *v: of_all(*v))(a, b)
    wide()
    found, found_slopes, mapped = jax.jit(lambda *v: of_all(*v))(a, b)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    np.testing.assert_array_equal(found_slopes, slopes)
    np.testing.assert_array_equal(mapped, expected["low"])


@pytest.mark.parametrize("occupied", [0.0, 0.002, 0.05, 0.2, 0.3, 1.0])
def test_cells_are_compacted_at_once_as_one_by_one(occupied):
    """The finest list that fits, in its order, and 0 beyond: also of none, and where only the last one fits.

    Two groups whose rooms differ choose different lists, of which they have two in common.
    """
    rng = np.random.default_rng(3)
    lists = [jnp.asarray(rng.random((count, 4)) * (rng.random((count, 1)) < occupied)) for count in (960, 240, 60)]
    together = jax.jit(cells._compacted_at_once)([lists, lists[:2]])
    for group, others in zip((lists, lists[:2]), together, strict=True):
        chosen, which, found = jax.jit(cells._compacted)(group)
        room = len(group[-1])
        assert int(chosen) == int(others.chosen) == [bool((v[:, 0] > 0).sum() <= room) for v in group].index(True)
        there = others.sums[:, 0] > 0
        np.testing.assert_array_equal(others.sums[there], found[found[:, 0] > 0])
        np.testing.assert_array_equal(others.which[there], which[found[:, 0] > 0])
        np.testing.assert_allclose(others.sums.sum(0), found.sum(0), rtol=1e-13)  # 0 beyond


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_root_finder_s_bracket_is_as_long_as_promised(dtype, wide):
    """With a minimum between any two nodes, also near the ends, of functions whose bounds are lowest elsewhere."""
    wide()
    longest, brackets = longest_interval(dtype), []

    @jax.jit
    @jax.vmap
    def bracket(floor, place):
        at = floor ** (1 - place)  # from the floor to 1

        def touch(eta):
            away = jnp.log(eta / at)
            # Flat bounds to the right of the minimum, where nothing is to be found.
            bend = jnp.where(eta > at, 1e4, 0.0).astype(eta.dtype)
            # Slopes are finite at the least eta.
            return Touch(1 + 0.05 * away * away, 0.1 * away / eta, bend, jnp.zeros_like(eta))

        found = least(touch, floor)
        return found.below, found.above, at

    tiny = float(np.finfo(dtype).tiny)
    floors, places = (v.ravel() for v in np.meshgrid([1e-4, 0.3, 10 * tiny], np.linspace(0.01, 0.99, 97)))
    below, above, at = map(np.asarray, bracket(jnp.asarray(floors, dtype), jnp.asarray(places, dtype)))
    inside = (below > 0) & np.isfinite(above)
    assert inside.mean() > 0.9
    brackets = np.log(above[inside]) - np.log(below[inside])
    assert (brackets <= longest * (1 + 1e-3)).all()
    assert brackets.max() > longest / 3  # it is no idle promise
    blurred = 8 * float(np.finfo(dtype).eps) ** 0.5  # nodes this close to the minimum have its value
    assert ((below <= at * (1 + blurred)) & (at <= above * (1 + blurred))).all()


def test_a_mean_has_the_same_curves_and_slopes(wide):
    """Of many pixels with posts that tie for the width; slopes also by reverse mode, which not every sum has."""
    view = SceneView(CAMERA, DirectionalLight(LIGHTS[0]), DepthBuffer(depths()[0], weights="depth"))
    objective = Objective("edge", "l2")
    norm = log_norm_of(view.footprint(objective), view.frame(), objective)

    def of_all(norm, logs):
        @jax.vmap
        def at(u):
            active = norm.active(u)
            slope = jax.value_and_grad(lambda u: norm.value_and_slope(u, active)[1])
            return norm.touch(jnp.exp(u)), norm.value_and_slope(u, active), slope(u)

        return at(logs)

    logs = jnp.linspace(-6, -0.01, 20)
    one = jax.jit(lambda *v: of_all(*v))(norm, logs)
    wide()
    many = jax.jit(lambda *v: of_all(*v))(norm, logs)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-13), one, many)  # sums reorder


@pytest.mark.thorough
def test_bounds_between_nodes_hold_at_once(wide):
    """For waves, whose parabolas are as steep as they must be: what is not proved is said."""

    def touch(eta):
        bend = 200.0 * jnp.ones_like(eta)
        return Touch(3 + jnp.cos(20 * eta) + eta, 1 - 20 * jnp.sin(20 * eta), bend, jnp.zeros_like(eta))

    grid = np.linspace(1e-3, 1, 20_001)
    values = np.asarray(touch(grid).value)
    wide()
    for tolerance in (1e-6, 1e-2):
        found = jax.jit(lambda floor, t=tolerance: least(touch, floor, tolerance=t))(1e-3)
        live = np.isfinite(found.bounds)
        starts, ends, bounds = (np.asarray(v)[live] for v in (found.starts, found.ends, found.bounds))
        order = np.argsort(starts)
        starts, ends, bounds = starts[order], ends[order], bounds[order]
        np.testing.assert_array_equal(starts[1:], ends[:-1])  # they tile the range
        which = np.clip(np.searchsorted(starts, grid, side="right") - 1, 0, None)
        assert (bounds[which] <= values + 1e-12).all()
        assert bounds.min() <= values.min() <= found.value + 1e-12
        assert found.below < found.eta < found.above
        np.testing.assert_allclose(found.value, values.min(), rtol=2e-3 if tolerance > 1e-4 else 1e-5)

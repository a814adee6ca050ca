"""jit, vmap, shapes, and no recompilation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes

import warpopt
from warpopt.solve import frusta

EPS = np.finfo(np.float64).eps
FRUSTUM, THETA = scenes.batch()
VIEW = warpopt.FrustumView(FRUSTUM, THETA)


@pytest.mark.parametrize(("metric", "norm"), [("p", "inf"), ("q", "l2")])
def test_jit_and_vmap_equal_the_eager_batch(metric, norm):
    """Fusion may regroup roundings: a few eps of eta's condition number."""
    eager = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm))

    def solve(frustum, theta):
        return warpopt.optimal_warp(warpopt.FrustumView(frustum, theta), warpopt.Objective(metric, norm))

    jitted, mapped = jax.jit(solve)(FRUSTUM, THETA), jax.vmap(solve)(FRUSTUM, THETA)
    for other in (jitted, mapped):
        np.testing.assert_allclose(other.warp.eta, eager.warp.eta, rtol=1e-13)
        np.testing.assert_allclose(other.value, eager.value, rtol=1e-13)
        assert other.result.tolist() == eager.result.tolist()


def test_one_scene_equals_its_place_in_the_batch():
    """Lanes do not disturb each other, though they iterate together."""
    batch = warpopt.optimal_warp(VIEW, warpopt.Objective("p", "l2"))
    for i in (0, 5, 9):
        alone = warpopt.optimal_warp(
            warpopt.FrustumView(jax.tree.map(lambda v, i=i: v[i], FRUSTUM), THETA[i]), warpopt.Objective("p", "l2")
        )
        assert alone.value.shape == ()
        np.testing.assert_allclose(alone.warp.eta, batch.warp.eta[i], rtol=1e-13)


@pytest.mark.parametrize("norm", ["inf", "l1"])
def test_shapes_broadcast(norm):
    frustum = warpopt.ViewFrustum(1.0, np.array([10.0, 100.0, 1e3])[:, None], 0.5)
    view = warpopt.FrustumView(frustum, np.array([0.3, 1.0]))
    solution = warpopt.optimal_warp(view, warpopt.Objective("p", norm))
    for field in (solution.warp.eta, solution.warp.lam, solution.warp.mu, solution.value, solution.result):
        assert field.shape == (3, 2)
    assert solution.warp.one_minus_eta.shape == solution.residual.shape == (3, 2)
    warp = warpopt.Warp.from_eta(np.ones((4, 1, 1)), view)
    values = warpopt.error_norm(view, warp, warpopt.Objective("p", norm))
    assert values.shape == (4, 3, 2)


@pytest.mark.parametrize("norm", ["inf", "l1"])
def test_an_empty_batch_is_a_batch(norm):
    empty = warpopt.ViewFrustum(jnp.zeros((0,)), jnp.zeros((0,)), 0.5)
    assert warpopt.optimal_warp(warpopt.FrustumView(empty, 1.0), warpopt.Objective("p", norm)).value.shape == (0,)
    assert warpopt.rules.lispsm(empty, 1.0).eta.shape == (0,)


def test_new_values_do_not_recompile():
    """The compiled solver is specialised to shapes, dtype, norm and method, never to a value."""
    warpopt.optimal_warp(VIEW, warpopt.Objective("p", "inf"))
    warpopt.error_norm(VIEW, warpopt.Warp.from_eta(0.5 + 0 * THETA, VIEW), warpopt.Objective("p", "inf"))
    before = frusta.solve_frusta._cache_size(), frusta.norms_over_frusta._cache_size()
    for factor in (1.5, 2.5):
        frustum = warpopt.ViewFrustum(FRUSTUM.near * factor, FRUSTUM.far * factor**2, FRUSTUM.half_fov / factor)
        theta = THETA / factor
        view = warpopt.FrustumView(frustum, theta)
        solution = warpopt.optimal_warp(view, warpopt.Objective("p", "inf"))
        warpopt.error_norm(view, warpopt.Warp.from_eta(solution.warp.eta, view), warpopt.Objective("p", "inf"))
    assert (frusta.solve_frusta._cache_size(), frusta.norms_over_frusta._cache_size()) == before
    warpopt.optimal_warp(VIEW, warpopt.Objective("p", "inf"), method="iterative")
    assert frusta.solve_frusta._cache_size() == before[0] + 1


def test_any_size_beyond_a_block_is_one_compilation():
    """Blocks of 2^20 of one padded shape: sizes on either side of two and three of them, and the values of one call."""
    few = jnp.linspace(0.1, 1.5, 1000)
    one = warpopt.ViewFrustum(1.0, 50.0, 0.5)
    expected = warpopt.optimal_warp(warpopt.FrustumView(one, few)).warp.eta
    before = frusta.solve_frusta._cache_size()
    for count in (2**20 + 1, 2**21 - 7, 2**21 + 3):
        theta = np.resize(few, count)
        eta = warpopt.optimal_warp(warpopt.FrustumView(one, theta)).warp.eta
        assert eta.shape == (count,)
        np.testing.assert_allclose(eta, np.resize(expected, count), rtol=4 * np.finfo(float).eps)
    assert frusta.solve_frusta._cache_size() == before + 1


def test_solutions_and_warps_are_trees():
    """They pass through jit and scan as arguments and results."""
    warp = warpopt.optimal_warp(VIEW).warp
    same = jax.jit(lambda w: w)(warp)
    assert isinstance(same, warpopt.Warp)
    np.testing.assert_array_equal(same.eta, warp.eta)

"""jit, vmap, shapes, and no recompilation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes

import warpopt
from warpopt.bound import lower_bound as bounds
from warpopt.compare import over_scene, rule_set
from warpopt.receivers import ConvexBody
from warpopt.render import shadow_matrix as matrices
from warpopt.solve import chunks, frusta, scene
from warpopt.solve import optimal_warp as solver

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


@pytest.mark.thorough
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


def test_a_new_resolution_compiles_nothing():
    """Screen, shadow map, floor of eta, padding and the box' bounds are traced values; each took seconds anew.

    Killed: any of them as a static argument, integers in the place of floats as another program.
    """
    camera = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45)
    objective = warpopt.Objective("q")
    programs = scene.solve_scene, scene.norms_over_scene, matrices._matrix, over_scene._over_lights

    def run(screen, shadow_map, min_eta, depth):
        light, box = warpopt.DirectionalLight((0.3, -1, depth / 100)), ConvexBody.box((-9, 0, -depth), (9, 3, -5))
        view = warpopt.SceneView(camera, light, box, screen=screen, shadow_map=shadow_map)
        solution = warpopt.optimal_warp(view, objective, min_eta=min_eta)
        norm = warpopt.error_norm(view, solution, objective)
        matrix = warpopt.shadow_matrix(view, solution, padding=(1 / shadow_map[0], 1 / shadow_map[1]))
        lights = jax.tree.map(lambda v: v[None], light)
        several = warpopt.SceneView(camera, lights, box, screen=screen, shadow_map=shadow_map)
        found = warpopt.compare_rules(several, "psm", objective, min_eta=min_eta)
        return norm, matrix, found.unwarped

    first = run((1920, 1080), (2048, 2048), 1e-4, 60.0)
    before = [program._cache_size() for program in programs]
    for changed in (((1280.0, 720.0), (512, 1024), 1e-4, 60.0), ([640, 480], (64, 32), np.float64(1e-3), 40.0)):
        other = run(*changed)
        assert all(np.any(np.asarray(a) != np.asarray(b)) for a, b in zip(first, other, strict=True))
    assert [program._cache_size() for program in programs] == before


def test_a_new_frustum_compiles_nothing_in_a_comparison_and_a_bound():
    view = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 100.0, 0.5), np.linspace(0.2, 1.5, 16))
    warpopt.compare_rules(view, ["lispsm", "tsm"])
    programs = rule_set._own, frusta.solve_and_compare, bounds.bound_frusta
    before = [program._cache_size() for program in programs]
    other = warpopt.FrustumView(warpopt.ViewFrustum(0.3, 70.0, 0.7), np.linspace(0.3, 1.4, 16))
    found = warpopt.compare_rules(other, ["lispsm", "tsm"])
    assert np.isfinite(found.values).all()
    assert [program._cache_size() for program in programs] == before


def test_a_comparison_of_many_directions_goes_by_blocks(monkeypatch):
    """No compiled program is given more than a block of directions, whatever the rules; and the values are the same.

    Killed: rules, optima or bounds of a comparison in one call, whose memory grows with the number of directions.
    """
    theta = np.linspace(0.1, 1.5, 1500)
    view = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 50.0, 0.5), theta)
    whole = warpopt.compare_rules(view, ["lispsm", "tsm"])
    monkeypatch.setattr(chunks, "_BLOCK", 512)
    sizes = {}

    def recorded(module, name):
        program = getattr(module, name)

        def call(*arguments):
            leaves = jax.tree.leaves(arguments)
            sizes.setdefault(name, []).append(max(np.size(leaf) for leaf in leaves if not isinstance(leaf, str)))
            return program(*arguments)

        monkeypatch.setattr(module, name, call)

    recorded(rule_set, "_own")
    recorded(solver, "solve_and_compare")
    recorded(bounds, "bound_frusta")
    pieces = warpopt.compare_rules(view, ["lispsm", "tsm"])
    assert {name: max(seen) for name, seen in sizes.items()} == dict.fromkeys(
        ("_own", "solve_and_compare", "bound_frusta"), 512
    )
    for name in ("eta", "values", "unwarped", "bound"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=8 * EPS)
    assert pieces.regions == whole.regions

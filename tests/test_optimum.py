"""Optima against the twin's search, which knows raw geometry and the definition of a norm and nothing else."""

import numpy as np
import optima
import pytest
import scenes
import twin
from twin import mp, mpf

import warpopt

EPS = np.finfo(np.float64).eps
EXPONENTS = optima.NAMED
FRUSTUM, THETA = scenes.batch()
VIEW = warpopt.FrustumView(FRUSTUM, THETA)


def check_against_search(solution, of, cases=scenes.CASES):
    """eta to 1e-12 and lambda to 1e-10 max(1, lambda / mu), relatively; the value to 500 eps."""
    eta, lam, value = (np.asarray(v) for v in (solution.warp.eta, solution.warp.lam, solution.value))
    for i, scene in enumerate(scenes.twins(cases)):
        exact_eta, exact_lam, exact_value = optima.known()[cases[i].tag, of]
        where = f"{cases[i].tag}: {eta[i]} for {mp.nstr(exact_eta, 20)}"
        assert abs(float(mpf(float(eta[i])) / exact_eta - 1)) < 1e-12, where
        if exact_eta < 1 - mpf(10) ** -9:
            allowed = 1e-10 * max(1.0, float(exact_lam / scene.mu))
            assert abs(float(mpf(float(lam[i])) / exact_lam - 1)) < allowed, where
        if solution.result[i] == warpopt.Outcome.no_warp:
            assert eta[i] == 1
            assert lam[i] == np.inf
        assert abs(float(mpf(float(value[i])) / exact_value - 1)) < 500 * EPS, where


@pytest.mark.parametrize("number", range(len(optima.OBJECTIVES)))
def test_the_file_of_optima_is_what_the_search_finds(number):
    """One scene for each objective, another for each; `python tests/optima.py` writes all of them."""
    of, case = optima.OBJECTIVES[number], scenes.CASES[(5 * number) % len(scenes.CASES)]
    eta, _, value = optima.searched(case, of)
    known_eta, _, known_value = optima.known()[case.tag, of]
    assert abs(eta / known_eta - 1) < mpf(10) ** -19
    assert abs(value / known_value - 1) < mpf(10) ** -19


@pytest.mark.parametrize("measure", ["screen", "axis"])
@pytest.mark.parametrize("norm", ["inf", "l1", "l2"])
@pytest.mark.parametrize("metric", ["p", "q", "pxq"])
def test_optimum(metric, norm, measure):
    solution = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm, measure))
    check_against_search(solution, optima.Of(*EXPONENTS[metric], norm, measure))


@pytest.mark.parametrize(
    ("metric", "norm", "measure"),
    [("p", "l2", "volume"), ("pxq", "l1", "log_depth"), ("q", "l2", "ground"), ("p", "l1", "ground")],
)
def test_optimum_in_other_measures(metric, norm, measure):
    solution = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm, measure))
    check_against_search(solution, optima.Of(*EXPONENTS[metric], norm, measure))


@pytest.mark.parametrize("of", optima.REAL_ORDERS)
def test_optimum_of_real_orders(of):
    """The quadrature's path."""
    objective = warpopt.Objective(warpopt.Metric(of.alpha, of.beta), of.norm, of.measure)
    check_against_search(
        warpopt.optimal_warp(warpopt.FrustumView(*scenes.batch(optima.FEW)), objective), of, optima.FEW
    )


def test_optimum_of_a_mixed_metric():
    """Exponents that are not whole but whose M is: Metric(0.5, 1), L1, has M = 2 and moments."""
    solution = warpopt.optimal_warp(VIEW, warpopt.Objective(warpopt.Metric(0.5, 1), "l1"))
    check_against_search(solution, optima.Of(0.5, 1.0, "l1", "screen"))


def test_moments_and_quadrature_agree():
    """Two independent paths to one number: order 2 by moments, order 2 + 1e-9 by quadrature.

    d log(eta) / d order is of order one, so that 1e-8 is the order's own effect, and the value moves as little.
    """
    by_moments = warpopt.optimal_warp(VIEW, warpopt.Objective("q", 2.0))
    by_quadrature = warpopt.optimal_warp(VIEW, warpopt.Objective("q", 2 + 1e-9))
    np.testing.assert_allclose(by_quadrature.warp.eta, by_moments.warp.eta, rtol=1e-8)
    np.testing.assert_allclose(by_quadrature.value, by_moments.value, rtol=1e-8)


def test_the_iterative_path_reaches_the_closed_forms():
    """E_p L1 and E_q L2 are closed; the bracketed Newton gives the same to its own tolerance, a few eps."""
    for metric, norm in (("p", "l1"), ("q", "l2")):
        closed = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm))
        iterated = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm), method="iterative")
        # the residual bounds the error of log(eta), and is itself a rounded difference of two logarithms
        np.testing.assert_array_less(iterated.residual, 1e-13)
        np.testing.assert_allclose(iterated.warp.eta, closed.warp.eta, rtol=1e-12)


def test_values_are_norms_of_the_optimal_warps():
    for metric, norm in (("p", "inf"), ("pxq", "l2")):
        solution = warpopt.optimal_warp(VIEW, warpopt.Objective(metric, norm))
        recomputed = warpopt.error_norm(VIEW, solution.warp, warpopt.Objective(metric, norm))
        np.testing.assert_allclose(recomputed, solution.value, rtol=4 * EPS)


@pytest.mark.thorough
def test_norms_of_any_warp_equal_the_twin():
    """Not at optima only: three warps on every scene, L1, L2 and L-inf, to the moments' 500 eps."""
    for metric, norm in (("p", "inf"), ("pxq", "inf"), ("p", "l2"), ("q", "l1")):
        norms = [optima.norm_of(scene, optima.Of(*EXPONENTS[metric], norm, "screen")) for scene in scenes.twins()]
        for eta in (1e-3, 0.2, 0.95):
            warp = warpopt.Warp.from_eta(np.full(len(norms), eta), VIEW)
            got = np.asarray(warpopt.error_norm(VIEW, warp, warpopt.Objective(metric, norm)))
            exact = [f(s.lam(mpf(eta))) for f, s in zip(norms, scenes.twins(), strict=True)]
            np.testing.assert_allclose(got, [float(e) for e in exact], rtol=500 * EPS)


def test_norms_over_thin_frusta_keep_their_digits():
    """f - n = 1e-8: masses and moments, whose differences of powers would lose half of all digits."""
    near, far = np.linspace(1.1, 7.3, 4), np.linspace(1.1, 7.3, 4) + 1e-8 * np.linspace(0.7, 3.1, 4)
    view = warpopt.FrustumView(warpopt.ViewFrustum(near, far, 0.5), 1.0)
    for measure in ("volume", "ground"):
        of = optima.Of(1.0, 0.0, "l1", measure)
        got = warpopt.error_norm(
            view, warpopt.Warp.from_eta(np.full(4, 0.3), view), warpopt.Objective("p", "l1", measure)
        )
        scenes_of = [twin.Scene(n, f, 0.5, 1.0) for n, f in zip(near, far, strict=True)]
        exact = [float(optima.norm_of(scene, of)(scene.lam(mpf(0.3)))) for scene in scenes_of]
        np.testing.assert_allclose(got, exact, rtol=64 * EPS)


def test_twin_norms_agree_with_plain_integration():
    """The oracle's own check: two nested quadratures over (z, y) of the error itself, no antiderivative."""
    scene = twin.Scene(1.0, 20.0, 0.5, 0.7)
    lam = mpf("3.7")
    norm = twin.PowerMean(scene, 1, 1, 2, "screen")
    mp.dps = 15
    try:

        def over_heights(integrand, z):
            return mp.quad(lambda y: integrand(y, z), [-z * scene.tan_phi, z * scene.tan_phi], method="gauss-legendre")

        def over_view(integrand):
            # screen: z^-2 dx dy dz, dx giving 2 z tan(phi); dz = z d(log z)
            return mp.quad(
                lambda t: over_heights(integrand, mp.exp(t)) * 2 * scene.tan_phi,
                [0, mp.log(20)],
                method="gauss-legendre",
            )

        plain = mp.sqrt(over_view(lambda y, z: scene.error(1, 1, lam, y, z) ** 2) / over_view(lambda y, z: mpf(1)))
        assert abs(plain / norm(lam) - 1) < mpf(10) ** -13
    finally:
        mp.dps = 60


def test_the_maximum_is_at_a_corner():
    """The L-inf oracle looks at corners only; a dense grid of points never exceeds them."""
    s, r = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0, 1, 41))
    for metric, exponents in EXPONENTS.items():
        for eta in (0.003, 0.1, 0.9):
            warp = warpopt.Warp.from_eta(eta, VIEW)
            z = np.asarray(FRUSTUM.near) * (1 - r[..., None]) + np.asarray(FRUSTUM.far) * r[..., None]
            u = (1 + s[..., None]) / 2
            grid = np.asarray(warpopt.theory.aliasing_error_uz(FRUSTUM, THETA, warp, u, z, metric))
            corners = [float(t.supremum(*exponents, t.lam(mpf(eta)))) for t in scenes.twins()]
            np.testing.assert_allclose(grid.max((0, 1)), corners, rtol=64 * EPS)


@pytest.mark.parametrize("norm", ["l1", "l2"])
def test_a_flat_optimum_is_no_warp(norm):
    """A light along the view: delta is even about 1/2, so that E_p's norm has its minimum, and no slope, at eta = 1.

    Killed: a slope of rounding, which has either sign, taken for one.
    """
    rng = np.random.default_rng(5)
    near = 10 ** rng.uniform(-2, 2, 200)
    frustum = warpopt.ViewFrustum(near, near * (1 + 10 ** rng.uniform(-1, 3, 200)), rng.uniform(0.05, 1.2, 200))
    solution = warpopt.optimal_warp(warpopt.FrustumView(frustum, 0.0), warpopt.Objective("p", norm))
    assert bool((solution.warp.eta == 1).all())
    assert bool((solution.result == warpopt.Outcome.no_warp).all())

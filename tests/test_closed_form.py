"""The exact L-inf optimum for every direction and several exponents: against iteration, and against the twin."""

import functools
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import scenes
import twin
from twin import mpf

import warpopt
from warpopt.solve.sign_change import positive_root

EPS = np.finfo(np.float64).eps
ROOT = Path(__file__).parents[1]
EXPONENTS = [(1, 0), (0, 1), (1, 1), (0.5, 2), (2, 0.5)]
SWEEP = np.concatenate([np.linspace(0, np.pi, 61), [scenes.PHI, np.pi - scenes.PHI, 1e-6, np.pi / 2 - 1e-6]])
# (f/n, phi) in rows, near scaled so that no length is of order one
VIEWS = warpopt.ViewFrustum(
    np.array([[3.0], [0.02], [50.0], [7.0]]),
    np.array([[300.0], [0.022], [5e5], [35.0]]),
    np.array([[scenes.PHI], [1.2], [0.05], [0.8]]),
)


@pytest.mark.parametrize(("alpha", "beta"), EXPONENTS)
def test_closed_form_equals_iteration(alpha, beta):
    """Every direction in 0..pi, four views. Two formulas apart in structure; both within tens of eps of the truth."""
    metric = warpopt.Metric(alpha, beta)
    closed = warpopt.optimal_warp(warpopt.FrustumView(VIEWS, SWEEP), warpopt.Objective(metric, "inf"))
    iterated = warpopt.optimal_warp(
        warpopt.FrustumView(VIEWS, SWEEP), warpopt.Objective(metric, "inf"), method="iterative"
    )
    np.testing.assert_allclose(iterated.value, closed.value, rtol=64 * EPS)
    # the tie is a difference at theta near phi, eta's own condition number: lambda = Y - g
    np.testing.assert_allclose(iterated.warp.eta, closed.warp.eta, rtol=1e-12)
    assert (np.asarray(iterated.warp.no_warp) == np.asarray(closed.warp.no_warp)).mean() > 0.99  # ties of rounding
    np.testing.assert_array_less(closed.residual, 1e-12)


@pytest.mark.parametrize(("alpha", "beta"), EXPONENTS)
def test_closed_form_equals_the_search(alpha, beta):
    """Thirteen directions of the sweep, each view, to 1e-12 in eta; the regret to rounding."""
    chosen = slice(1, None, 5)
    solution = warpopt.optimal_warp(
        warpopt.FrustumView(VIEWS, SWEEP), warpopt.Objective(warpopt.Metric(alpha, beta), "inf")
    )
    eta, value = np.asarray(solution.warp.eta)[:, chosen], np.asarray(solution.value)[:, chosen]
    for i in range(4):
        near, far, half_fov = float(VIEWS.near[i, 0]), float(VIEWS.far[i, 0]), float(VIEWS.half_fov[i, 0])
        for j, theta in enumerate(SWEEP[chosen]):
            s = twin.Scene(near, far, half_fov, theta)
            norm = functools.partial(s.supremum, mpf(alpha), mpf(beta))
            exact, _, least = twin.search(s, norm, lowest=1e-9, width=1e-16)
            assert abs(float(mpf(float(eta[i, j])) / exact - 1)) < 1e-12, (i, theta)
            assert abs(float(mpf(float(value[i, j])) / least - 1)) < 64 * EPS, (i, theta)


def test_e_q_optimum_is_psm_or_no_warp():
    """lambda = n a, value 2 b / a, where f a > n b; elsewhere no warp, value 2 f / n."""
    solution = warpopt.optimal_warp(warpopt.FrustumView(VIEWS, SWEEP), warpopt.Objective("q", "inf"))
    n, f, phi = (np.asarray(v) for v in (VIEWS.near, VIEWS.far, VIEWS.half_fov))
    s, T = np.sin(SWEEP), np.tan(phi) * np.abs(np.cos(SWEEP))
    a, b = s - T, s + T
    clear = np.abs(f * a - n * b) > 1e-9 * f  # which side is meant, beyond rounding
    helps = f * a > n * b
    assert (np.asarray(solution.warp.no_warp) == ~helps)[clear].all()
    with np.errstate(divide="ignore"):
        expected = np.where(helps, 2 * b / a, 2 * f / n)
    # naive a here: an eps of s, of itself a / s times that
    np.testing.assert_allclose(np.asarray(solution.value)[clear], expected[clear], rtol=1e-12)
    psm = warpopt.rules.psm(VIEWS, SWEEP)
    both = helps & clear
    np.testing.assert_allclose(np.asarray(solution.warp.eta)[both], np.asarray(psm.eta)[both], rtol=1e-12)


def test_e_q_optimum_keeps_its_digits_next_to_phi():
    """lambda = n a is a difference of lengths f/n times larger if taken from the tie; every digit must survive.

    f/n = 1e8 and theta from phi (1 + 1e-6): the value 2 b / a against the twin, to 64 eps.
    """
    phi = 0.4
    frustum = warpopt.ViewFrustum(1.0, 1e8, phi)
    theta = phi * (1 + np.array([1e-6, 1e-5, 1e-3]))
    solution = warpopt.optimal_warp(warpopt.FrustumView(frustum, theta), warpopt.Objective("q", "inf"))
    for i, angle in enumerate(theta):
        s = twin.Scene(1.0, 1e8, phi, angle)
        a, b = s.sin - s.tan_phi * s.cos, s.sin + s.tan_phi * s.cos
        assert abs(float(float(solution.value[i]) * a / (2 * b) - 1)) < 64 * EPS
        assert abs(float(float(solution.warp.lam[i]) / (s.near * a) - 1)) < 64 * EPS


def test_axis_optimum_of_e_p():
    """theta >= phi: lambda = max(d0 + sin(theta) sqrt(n f), mu n T / (mu - 2 n T)), T = tan(phi) |cos(theta)|."""
    solution = warpopt.optimal_warp(warpopt.FrustumView(VIEWS, SWEEP), warpopt.Objective("p", "inf", "axis"))
    for i in range(4):
        n, f, phi = float(VIEWS.near[i, 0]), float(VIEWS.far[i, 0]), float(VIEWS.half_fov[i, 0])
        for j, theta in enumerate(SWEEP):
            s = twin.Scene(n, f, phi, theta)
            if s.d0 <= 0:
                continue
            T = s.tan_phi * abs(s.cos)
            near_end = s.mu * s.near * T / (s.mu - 2 * s.near * T) if s.mu > 2 * s.near * T else mpf("inf")
            lam = max(s.d0 + s.sin * (s.near * s.far) ** mpf("0.5"), near_end)
            if lam == mpf("inf"):
                assert bool(solution.warp.no_warp[i, j])
            else:
                got = mpf(float(solution.warp.lam[i, j]))
                assert abs(float(got / lam - 1)) < 1e-12 * max(1.0, float(lam / s.mu)), (i, theta)


def test_no_warp_zone_is_decided_by_one_sign():
    """E_p: no warp iff D sin(theta) <= n T (theta < phi); both sides of it, 1e-9 apart."""
    frustum = warpopt.ViewFrustum(1.0, 100.0, scenes.PHI)
    edge = np.arctan(np.tan(scenes.PHI) / 99)
    solution = warpopt.optimal_warp(
        warpopt.FrustumView(frustum, np.array([edge * (1 - 1e-9), edge * (1 + 1e-9)])), warpopt.Objective("p", "inf")
    )
    assert solution.result.tolist() == [warpopt.Outcome.no_warp, warpopt.Outcome.stationary]
    assert float(solution.warp.lam[0]) == np.inf
    assert float(solution.warp.lam_over_mu[1]) > 1e6


def test_orders_of_magnitude(monkeypatch):
    """n = 1, f = 100, phi = 30 degrees: worked elsewhere to three figures; README has what the experiment finds."""
    monkeypatch.setattr(sys, "path", [str(ROOT / "experiments"), *sys.path])
    import results

    worked = {
        "p": [
            [0.1111, 10.0, 1.00, 2.50, 2.15],
            [0.1055, 9.55, 1.04, 1.52, 2.04],
            [0.1, 9.09, 1.79, 1.08, 1.96],
            [1.210, 1.09, 1.05, 1.33, 16.3],
        ],
        "pxq": [
            [0.04868, 464, 4.64, 29.0, np.nan],  # no limit is known
            [0.04098, 116, 5.72, 5.29, np.nan],
            [np.inf, 1, 1.56, 3.11, np.nan],
        ],
    }
    found = {metric: results.losses(metric) for metric in results.DEGREES}
    for metric, rows in worked.items():
        np.testing.assert_allclose(found[metric], rows, rtol=6e-3)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"<!-- results -->\n{results.table(found)}\n<!-- end results -->" in readme


def test_quadratics_of_any_size_have_their_root():
    """c2 x^2 + c1 x + c0, c2 > 0 > c0, c1 of either sign or zero, over 200 orders of magnitude: 500 digits beside."""
    rng = np.random.default_rng(6)
    c2, c1, c0 = 10 ** rng.uniform(-100, 100, 90), 10 ** rng.uniform(-100, 100, 90), -(10 ** rng.uniform(-100, 100, 90))
    c1 *= np.resize([1, -1, 0], 90)
    root, found = positive_root(((2, 1, 0), tuple(jnp.asarray(c) for c in (c2, c1, c0))), False)
    assert bool(found.all())
    exact = []
    for a, b, c in zip(c2, c1, c0, strict=True):
        a, b, c = (twin.mp.mpf(float(v)) for v in (a, b, c))
        with twin.mp.workdps(500):
            exact.append(float((twin.mp.sqrt(b * b - 4 * a * c) - b) / (2 * a)))
    np.testing.assert_allclose(root, exact, rtol=8 * EPS)

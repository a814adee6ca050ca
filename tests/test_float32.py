"""float32 in, float32 out, to a multiple of its eps; and the angles that only float32 can write."""

import jax.numpy as jnp
import numpy as np
import pytest
import scenes

import warpopt

EPS = np.finfo(np.float32).eps
# Without the two scenes that differ from theta = phi, or from theta = pi/2, by less than float32 can say.
CASES = [
    case
    for case in scenes.CASES
    if case.tag not in ("just above phi", "nearly overhead", "theta equals phi", "deep, theta equals phi")
]
FRUSTUM, THETA = scenes.batch(CASES, np.float32)
# The same numbers, as float64 sees them: input rounding is not what is measured here.
EXACT = warpopt.ViewFrustum(*(np.asarray(v, np.float64) for v in (FRUSTUM.near, FRUSTUM.far, FRUSTUM.half_fov)))
EXACT_THETA = np.asarray(THETA, np.float64)
SINGLE, DOUBLE = warpopt.FrustumView(FRUSTUM, THETA), warpopt.FrustumView(EXACT, EXACT_THETA)


@pytest.mark.parametrize(("metric", "norm"), [("p", "inf"), ("pxq", "inf"), ("p", "l2"), ("q", "l2")])
def test_same_optimum(metric, norm):
    """eta to 1e3 eps where it is well conditioned, the value to 400 eps everywhere, no lane failed, all in float32."""
    single = warpopt.optimal_warp(SINGLE, warpopt.Objective(metric, norm))
    double = warpopt.optimal_warp(DOUBLE, warpopt.Objective(metric, norm))
    for field in (
        single.warp.eta,
        single.warp.one_minus_eta,
        single.warp.lam,
        single.warp.mu,
        single.value,
        single.residual,
    ):
        assert field.dtype == jnp.float32
    np.testing.assert_allclose(single.value, double.value, rtol=400 * EPS)
    np.testing.assert_allclose(single.warp.eta, double.warp.eta, rtol=1000 * EPS)
    # what matters: the norm of the float32 warp, in float64, is the minimum
    regret = (
        warpopt.error_norm(
            DOUBLE,
            warpopt.Warp.from_eta(np.asarray(single.warp.eta, np.float64), DOUBLE),
            warpopt.Objective(metric, norm),
        )
        / double.value
    )
    np.testing.assert_allclose(regret, 1, atol=100 * EPS)


def test_errors_and_rules():
    warp, exact = warpopt.rules.lispsm(FRUSTUM, THETA), warpopt.rules.lispsm(EXACT, EXACT_THETA)
    assert warp.eta.dtype == warp.lam.dtype == jnp.float32
    np.testing.assert_allclose(warp.lam, exact.lam, rtol=32 * EPS)
    z = FRUSTUM.near * 0.4 + FRUSTUM.far * 0.6
    got = warpopt.theory.aliasing_error_uz(FRUSTUM, THETA, warp, jnp.float32(0.25), z, "pxq")
    expected = warpopt.theory.aliasing_error_uz(EXACT, EXACT_THETA, exact, 0.25, np.asarray(z, np.float64), "pxq")
    assert got.dtype == jnp.float32
    np.testing.assert_allclose(got, expected, rtol=100 * EPS)


def test_right_angles_as_float32_writes_them():
    """float32(pi/2) > pi/2 and float32(pi) > pi, and both are accepted; the optimum is the right angle's."""
    frustum = warpopt.ViewFrustum(np.float32(1), np.float32(100), np.float32(0.5))
    solution = warpopt.optimal_warp(
        warpopt.FrustumView(frustum, jnp.array([np.pi / 2, np.pi, 0.0], jnp.float32)), warpopt.Objective("p", "inf")
    )
    assert solution.value.dtype == jnp.float32
    np.testing.assert_allclose(solution.warp.lam[0], 11.0, rtol=16 * EPS)
    assert bool(solution.warp.no_warp[1:].all())
    np.testing.assert_allclose(solution.value[1], solution.value[2], rtol=16 * EPS)


def test_large_ratios_do_not_overflow():
    """f/n = 1e12: the L2 moments of E_pxq span 1e72, float32 holds 1e38."""
    frustum = warpopt.ViewFrustum(np.float32(1e-3), np.float32(1e9), np.float32(0.5))
    exact = warpopt.ViewFrustum(*(np.float64(v) for v in (frustum.near, frustum.far, frustum.half_fov)))
    theta = jnp.array([0.2, 1.0, 1.5], jnp.float32)
    single = warpopt.optimal_warp(warpopt.FrustumView(frustum, theta), warpopt.Objective("pxq", "l2"))
    double = warpopt.optimal_warp(
        warpopt.FrustumView(exact, np.asarray(theta, np.float64)), warpopt.Objective("pxq", "l2")
    )
    assert bool(jnp.isfinite(single.value).all())
    np.testing.assert_allclose(single.warp.eta, double.warp.eta, rtol=2000 * EPS)

"""Laws that hold for every frustum and light, on random ones.

Every draw is one fixed-length batch, so that each (metric, norm) is compiled once.
"""

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
import scenes
from hypothesis import HealthCheck, given, settings

import warpopt

EPS = np.finfo(np.float64).eps
BATCH = 16
RULES = ("ssm", "psm", "lispsm", "tsm", "tsm_alternative", "minimum_norm", "scherzer")
OBJECTIVES = [("p", "inf"), ("q", "inf"), ("pxq", "inf"), ("p", "l2"), ("q", "l1"), ("pxq", "l1")]
law = settings(deadline=None, max_examples=8, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])

numbers = st.lists(st.floats(0, 1), min_size=BATCH, max_size=BATCH).map(np.array)


@st.composite
def views(draw):
    """(near, f/n, half_fov, theta): n over six decades, f/n in 1.05 .. 1e5, any direction in [0, pi]."""
    a, b, c, d = (draw(numbers) for _ in range(4))
    return 10 ** (6 * a - 3), 1.05 * 1e5**b, 0.02 + 1.4 * c, np.pi * d


@jax.jit
def every_rule(frustum, theta):
    warps = [getattr(warpopt.rules, name)(frustum, theta) for name in RULES]
    return jax.tree.map(lambda *fields: jax.numpy.stack(fields), *warps)


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@given(drawn=views())
@law
def test_no_rule_beats_the_optimum(metric, norm, drawn):
    """value(rule) / value(optimum) >= 1 - 1e-13, for every rule at once."""
    near, ratio, half_fov, theta = drawn
    objective = warpopt.Objective(metric, norm)
    frustum = warpopt.ViewFrustum(near, near * ratio, half_fov)
    view = warpopt.FrustumView(frustum, theta)
    best = warpopt.optimal_warp(view, objective)
    values = warpopt.error_norm(view, every_rule(frustum, theta), objective)
    assert bool((values / best.value >= 1 - 1e-13).all())


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@given(drawn=views())
@law
def test_the_norm_falls_then_rises(metric, norm, drawn):
    """Pseudo-convexity: along log(eta) no value is a strict interior maximum, and the optimum sits at the bottom."""
    near, ratio, half_fov, theta = drawn
    objective = warpopt.Objective(metric, norm)
    frustum = warpopt.ViewFrustum(near, near * ratio, half_fov)
    view = warpopt.FrustumView(frustum, theta)
    best = warpopt.optimal_warp(view, objective)
    eta = np.exp(np.linspace(np.log(1e-7), 0, 7))[:, None] * np.ones(BATCH)
    values = np.asarray(warpopt.error_norm(view, warpopt.Warp.from_eta(eta, view), objective))
    beside = warpopt.Warp.from_eta(np.minimum(best.warp.eta * np.exp(np.linspace(-0.3, 0.3, 7))[:, None], 1), view)
    around = np.asarray(warpopt.error_norm(view, beside, objective))
    assert (around >= np.asarray(best.value) * (1 - 1e-13)).all()
    inner, before, after = values[1:-1], values[:-2], values[2:]
    assert (inner <= np.maximum(before, after) * (1 + 1e-13)).all()
    assert (values >= np.asarray(best.value) * (1 - 1e-13)).all()
    # left of the optimum the norm falls with eta, right of it it rises
    left = eta[1:] <= np.asarray(best.warp.eta)
    right = eta[:-1] >= np.asarray(best.warp.eta)
    steps = np.diff(values, axis=0) / values[:-1]
    assert (steps[left] <= 1e-13).all()
    assert (steps[right] >= -1e-13).all()


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@given(drawn=views(), scale=st.floats(1e-3, 1e3))
@law
def test_scaling_lengths_leaves_eta_alone(metric, norm, drawn, scale):
    """eta and the value do not depend on units. f/n is rounded anew: 1e4 is room for its condition."""
    near, ratio, half_fov, theta = drawn
    objective = warpopt.Objective(metric, norm)
    far = near * ratio

    def solve(unit):
        frustum = warpopt.ViewFrustum(unit * near, unit * far, half_fov)
        return warpopt.optimal_warp(warpopt.FrustumView(frustum, theta), objective)

    one = solve(1.0)
    power = 2.0 ** np.round(np.log2(scale))  # exact in binary: then nothing at all may change
    same = solve(power)
    np.testing.assert_array_equal(same.warp.eta, one.warp.eta)
    np.testing.assert_array_equal(same.value, one.value)
    other = solve(scale)
    np.testing.assert_allclose(other.value, one.value, rtol=1e4 * EPS)


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@given(drawn=views())
@law
def test_mirrored_light(metric, norm, drawn):
    """theta and pi - theta have one value; pi - theta is rounded, which the value feels by 1/sin at most."""
    near, ratio, half_fov, theta = drawn
    objective = warpopt.Objective(metric, norm)
    theta = np.clip(theta, 1e-3, np.pi - 1e-3)
    frustum = warpopt.ViewFrustum(near, near * ratio, half_fov)
    view = warpopt.FrustumView(frustum, theta)
    here = warpopt.optimal_warp(view, objective)
    there = warpopt.optimal_warp(warpopt.FrustumView(frustum, np.pi - theta), objective)
    np.testing.assert_allclose(there.value, here.value, rtol=1e-10)


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@given(drawn=views())
@law
def test_continuity_across_theta_equal_phi(metric, norm, drawn):
    """At theta = phi (1 +- 1e-9) the values agree to 1e-5; eta too, except for E_q in L-inf and L1, whose eta jumps."""
    near, ratio, half_fov, _ = drawn
    objective = warpopt.Objective(metric, norm)
    ratio = np.minimum(ratio, 1e3)  # the slopes on both sides grow with f/n
    half_fov = np.maximum(half_fov, 0.1)
    frustum = warpopt.ViewFrustum(near, near * ratio, half_fov)
    views = (warpopt.FrustumView(frustum, half_fov * factor) for factor in (1 - 1e-9, 1 + 1e-9))
    below, above = (warpopt.optimal_warp(view, objective) for view in views)
    np.testing.assert_allclose(above.value, below.value, rtol=1e-5)
    if metric != "q":
        np.testing.assert_allclose(above.warp.eta, below.warp.eta, rtol=1e-5)


def test_e_q_jumps_where_f_a_equals_n_b():
    """L-inf E_q: no warp below tan(theta) = tan(phi) (f + n) / (f - n), lambda = n a above; the value is continuous."""
    n, f = 1.0, 100.0
    frustum = warpopt.ViewFrustum(n, f, scenes.PHI)
    jump = np.arctan(np.tan(scenes.PHI) * (f + n) / (f - n))
    solution = warpopt.optimal_warp(
        warpopt.FrustumView(frustum, np.array([jump - 1e-9, jump + 1e-9])), warpopt.Objective("q", "inf")
    )
    assert float(solution.warp.eta[0]) == 1
    assert float(solution.warp.eta[1]) < 1e-3
    np.testing.assert_allclose(solution.value, 2 * f / n, rtol=1e-5)

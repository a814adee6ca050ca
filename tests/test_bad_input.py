"""Bad input: a static fact is a ValueError that names the argument, what was got and what was expected."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt

NAN = float("nan")
GOOD = warpopt.ViewFrustum(1.0, 100.0, 0.5)
BODY = warpopt.theory.Extent(1.0, 99.0)
HALF = warpopt.Warp.from_eta(0.5, BODY)


@pytest.mark.parametrize(
    ("name", "arguments", "got"),
    [
        ("near", (0.0, 1.0, 0.5), "0.0"),
        ("near", (-1.0, 1.0, 0.5), "-1.0"),
        ("near", (NAN, 1.0, 0.5), "nan"),
        ("near", (np.inf, np.inf, 0.5), "inf"),
        ("far", (1.0, 1.0, 0.5), "1.0"),
        ("far", (2.0, 1.0, 0.5), "1.0"),
        ("far", (1.0, NAN, 0.5), "nan"),
        ("far", (1.0, np.inf, 0.5), "inf"),
        ("half_fov", (1.0, 2.0, 0.0), "0.0"),
        ("half_fov", (1.0, 2.0, -0.1), "-0.1"),
        ("half_fov", (1.0, 2.0, np.pi / 2), "1.57"),
        ("half_fov", (1.0, 2.0, 30.0), "30.0"),  # degrees
        ("half_fov", (1.0, 2.0, NAN), "nan"),
        ("far", (1.0, np.array([2.0, 0.5]), 0.5), "0.5"),
        ("shapes", (np.ones(3), np.array([2.0, 3.0]), 0.5), r"\(2,\)"),
    ],
)
def test_frustum(name, arguments, got):
    with pytest.raises(ValueError, match=rf"^{name}: got .*{got}.*, expected "):
        warpopt.ViewFrustum(*arguments)


@pytest.mark.parametrize("theta", [-1e-9, 3.15, 45.0, NAN, np.array([0.5, -0.5])])
def test_theta(theta):
    for call in (
        lambda: warpopt.optimal_warp(warpopt.FrustumView(GOOD, theta)),
        lambda: warpopt.rules.lispsm(GOOD, theta),
        lambda: warpopt.error_norm(warpopt.FrustumView(GOOD, theta), HALF),
        lambda: warpopt.theory.aliasing_error(GOOD, theta, HALF, 0.0, 2.0),
    ):
        with pytest.raises(ValueError, match=r"^theta: got .*, expected radians in \[0, pi\]"):
            call()


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("metric", {"metric": "x"}),
        ("metric", {"metric": 1.0}),
        ("norm", {"norm": "l3"}),
        ("norm", {"norm": 0.99}),
        ("norm", {"norm": NAN}),
        ("norm", {"norm": True}),
        ("measure", {"measure": "pixels"}),
    ],
)
def test_choices(name, arguments):
    with pytest.raises(ValueError, match=rf"^{name}: got .*, expected "):
        warpopt.Objective(**arguments)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("method", {"method": "fast"}),
        ("quadrature_nodes", {"quadrature_nodes": 1}),
        ("quadrature_nodes", {"quadrature_nodes": True}),
    ],
)
def test_choices_of_the_solver(name, arguments):
    with pytest.raises(ValueError, match=rf"^{name}: got .*, expected "):
        warpopt.optimal_warp(warpopt.FrustumView(GOOD, 1.0), **arguments)


def test_an_objective_that_cannot_be_certified():
    """E_q^(1/2) in L1 has k P < 1: several local minima are possible. Without E_q any k is fine."""
    with pytest.raises(ValueError, match=r"^norm: got .*certified"):
        warpopt.optimal_warp(warpopt.FrustumView(GOOD, 1.0), warpopt.Objective(warpopt.Metric(0, 0.5), "l1"))
    with pytest.raises(ValueError, match=r"^norm: got .*certified"):
        warpopt.error_norm(warpopt.FrustumView(GOOD, 1.0), HALF, warpopt.Objective(warpopt.Metric(0.1, 0.5), "l1"))
    assert np.isfinite(
        warpopt.optimal_warp(warpopt.FrustumView(GOOD, 1.0), warpopt.Objective(warpopt.Metric(0, 0.5), "l2")).value
    )


@pytest.mark.parametrize("exponents", [(-1, 0), (0, -0.5), (NAN, 1), (1, np.inf), (0, 0), ("1", 0)])
def test_metric_exponents(exponents):
    with pytest.raises(ValueError, match=r"^metric: got .*, expected "):
        warpopt.Metric(*exponents)


def test_warps_and_rule_parameters():
    for eta in (0.0, -0.1, 1.1, NAN):
        with pytest.raises(ValueError, match=r"^eta: got .*, expected a number in \(0, 1\]"):
            warpopt.Warp.from_eta(eta, BODY)
    for lam in (0.0, -3.0, NAN):
        with pytest.raises(ValueError, match=r"^lam: got .*, expected a number > 0"):
            warpopt.Warp.from_lam(lam, BODY)
    for kappa, xi, name in ((0.0, 0.8, "kappa"), (1.0, 0.8, "kappa"), (0.5, 1.0, "xi"), (0.5, NAN, "xi")):
        with pytest.raises(ValueError, match=rf"^{name}: got .*, expected a number in \(0, 1\)"):
            warpopt.rules.tsm(GOOD, 1.0, kappa, xi)


def test_traced_values_are_refused_at_run_time():
    """Under jit the same words come from the running computation."""

    @eqx.filter_jit
    def lam(near, far, half_fov, theta):
        return warpopt.optimal_warp(warpopt.FrustumView(warpopt.ViewFrustum(near, far, half_fov), theta)).warp.lam

    assert np.isfinite(lam(*map(jnp.asarray, (1.0, 100.0, 0.5, 1.0))))
    for name, arguments in {
        "near": (-1.0, 100.0, 0.5, 1.0),
        "far": (1.0, 0.5, 0.5, 1.0),
        "half_fov": (1.0, 100.0, 2.0, 1.0),
        "theta": (1.0, 100.0, 0.5, 4.0),
    }.items():
        with pytest.raises(eqx.EquinoxRuntimeError, match=rf"{name}: got a value out of range, expected"):
            jax.block_until_ready(lam(*map(jnp.asarray, arguments)))


def test_beyond_the_tables_reach_the_outcome_says_so():
    """f/n > 7.9e13 with moments: a NaN and an outcome without `throw`, an error in words with it; others unharmed."""
    frustum = warpopt.ViewFrustum(1.0, jnp.array([100.0, 1e14]), 0.5)
    solution = warpopt.optimal_warp(warpopt.FrustumView(frustum, 1.0), warpopt.Objective("p", "l2"), throw=False)
    assert solution.result.tolist() == [warpopt.Outcome.stationary, warpopt.Outcome.not_finite]
    assert np.isfinite(solution.value[0])
    assert not np.isfinite(solution.value[1])
    with pytest.raises(RuntimeError, match=r"1 of 2 problems failed.*7\.9e13"):
        warpopt.optimal_warp(warpopt.FrustumView(frustum, 1.0), warpopt.Objective("p", "l2"))
    assert not warpopt.Outcome.not_finite.succeeded
    assert all(outcome.sentence.endswith((".", "input.")) for outcome in warpopt.Outcome)


def test_a_traced_failure_raises_at_run_time():
    solve = eqx.filter_jit(
        lambda far: (
            warpopt.optimal_warp(
                warpopt.FrustumView(warpopt.ViewFrustum(1.0, far, 0.5), 1.0), warpopt.Objective("p", "l2")
            ).value
        )
    )
    with pytest.raises(eqx.EquinoxRuntimeError, match="optimal_warp failed"):
        jax.block_until_ready(solve(jnp.array([100.0, 1e14])))

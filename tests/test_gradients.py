"""Derivatives of eta, lambda and the value: implicit, equal to differences of the solve, finite."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from jax.test_util import check_grads

import warpopt
from warpopt import Outcome

PHI = scenes.PHI
# near, far, half_fov, theta
SMOOTH = [
    (1.0, 100.0, PHI, np.pi / 3),
    (1.0, 100.0, PHI, 0.25),
    (0.3, 40.0, 0.8, 1.2),
    (20.0, 70.0, 0.4, 2.2),
    (2.0, 2.6, 0.3, 1.1),
    (1.0, 100.0, PHI, 0.571),
    (0.1, 1000.0, 0.7, 0.4),
    (1.0, 30.0, 0.9, 1.45),
]
EDGES = {
    "light along the view": (1.0, 100.0, PHI, 0.0),
    "theta equals phi": (1.0, 100.0, PHI, PHI),
    "overhead": (1.0, 100.0, PHI, np.pi / 2),
    "light against the view": (1.0, 100.0, PHI, np.pi),
    "mirrored phi": (1.0, 100.0, PHI, np.pi - PHI),
    "clamped": (1.0, 100.0, PHI, 1e-3),
    "thin, clamped": (2.0, 2.2, 0.3, 0.1),
    "psm": (1.0, 20.0, 0.5, 1.0),
}
POINTS = jnp.asarray(np.array(SMOOTH + list(EDGES.values())).T)  # (4, lanes)
LANES = POINTS.shape[1]
EDGE = {name: len(SMOOTH) + i for i, name in enumerate(EDGES)}
# What fixes the optimum on these lanes: together, every mechanism.
OBJECTIVES = {
    ("p", "inf"): {Outcome.stationary, Outcome.tie, Outcome.no_warp},
    ("q", "inf"): {Outcome.tie, Outcome.no_warp},
    ("pxq", "inf"): {Outcome.tie, Outcome.no_warp},
    ("p", "l2"): {Outcome.stationary, Outcome.no_warp},
    ("q", "l2"): {Outcome.stationary, Outcome.kink, Outcome.no_warp},
    ("p", 1.7): {Outcome.stationary, Outcome.no_warp},
}


def solve(points, metric, norm):
    near, far, half_fov, theta = points
    # the axis for the real order: one dimension of quadrature is enough to differentiate through its root
    measure = "axis" if norm == 1.7 else "screen"
    return warpopt.optimal_warp(
        warpopt.FrustumView(warpopt.ViewFrustum(near, far, half_fov), theta),
        warpopt.Objective(metric, norm, measure),
        throw=False,
    )


@functools.lru_cache
def compiled(metric, norm):
    """points -> (outputs, forward, reverse, outcomes); derivatives have shape (3 outputs, 4 inputs, lanes)."""

    def outputs(points):
        solution = solve(points, metric, norm)
        return jnp.stack([solution.warp.eta, solution.warp.lam, solution.value]), solution.result

    @jax.jit
    def everything(points):
        tangents = jnp.eye(4)[:, :, None] * jnp.ones(LANES)
        forward = jax.vmap(lambda t: jax.jvp(outputs, (points,), (t,), has_aux=True)[1], out_axes=1)(tangents)
        value, pull, outcomes = jax.vjp(outputs, points, has_aux=True)
        cotangents = jnp.eye(3)[:, :, None] * jnp.ones(LANES)
        return value, forward, jax.vmap(lambda c: pull(c)[0])(cotangents), outcomes

    return lambda points: tuple(np.asarray(v) for v in everything(points))


@functools.lru_cache
def derivatives(metric, norm):
    return compiled(metric, norm)(POINTS)


def check_forward_equals_reverse_and_all_are_finite(metric, norm):
    """To 1e-13 of each lane's largest entry: the two modes sum the same products in another order.

    Real orders to 1e-12: their sums have two thousand terms.
    """
    _, forward, reverse, outcomes = derivatives(metric, norm)
    assert {Outcome(o) for o in outcomes} >= OBJECTIVES[metric, norm]
    assert (outcomes <= Outcome.no_warp).all()
    assert np.isfinite(forward).all()
    assert np.isfinite(reverse).all()
    # sensitivities to log(input), so that their sizes compare
    forward, reverse = forward * POINTS, reverse * POINTS
    scale = np.abs(forward).max(1, keepdims=True)
    tolerance = 1e-13 if isinstance(norm, str) else 1e-12
    assert (np.abs(forward - reverse) <= tolerance * scale + 1e-300).all()


def check_differences_of_the_whole_solve(metric, norm):
    """Centred, step 1e-5: truncation 1e-10 times the third derivative, rounding 1e-15 / 1e-5 times the condition.

    So 1e-6 of the largest sensitivity, on lanes whose outcome is the same on both sides.
    """
    _, forward, _, outcomes = derivatives(metric, norm)
    lanes = slice(0, len(SMOOTH))
    checked = 0
    for i in range(4):
        step = (1e-5 * POINTS * jnp.eye(4)[i][:, None]).at[:, len(SMOOTH) :].set(0)
        above, below = (compiled(metric, norm)(POINTS + sign * step)[0] for sign in (1, -1))
        with np.errstate(invalid="ignore"):  # inf - inf, no warp on both sides
            difference = ((above - below) / 2e-5)[..., lanes]
        implicit = (forward[:, i] * POINTS[i])[..., lanes]
        scale = np.abs(forward * POINTS).max(1)[..., lanes] + 1e-30
        flat = outcomes[lanes] == Outcome.no_warp
        assert (implicit[:2, flat] == 0).all()
        usable = np.isfinite(difference) & ~(flat & (np.arange(3) < 2)[:, None])
        assert (np.abs(difference - implicit)[usable] <= 1e-6 * scale[usable]).all()
        checked += usable.sum()
    assert checked >= 4 * 3 * 4  # most lanes are not flat


def test_check_grads():
    """JAX's own ladder, both modes, on a stationary optimum, a tie and a far one."""
    point = POINTS[:, :3]

    @jax.jit
    def function(at):
        solution = solve(at, "p", "inf")
        return jnp.stack([jnp.log(solution.warp.eta), jnp.log(solution.value)])

    check_grads(function, (point,), order=1, modes=("fwd", "rev"), atol=1e-5, rtol=1e-5, eps=1e-5)


def test_second_derivative_through_the_implicit_one():
    """d2 log(eta) / d log(far)2 of a bracketed root (E_p, L-inf, iterated), against differences of the first.

    Step 1e-4: truncation 1e-8, rounding 1e-11.
    """
    point = POINTS[:, 1]

    def log_eta(log_far):
        frustum = warpopt.ViewFrustum(point[0], jnp.exp(log_far), point[2])
        solution = warpopt.optimal_warp(
            warpopt.FrustumView(frustum, point[3]), warpopt.Objective("p", "inf"), method="iterative", throw=False
        )
        return jnp.log(solution.warp.eta)

    @jax.jit
    def both(log_far):
        return jax.jvp(jax.grad(log_eta), (log_far,), (jnp.ones(()),))

    at = jnp.log(point[1])
    (_, second), (above, _), (below, _) = both(at), both(at + 1e-4), both(at - 1e-4)
    assert float(second) == pytest.approx(float((above - below) / 2e-4), rel=1e-6)


def check_no_gradient_of_eta_where_clamped(metric, norm):
    """A light along the view, a light against it, and inside the no-warp zone: eta = 1, lambda = inf, both flat.

    The value still depends on the frustum.
    """
    values, forward, _, outcomes = derivatives(metric, norm)
    # E_p's power means have no zone: any light off the view direction makes a warp pay
    zone = () if metric == "p" and norm != "inf" else ("clamped",)
    for name in ("light along the view", "light against the view", *zone):
        lane = EDGE[name]
        assert outcomes[lane] == Outcome.no_warp
        assert values[0, lane] == 1
        assert np.isinf(values[1, lane])
        assert (forward[:2, :, lane] == 0).all()
        assert forward[2, 0, lane] != 0


def check_left_derivative_at_theta_equal_phi(metric, norm):
    """mu kinks there. Second-order one-sided differences in theta from the left agree to 1e-5, from the right not."""
    _, forward, _, _ = derivatives(metric, norm)
    lane, h = EDGE["theta equals phi"], 1e-5
    shift = jnp.zeros((4, LANES)).at[3, lane].set(h)

    def one_sided(sign):
        at = [compiled(metric, norm)(POINTS + sign * k * shift)[0][:, lane] for k in range(3)]
        return sign * (-3 * at[0] + 4 * at[1] - at[2]) / (2 * h)

    implicit = forward[:, 3, lane]
    left, right = one_sided(-1), one_sided(1)
    np.testing.assert_allclose(implicit, left, rtol=1e-5)
    assert (np.abs(right / implicit - 1) > 1e-2).any()


def check_overhead_gradient_is_lispsms(metric, norm):
    """lambda = n + sqrt(f n) at pi/2: d/dn = 1 + sqrt(f/n)/2 = 6 and d/df = sqrt(n/f)/2 = 0.05, by hand."""
    _, forward, _, _ = derivatives(metric, norm)
    np.testing.assert_allclose(forward[1, :2, EDGE["overhead"]], [6.0, 0.05], rtol=1e-12)


def check_envelope(metric, norm):
    """The envelope theorem: at a smooth optimum d value = the partial derivative at fixed eta, to 1e-7 of its size."""
    _, forward, _, outcomes = derivatives(metric, norm)
    eta = derivatives(metric, norm)[0][0]

    def fixed(points):
        near, far, half_fov, theta = points
        view = warpopt.FrustumView(warpopt.ViewFrustum(near, far, half_fov), theta)
        return warpopt.error_norm(view, warpopt.Warp.from_eta(eta, view), warpopt.Objective(metric, norm)).sum()

    partial = np.asarray(jax.grad(fixed)(POINTS))
    smooth = outcomes == Outcome.stationary
    np.testing.assert_allclose(forward[2][:, smooth], partial[:, smooth], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("metric", "norm"), OBJECTIVES)
@pytest.mark.thorough("p-1.7", "q-l2", "q-inf")
def test_derivatives(metric, norm):
    """All checks of one objective in one test: its derivatives, the costly part, are compiled once."""
    check_forward_equals_reverse_and_all_are_finite(metric, norm)
    check_differences_of_the_whole_solve(metric, norm)
    check_no_gradient_of_eta_where_clamped(metric, norm)
    if metric != "q" and norm != 1.7:
        check_left_derivative_at_theta_equal_phi(metric, norm)
    if (metric, norm) == ("p", "inf"):
        check_overhead_gradient_is_lispsms(metric, norm)
    if (metric, norm) == ("p", "l2"):
        check_envelope(metric, norm)

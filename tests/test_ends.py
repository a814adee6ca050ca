"""Numbers at the ends of the dtypes: the answer, or an outcome that says out of range; never a wrong number."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, FrustumView, Objective, Outcome, SceneView, ViewFrustum
from warpopt.receivers import ConvexBody
from warpopt.theory import far_limit

METRICS = "p", "q", "pxq"
ANGLES = np.array([0.1, np.pi / 6, np.pi / 3, np.pi / 2, 2.5])


def deep(dtype, count=400):
    """Frusta with far/near from 1e12 to what is accepted, and directions."""
    rng = np.random.default_rng(4)
    largest = 0.25 / float(np.finfo(dtype).tiny)
    near = np.exp(rng.uniform(np.log(1e-3), np.log(1e3), count)).astype(dtype)
    ratio = 10 ** rng.uniform(12, np.log10(largest) - 4, count)
    near[: len(ANGLES)], ratio[: len(ANGLES)] = 1, largest * (1 - 1e-6)
    theta = np.resize(ANGLES, count).astype(dtype)
    far = (near.astype(np.longdouble) * ratio).astype(dtype)
    return ViewFrustum(near, far, dtype(np.pi / 6)), np.minimum(theta, dtype(np.pi))


@pytest.fixture
def problem(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(Path(__file__).parents[1] / "experiments"), *sys.path])
    from reference import Problem

    return Problem


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_far_over_near_up_to_what_the_dtype_holds(dtype, metric, problem):
    """Minimum and value at f/n up to 2e37 and 1e307, to 64 eps of 50 digits; the optimum's regret to 32 k eps.

    Killed: lengths over near instead of far; (n/f)^r of a corner apart from its other factors.
    """
    frustum, theta = deep(dtype)
    objective = Objective(metric)
    solution = warpopt.optimal_warp(FrustumView(frustum, theta), objective, throw=False)
    eps = float(np.finfo(dtype).eps)
    checked = 0
    for i in [*range(len(ANGLES)), *range(20, 400, 29)]:
        exact = problem(frustum.near[i], frustum.far[i], frustum.half_fov[i], theta[i], metric, np.inf, "screen")
        best = exact.minimise()
        result = Outcome(int(solution.result[i]))
        held = all(float(np.finfo(dtype).tiny) <= v <= float(np.finfo(dtype).max) for v in (best.eta, best.value))
        if not held:
            assert result in (Outcome.out_of_range, Outcome.not_finite)
            assert np.isnan(solution.warp.eta[i])
            continue
        checked += 1
        assert result.succeeded, (i, result)
        assert abs(float(float(solution.value[i]) / best.value - 1)) < 64 * eps
        regret = float(exact.norm(float(solution.warp.eta[i])) / best.value - 1)
        assert regret < 32 * objective.metric.blend_power * eps
    assert checked > 12


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_beyond_the_dtypes_range_it_says_so(dtype):
    """Refused with the range, or an outcome; means too."""
    info = np.finfo(dtype)
    for near, far in ((1, info.max), (info.tiny, 1), (info.tiny / 4, 1)):
        with pytest.raises(ValueError, match=r"(far|near): got .*, expected a finite number > .*float"):
            ViewFrustum(dtype(near), dtype(far), dtype(0.5))
    with pytest.raises(ValueError, match=r"far: got inf, .*; for no far plane see warpopt.theory.far_limit"):
        ViewFrustum(dtype(1), dtype(np.inf), dtype(0.5))
    # mu = f (a + 2 T): beyond the largest number, though f is not.
    view = FrustumView(ViewFrustum(dtype(info.max / 1e3), dtype(info.max / 2), dtype(1.5)), dtype(0.3))
    solution = warpopt.optimal_warp(view, throw=False)
    assert int(solution.result) == Outcome.out_of_range
    assert np.isnan(solution.warp.eta)
    with pytest.raises(RuntimeError, match="Out of range"):
        warpopt.optimal_warp(view)
    if dtype == np.float32:
        beyond = FrustumView(ViewFrustum(dtype(1), dtype(1e37), dtype(0.5)), dtype(1))
        assert int(warpopt.optimal_warp(beyond, Objective("p", "l1"), throw=False).result) == Outcome.not_finite


@pytest.mark.parametrize("measure", ["screen", "axis"])
def test_derivatives_of_the_deepest_frusta_at_the_edge_of_the_view(measure):
    """theta = phi up to rounding, where E_q's eta is 1e-303 and its derivative 1e303: finite, and log(n/f)'s part is 0.

    Killed: delta or the tie as plain quotients, whose transposed product overflows before it meets a zero.
    """
    near = np.array([2.374009391447344e-29, 3.5358818607828043e-15, 1.312617426303167])
    far = np.array([3.0064257298201124e259, 1.2221424829690808e273, 1.8606258600940003e288])
    phi = np.array([0.0003291572744702632, 0.0001658998547166807, 0.0008660264212149351])
    theta = np.array([0.0003291572744702636, 0.0001658998547166809, 0.0008660264212149361])

    def total(near, far, phi, theta):
        view = FrustumView(ViewFrustum(near, far, phi), theta)
        solution = warpopt.optimal_warp(view, Objective("q", "inf", measure), throw=False)
        return solution.warp.eta.sum() + jnp.log(solution.value).sum()

    found = jax.grad(total, (0, 1, 2, 3))(*map(jnp.asarray, (near, far, phi, theta)))
    assert np.isfinite(found).all()
    assert (np.abs(found[0] * near) < 1e-12).all()


def test_means_are_right_or_say_that_they_are_not():
    """Beyond the tabulated integrals: bodies have no number, quadrature is right or `inaccurate`."""
    lights = DirectionalLight((0, -np.sin(1.0), -np.cos(1.0)))

    def of_body(far):
        camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, far, np.pi / 6)
        everything = ConvexBody.box((-4 * far, -4 * far, -2 * far), (4 * far, 4 * far, far))
        solution = warpopt.optimal_warp(SceneView(camera, lights, everything), Objective("p", "l2"), throw=False)
        return float(solution.value), Outcome(int(solution.result))

    whole = FrustumView(ViewFrustum(1.0, [1e12, 7.8e13, 8e13], np.pi / 6), 1.0)
    exact = warpopt.optimal_warp(whole, Objective("p", "l2"), throw=False)
    assert [Outcome(int(v)) for v in exact.result] == [Outcome.stationary, Outcome.stationary, Outcome.not_finite]
    assert of_body(1e12)[0] == pytest.approx(float(exact.value[0]), rel=1e-9)
    assert of_body(1e20)[1] == Outcome.not_finite
    # To 400 Gauss panels of 50 digits.
    view = FrustumView(ViewFrustum(1.0, 1e100, np.pi / 6), 1.0)
    assert float(warpopt.optimal_warp(view, Objective("q", 1.5)).value) == pytest.approx(3.2146831536130033, rel=1e-9)
    for metric in ("p", "pxq"):
        deepest = FrustumView(ViewFrustum(1.0, 1e300, np.pi / 6), 1.0)
        result = Outcome(int(warpopt.optimal_warp(deepest, Objective(metric, 2.3), throw=False).result))
        assert result in (Outcome.inaccurate, Outcome.out_of_range, Outcome.not_finite)


@pytest.mark.parametrize("metric", [*METRICS, warpopt.Metric(2.0, 0.5)])
def test_the_limit_without_a_far_plane(metric):
    """(T63) against the optimum at f/n = 1e100, whose eta is within (n/f)^(1/2) of it."""
    theta = np.array([0.02, 0.2, 0.5, 0.55, 1.0, np.pi / 2, 2.9])
    limit = far_limit(2.0, np.pi / 6, theta, metric)
    solution = warpopt.optimal_warp(FrustumView(ViewFrustum(2.0, 2e100, np.pi / 6), theta), Objective(metric))
    np.testing.assert_allclose(solution.warp.eta, limit.eta, rtol=1e-12, atol=1e-49)
    finite = np.isfinite(limit.value)
    np.testing.assert_allclose(np.asarray(solution.value)[finite], np.asarray(limit.value)[finite], rtol=1e-12)
    np.testing.assert_allclose(np.asarray(solution.warp.lam)[finite], np.asarray(limit.lam)[finite], rtol=1e-12)
    assert (np.asarray(solution.value)[~finite] > 1e40).all()
    assert finite.any() == (metric == "q")

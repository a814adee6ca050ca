"""Times of single calls, by pytest-benchmark; skipped unless asked for: `pytest --benchmark-only tests/benchmarks`.

They decide nothing. The ratios that the project promises are measured by experiments/runtime_vs_error.py.
"""

import jax
import numpy as np
import pytest

import warpopt

COUNT = 100_000


@pytest.fixture(scope="module")
def batch():
    rng = np.random.default_rng(0)
    far = np.exp(rng.uniform(0.1, 9.0, COUNT))
    return warpopt.ViewFrustum(1.0, far, rng.uniform(0.05, 1.3, COUNT)), rng.uniform(0.0, np.pi / 2, COUNT)


@pytest.mark.parametrize("metric", ["p", "q", "pxq"])
@pytest.mark.parametrize("norm", ["inf", "l2"])
def test_batch_of_optimal_warps(benchmark, batch, metric, norm):
    benchmark(
        lambda: jax.block_until_ready(
            warpopt.optimal_warp(warpopt.FrustumView(*batch), warpopt.Objective(metric, norm), throw=False)
        )
    )


def test_one_optimal_warp(benchmark):
    frustum = warpopt.ViewFrustum(1.0, 100.0, 0.5)
    benchmark(
        lambda: jax.block_until_ready(
            warpopt.optimal_warp(warpopt.FrustumView(frustum, 0.7), warpopt.Objective("p", "l2"))
        )
    )


def test_batch_of_norms(benchmark, batch):
    warp = warpopt.rules.lispsm(*batch)
    benchmark(
        lambda: warpopt.error_norm(warpopt.FrustumView(*batch), warp, warpopt.Objective("p", "l2")).block_until_ready()
    )

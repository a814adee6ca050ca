"""Defects of dependencies that the package steers around: these fail, or start to pass, when a release changes them."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest


def test_small_matrix_products_under_jit_vmap_are_right():
    """jax 0.10.2 on CPU: half of 32768 rows wrong. Excluded in pyproject.toml; this guards every other version."""
    rng = np.random.default_rng(0)
    matrix, rows = rng.normal(size=(3, 3)), rng.normal(size=(32768, 3))
    got = jax.jit(jax.vmap(lambda r: jnp.sum((jnp.asarray(matrix) @ r) ** 2)))(jnp.asarray(rows))
    expected = ((rows @ matrix.T) ** 2).sum(1)
    np.testing.assert_allclose(got, expected, rtol=64 * np.finfo(np.float64).eps)


@pytest.mark.xfail(strict=True, raises=AssertionError, reason="optimistix 0.1.0's GoldenSearch needs lower = 0")
def test_golden_search_of_optimistix_finds_a_minimum():
    """(x - 3.3)^2 on [2, 5]; the package does not use it. When this passes, it may be considered again."""
    solution = optimistix.minimise(
        lambda x, _: (x - 3.3) ** 2,
        optimistix.GoldenSearch(rtol=1e-6, atol=1e-6),
        jnp.asarray(3.0),
        options={"lower": jnp.asarray(2.0), "upper": jnp.asarray(5.0)},
        max_steps=500,
        throw=False,
    )
    assert abs(float(solution.value) - 3.3) < 1e-3

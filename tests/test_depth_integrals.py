"""The depth integrals against their closed form, Beta times 2F1, in 60 digits."""

import jax.numpy as jnp
import numpy as np
import pytest
from twin import mp, mpf

from warpopt.receivers.bodies.depth_integrals import LARGEST_LOG_RATIO, depth_integrals

EPS = np.finfo(np.float64).eps
# Insides and both edges of panels of width 1/2, thin frusta, and the last panel.
LOG_RATIO = np.array([1e-9, 0.2, 0.4999, 0.5, 2.25, 2.9957, 3.0, 8.0064, 8.25, 8.4999, 15.05, 23.0001, 31.75, 31.9999])


@pytest.mark.parametrize(("degree", "exponent"), [(2, 1.0), (2, 2.0), (4, 2.0), (6, 4.0)])
def test_depth_integrals(degree, exponent):
    """To (32 M + 8 L) eps: M powers of a rounded node each, and exponentials of multiples of L. Panel edges too."""
    got = np.asarray(depth_integrals(degree, exponent, jnp.asarray(LOG_RATIO)))
    for i, row in enumerate(got):
        for value, log_ratio in zip(row, LOG_RATIO, strict=True):
            L = mpf(float(log_ratio))
            exact = mp.beta(i + 1, degree - i + 1) * mp.hyp2f1(exponent, i + 1, degree + 2, -mp.expm1(L))
            exact *= mp.exp(L * min(i + 1, exponent))
            assert abs(float(float(value) / exact - 1)) < (32 * degree + 8 * log_ratio) * EPS, (i, log_ratio)


def test_beyond_reach_is_nan():
    assert np.isnan(depth_integrals(2, 2.0, jnp.asarray([LARGEST_LOG_RATIO + 1e-9]))).all()

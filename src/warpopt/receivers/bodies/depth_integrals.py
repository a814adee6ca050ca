"""The integrals over depth in every L_P norm over the frustum; independent of theta and of the field of view.

    I_i(f/n) = integral over t in [0, 1] of t^i (1 - t)^(M - i) (1 + (f/n - 1) t)^-Q,   i = 0..M

an incomplete-Beta (2F1) family. Its elementary forms cancel for thin frusta and overflow for deep ones. Instead,
I_i (f/n)^min(i+1, Q), which stays between constants times (1 + L), is tabulated as a piecewise polynomial in
L = log(f/n). It is interpolated at Chebyshev nodes and stored as powers, for Horner: the integrand's nearest
singularities in L are at +-2 pi i, so the coefficients on panels of half width 1/4 fall by 2 pi / (1/4) = 25 each, and
nothing cancels. Relative error at most one eps for L in [0, 32] and M <= 9 (measured); twelve multiply-adds each.
"""

import functools
import itertools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._numerics import horner

_PANELS = 64
_DEGREE = 11
LARGEST_LOG_RATIO = 32.0  # f/n up to 7.9e13
_WIDTH = LARGEST_LOG_RATIO / _PANELS


def _gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [-1, 1] in extended precision, by Newton's method from NumPy's."""
    x: np.ndarray = np.polynomial.legendre.leggauss(count)[0].astype(np.longdouble)
    slope = np.ones_like(x)
    for _ in range(2):
        before: np.ndarray = np.ones_like(x)
        value: np.ndarray = x
        for n in range(2, count + 1):
            before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / n
        slope = count * (x * value - before) / (x * x - 1)
        x = x - value / slope
    return x, 2 / ((1 - x * x) * slope * slope)


def log_depth_nodes(count: int, log_ratio: "np.ndarray | Array", xp=np):
    """Gauss-Legendre nodes in t for z = n (f/n)^t: (p, q, weight), the far and near fractions of each node's depth.

    p = (z - n)/(f - n) and q = (f - z)/(f - n) come from expm1, so neither is a difference; the weight is dz/(f - n)
    times n/z. Log depth because the integrands are rational in z with poles at z <= 0: in log z they are entire enough
    for 48 nodes to reach rounding at f/n = 1e13.
    """
    nodes, weights = _gauss_legendre(count) if xp is np else np.polynomial.legendre.leggauss(count)
    t, one_minus_t, w = (v.astype(log_ratio.dtype) for v in ((1 + nodes) / 2, (1 - nodes) / 2, weights / 2))
    L = log_ratio[..., None]
    p = xp.expm1(t * L) / xp.expm1(L)
    q = xp.expm1(-one_minus_t * L) / xp.expm1(-L)
    return p, q, w * L / xp.expm1(L), t * L


def _powers(base: np.ndarray, highest: int) -> list[np.ndarray]:
    """base^0 .. base^highest."""
    return list(itertools.accumulate([base] * highest, np.multiply, initial=np.ones_like(base)))


@functools.lru_cache(maxsize=64)
def _panels(degree: int, exponent: float) -> np.ndarray:
    """Coefficients in y in [-1, 1] on each panel, lowest power first, shape (M + 1, _DEGREE + 1, _PANELS).

    In extended precision where the platform has it: the exponentials' arguments reach a few hundred, and each costs
    its size in eps.
    """
    wide = np.longdouble
    k = np.arange(_DEGREE + 1)
    angle = np.arccos(wide(-1)) * (k + wide(0.5)) / (_DEGREE + 1)
    L = _WIDTH * (np.arange(_PANELS)[:, None] + (np.cos(angle) + 1) / 2)
    p, q, weight, log_z = log_depth_nodes(64, L)
    # Exponentials take nearly all of the time: one for each node, and one more for each integral and panel.
    near, far = (_powers(v, degree) for v in (q, p))
    density = weight * np.exp((1 - wide(exponent)) * log_z)
    sums = np.stack([(density * far[i] * near[degree - i]).sum(-1) for i in range(degree + 1)])
    values = sums * np.exp(np.minimum(np.arange(degree + 1) + 1, wide(exponent))[:, None, None] * L)
    to_chebyshev = wide(2) / (_DEGREE + 1) * np.cos(k[:, None] * angle)
    to_chebyshev[0] /= 2
    to_powers = np.zeros((_DEGREE + 1, _DEGREE + 1))
    for row in k:
        powers = np.polynomial.chebyshev.cheb2poly(np.eye(_DEGREE + 1)[row])
        to_powers[: len(powers), row] = powers
    # Two steps: the product of the two matrices has entries in the hundreds that cancel, at 1e-13 on panel edges.
    chebyshev = np.einsum("dk,ipk->idp", to_chebyshev, values)
    return np.einsum("cd,idp->icp", to_powers, chebyshev).astype(np.float64)


def depth_integrals(degree: int, exponent: float, log_ratio: Float[Array, "..."]) -> list[Float[Array, "..."]]:
    """I_i (f/n)^min(i+1, Q) for i = 0..M at L = log_ratio; NaN beyond LARGEST_LOG_RATIO.

    Args:
        degree: M.
        exponent: Q.
        log_ratio: L = log(f/n) >= 0.
    """
    table = _panels(degree, exponent).astype(log_ratio.dtype)
    position = jnp.where(log_ratio < LARGEST_LOG_RATIO, log_ratio / _WIDTH, 0)
    panel = position.astype(jnp.int32)
    y = jnp.where(log_ratio < LARGEST_LOG_RATIO, 2 * (position - panel) - 1, jnp.nan)
    rows = [jnp.asarray(powers.T).at[panel].get(mode="promise_in_bounds") for powers in table]
    return [horner([row[..., k] for k in range(_DEGREE, -1, -1)], y) for row in rows]

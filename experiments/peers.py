"""The peers of runtime_vs_error.py: what else finds the minimum, given AT09's formulas as its reader would type them.

Each peer gets what a careful user would give it: quadrature nodes made once, exact in height, of the smallest order in
depth that meets its tolerance; an analytic slope for the root finder; a bracket by SciPy's own search.
"""

import functools
import time

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.optimize
from scipy.optimize import elementwise

import warpopt

_POWERS = {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}
_SMALLEST = np.log(1e-9)  # of log eta; E_pxq's optimum at f/n = 1e4 is about 1e-5


def errors_as_printed(eta, z, u, n, f, phi, theta, metric, xp, with_slope=False):
    """(E, d log E / d lambda if asked for) at height fraction u and depth z, through lambda and z_w."""
    s, c, tan = xp.sin(theta), xp.cos(theta), xp.tan(phi)
    a = s - tan * c
    d0 = xp.where(a >= 0, n * a, f * a)
    mu = f * (s + tan * c) - d0
    lam = mu * eta / (1 - eta)
    z_w = lam + z * s - z * tan * (1 - 2 * u) * c - d0
    corner_near = n * tan / (lam + n * a - d0)
    corner_far = f * tan / (lam + f * a - d0)
    alpha, beta = _POWERS[metric]
    error, slope = 1.0, 0.0
    if alpha:
        error = mu * z_w**2 / (tan * lam * (lam + mu) * z)
        slope = 2 / z_w - 1 / lam - 1 / (lam + mu) if with_slope else None
    if beta:
        error = error * (2 * xp.maximum(corner_near, corner_far) * z_w / (tan * z))
        if not with_slope:
            return error, None
        slope = slope + 1 / z_w - 1 / xp.where(corner_near > corner_far, lam + n * a - d0, lam + f * a - d0)
    return error, slope


@functools.lru_cache
def nodes(order: int) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(order)
    return (1 + x) / 2, w / 2


def norm_as_printed(eta, problem, objective, order, xp, with_slope=False):
    """(norm, a multiple > 0 of its derivative in eta if asked for): `order` nodes in log depth, exact in height."""
    n, f, phi, theta = (xp.asarray(v)[..., None, None] for v in problem)
    metric, eta = objective.name, xp.asarray(eta)[..., None, None]
    if objective.supremum:
        z = xp.stack([n, f], -1)[..., 0, :]
        error, slope = errors_as_printed(eta, z, 1.0, n, f, phi, theta, metric, xp, with_slope)
        near_rules = error[..., 0, 0] > error[..., 0, 1]
        asked = (error, slope) if with_slope else (error,)
        return tuple(xp.where(near_rules, v[..., 0, 0], v[..., 0, 1]) for v in asked)
    (t, w), (u, v) = nodes(order), nodes(sum(_POWERS[metric]) + _POWERS[metric][0] + 1)
    z = n * (f / n) ** t
    density = w * v[:, None] * z ** (1.0 if objective.measure == "screen" else 3.0)
    error, slope = errors_as_printed(eta, z, u[:, None], n, f, phi, theta, metric, xp, with_slope)
    weighted = density * error**2
    value = xp.sqrt(weighted.sum((-1, -2)) / density.sum((-1, -2)))
    return (value, (weighted * slope).sum((-1, -2))) if with_slope else (value,)


def least_order(sample, tolerance: float) -> int:
    """The smallest quadrature order whose norm is within tolerance of the reference, for the worst of the sample."""
    if sample.objective.supremum:
        return 1
    eta = np.array([float(min(b.eta, 1 - 1e-9)) for b in sample.best])
    exact = np.array([float(p.norm(e)) for p, e in zip(sample.exact, eta, strict=True)])
    for order in (4, 6, 8, 10, 12, 14, 16, 20, 24, 32):
        (value,) = norm_as_printed(eta, sample.problem, sample.objective, order, np)
        if np.abs(value / exact - 1).max() < tolerance:
            return order
    return 48


def scipy_one_at_a_time(sample, effort: float, count: int) -> dict:
    """`minimize_scalar(bounded)` over log eta; values alone reach sqrt(eps) at best, so the order is for 1e-12."""
    order = least_order(sample, max(effort**2, 1e-12))

    def solve(problem) -> float:
        def objective(log_eta: float) -> float:
            return float(norm_as_printed(np.exp(log_eta), problem, sample.objective, order, np)[0])

        options = {"bounds": (_SMALLEST, -1e-12), "method": "bounded", "options": {"xatol": effort}}
        return float(np.exp(scipy.optimize.minimize_scalar(objective, **options).x))

    every = list(zip(*sample.problem, strict=True))
    solve(every[0])  # the nodes
    start = time.perf_counter()
    eta = [solve(problem) for problem in every[:count]]
    per_solve = (time.perf_counter() - start) / len(eta)
    eta += [solve(problem) for problem in every[count:]]
    name = "SciPy minimize_scalar, one at a time"
    return sample.row(name, f"xatol={effort:g} order={order}", per_solve, count, eta)


def scipy_vectorised(sample, problems, seconds) -> list[dict]:
    """`elementwise.find_minimum` on the norm and `elementwise.find_root` on its slope, by NumPy arrays."""
    order = least_order(sample, 1e-12)

    def value(log_eta, *problem):
        return norm_as_printed(np.exp(log_eta), problem, sample.objective, order, np)[0]

    def slope(log_eta, *problem):
        return norm_as_printed(np.exp(log_eta), problem, sample.objective, order, np, True)[1]

    def minimum(problem):
        start, ends = np.full(len(problem[0]), -1.0), {"xmin": _SMALLEST, "xmax": -1e-9}
        found = elementwise.bracket_minimum(value, start, args=tuple(problem), **ends)
        found = elementwise.find_minimum(value, found.bracket, args=tuple(problem))
        return np.where(found.success, np.exp(found.x), 1.0)

    def root(problem):
        ends = np.full(len(problem[0]), _SMALLEST), np.full(len(problem[0]), -1e-9)
        found = elementwise.find_root(slope, ends, args=tuple(problem))
        return np.where(found.success, np.exp(found.x), 1.0)

    rows, count = [], len(problems[0])
    for name, solve in (("find_minimum", minimum), ("find_root", root)):
        timing = seconds(lambda s=solve: s(problems), 2)
        rows.append(
            sample.row(f"SciPy elementwise.{name}", f"order={order}", timing / count, count, solve(sample.problem))
        )
    return rows


def dense_grid(sample, points: int, many, few, seconds) -> dict:
    """The best of evenly spaced log eta, in JAX."""
    eta = jnp.exp(jnp.linspace(_SMALLEST, 0.0, points))

    @jax.jit
    def solve(view):
        values = warpopt.error_norm(view, warpopt.Warp.from_eta(eta[:, None], view), sample.objective)
        return eta[jnp.argmin(values, axis=0)]

    count = many.theta.size
    timing = seconds(lambda: solve(many), 2)
    return sample.row("dense grid in JAX", f"points={points}", timing / count, count, solve(few))


def general_minimiser(sample, name: str, solver: optx.AbstractMinimiser, problems, seconds) -> dict:
    """An optimistix minimiser on log of the raw norm, in x = logit(eta)."""
    order = least_order(sample, 1e-12)

    def solve_one(problem):
        def objective(x, _):
            return jnp.log(norm_as_printed(jax.nn.sigmoid(x), problem, sample.objective, order, jnp)[0])

        return jax.nn.sigmoid(optx.minimise(objective, solver, jnp.asarray(-2.0), max_steps=300, throw=False).value)

    solve, count = jax.jit(jax.vmap(solve_one)), len(problems[0])
    many = tuple(map(jnp.asarray, problems))
    timing = seconds(lambda: solve(many), 2)
    eta = np.clip(np.nan_to_num(np.asarray(solve(tuple(map(jnp.asarray, sample.problem)))), nan=1.0), 1e-12, 1.0)
    return sample.row(f"optimistix {name}", f"rtol={solver.rtol:g}", timing / count, count, eta)

"""Run time against error: warpopt beside SciPy, general minimisers and the published rules, in one run.

    python experiments/runtime_vs_error.py --directory runs/runtime_vs_error

Every method solves the same random problems; errors are against 50-digit references on a sample of them. Writes
`methods.csv` (one row for each method and effort), `summary.json` (the ratios, with the machine and date), and
`runtime_vs_error.png`. `--short` is a slice for tests: it shows that everything runs, its times mean nothing.
"""

import argparse
import csv
import datetime
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.optimize
from matplotlib.figure import Figure
from reference import Problem
from scipy.optimize import elementwise

import warpopt

METRICS, NORMS, MEASURES = ("p", "q", "pxq"), ("inf", "l2"), ("screen", "volume")
_ORDER = {"inf": np.inf, "l2": 2.0}
_POWERS = {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}


def problems(count: int, seed: int, largest_ratio: float = 1e4) -> tuple[np.ndarray, ...]:
    """(near, far, half_fov, theta), drawn over wide ranges."""
    rng = np.random.default_rng(seed)
    ratio = np.exp(rng.uniform(np.log(1.05), np.log(largest_ratio), count))
    near = np.exp(rng.uniform(np.log(0.01), np.log(10.0), count))
    return near, near * ratio, rng.uniform(0.05, 1.3, count), rng.uniform(0.02, np.pi / 2, count)


def seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """The least of several runs after a warm-up, of a call that returns JAX or NumPy arrays."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return min(times)


# AT09's formulas as its reader would type them: the peers minimise these.


def errors_as_printed(eta, z, u, n, f, phi, theta, metric, xp):
    """E over points at height fraction u and depth z, through lambda and z_w."""
    s, c, tan = xp.sin(theta), xp.cos(theta), xp.tan(phi)
    a = s - tan * c
    d0 = xp.where(a >= 0, n * a, f * a)
    mu = f * (s + tan * c) - d0
    lam = mu * eta / (1 - eta)
    z_w = lam + z * s - z * tan * (1 - 2 * u) * c - d0
    corner_near = n * tan / (lam + n * a - d0)
    corner_far = f * tan / (lam + f * a - d0)
    e_p = mu * z_w**2 / (tan * lam * (lam + mu) * z)
    e_q = 2 * xp.maximum(corner_near, corner_far) * z_w / (tan * z)
    alpha, beta = _POWERS[metric]
    return e_p**alpha * e_q**beta


def norm_as_printed(eta, problem, metric, norm, measure, order, xp):
    """The norm by plain quadrature: `order` nodes in log depth, up to 8 in height; batches go in front."""
    n, f, phi, theta = (xp.asarray(v)[..., None, None] for v in problem)
    eta = xp.asarray(eta)[..., None, None]
    if norm == "inf":
        z = xp.concatenate([n, f], axis=-1)
        return errors_as_printed(eta, z, 1.0, n, f, phi, theta, metric, xp).max((-1, -2))
    nodes, weights = np.polynomial.legendre.leggauss(order)
    t, w = (1 + nodes) / 2, weights / 2
    z = n * (f / n) ** t
    u = t[:, None][: min(order, 8)] if order < 8 else ((1 + np.polynomial.legendre.leggauss(8)[0]) / 2)[:, None]
    v = w[:, None][: min(order, 8)] if order < 8 else (np.polynomial.legendre.leggauss(8)[1] / 2)[:, None]
    density = w * v * z ** (3.0 - (2.0 if measure == "screen" else 0.0))
    squares = errors_as_printed(eta, z, u, n, f, phi, theta, metric, xp) ** 2
    return xp.sqrt((density * squares).sum((-1, -2)) / density.sum((-1, -2)))


class Sample:
    """The problems with their references, and the error measures of a method's answers on them."""

    def __init__(self, count: int, metric: str, norm: str, measure: str, largest_ratio: float):
        self.problem = problems(count, 1, largest_ratio)
        self.key = (metric, norm, measure)
        self.exact = [Problem(*p, metric, _ORDER[norm], measure) for p in zip(*self.problem, strict=True)]
        self.best = [problem.minimise() for problem in self.exact]
        self.interior = np.array([best.outcome != "no_warp" for best in self.best])

    def errors(self, eta) -> dict[str, float]:
        """Relative error in eta and regret: median and worst over the interior optima (over all, for the regret)."""
        eta = np.asarray(eta, float)
        error = np.array([float(abs(e / b.eta - 1)) for e, b in zip(eta, self.best, strict=True)])
        regret = np.array(
            [max(float(p.norm(e) / b.value - 1), 0.0) for e, p, b in zip(eta, self.exact, self.best, strict=True)]
        )
        inside = error[self.interior] if self.interior.any() else error
        return {
            "eta_error_median": float(np.median(inside)),
            "eta_error_worst": float(inside.max()),
            "regret_median": float(np.median(regret)),
            "regret_worst": float(regret.max()),
        }


def frustum_of(problem, dtype=np.float64):
    near, far, half_fov, theta = (np.asarray(v, dtype) for v in problem)
    return warpopt.ViewFrustum(near, far, half_fov), jnp.asarray(theta)


def ours(sample: Sample, batch: int) -> list[dict]:
    rows = []
    metric, norm, measure = sample.key
    variants = [("warpopt", "float64", {}), ("warpopt, iterative", "float64", {"method": "iterative"})]
    variants.append(("warpopt, float32", "float32", {}))
    if norm == "l2":
        nodes = ((f"warpopt, {k}-node quadrature", "float64", {"quadrature_nodes": k}) for k in (8, 16, 32))
        variants += list(nodes)
    for name, dtype, options in variants:
        size = batch if "quadrature" not in name else max(batch // 1000, 64)
        frustum, theta = frustum_of(problems(size, 0), dtype)
        solve = {"throw": False, **options}
        timing = seconds(lambda f=frustum, t=theta, o=solve: warpopt.optimal_warp(f, t, metric, norm, measure, **o))
        few, few_theta = frustum_of(sample.problem, dtype)
        eta = warpopt.optimal_warp(few, few_theta, metric, norm, measure, **solve).warp.eta
        rows.append(row(sample, name, "", timing / size, size, eta))
    return rows


def row(sample: Sample, method: str, effort: str, per_solve: float, batch: int, eta) -> dict:
    metric, norm, measure = sample.key
    return {
        "metric": metric, "norm": norm, "measure": measure, "method": method, "effort": effort,
        "ns_per_solve": per_solve * 1e9, "batch": batch, **sample.errors(eta),
    }  # fmt: skip


def least_order(sample: Sample, tolerance: float) -> int:
    """The smallest quadrature order whose norm is within tolerance of the reference, for the worst of the sample."""
    metric, norm, measure = sample.key
    if norm == "inf":
        return 1
    eta = np.array([float(min(b.eta, 1 - 1e-9)) for b in sample.best])
    exact = np.array([float(p.norm(e)) for p, e in zip(sample.exact, eta, strict=True)])
    for order in (4, 6, 8, 10, 12, 14, 16, 20, 24, 32):
        if np.abs(norm_as_printed(eta, sample.problem, metric, norm, measure, order, np) / exact - 1).max() < tolerance:
            return order
    return 48


def scipy_one_at_a_time(sample: Sample, effort: float, count: int) -> dict:
    """`minimize_scalar(bounded)` over log eta; values alone reach sqrt(eps) at best, so the order is for 1e-12."""
    metric, norm, measure = sample.key
    order = least_order(sample, max(effort**2, 1e-12))

    def solve(problem) -> float:
        def objective(log_eta: float) -> float:
            return float(norm_as_printed(np.exp(log_eta), problem, metric, norm, measure, order, np))

        options = {"bounds": (np.log(1e-7), -1e-12), "method": "bounded", "options": {"xatol": effort}}
        return float(np.exp(scipy.optimize.minimize_scalar(objective, **options).x))

    every = list(zip(*sample.problem, strict=True))
    start = time.perf_counter()
    for problem in every[:count]:
        solve(problem)
    per_solve = (time.perf_counter() - start) / min(count, len(every))
    eta = [solve(problem) for problem in every]
    return row(sample, "SciPy minimize_scalar, one at a time", f"xatol={effort:g} order={order}", per_solve, count, eta)


def scipy_vectorised(sample: Sample, batch: int) -> list[dict]:
    """`elementwise.find_minimum` on the norm and `elementwise.find_root` on its derivative, by NumPy arrays."""
    metric, norm, measure = sample.key
    rows = []
    order = least_order(sample, 1e-12)

    def objective(log_eta, *problem):
        return norm_as_printed(np.exp(log_eta), problem, metric, norm, measure, order, np)

    def slope(log_eta, *problem):
        # complex-free derivative by a central difference would lose digits; the analytic one of E is simple in L2
        step = 1e-5
        return objective(log_eta + step, *problem) - objective(log_eta - step, *problem)

    def minimum(problem):
        ends = np.full(len(problem[0]), np.log(1e-7)), np.full(len(problem[0]), -1.0), np.full(len(problem[0]), -1e-9)
        return np.exp(elementwise.find_minimum(objective, ends, args=tuple(problem)).x)

    def root(problem):
        ends = np.full(len(problem[0]), np.log(1e-7)), np.full(len(problem[0]), -2e-5)
        found = elementwise.find_root(slope, ends, args=tuple(problem))
        return np.where(found.success, np.exp(found.x), 1.0)

    for name, solve in (("find_minimum", minimum), ("find_root", root)):
        many = problems(batch, 0)
        timing = seconds(lambda s=solve, m=many: s(m), 1)
        rows.append(
            row(sample, f"SciPy elementwise.{name}", f"order={order}", timing / batch, batch, solve(sample.problem))
        )
    return rows


def dense_grid(sample: Sample, points: int, batch: int) -> dict:
    """The best of evenly spaced log eta, in JAX."""
    metric, norm, measure = sample.key
    eta = jnp.exp(jnp.linspace(jnp.log(1e-7), 0.0, points))

    @jax.jit
    def solve(frustum, theta):
        mu = jnp.zeros(())
        warp = warpopt.Warp(eta[:, None], 1 - eta[:, None], mu, jnp.ones((), bool))
        values = warpopt.error_norm(frustum, theta, warp, metric, norm, measure)
        return eta[jnp.argmin(values, axis=0)]

    timing = seconds(lambda: solve(*frustum_of(problems(batch, 0))), 2)
    return row(
        sample, "dense grid in JAX", f"points={points}", timing / batch, batch, solve(*frustum_of(sample.problem))
    )


def general_minimiser(sample: Sample, name: str, solver, batch: int) -> dict:
    """An optimistix minimiser on log of the raw norm, in x = logit(eta)."""
    metric, norm, measure = sample.key
    order = least_order(sample, 1e-12)

    def solve_one(problem):
        def objective(x, _):
            return jnp.log(norm_as_printed(jax.nn.sigmoid(x), problem, metric, norm, measure, order, jnp))

        start = jnp.asarray(-2.0)
        return jax.nn.sigmoid(optx.minimise(objective, solver, start, max_steps=300, throw=False).value)

    solve = jax.jit(jax.vmap(solve_one))
    many = tuple(map(jnp.asarray, problems(batch, 0)))
    timing = seconds(lambda: solve(many), 1)
    eta = np.clip(np.nan_to_num(np.asarray(solve(tuple(map(jnp.asarray, sample.problem)))), nan=1.0), 1e-12, 1.0)
    return row(sample, f"optimistix {name}", f"rtol={solver.rtol:g}", timing / batch, batch, eta)


def published(sample: Sample, batch: int) -> list[dict]:
    rows = []
    for name in ("lispsm", "tsm"):
        rule = jax.jit(getattr(warpopt.rules, name))
        many = frustum_of(problems(batch, 0))
        timing = seconds(lambda r=rule, m=many: r(*m))
        rows.append(row(sample, f"rule {name}", "", timing / batch, batch, rule(*frustum_of(sample.problem)).eta))
    return rows


def measure_methods(arguments) -> list[dict]:
    rows = []
    combinations = [(m, n, d) for m in METRICS for n in NORMS for d in MEASURES if n != "inf" or d == "screen"]
    for metric, norm, measure in combinations if not arguments.short else [("p", "l2", "screen")]:
        sample = Sample(arguments.references, metric, norm, measure, 1e4)
        found = ours(sample, arguments.batch)
        found += [scipy_one_at_a_time(sample, effort, 100) for effort in (1e-3, 1e-8)]
        found += scipy_vectorised(sample, max(arguments.batch // 500, 50))
        found += [dense_grid(sample, points, max(arguments.batch // 500, 50)) for points in (64, 1024)]
        minimisers = (("BFGS", optx.BFGS(1e-8, 1e-8)), ("Nelder-Mead", optx.NelderMead(1e-8, 1e-8)))
        found += [
            general_minimiser(sample, name, solver, max(arguments.batch // 500, 50)) for name, solver in minimisers
        ]
        found += published(sample, arguments.batch)
        for r in found:
            print(
                f"{metric:>4} {norm:>4} {measure:>7} {r['method']:<40} {r['effort']:<22} {r['ns_per_solve']:>12.1f} ns"
                f"  eta {r['eta_error_median']:.1e} / {r['eta_error_worst']:.1e}  regret {r['regret_worst']:.1e}",
                flush=True,
            )
        rows += found
    return rows


def draw(rows: list[dict], path: Path) -> None:
    combinations = list(dict.fromkeys((r["metric"], r["norm"], r["measure"]) for r in rows))
    figure = Figure(figsize=(5.2 * min(3, len(combinations)), 3.9 * -(-len(combinations) // 3)), layout="constrained")
    axes = figure.subplots(
        -(-len(combinations) // 3), min(3, len(combinations)), squeeze=False, sharex=True, sharey=True
    )
    methods = list(dict.fromkeys(r["method"] for r in rows))
    markers = "ooosssDD^^vvXXPP**"
    for ax, key in zip(axes.flat, combinations, strict=False):
        for i, method in enumerate(methods):
            points = [r for r in rows if r["method"] == method and (r["metric"], r["norm"], r["measure"]) == key]
            if points:
                x = [r["ns_per_solve"] for r in points]
                y = [max(r["eta_error_median"], 1e-17) for r in points]
                ax.loglog(x, y, markers[i % len(markers)], color=f"C{i % 10}", label=method, alpha=0.85)
        ax.set_title(f"E_{key[0]}, {key[1]}, {key[2]}", fontsize=10)
        ax.grid(alpha=0.25)
    for ax in axes[-1]:
        ax.set_xlabel("time per solve (ns)")
    for ax in axes[:, 0]:
        ax.set_ylabel("median relative error of eta")
    for ax in axes.flat[len(combinations) :]:
        ax.set_visible(False)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    for ax in axes.flat[: len(combinations)]:
        named |= {k: v for v, k in zip(*ax.get_legend_handles_labels(), strict=True) if k not in named}
    figure.legend(named.values(), named.keys(), loc="outside right upper", fontsize=8, frameon=False)
    figure.savefig(path, dpi=150)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/runtime_vs_error"))
    parser.add_argument("--batch", type=int, default=1_000_000)
    parser.add_argument("--references", type=int, default=300)
    parser.add_argument("--short", action="store_true")
    arguments = parser.parse_args(words)
    if arguments.short:
        arguments.batch, arguments.references = 2_000, 6
    arguments.directory.mkdir(parents=True, exist_ok=True)
    from targets import measure_targets

    rows = measure_methods(arguments)
    with (arguments.directory / "methods.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    summary = {
        "date": datetime.date.today().isoformat(),
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "device": str(jax.devices()[0])},
        "versions": {
            "jax": jax.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": sys.version.split()[0],
        },
        "batch": arguments.batch,
        "targets": measure_targets(rows, arguments),
    }
    (arguments.directory / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    draw(rows, arguments.directory / "runtime_vs_error.png")
    for name, entry in summary["targets"].items():
        print(f"{name:<58} {entry['measured']:>12.4g}   target {entry['target']}")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()

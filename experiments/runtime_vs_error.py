"""Run time against error: warpopt beside SciPy, general minimisers and the published rules, in one run.

    python experiments/runtime_vs_error.py --directory runs/runtime_vs_error

Every method solves the same random problems; errors are against 50-digit references on a sample of them. Writes
`methods.csv` (one row for each method and effort), `summary.json` (the ratios, with the machine and date),
`runtime_vs_error.png` and `runtime_vs_regret.png`. `--short` is a slice for tests: it shows that everything runs, its
times mean nothing.
"""

import argparse
import csv
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import numpy as np
import optimistix as optx
from matplotlib.figure import Figure
from peers import dense_grid, general_minimiser, scipy_one_at_a_time, scipy_vectorised
from provenance import markdown_table, provenance, sentence, write_section
from reference import Problem

import warpopt

OBJECTIVES = [warpopt.Objective(metric, "inf") for metric in ("p", "q", "pxq")]
OBJECTIVES += [
    warpopt.Objective(metric, "l2", measure) for metric in ("p", "q", "pxq") for measure in ("screen", "volume")
]


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


class Sample:
    """The problems with their references, and the error measures of a method's answers on them."""

    def __init__(self, count: int, objective: warpopt.Objective, largest_ratio: float):
        self.problem = problems(count, 1, largest_ratio)
        self.objective = objective
        what = (objective.name, objective.order, objective.measure)
        self.exact = [Problem(*p, *what) for p in zip(*self.problem, strict=True)]
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

    def row(self, method: str, effort: str, per_solve: float, batch: int, eta) -> dict:
        of = self.objective
        return {
            "metric": of.name, "norm": of.norm, "measure": of.measure, "method": method, "effort": effort,
            "ns_per_solve": per_solve * 1e9, "batch": batch, **self.errors(eta),
        }  # fmt: skip


def rows_of(rows: list[dict], objective: warpopt.Objective, method: str) -> list[dict]:
    """Those of one method and objective."""
    key = (objective.name, objective.norm, objective.measure, method)
    return [r for r in rows if (r["metric"], r["norm"], r["measure"], r["method"]) == key]


def view_of(problem, dtype=np.float64) -> warpopt.FrustumView:
    near, far, half_fov, theta = (np.asarray(v, dtype) for v in problem)
    return warpopt.FrustumView(warpopt.ViewFrustum(near, far, half_fov), theta)


def ours(sample: Sample, batch: int, short: bool = False) -> list[dict]:
    rows = []
    paths = [("", {}), (", iterative", {"method": "iterative"})]
    if not sample.objective.supremum:
        paths += [(f", {k}-node quadrature", {"quadrature_nodes": k}) for k in ((8,) if short else (8, 16, 32))]
    dtypes = ("float64",) if short else ("float64", "float32")
    variants = [(f"warpopt{word}{', float32' * (d == 'float32')}", d, o) for d in dtypes for word, o in paths]
    for name, dtype, options in variants:
        size = batch if "quadrature" not in name else min(batch, max(batch // 1000, 64))
        many, few = view_of(problems(size, 0), dtype), view_of(sample.problem, dtype)

        def solve(view, options=options):
            return warpopt.optimal_warp(view, sample.objective, throw=False, **options)

        timing = seconds(lambda solve=solve, many=many: solve(many))
        rows.append(sample.row(name, "", timing / size, size, solve(few).warp.eta))
    return rows


def published(sample: Sample, batch: int) -> list[dict]:
    rows = []
    for name in ("lispsm", "tsm"):
        rule = jax.jit(warpopt.rules.PUBLISHED[name].function)
        many, few = view_of(problems(batch, 0)), view_of(sample.problem)
        timing = seconds(lambda rule=rule, many=many: rule(many.frustum, many.theta))
        rows.append(sample.row(f"rule {name}", "", timing / batch, batch, rule(few.frustum, few.theta).eta))
    return rows


def deep(arguments, objective: warpopt.Objective) -> list[dict]:
    """The solver alone on f/n up to 1e12: reported, not promised (eta's condition grows near the onset of no warp)."""
    sample = Sample(max(arguments.references // 3, 6), objective, 1e12)
    many = view_of(problems(arguments.batch, 0, 1e12))
    timing = seconds(lambda: warpopt.optimal_warp(many, objective, throw=False))
    eta = warpopt.optimal_warp(view_of(sample.problem), objective, throw=False).warp.eta
    return [sample.row("warpopt, f/n to 1e12", "", timing / arguments.batch, arguments.batch, eta)]


def measure_methods(arguments) -> list[dict]:
    rows = []
    for objective in [warpopt.Objective("p", "l2")] if arguments.short else OBJECTIVES:
        sample = Sample(arguments.references, objective, 1e4)
        found = ours(sample, arguments.batch, arguments.short)
        found += [scipy_one_at_a_time(sample, effort, 100) for effort in (1e-3, 1e-8)]
        fewer = problems(min(arguments.batch, max(arguments.batch // 100, 50)), 0)
        many, few = view_of(fewer), view_of(sample.problem)
        found += scipy_vectorised(sample, fewer, seconds)
        grids = (64,) if arguments.short else (64, 1024)
        found += [dense_grid(sample, points, many, few, seconds) for points in grids]
        minimisers = (("BFGS", optx.BFGS(1e-8, 1e-8)), ("Nelder-Mead", optx.NelderMead(1e-8, 1e-8)))
        found += [
            general_minimiser(sample, name, solver, fewer, seconds)
            for name, solver in minimisers[: 1 if arguments.short else 2]
        ]
        found += published(sample, arguments.batch)
        found += deep(arguments, objective)
        for r in found:
            print(
                f"{r['metric']:>4} {r['norm']:>4} {r['measure']:>7} {r['method']:<40} {r['effort']:<22} "
                f"{r['ns_per_solve']:>12.1f} ns"
                f"  eta {r['eta_error_median']:.1e} / {r['eta_error_worst']:.1e}  regret {r['regret_worst']:.1e}",
                flush=True,
            )
        rows += found
    return rows


def draw(rows: list[dict], quantity: str, label: str, path: Path) -> None:
    objectives = [o for o in OBJECTIVES if any(rows_of(rows, o, r["method"]) for r in rows)]
    figure = Figure(figsize=(5.2 * min(3, len(objectives)), 3.9 * -(-len(objectives) // 3)), layout="constrained")
    axes = figure.subplots(-(-len(objectives) // 3), min(3, len(objectives)), squeeze=False, sharex=True, sharey=True)
    methods = list(dict.fromkeys(r["method"] for r in rows))
    markers = "ooosssDD^^vvXXPP**"
    for ax, objective in zip(axes.flat, objectives, strict=False):
        for i, method in enumerate(methods):
            points = rows_of(rows, objective, method)
            if points:
                x = [r["ns_per_solve"] for r in points]
                y = [max(r[quantity], 1e-17) for r in points]
                ax.loglog(x, y, markers[i % len(markers)], color=f"C{i % 10}", label=method, alpha=0.85)
        ax.set_title(f"{objective.title}, {objective.measure}", fontsize=10)
        ax.grid(alpha=0.25)
    for ax in axes[-1]:
        ax.set_xlabel("time per solve (ns)")
    for ax in axes[:, 0]:
        ax.set_ylabel(label)
    for ax in axes.flat[len(objectives) :]:
        ax.set_visible(False)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    for ax in axes.flat[: len(objectives)]:
        named |= {k: v for v, k in zip(*ax.get_legend_handles_labels(), strict=True) if k not in named}
    figure.legend(named.values(), named.keys(), loc="outside right upper", fontsize=8, frameon=False)
    figure.savefig(path, dpi=150)


def performance(rows: list[dict], summary: dict) -> str:
    """The table of README's performance section."""
    shown = {"warpopt": "warpopt", "SciPy elementwise.find_root": "SciPy find_root, vectorised"}
    shown |= {"SciPy elementwise.find_minimum": "SciPy find_minimum, vectorised", "optimistix BFGS": "optimistix BFGS"}
    shown["SciPy minimize_scalar, one at a time"] = "SciPy minimize_scalar, one at a time"
    objectives = [warpopt.Objective(*names) for names in (("p", "inf"), ("p", "l2"), ("pxq", "l2"))]
    lines, times = [], {}
    for method, name in shown.items():
        cells = [name]
        for objective in objectives:
            found = rows_of(rows, objective, method)
            if found:
                best = min(found, key=lambda r: r["eta_error_median"])
                unit = times.setdefault(objective, best["ns_per_solve"])
                cells.append(f"{best['ns_per_solve'] / unit:,.0f}, {best['eta_error_median']:.0e}")
        lines.append(cells)
    heads = ("method", *(f"E_{o.name} {o.norm}: time, error" for o in objectives))
    own = ", ".join(f"{time:.0f}" for time in times.values())
    return markdown_table(heads, lines) + (
        f"\n\nTime per solve over warpopt's ({own} ns), and median relative error of eta, on random problems"
        f"\nwith f/n up to 1e4. {sentence(summary)}."
    )


def targets_table(summary: dict) -> str:
    rows = ((k, f"{t['measured']:.4g}", t["target"], t["how"]) for k, t in summary["targets"].items())
    text = markdown_table(("what", "measured", "target", "how"), rows)
    return f"{text}\n\nBatches of {summary['batch']:,}. {sentence(summary)}."


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/runtime_vs_error"))
    parser.add_argument("--batch", type=int, default=1_000_000)
    parser.add_argument("--references", type=int, default=300)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--readme", type=Path, help="a page with a place for `performance`")
    parser.add_argument("--page", type=Path, help="a page with a place for `targets`")
    arguments = parser.parse_args(words)
    if arguments.short:
        arguments.batch = arguments.references = 6  # one shape: everything is compiled once
    arguments.directory.mkdir(parents=True, exist_ok=True)
    from targets import measure_targets

    rows = measure_methods(arguments)
    with (arguments.directory / "methods.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    summary = provenance() | {"batch": arguments.batch, "targets": measure_targets(rows, arguments)}
    (arguments.directory / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    draw(rows, "eta_error_median", "median relative error of eta", arguments.directory / "runtime_vs_error.png")
    draw(rows, "regret_worst", "worst regret: value / minimum - 1", arguments.directory / "runtime_vs_regret.png")
    for name, entry in summary["targets"].items():
        print(f"{name:<58} {entry['measured']:>12.4g}   target {entry['target']}")
    if arguments.readme:
        write_section(arguments.readme, "performance", performance(rows, summary))
    if arguments.page:
        write_section(arguments.page, "targets", targets_table(summary))


if __name__ == "__main__":
    main()

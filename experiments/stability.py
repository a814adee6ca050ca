"""Numerical stability at the edges: invariants on every draw, 50-digit references on thousands of them.

    python experiments/stability.py --directory runs/stability

Draws come from the edges of the input (see `draws`); each objective, of every metric, the norms 1, 2, 3 and inf, and
every measure, is solved for a share of them, in float64 and float32. Errors are in units of eps against references that
take the inputs as the exact numbers they are. Writes `report.md`, `stability.json`, `worst.csv` (the inputs of each
worst case, in exact hexadecimal, to rerun it) and `heat_map.png`. `--draws` is a number for each dtype.
"""

import argparse
import contextlib
import csv
import functools
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from provenance import markdown_table, provenance, sentence, write_section
from reference import Problem

import warpopt

MEASURES = ("volume", "screen", "log_depth", "ground", "axis")
OBJECTIVES = [
    warpopt.Objective(metric, order, measure)
    for metric in ("p", "q", "pxq")
    for order in (1.0, 2.0, 3.0, np.inf)
    for measure in (MEASURES if np.isfinite(order) else ("screen", "axis"))
]


def deepest(objective: warpopt.Objective, dtype) -> float:
    """log10 of the largest f/n drawn: in L-inf up to what the dtype holds of the errors, which are of order (f/n)^r."""
    if not objective.supremum:
        return 12.0
    # E_q's eta is n a/(f b), with a of order eps next to theta = phi: 20 decades for that.
    return max(12.0, (np.log10(float(np.finfo(dtype).max)) - 20) / objective.metric.depth_power)


def draws(count: int, dtype, seed: int, largest: float = 12.0) -> dict[str, np.ndarray]:
    """Inputs from the edges: thin and deep frusta, narrow and wide fields of view, special directions, any scale.

    Args:
        largest: log10 of the largest f/n; a third of the draws are above 1e12.
    """
    rng = np.random.default_rng(seed)
    double = dtype == np.float64

    def pick(*choices):
        return np.choose(rng.integers(0, len(choices), count), [np.broadcast_to(c, count) for c in choices])

    usual = rng.uniform(np.log10(1e-9 if double else 2e-7), 12, count)
    exponent = np.where(rng.random(count) < (largest > 12) / 3, rng.uniform(12, largest, count), usual)
    excess = 10**exponent
    decades = 30 if double else 15
    # Lengths that the dtype holds: mu is up to 2e4 far.
    top = np.minimum(decades, np.log10(float(np.finfo(dtype).max)) - 8 - exponent)
    near = (10 ** (-decades + rng.random(count) * (decades + top))).astype(dtype)
    far = np.maximum((near.astype(float) * (1 + excess)).astype(dtype), np.nextafter(near, dtype(np.inf)))
    margin = 10 ** rng.uniform(-4, 0, count)
    half_fov = pick(margin, np.pi / 2 - margin, rng.uniform(1e-4, np.pi / 2 - 1e-4, count))
    half_fov = np.clip(half_fov, 1e-4, np.pi / 2 - 1e-4).astype(dtype)
    step = 1e-15 if double else 1e-6
    phi = half_fov.astype(float)
    anywhere = rng.uniform(0, np.pi, count)
    special = (0.0, 1e-300 if double else 1e-37, 1e-12, phi, phi * (1 + step), phi * (1 - step), np.pi - phi)
    theta = pick(*special, np.pi / 2, np.pi / 2 - 1e-12, np.pi, anywhere, anywhere).astype(dtype)
    eta = np.minimum(10 ** rng.uniform(-12, 0, count), 1).astype(dtype)
    return {"near": near, "far": far, "half_fov": half_fov, "theta": np.minimum(theta, dtype(np.pi)), "eta": eta}


def view_of(d: dict[str, np.ndarray]) -> warpopt.FrustumView:
    return warpopt.FrustumView(warpopt.ViewFrustum(d["near"], d["far"], d["half_fov"]), d["theta"])


def norm_of(d: dict[str, np.ndarray], objective: warpopt.Objective) -> np.ndarray:
    view = view_of(d)
    return np.asarray(warpopt.error_norm(view, warpopt.Warp.from_eta(d["eta"], view), objective))


def strata(d: dict[str, np.ndarray], count: int) -> np.ndarray:
    """Draws spread evenly over theta (every special direction is one) and, within each, over f/n."""
    theta, ratio = d["theta"].astype(float), d["far"].astype(float) / d["near"].astype(float)
    kinds = np.unique(theta.round(3), return_inverse=True)[1]
    common = np.bincount(kinds)[kinds] > 1  # the special directions; all others count as one kind
    order = np.lexsort((ratio, np.where(common, kinds, -1)))
    return order[np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(int)]


@functools.cache
def _compiled_rule(name: str):
    return jax.jit(warpopt.rules.PUBLISHED[name].function)


def check_invariants(d: dict[str, np.ndarray], objective: warpopt.Objective) -> tuple[dict[str, float], np.ndarray]:
    """(counts and worst figures over all draws, an indicator of where errors may be largest)."""
    eps = float(np.finfo(d["near"].dtype).eps)
    k_eps = objective.metric.blend_power * eps
    view = view_of(d)
    solution = warpopt.optimal_warp(view, objective, throw=False)
    eta, value = np.asarray(solution.warp.eta), np.asarray(solution.value)
    result, residual = np.asarray(solution.result), np.asarray(solution.residual)
    norm_at_eta = norm_of(d, objective)
    if not np.isfinite(norm_at_eta).all():
        # Where the true norm exceeds the dtype's largest number, infinity is the right answer.
        wide = norm_of({k: v.astype(np.float64) for k, v in d.items()}, objective)
        norm_at_eta = np.where(wide > np.finfo(d["near"].dtype).max, 0, norm_at_eta)
    found = {
        "not_finite": int((~np.isfinite(eta) | ~np.isfinite(value) | ~np.isfinite(norm_at_eta)).sum()),
        "out_of_range": int(((eta <= 0) | (eta > 1)).sum()),
        "failed": int((result > warpopt.Outcome.no_warp).sum()),
        "residual_over_k_eps": float(residual.max() / k_eps),
    }
    below = 0.0
    for name in warpopt.rules.PUBLISHED:
        warp = _compiled_rule(name)(view.frustum, view.theta)
        rival = np.asarray(warpopt.error_norm(view, warp, objective), float)
        found["not_finite"] += int(np.isnan(rival).sum())
        below = max(below, float(np.nanmax(1 - rival / value)))
    found["optimum_above_a_rule_over_k_eps"] = below / k_eps
    # A power of two scales exactly, so that the answer must be the same to the last bit; 3 rounds the input anew, and
    # what moves much is where errors may be large.
    scaled = {**d, "near": d["near"] * 4, "far": d["far"] * 4}
    other = warpopt.optimal_warp(view_of(scaled), objective, throw=False)
    found["not_scale_free"] = int((np.asarray(other.warp.eta) != eta).sum())
    scaled = {**d, "near": d["near"] * 3, "far": d["far"] * 3}
    scaled["far"] = np.maximum(scaled["far"], np.nextafter(scaled["near"], scaled["near"].dtype.type(np.inf)))
    moved = warpopt.optimal_warp(view_of(scaled), objective, throw=False)
    indicator = np.abs(np.asarray(moved.value, float) / value - 1) / eps + residual / eps

    def total(d):
        view = view_of(d)
        best = warpopt.optimal_warp(view, objective, throw=False)
        both = best.warp.eta.sum() + jnp.log(best.value).sum()
        if eps > 1e-10:  # in single precision norms at any eta may overflow, and rightly have no derivative
            return both
        norms = warpopt.error_norm(view, warpopt.Warp.from_eta(d["eta"], view), objective)
        return both + jnp.log(norms).sum()

    gradients = jax.grad(total)({name: jnp.asarray(values) for name, values in d.items()})
    found["gradient_not_finite"] = int(sum((~np.isfinite(np.asarray(g))).sum() for g in gradients.values()))
    return found, np.nan_to_num(indicator, nan=np.inf)


class Answer(NamedTuple):
    """One draw and what warpopt says of it, as exact Python numbers."""

    inputs: dict[str, float]
    eta: float
    value: float
    norm_at_eta: float
    largest: float
    eps: float
    objective: warpopt.Objective


def reference_errors(answer: Answer) -> dict[str, float]:
    """Regret of the optimum and error of a norm, for one draw, in units of eps."""
    objective = answer.objective
    view = (answer.inputs[k] for k in ("near", "far", "half_fov", "theta"))
    problem = Problem(*view, objective.name, objective.order, objective.measure)
    best = problem.minimise()
    exact = problem.norm(answer.inputs["eta"])
    eps, k_eps = answer.eps, objective.metric.blend_power * answer.eps
    return {
        "regret_over_k_eps": max(float(problem.norm(answer.eta) / best.value - 1), 0.0) / k_eps,
        "value_ulp": abs(float(mp.mpf(answer.value) / best.value - 1)) / eps,
        "norm_ulp": 0.0 if exact > answer.largest else abs(float(mp.mpf(answer.norm_at_eta) / exact - 1)) / eps,
        "eta_relative": abs(float(mp.mpf(answer.eta) / best.eta - 1)),
    }


def answers(d: dict[str, np.ndarray], chosen: np.ndarray, solution, at_eta: np.ndarray, objective) -> list[Answer]:
    info = np.finfo(d["near"].dtype)
    return [
        Answer(
            {k: float(v[i]) for k, v in d.items()}, float(solution.warp.eta[i]), float(solution.value[i]),
            float(at_eta[i]), float(info.max), float(info.eps), objective,
        )
        for i in chosen
    ]  # fmt: skip


def point_errors(d: dict[str, np.ndarray], count: int, seed: int) -> dict[str, float]:
    """Errors at points: (u, z) in ulp, (y, z) in ulp over its condition number, worst of `count`."""
    dtype = d["near"].dtype
    eps = float(np.finfo(dtype).eps)
    rng = np.random.default_rng(seed)
    few = {k: v[:count] for k, v in d.items()}
    u = np.where(rng.random(count) < 0.3, rng.integers(0, 2, count), rng.random(count)).astype(dtype)
    t = np.where(rng.random(count) < 0.3, rng.integers(0, 2, count), rng.random(count))
    near, far = few["near"].astype(float), few["far"].astype(float)
    z = np.clip((near * (far / near) ** t).astype(dtype), few["near"], few["far"])
    y = (z.astype(float) * np.tan(few["half_fov"].astype(float)) * (1 - 2 * u)).astype(dtype)
    view = view_of(few)
    warp = warpopt.Warp.from_eta(few["eta"], view)
    smallest, largest = float(np.finfo(dtype).tiny), float(np.finfo(dtype).max)
    worst = {"uz_ulp": 0.0, "yz_ulp_over_condition": 0.0, "largest_condition": 0.0}
    for metric in ("p", "q", "pxq"):
        at_uz = np.asarray(warpopt.theory.aliasing_error_uz(view.frustum, view.theta, warp, u, z, metric))
        at_yz = np.asarray(warpopt.theory.aliasing_error(view.frustum, view.theta, warp, y, z, metric))
        for i in range(count):
            problem = Problem(*(few[k][i] for k in ("near", "far", "half_fov", "theta")), metric, np.inf, "screen")
            eta, depth = mp.mpf(float(few["eta"][i])), mp.mpf(float(z[i])) / mp.mpf(float(few["near"][i]))
            exact = problem.error(float(u[i]), depth, eta)
            if not smallest < exact < largest:
                continue  # beyond the dtype's normal numbers
            worst["uz_ulp"] = max(worst["uz_ulp"], abs(float(mp.mpf(float(at_uz[i])) / exact - 1)) / eps)
            height = problem.tan_phi * mp.mpf(float(z[i]))
            side = -1 if mp.cos(mp.mpf(float(few["theta"][i]))) < 0 else 1
            exact_u = (1 - side * mp.mpf(float(y[i])) / height) / 2
            exact = problem.error(exact_u, depth, eta)
            if exact_u < 0 or not smallest < exact < largest:
                continue  # the rounded y lies outside the frustum, or the error outside the normal numbers
            # d log E / d log y and d log E / d log z at fixed y, through A and through u(y, z)
            condition = float(problem.condition_yz(exact_u, depth, eta))
            error = abs(float(mp.mpf(float(at_yz[i])) / exact - 1)) / eps
            worst["yz_ulp_over_condition"] = max(worst["yz_ulp_over_condition"], error / max(condition, 1))
            worst["largest_condition"] = max(worst["largest_condition"], condition)
    return worst


def run_dtype(dtype, arguments, mapped: Callable[..., list]) -> tuple[dict, list[dict], list[tuple]]:
    """All objectives in one dtype: (figures by objective, worst cases, points of the heat map)."""
    chosen = [o for o in OBJECTIVES if o.order in arguments.orders]
    objectives = chosen[:: -(-len(chosen) // arguments.objectives)]
    per = -(-arguments.draws // len(objectives))
    stratified = hardest = -(-arguments.references // len(objectives))
    table, worst_rows, points = {}, [], []
    for number, objective in enumerate(objectives):
        start = time.perf_counter()
        d = draws(per, dtype, 1000 + number, deepest(objective, dtype))
        found, indicator = check_invariants(d, objective)
        name = f"E_{objective.name} order {objective.order:g} {objective.measure}"
        if number % 10 == 9:
            jax.clear_caches()  # each compiled program holds memory maps, of which Linux allows a process 65,530
        solution = warpopt.optimal_warp(view_of(d), objective, throw=False)
        solution, at_eta = jax.tree.map(np.asarray, solution), norm_of(d, objective)
        order_of_doubt = np.argsort(-indicator)
        chosen = np.unique(np.concatenate([strata(d, stratified), order_of_doubt[:hardest]]))
        errors = mapped(reference_errors, answers(d, chosen, solution, at_eta, objective))
        for key in ("regret_over_k_eps", "value_ulp", "norm_ulp"):
            values = np.array([e[key] for e in errors])
            found[key] = float(values.max())
            at = int(chosen[int(values.argmax())])
            case = {given: float(values[at]).hex() for given, values in d.items()}
            worst_rows.append(
                {"dtype": np.dtype(dtype).name, "metric": objective.name, "order": objective.order,
                 "measure": objective.measure, "figure": key, "worst": found[key], **case}
            )  # fmt: skip
        points += [
            (float(d["theta"][i]), float(d["far"][i]) / float(d["near"][i]), max(e["value_ulp"], e["norm_ulp"]))
            for i, e in zip(chosen, errors, strict=True)
        ]
        table[name] = found
        print(
            f"{np.dtype(dtype).name} {name}: "
            + ", ".join(f"{k} {v:.3g}" for k, v in found.items())
            + f" ({time.perf_counter() - start:.0f} s)",
            flush=True,
        )
    return table, worst_rows, points


@contextlib.contextmanager
def over_processes(count: int) -> Iterator[Callable[..., list]]:
    """`map` to a list, over new processes (JAX's threads do not survive a fork), or in this one."""
    if count == 1:
        yield lambda function, items: list(map(function, items))
        return
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        yield lambda function, items: list(pool.map(function, items, chunksize=4))


TARGETS = {
    "not_finite": 0, "out_of_range": 0, "failed": 0, "gradient_not_finite": 0, "not_scale_free": 0,
    "residual_over_k_eps": 64, "optimum_above_a_rule_over_k_eps": 32, "regret_over_k_eps": 32, "value_ulp": 64,
    "norm_ulp": 64, "uz_ulp": 64, "yz_ulp_over_condition": 64,
}  # fmt: skip

KNOWN_LIMITS = [
    (
        "E at (y, z) on the upper plane",
        "its condition number, up to 1/eta, is inherent; use `theory.aliasing_error_uz`",
    ),
    ("1 - eta, lambda next to the onset of no warp", "condition number 1/(1 - eta); the regret stays at rounding"),
    ("eta of a flat optimum", "its condition number is 1/sqrt(second derivative); reported by regret"),
    ("f/n > 7.9e13 in L_P", "outside the tabulated integrals: `Outcome.not_finite`"),
    (
        "values beyond the dtype's normal numbers",
        "E_pxq spans 1e-40 to 1e50 at f/n = 1e12: infinite or rounded to zero",
    ),
]


def draw_heat_map(points: dict[str, list[tuple]], path: Path) -> None:
    figure = Figure(figsize=(5.4 * len(points), 4.2), layout="constrained")
    axes = figure.subplots(1, len(points), squeeze=False)[0]
    theta_edges, ratio_edges = np.linspace(0, 180, 25), np.linspace(-9, 12, 22)
    for ax, (name, found) in zip(axes, points.items(), strict=True):
        grid = np.full((len(ratio_edges) - 1, len(theta_edges) - 1), np.nan)
        for theta, ratio, error in found:
            i = min(np.searchsorted(ratio_edges, np.log10(max(ratio - 1, 1e-9)), "right") - 1, grid.shape[0] - 1)
            j = min(np.searchsorted(theta_edges, np.degrees(theta), "right") - 1, grid.shape[1] - 1)
            grid[i, j] = np.nanmax([grid[i, j], max(error, 0.25)])
        mesh = ax.pcolormesh(theta_edges, ratio_edges, grid, norm=LogNorm(0.25, 64), cmap="viridis")
        ax.set_title(f"{name}: worst error of norms and minima", fontsize=10)
        ax.set_xlabel("theta (degrees)")
        ax.set_ylabel("log10(f/n - 1)")
        ax.set_xticks(range(0, 181, 30))
    figure.colorbar(mesh, ax=list(axes), label="units of eps (64 allowed; white: no reference)")
    figure.savefig(path, dpi=150)


def report(summary: dict) -> str:
    lines = ["# Numerical stability", "", ""]
    lines += [
        f"{summary['draws']:,} draws for each dtype; {summary['references']:,} stratified and as many of the worst are",
        f"compared with 50-digit references; ulp and eps are each dtype's own. {sentence(summary)}.",
        "",
    ]
    dtypes = ("float64", "float32")
    figures = ([float(summary["worst"][d].get(name, "nan")) for d in dtypes] for name in TARGETS)
    rows = ([name, str(target), *of] for (name, target), of in zip(TARGETS.items(), figures, strict=True))
    lines.append(markdown_table(("figure", "target", *dtypes), rows))
    conditions = {d: summary["worst"][d].get("largest_condition", float("nan")) for d in dtypes}
    lines += [
        "",
        f"Largest condition number of E at (y, z): {conditions['float64']:.3g}, {conditions['float32']:.3g}.",
        "",
    ]
    lines += ["### Known limits", "", markdown_table(("what", "why"), KNOWN_LIMITS)]
    lines += ["", "### Known defects", ""]
    lines += [f"- {d}" for d in summary["defects"]] or ["None."]
    return "\n".join(lines) + "\n"


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/stability"))
    parser.add_argument("--draws", type=int, default=1_040_000)
    parser.add_argument("--references", type=int, default=3_000, help="stratified draws, and as many of the worst")
    parser.add_argument("--points", type=int, default=3_000)
    parser.add_argument("--objectives", type=int, default=len(OBJECTIVES), help="evenly chosen, for a short run")
    orders = sorted({o.order for o in OBJECTIVES})
    told = "of the norms; inf alone is where f/n is drawn up to the dtype's range"
    parser.add_argument("--orders", type=float, nargs="+", choices=orders, default=orders, help=told)
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="for the references")
    parser.add_argument("--page", type=Path, help="a page with a place for `stability`")
    parser.add_argument("--dtypes", nargs="+", default=["float64", "float32"])
    arguments = parser.parse_args(words)
    arguments.directory.mkdir(parents=True, exist_ok=True)
    tables, rows, points, worst = {}, [], {}, {}
    for name in arguments.dtypes:
        dtype = np.dtype(name).type
        with over_processes(arguments.processes) as mapped:
            tables[name], found, points[name] = run_dtype(dtype, arguments, mapped)
        rows += found
        worst[name] = {
            k: max(t[k] for t in tables[name].values()) for k in next(iter(tables[name].values()))
        } | point_errors(draws(arguments.points, dtype, 77), arguments.points, 78)
    defects = [
        f"{name}: {key} is {figure:.3g}, target {TARGETS[key]}"
        for name, figures in worst.items()
        for key, figure in figures.items()
        if key in TARGETS and not figure <= TARGETS[key]
    ]
    summary = provenance() | {"draws": arguments.draws, "references": arguments.references}
    summary |= {"worst": worst, "defects": defects, "tables": tables}
    (arguments.directory / "stability.json").write_text(json.dumps(summary, indent=1) + "\n")
    with (arguments.directory / "worst.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    summary["worst"] = {name: worst.get(name, {}) for name in ("float64", "float32")}
    (arguments.directory / "report.md").write_text(report(summary))
    draw_heat_map(points, arguments.directory / "heat_map.png")
    print(report(summary))
    if arguments.page:
        write_section(arguments.page, "stability", report(summary).split("\n", 2)[2])
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())

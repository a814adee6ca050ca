"""The speed targets, each a ratio of two times measured in the same run (see runtime_vs_error.py)."""

import resource
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np

import warpopt

_MEMORY_PROBE = """
import os, sys
os.environ.setdefault("JAX_ENABLE_X64", "1")
sys.path.insert(0, {folder!r})
import warpopt
from runtime_vs_error import problems, view_of
warpopt.optimal_warp(view_of(problems({count}, 0)), warpopt.Objective("p", "l2"), throw=False)
# Not getrusage's ru_maxrss: Linux starts it from the parent's, across exec.
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(int(peak.split()[1]) / 1024)
"""


def measure_targets(rows: list[dict], arguments) -> dict[str, dict]:
    """Every target: what was measured, what was asked for, how."""
    from peers import errors_as_printed
    from runtime_vs_error import problems, rows_of, seconds, view_of

    batch = arguments.batch
    raw = problems(batch, 0)
    many = view_of(raw)
    least_squares = warpopt.Objective("p", "l2")
    found: dict[str, dict] = {}

    def put(name: str, measured: float, target: str, how: str) -> None:
        found[name] = {"measured": measured, "target": target, "how": how}

    for measure, one_by_one in (("volume", 2000), ("screen", 1000)):

        def per_solve(method: str, effort: str = "", measure: str = measure) -> float:
            objective = warpopt.Objective("p", "l2", measure)
            found = (r["ns_per_solve"] for r in rows_of(rows, objective, method) if effort in r["effort"])
            return min(found, default=float("nan"))

        mine = per_solve("warpopt")
        put(
            f"E_p L2 {measure}: SciPy one at a time / ours",
            per_solve("SciPy minimize_scalar, one at a time", "1e-08") / mine,
            f">= {one_by_one}",
            "per solve",
        )
        put(
            f"E_p L2 {measure}: SciPy find_root / ours",
            per_solve("SciPy elementwise.find_root") / mine,
            ">= 20" if measure == "volume" else "(reported)",
            "per solve, both vectorised",
        )

    for measure in ("volume", "screen"):
        for word, target in (("median", "<= 1e-12"), ("worst", "<= 1e-10")):
            error = max(
                [r[f"eta_error_{word}"] for r in rows if r["method"] == "warpopt" and r["measure"] == measure],
                default=np.nan,
            )
            put(
                f"error of eta, {word}, every metric, L2{' and L-inf' * (measure == 'screen')}, {measure}",
                error,
                target,
                "interior optima, f/n <= 1e4",
            )

    def solve_time(view=many, objective=least_squares, repeats=5) -> float:
        return seconds(lambda: warpopt.optimal_warp(view, objective, throw=False), repeats)

    eta = jnp.asarray(np.random.default_rng(5).uniform(0.01, 0.99, batch))
    warp = warpopt.Warp.from_eta(eta, many)
    ep = {}
    for measure in ("screen",) if arguments.short else ("screen", "volume"):
        objective = warpopt.Objective("p", "l2", measure)
        ep[measure] = solve_time(objective=objective)
        moment_pass = seconds(lambda objective=objective: warpopt.error_norm(many, warp, objective))
        put(
            f"E_p L2 {measure}: whole solve / moment pass",
            ep[measure] / moment_pass,
            "<= 2",
            "moments and one norm value",
        )
        for metric in ("q", "pxq"):
            ratio = solve_time(objective=warpopt.Objective(metric, "l2", measure)) / ep[measure]
            put(f"E_{metric} L2 {measure} / E_p L2 {measure}", ratio, "<= 4", "whole solves")

    corners = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    for metric in ("p", "q", "pxq"):

        @jax.jit
        def four_corners(n, f, phi, theta, eta, metric=metric):
            errors = [
                errors_as_printed(eta, f if far else n, float(u), n, f, phi, theta, metric, jnp)[0]
                for u, far in corners.tolist()
            ]
            return jnp.stack(errors).max(0)

        arrays = [jnp.asarray(v) for v in raw]
        evaluation = seconds(lambda e=four_corners, a=arrays: e(*a, eta))
        ratio = solve_time(objective=warpopt.Objective(metric)) / evaluation
        put(f"E_{metric} L-inf: solve / objective at four corners", ratio, "<= 4", "trigonometry on both sides")

    one = warpopt.ViewFrustum(1.0, 100.0, 0.5)
    sweep = solve_time(warpopt.FrustumView(one, many.theta))
    put("E_p L2 screen: random batch / theta sweep", ep["screen"] / sweep, ">= 3", "per solve, same count")
    single = seconds(lambda: warpopt.optimal_warp(warpopt.FrustumView(one, 0.7), least_squares, throw=False), 30)
    put("overhead of one call (ms)", single * 1e3, "<= 2", "one problem with its view, compiled before")
    if not arguments.short:
        times = {}
        for count in (100_000, 1_000_000, 10_000_000):
            times[count] = solve_time(view_of(problems(count, 0)), repeats=3)
            put(f"ns per solve at {count:.0e}", times[count] / count * 1e9, "(reported)", "E_p L2 screen")
        slopes = [(times[b] - times[a]) / (b - a) for a, b in ((100_000, 1_000_000), (1_000_000, 10_000_000))]
        spread = max(slopes) / min(slopes) - 1
        put("slope of time over N, 1e5 to 1e7: spread", spread, "<= 0.2", "between 1e5, 1e6 and 1e7")
        probe = _MEMORY_PROBE.format(folder=str(__file__.rsplit("/", 1)[0]), count=10_000_000)
        output = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True).stdout
        put("peak memory at 1e7 (MiB)", float(output.split()[-1]), "<= 2048", "resident set of a process of its own")
    else:
        put(
            "peak memory so far (MiB)",
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "(reported)",
            "this process",
        )
    if jax.default_backend() != "cpu":
        count = 10_000_000
        time = solve_time(view_of(problems(count, 0)))
        copy = jnp.zeros(50_000_000)
        bandwidth = 2 * copy.nbytes / seconds(lambda: copy + 1)
        put("accelerator: ns per solve", time / count * 1e9, "(reported)", "E_p L2 screen, 1e7")
        least = count * (4 * 8 + 5 * 8 + 4 + 1)  # four inputs, five outputs, the outcome and a flag
        put("accelerator: fraction of the memory bound", least / bandwidth / time, "(reported)", "least traffic")
    return found

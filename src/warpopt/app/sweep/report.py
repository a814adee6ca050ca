"""`report.md`: the results of a run as text, with its figures."""

import dataclasses

import numpy as np

import warpopt
from warpopt.rules.registry import PUBLISHED, rule_title

from ..common.limits import least_and_largest, limit_sentence
from ..common.words import markdown_pictures, markdown_table
from ..frusta.solve import OptimumCurves, RuleCurves, Sweep
from .settings import RunConfig


@dataclasses.dataclass(frozen=True)
class Finding:
    """The summary of one objective over one view."""

    depth_ratio: float
    half_fov_deg: float
    metric: str
    norm: str
    no_warp: str
    worst: dict[str, tuple[float, float]]  # rule: (largest ratio where the rule is defined, theta_deg); NaN if nowhere
    everywhere: frozenset[str]  # the rules that are defined for every direction of the table
    harmful: dict[str, str]  # rule: the directions where it is worse than no warp, as ranges
    over_limit: tuple[float, float] | None  # least and largest error of the optimum as a multiple of the limit
    failures: int


def ranges_of(theta_deg: np.ndarray, selected: np.ndarray) -> str:
    """The selected directions as text: "0 to 10 deg, 80 deg"; empty if none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], selected, [False]]).astype(int)))
    words = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        low, high = theta_deg[first], theta_deg[last]
        words.append(f"{low:g} deg" if first == last else f"{low:g} to {high:g} deg")
    return ", ".join(words)


def findings(sweep: Sweep) -> list[Finding]:
    """One for each view of the configuration and each objective."""
    order = np.argsort(sweep.theta_deg, kind="stable")
    return [_finding(sweep, i, optimum, order) for i in range(len(sweep.views)) for optimum in sweep.optima]


def _finding(sweep: Sweep, i: int, optimum: OptimumCurves, order: np.ndarray) -> Finding:
    theta = sweep.theta_deg[order]
    view = sweep.views[i]
    worst, harmful = {}, {}
    unwarped = optimum.ratios["ssm"][i, order]
    for name in PUBLISHED:
        rule: RuleCurves = sweep.rules[name]
        ratio = np.where(rule.defined[i, order], optimum.ratios[name][i, order], np.nan)
        if np.isfinite(ratio).any():
            at = int(np.nanargmax(ratio))
            worst[name] = (float(ratio[at]), float(theta[at]))
        else:
            worst[name] = (float("nan"), float("nan"))
        # by more than rounding
        harmful[name] = ranges_of(theta, np.nan_to_num(ratio) > unwarped * (1 + 1e-9))
    result = optimum.result[i, order]
    return Finding(
        view.far / view.near,
        view.half_fov_deg,
        optimum.metric,
        optimum.norm,
        ranges_of(theta, result == warpopt.Outcome.no_warp) or "none",
        worst,
        frozenset(name for name in PUBLISHED if sweep.rules[name].defined[i].all()),
        harmful,
        least_and_largest(optimum.over_limit[i]),
        int(optimum.failed[i].sum()),
    )


def _paragraph(finding: Finding) -> str:
    f = finding
    lines = [f"### E_{f.metric}, norm {f.norm}, f/n = {f.depth_ratio:g}, half field of view {f.half_fov_deg:g} deg", ""]
    if f.failures:
        lines.append(f"**{f.failures} directions could not be solved**; `run.json` names each outcome.")
    lines.append(
        "A warp helps for every direction of the table."
        if f.no_warp == "none"
        else f"eta = 1 (no warp) minimises the error for theta = {f.no_warp}; a warp helps for the others."
    )
    lines += filter(None, [limit_sentence(f.over_limit)])
    rows = []
    for name, (ratio, theta) in f.worst.items():
        if np.isnan(ratio):
            rows.append([rule_title(name), "gives no lambda > 0 here", "", ""])
        else:
            harm = f.harmful[name] or ("" if name == "ssm" else "nowhere")
            rows.append([rule_title(name), f"{ratio:.4g}", f"{theta:g} deg", harm])
    heads = ["rule", "worst error / optimum", "at theta", "worse than no warp for theta"]
    return "\n".join([*lines, "", markdown_table(heads, rows)])


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _closest(found: list[Finding]) -> str:
    """Text: for each objective, the rule that is closest to the optimum in its worst direction."""
    words = []
    for f in found:
        complete = {name: worst for name, worst in f.worst.items() if name in f.everywhere and name != "ssm"}
        if complete:
            name = min(complete, key=lambda rule: complete[rule][0])
            ratio, theta = complete[name]
            words.append(
                f"- E_{f.metric}, norm {f.norm}, f/n = {f.depth_ratio:g}, half field of view {f.half_fov_deg:g} deg: "
                f"of the rules that always give a warp, {rule_title(name)} is the closest, at worst {ratio:.4g} times "
                f"the optimum's error (at {theta:g} deg); no warp is at worst {f.worst['ssm'][0]:.4g} times."
            )
    return "\n".join(words) + "\n"


def _without_limit(sweep: Sweep) -> str:
    """Text: the objectives that have no limit."""
    without = [f"E_{o.metric} in norm {o.norm}" for o in sweep.optima if o.no_limit_because]
    return f"None is known, and the columns hold nan, for {', '.join(without)}." if without else ""


def report(config: RunConfig, sweep: Sweep, found: list[Finding], figures: list[tuple[str, str]]) -> str:
    """The report as Markdown."""
    n_directions, n_views = len(sweep.theta_deg), len(sweep.views)
    failures = sum(f.failures for f in found)
    parts = [
        "# Optimal perspective warps\n",
        f"{_counted(n_views, 'view')}, {_counted(n_directions, 'light direction')} from {sweep.theta_deg.min():g} to "
        f"{sweep.theta_deg.max():g} deg, norms over the measure `{sweep.measure}`.\n",
        f"**{_counted(failures, 'problem')} could not be solved**; `run.json` names each outcome.\n"
        if failures
        else "Every optimum is a global minimum: its stationarity condition changes sign once, or it is a tie or a "
        "kink with the right signs on both sides.\n",
        "`table.csv` and `table.npz` hold eta, lambda / mu, lambda, the minimal norm, the limit and the norm over it "
        "for each direction, then each rule's norm as a multiple of the minimum; `run.json` has configuration, "
        "versions and outcomes. lambda is the near-plane distance of the warping frustum (inf: no warp), mu its depth "
        "range, and eta = lambda / (lambda + mu).\n",
        "A ratio counts where its rule is defined; where a rule gives no lambda > 0, the table has no warp in its "
        "place.\n",
        "The limit is what the best monotone map of the depth would reach, perspective or not: no map can be better. "
        f"{_without_limit(sweep)}\n",
    ]
    if figures:
        parts.append("## Figures\n")
        parts += markdown_pictures(figures)
    parts.append("## What was found\n")
    parts.append(_closest(found))
    parts += [_paragraph(f) for f in found]
    return "\n".join(parts)

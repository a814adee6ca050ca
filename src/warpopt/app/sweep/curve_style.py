"""The common style of figures over the light direction: looks and names of rules, optima and views."""

from matplotlib.axes import Axes

from warpopt.rules.registry import EVERY, rule_title

from ..common.figure_style import MUTED, norm_label
from ..frusta.problem import View
from ..frusta.solve import OptimumCurves, Sweep

MOST_PANELS = 6  # views in one figure
MOST_NORMS = 4  # norms for each metric in one figure
PLAIN_METRICS = {"p": "E_p", "q": "E_q", "pxq": "E_p×q"}
METRIC_DASHES = {"p": "-", "q": (0, (4.5, 1.5)), "pxq": (0, (1.2, 1.0))}
NORM_INKS = (("#000000", 3.0), ("#5c5c5c", 2.0), ("#000000", 1.2), ("#5c5c5c", 0.9))  # grey and line width


def rule_style(name: str) -> dict:
    """A rule that nearly follows another is dashed, and drawn above it."""
    rule = EVERY[name]
    return {"color": rule.colour, "linewidth": 1.5, "linestyle": (0, (4, 1.6)) if rule.follows else "-"}


def rules_of(sweep: Sweep) -> list[str]:
    """The rules in the order of the legend: one that follows another comes after it."""
    names = list(sweep.rules)
    return sorted(names, key=lambda name: (names.index(EVERY[name].follows or name), EVERY[name].follows is not None))


def rule_label(name: str) -> str:
    """The rule's name, with the parameters of the one that has any."""
    return rule_title(name) + (" (κ = 0.5, ξ = 0.8)" if name == "tsm" else "")


def plain_optimum_label(metric: str, norm: str) -> str:
    """The optimum's name in running text."""
    name = norm_label(norm).strip("$").replace("_", "").replace(r"\infty", "∞").strip("{}").replace("{", "")
    return f"{PLAIN_METRICS.get(metric, metric)} in {name}"


def optimum_style(sweep: Sweep, optimum: OptimumCurves) -> dict:
    """Dashes show the metric; grey and width show the norm."""
    grey, width = NORM_INKS[norms_of(sweep).index(optimum.norm) % len(NORM_INKS)]
    dashes = METRIC_DASHES.get(optimum.metric, "-.")
    return {"color": grey, "linewidth": width, "linestyle": dashes, "dash_capstyle": "butt"}


def metrics_of(sweep: Sweep) -> list[str]:
    return list(dict.fromkeys(optimum.metric for optimum in sweep.optima))


def norms_of(sweep: Sweep) -> list[str]:
    return list(dict.fromkeys(optimum.norm for optimum in sweep.optima))


def drawn_optima(sweep: Sweep) -> list[OptimumCurves]:
    """The optima that fit in the figures: the first norms of each metric."""
    return [optimum for optimum in sweep.optima if optimum.norm in norms_of(sweep)[:MOST_NORMS]]


def ratio_text(view: View) -> str:
    ratio = view.far / view.near
    return f"{ratio:,.0f}" if ratio >= 1000 else f"{ratio:.4g}"


def view_label(view: View) -> str:
    return f"f/n = {ratio_text(view)},  φ = {view.half_fov_deg:g}°"


def theta_limit(sweep: Sweep) -> float:
    """The right end of the theta axis in degrees: 90, or 180 if the sweep goes beyond 90."""
    return 180.0 if sweep.theta_deg.size and sweep.theta_deg.max() > 90 else 90.0


def mark_field_of_view(axes: Axes, half_fov_deg: float, limit: float, top: bool = False) -> None:
    """A dotted line where theta = phi, and at its mirror image if that is on the axis."""
    for theta in {half_fov_deg, 180 - half_fov_deg}:
        if theta < limit:
            axes.axvline(theta, color=MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
    side = "right" if half_fov_deg > 0.12 * limit else "left"
    axes.annotate(
        "θ = φ",
        (half_fov_deg, float(top)),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-3 if side == "right" else 3, -4 if top else 3),
        textcoords="offset points",
        color=MUTED,
        fontsize=7,
        ha=side,
        va="top" if top else "bottom",
        zorder=6,
    )

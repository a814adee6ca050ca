"""What the figures share: colours, labels, axis furniture and layout, with matplotlib's object interface only."""

import contextlib
import math
import threading
from collections.abc import Iterator, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .names import rule_title
from .sweep import OptimumCurves, Sweep, View

INK = "#222222"
MUTED = "#6e6e6e"
MOST_PANELS = 6  # views in one figure
MOST_NORMS = 4  # norms for each metric in one figure

# Okabe and Ito's palette: distinct under every common colour blindness. Black is kept for the optimum.
RULE_COLOURS = {
    "ssm": "#a3a3a3",
    "psm": "#cc79a7",
    "lispsm": "#0072b2",
    "scherzer": "#56b4e9",
    "tsm": "#d55e00",
    "tsm_alternative": "#e69f00",
    "minimum_norm": "#009e73",
}
METRIC_LABELS = {"p": r"$E_p$", "q": r"$E_q$", "pxq": r"$E_{p\times q}$"}
PLAIN_METRICS = {"p": "E_p", "q": "E_q", "pxq": "E_p×q"}
METRIC_DASHES = {"p": "-", "q": (0, (4.5, 1.5)), "pxq": (0, (1.2, 1.0))}
NORM_INKS = (("#000000", 3.0), ("#5c5c5c", 2.0), ("#000000", 1.2), ("#5c5c5c", 0.9))  # grey and line width

# Whatever a user's matplotlibrc says, the figures come out alike.
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "text.usetex": False,
    "font.size": 8.5,
    "axes.linewidth": 0.7,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.0,
    "axes.titlepad": 4.0,
    "axes.labelsize": 8.5,
    "axes.grid": False,
    "axes.facecolor": "white",
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "savefig.bbox": None,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "text.color": INK,
    "path.simplify": True,
    "svg.fonttype": "path",
    "svg.image_inline": True,
    "svg.hashsalt": "warpopt",
}
_LOCK = threading.RLock()  # rcParams are the process's: two threads must not restore each other's


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """The figures' style, set on entry and taken back on exit; also a decorator."""
    with _LOCK, matplotlib.rc_context(_STYLE):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in inches, on the Agg canvas: it never looks for a display."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def place(figure: Figure, left: float, top: float, width: float, height: float, **options) -> Axes:
    """Axes whose upper left corner is (left, top) inches from the figure's upper left corner."""
    w, h = figure.get_size_inches()
    return figure.add_axes((left / w, 1 - (top + height) / h, width / w, height / h), **options)


def write_at(figure: Figure, left: float, top: float, text: str, **options) -> None:
    """Text at (left, top) inches from the figure's upper left corner."""
    w, h = figure.get_size_inches()
    figure.text(left / w, 1 - top / h, text, **options)


def legend_at(figure: Figure, left: float, top: float, handles: Sequence, title: str, **options) -> None:
    """A legend whose upper left corner is (left, top) inches from the figure's upper left corner."""
    w, h = figure.get_size_inches()
    legend = figure.legend(
        handles=handles,
        title=title,
        loc="upper left",
        bbox_to_anchor=(left / w, 1 - top / h),
        alignment="left",
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=2.6,
        labelspacing=0.55,
        **options,
    )
    legend.get_title().set_fontweight("bold")
    legend.get_title().set_fontsize(8.5)


def rule_style(name: str) -> dict:
    """Scherzer's rule nearly follows LiSPSM's, so it is dashed and lies above."""
    dashes = (0, (4, 1.6)) if name == "scherzer" else "-"
    return {"color": RULE_COLOURS.get(name, "#7b5ea7"), "linewidth": 1.5, "linestyle": dashes}


def rules_of(sweep: Sweep) -> list[str]:
    """The rules in the order of the legend, unknown ones last."""
    known = list(RULE_COLOURS)
    return sorted(sweep.rules, key=lambda name: known.index(name) if name in known else len(known))


def rule_label(name: str) -> str:
    """The rule's name, with the parameters of the one that has any."""
    return rule_title(name) + (" (κ = 0.5, ξ = 0.8)" if name == "tsm" else "")


def norm_label(norm: str) -> str:
    """L∞, L1, L2, or the order as written without a trailing .0."""
    order = norm.removeprefix("l")
    if order == "inf":
        return r"$L_\infty$"
    with contextlib.suppress(ValueError):
        order = f"{float(order):g}"
    return f"$L_{{{order}}}$"


def optimum_label(metric: str, norm: str) -> str:
    return f"{METRIC_LABELS.get(metric, metric)}, {norm_label(norm)}"


def plain_optimum_label(metric: str, norm: str) -> str:
    """The optimum's name in running text."""
    name = norm_label(norm).strip("$").replace("_", "").replace(r"\infty", "∞").strip("{}").replace("{", "")
    return f"{PLAIN_METRICS.get(metric, metric)} in {name}"


def optimum_style(sweep: Sweep, optimum: OptimumCurves) -> dict:
    """Dashes tell the metric; grey and width tell the norm."""
    grey, width = NORM_INKS[norms_of(sweep).index(optimum.norm) % len(NORM_INKS)]
    dashes = METRIC_DASHES.get(optimum.metric, "-.")
    return {"color": grey, "linewidth": width, "linestyle": dashes, "dash_capstyle": "butt"}


def metrics_of(sweep: Sweep) -> list[str]:
    return list(dict.fromkeys(optimum.metric for optimum in sweep.optima))


def norms_of(sweep: Sweep) -> list[str]:
    return list(dict.fromkeys(optimum.norm for optimum in sweep.optima))


def drawn_optima(sweep: Sweep) -> list[OptimumCurves]:
    """The optima that the figures have room for: the first norms of each metric."""
    return [optimum for optimum in sweep.optima if optimum.norm in norms_of(sweep)[:MOST_NORMS]]


def ratio_text(view: View) -> str:
    ratio = view.far / view.near
    return f"{ratio:,.0f}" if ratio >= 1000 else f"{ratio:.4g}"


def view_label(view: View) -> str:
    return f"f/n = {ratio_text(view)},  φ = {view.half_fov_deg:g}°"


def theta_limit(sweep: Sweep) -> float:
    """The right end of the theta axis in degrees: 90, or 180 if the sweep goes beyond 90."""
    return 180.0 if sweep.theta_deg.size and sweep.theta_deg.max() > 90 else 90.0


def theta_axis(axes: Axes, limit: float, label: bool = True) -> None:
    axes.set_xlim(0, limit)
    axes.set_xticks(np.arange(0, limit + 1, 15 if limit <= 90 else 30))
    axes.tick_params(axis="x", labelbottom=label)
    if label:
        wide = axes.get_window_extent().width > 2.8 * axes.figure.dpi
        text = "θ, angle between view and light (degrees)" if wide else "θ (degrees)"
        beside(axes, text, (0.5, 0), (0, -19), va="top")


def beside(axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], **options) -> None:
    """Centred text at a place of the axes' box, offset in points: matplotlib's own titles measure every tick first."""
    options = {"ha": "center", "va": "center", "fontsize": 8.5, **options}
    axes.annotate(text, at, xycoords="axes fraction", xytext=offset, textcoords="offset points", **options)


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


def draw_curve(axes: Axes, theta_deg: np.ndarray, values: np.ndarray, label: str, **style) -> None:
    """A curve over theta with gaps where it is not finite; points without a neighbour get a marker."""
    order = np.argsort(theta_deg, kind="stable")
    values = np.where(np.isfinite(values), values, np.nan)[order]
    here = np.isfinite(values)
    beside = np.r_[False, here[:-1]] | np.r_[here[1:], False]
    alone = np.flatnonzero(here & (~beside | (here.size <= 8))).tolist()
    style = {"linewidth": 1.5, "solid_capstyle": "round", **style}
    size = 3.0 + style["linewidth"]
    axes.plot(theta_deg[order], values, label=label, marker="o", markevery=alone, markersize=size, **style)


def decades(values: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Limits of a log axis that hold all but the given quantiles of the finite positive values, with some room."""
    logs = np.log10(values[np.isfinite(values) & (values > 0)])
    if not logs.size:
        return 0.01, 10.0
    least, most = np.quantile(logs, [low, high])
    room = max(0.06 * (most - least), 0.15)
    return 10 ** (least - room), 10 ** (most + room)


def log_axis(axes: Axes, limits: tuple[float, float], label: bool = True) -> None:
    """A log y axis with few ticks: 1, 2, 5 over less than two decades, whole decades beyond, at most ten."""
    axes.set_yscale("log")
    axes.set_ylim(*limits)
    low, high = (math.log10(limit) for limit in limits)
    steps = (1, 2, 5) if high - low < 2 else (1,)
    every = 1 + int((high - low) / 10)
    exponents = range(math.floor(low), math.ceil(high) + 1)
    ticks = [step * 10.0**k for k in exponents if k % every == 0 for step in steps]
    ticks = [tick for tick in ticks if low <= math.log10(tick) < high - 0.012 * (high - low)]
    long = high - low > 3.7
    axes.set_yticks(ticks, [power_text(tick, long) for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.tick_params(axis="y", labelleft=label)


def power_text(value: float, long: bool = False) -> str:
    """A tick's number: plain while short, else a power of ten; `long` asks for powers except next to 1."""
    if (0.1 <= value <= 10) if long else (1e-3 <= value < 1e4):
        return f"{value:.3g}"
    exponent = math.floor(math.log10(value) + 1e-9)
    power = "10" + superscript(exponent)
    factor = round(value / 10.0**exponent)
    return power if factor == 1 else f"{factor}·{power}"


def superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def listed(items: Sequence[str]) -> str:
    """Items as a phrase: a, b and c."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))

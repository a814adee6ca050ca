"""The common style of the figures: colours, labels, axes and layout, with only matplotlib's object interface."""

import contextlib
import math
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK = "#222222"
MUTED = "#6e6e6e"
WORSE, WORSE_INK = "#f6dfd6", "#a0522d"  # where a rule is worse than no warp

METRIC_LABELS = {"p": r"$E_p$", "q": r"$E_q$", "pxq": r"$E_{p\times q}$"}

# The figures do not depend on a user's matplotlibrc.
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
PNG_DPI = 160
_SVG_DPI = 110  # for embedded pictures; the rest is vector graphics
_LOCK = threading.RLock()  # rcParams are global: two threads must not restore each other's values


@contextlib.contextmanager
def shared_style() -> Iterator[None]:
    """The figures' style, set on entry and restored on exit; also a decorator."""
    with _LOCK, matplotlib.rc_context(cast(Any, _STYLE)):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in inches, on the Agg canvas, which needs no display."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write `path`.png and `path`.svg: text as outlines, no date, ids that depend only on the content."""
    with shared_style():
        figure.savefig(path.with_name(path.name + ".png"), dpi=PNG_DPI, pil_kwargs={"compress_level": 4})
        figure.savefig(path.with_name(path.name + ".svg"), dpi=_SVG_DPI, metadata={"Date": None})


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


def theta_axis(axes: Axes, limit: float, label: bool = True) -> None:
    axes.set_xlim(0, limit)
    axes.set_xticks(np.arange(0, limit + 1, 15 if limit <= 90 else 30))
    axes.tick_params(axis="x", labelbottom=label)
    if label:
        wide = axes.get_window_extent().width > 2.8 * axes.figure.dpi
        text = "θ, angle between view and light (degrees)" if wide else "θ (degrees)"
        beside(axes, text, (0.5, 0), (0, -19), va="top")


def beside(axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], **options) -> None:
    """Centred text at a point of the axes' box, offset in points: faster than matplotlib's titles."""
    options = {"ha": "center", "va": "center", "fontsize": 8.5, **options}
    axes.annotate(text, at, xycoords="axes fraction", xytext=offset, textcoords="offset points", **options)


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
    """Limits of a log axis that hold all but the given quantiles of the finite positive values, with a margin."""
    logs = np.log10(values[np.isfinite(values) & (values > 0)])
    if not logs.size:
        return 0.01, 10.0
    least, most = np.quantile(logs, [low, high])
    room = max(0.06 * (most - least), 0.15)
    return 10 ** (least - room), 10 ** (most + room)


def log_axis(axes: Axes, limits: tuple[float, float], label: bool = True) -> None:
    """A log y axis with few ticks: 1, 2, 5 over less than two decades, more over less than 0.6, else whole decades."""
    axes.set_yscale("log")
    axes.set_ylim(*limits)
    low, high = (math.log10(limit) for limit in limits)
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 7) if high - low < 0.6 else (1, 2, 5) if high - low < 2 else (1,)
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
        return f"{value:.4g}"  # 1000, not 1e+03
    exponent = math.floor(math.log10(value) + 1e-9)
    power = "10" + superscript(exponent)
    factor = round(value / 10.0**exponent)
    return power if factor == 1 else f"{factor}·{power}"


def superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))

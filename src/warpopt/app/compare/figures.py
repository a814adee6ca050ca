"""The figures of a comparison: a map of rules against directions, and curves if there are few enough."""

from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from warpopt.rules.registry import rule_title

from ..common import figure_style as style
from .solve import Compared

MOST_CURVES = 24
MOST_PANELS = 6
_YOURS = "#c2185b"
_STRIP = 0.72  # inches, the optimum / limit strip below a panel
# For the few important curves, distinguishable without colour too; the others are thin and grey.
_LOOKS = (
    ("#0072b2", "-"), ("#d55e00", (0, (6, 1.6))), ("#e8a200", (0, (1.6, 1.1))), ("#7b2d9b", (0, (6, 1.4, 1.4, 1.4))),
    ("#00806a", (0, (9, 2, 3, 2))), ("#56b4e9", (0, (3, 1))),
)  # fmt: skip
_REST = {"color": "#b0b0b0", "linewidth": 0.9, "linestyle": "-", "zorder": 3}
_REST_INK = "#7d7d7d"
_CROWD = 8  # above this number, thin curves are named only if there is space
_LONGEST = 24  # characters of a rule's name
_APART = 0.058  # of the axis: the height of a text line
_AT_EDGE = 0.9  # of the axis: curves that end beyond it are named on the right
_CELL = 0.2  # inches, a row of the map
_LEVELS = (1.0, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
_SHADES = ("#f7fbf3", "#fdf3cf", "#fbdf9d", "#f7bd6a", "#ee9150", "#d9603f", "#b2332f", "#7a1226")
_UNDEFINED = "#d9d9d9"


def write_compare_figures(compared: list[Compared], folder: Path) -> list[tuple[str, str]]:
    """Write the figures as PNG and SVG.

    Returns:
        (stem, caption) of each.
    """
    first = compared[0].result
    figures = [("map", map_figure(compared), _map_caption(compared))]
    if first.regions is not None and len(first.names) <= MOST_CURVES:
        figures.append(("curves", curves_figure(compared), _curves_caption(compared)))
    for stem, figure, _ in figures:
        style.save(figure, folder / stem)
    return [(stem, caption) for stem, _, caption in figures]


def _left_out(compared: list[Compared]) -> str:
    more = len(compared) - MOST_PANELS
    return f" {more} more objective(s) of the run are not shown." if more > 0 else ""


def _short(name: str) -> str:
    """A rule's name, shortened."""
    title = rule_title(name)
    return title if len(title) <= _LONGEST else title[: _LONGEST - 1] + "…"


def _title(c: Compared) -> str:
    label = style.optimum_label(c.metric, c.norm) if c.metric != "max" else r"max($E_p$, $E_q$)"
    return label if c.camera is None else f"{label}, camera {c.camera}"


def _curves_caption(compared: list[Compared]) -> str:
    return (
        "Each rule's error relative to the optimum's against the angle between view and light. Coloured: the rules "
        "that are best on average in one of the panels, and your own; other rules are named if there is space (the "
        "map has every name). Black line: the optimum. Shaded region: worse than no warp. The strips below show the "
        "optimum as a multiple of the limit, the best that any map of the depth could reach, where it is known; "
        "multiply to get a rule's multiple of the limit. A curve is missing where its rule yields no λ > 0, and "
        "leaves the panel where it is worse than every ranked rule's worst." + _left_out(compared)
    )


def _map_caption(compared: list[Compared]) -> str:
    return (
        "Each rule's error relative to the optimum's, the best on average at the top: darker is worse. To the right: "
        "its mean, its worst, and its worst relative to the limit (the best that any map of the depth could reach) "
        "where it is known; the top row is the optimum relative to that limit. Hatched: worse than no warp. Grey: the "
        "rule yields no λ > 0; rules with grey are below the others." + _left_out(compared)
    )


@style.shared_style()
def curves_figure(compared: list[Compared]) -> Figure:
    """value / optimum against theta, a panel for each objective, every curve named at its right end."""
    compared = compared[:MOST_PANELS]
    columns = min(len(compared), 2)
    rows = -(-len(compared) // columns)
    width, height, left, names, gap, down = 3.9, 3.1, 0.62, 1.78, 0.35, 0.42
    foot = 0.62
    total = left + columns * (width + names) + (columns - 1) * gap
    in_rows = [compared[k : k + columns] for k in range(0, len(compared), columns)]
    strips = [(_STRIP + 0.12) * any(c.result.bound is not None for c in row) for row in in_rows]
    figure = style.new_figure(total, rows * (height + down) + sum(strips) + foot)
    looks = _looks(compared)
    limit = 180.0 if compared[0].result.theta.max() > np.pi / 2 + 1e-9 else 90.0
    for place, c in enumerate(compared):
        row, column = divmod(place, columns)
        x = left + column * (width + names + gap)
        top = row * (height + down) + sum(strips[:row]) + 0.3
        axes = style.place(figure, x, top, width, height)
        _curves_panel(axes, c, limit, looks)
        last, below = place + columns >= len(compared), c.result.bound is not None
        style.theta_axis(axes, limit, label=last and not below)
        if below:
            band = style.place(figure, x, top + height + 0.12, width, _STRIP)
            _limit_strip(band, c)
            style.theta_axis(band, limit, label=last)
            style.beside(band, "optimum / limit", (1, 0.5), (5, 0), ha="left", fontsize=7.4)
        style.beside(axes, _title(c), (0.5, 1), (0, 4), va="bottom", fontsize=9.5)
        if column == 0:
            style.beside(axes, "error / optimal error", (0, 0.5), (-36, 0), rotation=90)
    handles: list[Artist] = [Line2D([], [], color="black", linewidth=2.6, label="optimum (= 1)")]
    handles.append(Patch(facecolor=style.WORSE, label="worse than no warp"))
    handles.append(Line2D([], [], label="other rules", **_REST))
    at = (left / total, 0.06 / figure.get_size_inches()[1])
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=at, ncols=2 * columns, borderaxespad=0)
    return figure


def _curves_panel(axes: Axes, c: Compared, limit: float, looks: dict[str, dict]) -> None:
    r = c.result
    theta, ratio = np.rad2deg(r.theta), r.ratio
    limits = _limits(c)
    style.log_axis(axes, limits)
    axes.grid(axis="y", which="major", color="#e6e6e6", linewidth=0.6, zorder=0.5)
    bare = r.unwarped_ratio
    if len(theta) == 1:
        axes.fill_between(theta + np.array([-1.5, 1.5]), np.repeat(bare, 2), limits[1], color=style.WORSE, linewidth=0)
    else:
        axes.fill_between(theta, bare, limits[1], where=np.isfinite(bare), color=style.WORSE, linewidth=0, zorder=0)
    axes.axhline(1, color="black", linewidth=2.6, zorder=2)
    labels, spare = [], []
    for i, name in enumerate(r.names):
        look = looks.get(name, _REST)
        style.draw_curve(axes, theta, ratio[i], f"rule {name}", **look)
        there = np.flatnonzero(np.isfinite(ratio[i]))
        if there.size:
            end = float(theta[there[-1]]), float(ratio[i, there[-1]])
            if name in looks or len(r.names) <= _CROWD:
                labels.append((*end, _short(name), look["color"] if name in looks else _REST_INK))
            elif end[0] >= _AT_EDGE * limit:
                spare.append((*end, _short(name), _REST_INK))
    _name_curves(axes, labels + _with_room(spare, labels, limits), limits, limit)


def _limit_strip(axes: Axes, c: Compared) -> None:
    """optimum / limit against theta."""
    multiple = c.result.optimum_over_bound
    style.log_axis(axes, (0.85, max(3.0, 1.3 * float(np.nanmax(multiple, initial=1)))))
    axes.grid(axis="y", which="major", color="#e6e6e6", linewidth=0.6, zorder=0.5)
    style.draw_curve(axes, np.rad2deg(c.result.theta), multiple, "optimum / limit", color="black")


def _with_room(spare: list[tuple], labels: list[tuple], limits: tuple[float, float]) -> list[tuple]:
    """The spare labels whose ends are apart from every other label, within the panel."""
    low, high = np.log10(limits)
    ends = np.array([(np.log10(value) - low) / (high - low) for _, value, *_ in [*spare, *labels]])
    near = (np.abs(ends[:, None] - ends) < _APART).sum(1) > 1
    return [label for label, end, crowded in zip(spare, ends, near, strict=False) if end < 1 and not crowded]


def _limits(c: Compared) -> tuple[float, float]:
    """Limits of the panel: all ranked rules; worse curves, such as no warp, may leave it."""
    r = c.result
    ranked = [r.worst(name).ratio for name in r.ranking() if name != "ssm"]
    most = max((ratio for ratio in ranked if np.isfinite(ratio)), default=float(np.nanmax(r.unwarped_ratio, initial=1)))
    return 0.8, max(3.0, 1.3 * most)


def _looks(compared: list[Compared]) -> dict[str, dict]:
    """The style of the highlighted curves in every panel: the best on average in one of them, the user's, no warp."""
    best = dict.fromkeys(name for c in compared for name in [n for n in c.result.ranking() if n != "ssm"][:1])
    own = [name for name in compared[0].result.names if rule_title(name) == name]
    looks = {"ssm": {"color": style.MUTED, "linewidth": 2.2, "linestyle": "-", "zorder": 4}}
    chosen = [name for name in best if name not in own]
    for name, (colour, dashes) in zip(chosen, _LOOKS, strict=False):
        looks[name] = {"color": colour, "linewidth": 1.9, "linestyle": dashes, "zorder": 5}
    return looks | {name: {"color": _YOURS, "linewidth": 2.2, "linestyle": "-", "zorder": 6} for name in own}


def _name_curves(axes: Axes, labels: list[tuple], limits: tuple[float, float], limit: float) -> None:
    """Names to the right, in the order of the curves' ends, spaced for reading, with a line to each end."""
    low, high = np.log10(limits)
    for theta, value, text, colour in labels:
        if theta < _AT_EDGE * limit:  # its rule is undefined beyond this theta
            options = {"textcoords": "offset points", "va": "center", "fontsize": 7.4, "color": colour, "zorder": 7}
            axes.annotate(text, (theta, value), xytext=(4, 0), annotation_clip=True, **options)
    labels = sorted((label for label in labels if label[0] >= _AT_EDGE * limit), key=lambda label: label[1])
    ends = np.clip([(np.log10(value) - low) / (high - low) for _, value, *_ in labels], 0, 1)
    apart = min(_APART, 1 / max(len(labels), 1))
    at = ends.copy()
    for i in range(1, len(at)):
        at[i] = max(at[i], at[i - 1] + apart)
    over = at[-1] - 1 if len(at) else 0
    for i in range(len(at) - 1, -1, -1):
        if over > 0:
            at[i] = min(at[i], 1 - (len(at) - 1 - i) * apart)
    for (theta, _, text, colour), end, y in zip(labels, ends, at, strict=True):
        xs = [min(theta / limit, 1), 1.0, 1.035]
        axes.plot(xs, [end, end, y], color=colour, linewidth=0.6, transform=axes.transAxes, clip_on=False, zorder=1.5)
        axes.text(1.045, y, text, color=colour, fontsize=7.4, va="center", transform=axes.transAxes)


@style.shared_style()
def map_figure(compared: list[Compared]) -> Figure:
    """value / optimum as colour, a row for each rule, the best at the top; a panel for each objective."""
    compared = compared[:MOST_PANELS]
    count = len(compared[0].result.names)
    columns = min(len(compared), 2)
    rows = -(-len(compared) // columns)
    limited = any(c.result.bound is not None for c in compared)
    width, left, numbers, down = 3.3, 1.95, 1.5 if limited else 0.95, 0.52
    height = _CELL * (count + limited)
    scene = compared[0].result.regions is None
    foot = 0.95 if scene else 0.85
    if columns == 1:
        foot += 0.2  # the legend has more lines
    total = columns * (left + width + numbers)
    figure = style.new_figure(total, rows * (height + down) + foot)
    for place, c in enumerate(compared):
        row, column = divmod(place, columns)
        x = left + column * (left + width + numbers)
        own = _CELL * (count + (c.result.bound is not None))  # aligns the panels' lower ends
        axes = style.place(figure, x, row * (height + down) + 0.42 + height - own, width, own)
        _map_panel(axes, c, last=place + columns >= len(compared))
    _map_legend(figure, left, total)
    return figure


def _edges(c: Compared) -> np.ndarray:
    r = c.result
    if r.regions is None:
        return np.arange(len(r.theta) + 1) - 0.5
    theta = np.rad2deg(r.theta)
    if len(theta) == 1:
        return theta + np.array([-1.0, 1.0])
    middle = (theta[1:] + theta[:-1]) / 2
    return np.r_[theta[0], middle, theta[-1]]


def _map_panel(axes: Axes, c: Compared, last: bool) -> None:
    r = c.result
    order, edges = r.order(), _edges(c)
    index = [r.names.index(name) for name in order]
    top = [] if r.bound is None else [r.optimum_over_bound]
    ratio = np.stack([*top, *r.ratio[index]])
    worse = np.stack([*(np.zeros_like(row, bool) for row in top), *r.worse[index]])
    colours = ListedColormap(_SHADES[:-1]).with_extremes(over=_SHADES[-1], bad=_UNDEFINED)
    axes.pcolormesh(
        edges, np.arange(len(ratio) + 1) - 0.5, np.ma.masked_invalid(np.maximum(ratio, 1)), cmap=colours,
        norm=BoundaryNorm(_LEVELS, len(_LEVELS) - 1), rasterized=True,
    )  # fmt: skip
    for row, (values, harm) in enumerate(zip(ratio, worse, strict=True)):
        # white where the cells are dark
        dark = values > _LEVELS[5]
        for part, ink in ((~dark, "#2b2b2b"), (dark, "#ffffff")):
            for start, stop in np.flatnonzero(np.diff(np.r_[False, harm & part, False])).reshape(-1, 2):
                place, size = (float(edges[start]), row - 0.5), float(edges[stop] - edges[start])
                look = {"fill": False, "hatch": "//////", "linewidth": 0, "edgecolor": ink, "zorder": 3}
                axes.add_patch(Rectangle(place, size, 1, **look))
    _map_numbers(axes, c, order, len(top))
    axes.hlines(np.arange(1, len(ratio)) - 0.5, edges[0], edges[-1], color="white", linewidth=1.2, zorder=4)
    if top:
        axes.axhline(0.5, color=style.INK, linewidth=0.8, zorder=4)
    axes.set_ylim(len(ratio) - 0.5, -0.5)
    axes.set_xlim(edges[0], edges[-1])
    axes.set_yticks(range(len(ratio)), ["optimum / limit"] * len(top) + [_short(name) for name in order])
    for label, name in zip(axes.get_yticklabels()[len(top) :], order, strict=True):
        label.set_color(_YOURS if rule_title(name) == name else style.INK)
    axes.tick_params(axis="y", length=0)
    style.beside(axes, _title(c), (0.5, 1), (0, 4), va="bottom", fontsize=9.5)
    if r.regions is None:
        every = -(-len(r.theta) // 8)
        ticks = range(0, len(r.theta), every)
        axes.set_xticks(ticks, [f"{k}\n{np.rad2deg(r.theta[k]):.0f}°" for k in ticks])
        if last:
            style.beside(axes, "light, and its angle θ to the view", (0.5, 0), (0, -28), va="top")
    else:
        span = edges[-1] - edges[0]
        step = 30 if span > 90 else 15 if span > 45 else 5
        ticks = np.arange(np.ceil(edges[0] / step) * step, edges[-1] + 1e-9, step)
        axes.set_xticks(ticks if ticks.size else edges)
        if last:
            style.beside(axes, "θ, angle between view and light (degrees)", (0.5, 0), (0, -17), va="top")


def _map_numbers(axes: Axes, c: Compared, order: list[str], first: int) -> None:
    """Next to each row: the mean, the worst, and the worst over the limit; for the optimum, only the last."""
    r = c.result
    columns = {"mean": [r.mean(name) for name in order], "worst": [r.worst(name).ratio for name in order]}
    if first:
        columns["worst\n/ limit"] = [r.worst(name, "bound").ratio for name in order]
    look = {"transform": axes.transAxes, "ha": "right", "va": "center", "fontsize": 7.4}
    for k, (head, numbers) in enumerate(columns.items()):
        x = 1.13 + 0.14 * k
        style.beside(axes, head, (x, 1), (0, 3), ha="right", va="bottom", fontsize=7.0, color=style.MUTED)
        for row, value in enumerate(numbers, first):
            axes.text(x, 1 - (row + 0.5) / (len(order) + first), _number(value), **look)
    if first:
        axes.text(1.41, 1 - 0.5 / (len(order) + 1), _number(float(np.nanmax(r.optimum_over_bound, initial=1))), **look)


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "–" if np.isnan(value) else "∞"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _map_legend(figure: Figure, left: float, total: float) -> None:
    labels = [f"to {high:g}" for high in _LEVELS[1:]] + [f"over {_LEVELS[-1]:g}"]
    handles = [
        Patch(facecolor=s, edgecolor="#999999", linewidth=0.4, label=t) for s, t in zip(_SHADES, labels, strict=True)
    ]
    handles.append(
        Patch(facecolor="white", edgecolor="#2b2b2b", hatch="//////", linewidth=0, label="worse than no warp")
    )
    handles.append(Patch(facecolor=_UNDEFINED, label="not defined"))
    columns = len(handles) if total > 8 else 4
    figure.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.06 / figure.get_size_inches()[1]), ncols=columns,
        handlelength=1.3, handletextpad=0.4, columnspacing=1.1, borderaxespad=0, fontsize=7.4,
        title="error / optimal error", title_fontsize=7.4,
    )  # fmt: skip

"""Static error against false flicker of ways to fit a map along a path."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from warpopt.frames.methods import method_title
from warpopt.frames.names import STABLE, WINDOW
from warpopt.rules.registry import EVERY

from . import figure_style as style

COLOURS = {"p-inf": "#000000", "edge": "#d62612", "band": "#0d61d9", "none": "#a3a3a3", "best": "#009e73"}
COLOURS |= {"turned-edge": "#e8833a", "turned-band": "#5aa9e6"}
"""Of warps that are not rules."""
_FLOOR = 0.001  # per cent: what flickers less is drawn here
_PATH_COLOURS = {"sphere": "#7a5c3a", "sphere-receivers": "#b59a6a", "lispsm": "#0d61d9"}


@style.shared_style()
def flicker_figure(paths: dict[str, list[dict[str, Any]]]) -> Figure:
    """Wrong pixels against false flicker, every method: below and to the left is better.

    Args:
        paths: rows with method, static and flicker, by the title of a panel.
    """
    figure = style.new_figure(2.9 * len(paths) + 3.9, 3.6)
    found = [100 * row["static"] for rows in paths.values() for row in rows if row["static"]]
    ends = (min(found) / 1.4, max(found) * 1.4) if found else (0.1, 10.0)
    highest = max([100 * (row["flicker"] or 0) for rows in paths.values() for row in rows] + [1.0])
    handles: dict[str, Any] = {}
    for k, (title, rows) in enumerate(paths.items()):
        axes = style.place(figure, 0.75 + 2.9 * k, 0.5, 2.4, 2.5)
        for row in rows:
            if not row["static"]:
                continue
            name, y = row["method"], 100 * (row["flicker"] or 0)
            window, held = name.startswith(WINDOW), name.startswith("held-")
            warp = name.removeprefix(WINDOW).removeprefix("held-")
            marker = "D" if name in STABLE else "v" if held else "o"
            colour = (
                _PATH_COLOURS.get(name) or COLOURS.get(warp) or (EVERY[warp].colour if warp in EVERY else "#cc79a7")
            )
            (handles[name],) = axes.plot(
                [100 * row["static"]], [max(y, _FLOOR)], marker, color=colour, markersize=8.5 if window else 6,
                markerfacecolor=colour if window else "none", markeredgewidth=1.4, linestyle="", clip_on=False,
                zorder=3, label=method_title(name),
            )  # fmt: skip
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(*ends)
        decades = range(int(np.floor(np.log10(ends[0]))), int(np.ceil(np.log10(ends[1]))) + 1)
        marks = [step * 10.0**k for k in decades for step in (1, 2, 5) if ends[0] <= step * 10.0**k <= ends[1]]
        axes.set_xticks(marks, [f"{mark:g}" for mark in marks])
        axes.set_ylim(_FLOOR, 1.5 * highest)
        ticks = [t for t in (_FLOOR, 0.01, 0.1, 1.0, 10.0) if t <= 1.5 * highest]
        axes.set_yticks(ticks, ["" if k else "≤ 0.001" if t == _FLOOR else f"{t:g}" for t in ticks])
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_locator(NullLocator())
        axes.grid(color="#e4e4e4", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        style.beside(axes, title, (0.5, 1), (0, 10), fontweight="bold")
        style.beside(axes, "wrong pixels (%)", (0.5, 0), (0, -26))
        if not k:
            style.beside(axes, "false flicker (% of points a frame)", (0, 0.5), (-46, 0), rotation=90)
    style.legend_at(figure, 0.6 + 2.9 * len(paths), 0.45, list(handles.values()), "how maps are fitted")
    return figure

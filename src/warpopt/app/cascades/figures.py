"""The figures of `warpopt cascades`: the error along depth, and what each split loses."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import warpopt

from ..common import figure_style as style
from .report import TITLES
from .rows import Config, Row, objective_of

_COLOURS = {
    "best": "#000000", "logarithmic": "#0d61d9", "practical": "#d62612", "uniform": "#a3a3a3", "godot": "#478cbf",
    "unity": "#7a5c3a", "unreal": "#6b3fa0", "bevy": "#e8833a", "three": "#009e73", "filament": "#cc79a7",
}  # fmt: skip


def write_figures(config: Config, rows: list[Row], folder: Path) -> list[tuple[str, str]]:
    """The files written, with captions."""
    made = []
    for camera in dict.fromkeys(row.camera for row in rows):
        mine = [row for row in rows if row.camera == camera]
        stem = f"camera_{camera}_" if len({row.camera for row in rows}) > 1 else ""
        for name, figure, words in (
            ("lost", lost_figure(mine), "Each split's error over the best's."),
            ("along", along_figure(mine, objective_of(config)), "The error of each cascade along the depth."),
        ):
            figure.savefig(folder / f"{stem}{name}.png", dpi=160)
            made.append((f"{stem}{name}", words))
    return made


@style.shared_style()
def lost_figure(rows: list[Row]) -> Figure:
    """Bars: the error over the best's, warped and not."""
    keys = list(dict.fromkeys((row.name, row.over) for row in rows))
    several = len({over for _, over in keys}) > 1
    figure = style.new_figure(7.4, 0.9 + 0.3 * len(keys))
    axes = style.place(figure, 2.6, 0.35, 3.3, 0.3 * len(keys))
    for k, key in enumerate(keys):
        for row in (row for row in rows if (row.name, row.over) == key):
            axes.plot([row.lost], [k], "o", color=_COLOURS[row.name], markersize=7,
                      markerfacecolor=_COLOURS[row.name] if row.warped else "none", markeredgewidth=1.4)  # fmt: skip
    axes.set_xscale("log")
    axes.set_yticks(range(len(keys)), [TITLES[n] + (f" ({o})" if several else "") for n, o in keys])
    axes.set_ylim(len(keys) - 0.5, -0.5)
    lost = [row.lost for row in rows if np.isfinite(row.lost)]
    axes.set_xlim(0.85, 1.6 * max(lost))
    ticks = [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 1e4, 1e5, 1e6) if t <= 1.6 * max(lost)]
    ticks = ticks if len(ticks) < 7 else [t for t in ticks if np.log10(t) % 1 == 0]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    style.beside(axes, "error over the best's (filled: warped)", (0.5, 0), (0, -26))
    return figure


@style.shared_style()
def along_figure(rows: list[Row], objective: "warpopt.Objective") -> Figure:
    """Each cascade's error over its range of depths, on logarithmic axes."""
    shown = [row for row in rows if row.over == "receivers"]
    figure = style.new_figure(8.6, 3.6)
    handles: dict[str, object] = {}
    panels = [warped for warped in (True, False) if any(row.warped == warped for row in shown)]
    values = np.concatenate([np.asarray(row.plan.errors) for row in shown])
    values = values[np.isfinite(values) & (values > 0)]
    ends = (values.min() / 1.5, values.max() * 1.5) if len(values) else (0.1, 10.0)
    for k, warped in enumerate(panels):
        axes = style.place(figure, 0.75 + 2.9 * k, 0.45, 2.5, 2.5)
        for row in (row for row in shown if row.warped == warped):
            depths, errors = np.asarray(row.plan.splits), np.asarray(row.plan.errors)
            (handles[row.name],) = axes.step(
                depths, np.append(errors, errors[-1]), where="post", color=_COLOURS[row.name],
                linewidth=2.2 if row.name == "best" else 1.1, label=TITLES[row.name],
                zorder=3 if row.name == "best" else 2,
            )  # fmt: skip
        axes.set_xscale("log")
        style.log_axis(axes, ends, label=not k)
        first, last = float(shown[0].plan.splits[0]), float(shown[0].plan.splits[-1])
        axes.set_xlim(first, last)
        marks = [10.0**e for e in range(-3, 8) if first <= 10.0**e <= last] or [first, last]
        axes.set_xticks(marks, [f"{m:g}" for m in marks])
        axes.set_xticks([], minor=True)
        axes.grid(color="#e4e4e4", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        style.beside(axes, "each cascade warped" if warped else "no warp", (0.5, 1), (0, 9), fontweight="bold")
        style.beside(axes, "view depth", (0.5, 0), (0, -26))
        if not k:
            style.beside(axes, objective.title, (0, 0.5), (-46, 0), rotation=90)
    style.legend_at(figure, 0.85 + 2.9 * len(panels), 0.4, list(handles.values()), "splits")
    return figure

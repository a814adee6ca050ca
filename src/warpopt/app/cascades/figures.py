"""The figures of `warpopt cascades`: what each split loses, how many maps, and the screen by cascade."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import warpopt

from ..common import figure_style as style
from ..inputs.scene_files import SceneInput
from ..splits.looks import COLOURS, DASHES, MARKERS
from ..splits.settings import BEST, STEPPED, TITLES
from .numbers import ByNumber, Texels
from .rows import Config, Row, objective_of
from .screen import screen_figure
from .settings import SceneCascadesConfig

_ANGLES = ("#0d61d9", "#d62612", "#009e73", "#e8833a", "#6b3fa0")
_DPI = 160
MOST_SCREENS = 6


def write_figures(
    config: Config, scene: SceneInput | None, rows: list[Row], numbers: list[ByNumber], texels: list[Texels],
    folder: Path,
) -> list[tuple[str, str]]:  # fmt: skip
    """The files written, with captions."""
    made = []

    def write(name: str, figure: Figure, words: str) -> None:
        figure.savefig(folder / f"{name}.png", dpi=_DPI)
        made.append((name, words))

    cameras = list(dict.fromkeys(row.camera for row in rows))
    for camera in cameras:
        mine = [row for row in rows if row.camera == camera]
        lights = list(dict.fromkeys(row.light for row in mine))
        stem = f"camera_{camera}_" if len(cameras) > 1 else ""
        over = f" A mark for each of {len(lights)} lights." if len(lights) > 1 else ""
        write(f"{stem}lost", lost_figure(mine), f"Each split's error over the best's.{over}")
        middle = lights[len(lights) // 2]
        which = f" Light {middle}, in the middle of the path." if len(lights) > 1 else ""
        along = along_figure([row for row in mine if row.light == middle], objective_of(config))
        write(f"{stem}along", along, f"The error of each cascade along the depth.{which}")
        if scene is not None and len(lights) > 1:
            words = "Where the best splits are along the light's path, and the error there."
            write(f"{stem}path", path_figure(scene, mine), words)
    if numbers:
        words = "Each split's largest error over the best of as many maps with a warp in each. A mark where the scheme"
        write("counts", counts_figure(numbers), f"{words} or engine has splits for this number of maps.")
    if texels:
        words = "Texels for one per pixel, divided by the lower bound, with logarithmic splits. Ringed: the number of"
        words += " maps that needs the fewest. With a light near the view's axis both lines coincide."
        for camera in dict.fromkeys(at.camera for at in texels):
            mine = [at for at in texels if at.camera == camera]
            stem = f"camera_{camera}_" if len({at.camera for at in texels}) > 1 else ""
            shown = [mine[k] for k in np.linspace(0, len(mine) - 1, min(len(mine), len(_ANGLES))).round().astype(int)]
            more = f" {len(shown)} of {len(mine)} lights." if len(shown) < len(mine) else ""
            write(f"{stem}texels", texels_figure(shown), words + more)
    if isinstance(config, SceneCascadesConfig) and scene is not None and scene.depths:
        best = [row for row in rows if row.name == BEST]
        places = list(dict.fromkeys((row.camera, row.light) for row in best))
        chosen = np.linspace(0, len(places) - 1, min(len(places), MOST_SCREENS)).round().astype(int)
        for camera, light in (places[k] for k in chosen):
            both = [row for row in best if (row.camera, row.light) == (camera, light)]
            figure = screen_figure(config, scene, both)
            if figure is None:
                continue  # nothing is seen
            words = f"The screen by cascade, and the error at each pixel; camera {camera}, light {light}."
            words += f" One of {len(chosen)} pictures from {len(places)}." if len(chosen) < len(places) else ""
            write(f"screen_camera{camera}_light{light}", figure, words)
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
            axes.plot([row.lost], [k], "o", color=COLOURS[row.name], markersize=7,
                      markerfacecolor=COLOURS[row.name] if row.warped else "none", markeredgewidth=1.4)  # fmt: skip
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
                depths, np.append(errors, errors[-1]), where="post", color=COLOURS[row.name],
                linestyle=DASHES[row.name], linewidth=2.6 if row.name == "best" else 1.3, label=TITLES[row.name],
                zorder=1 if row.name == "best" else 2,
            )  # fmt: skip
        axes.set_xscale("log")
        style.log_axis(axes, ends, label=not k)
        first, last = float(shown[0].plan.splits[0]), float(shown[0].plan.splits[-1])
        axes.set_xlim(first, last)
        marks = [10.0**e for e in range(-3, 8) if first <= 10.0**e <= last]
        if len(marks) < 2:
            marks = [m * 10.0**e for e in range(-4, 8) for m in (1, 2, 5) if first <= m * 10.0**e <= last] or [first]
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


@style.shared_style()
def counts_figure(numbers: list[ByNumber]) -> Figure:
    """The error over the best's against the number of maps, a line for each scheme, with warps and without."""
    figure = style.new_figure(9.0, 3.75)
    panels = [
        warped for warped in (True, False) if any(scheme.warped if warped else scheme.plain for scheme in numbers)
    ]
    every = [v for scheme in numbers for values in (scheme.warped, scheme.plain) for v in values.values()]
    handles: dict[str, object] = {}
    for k, warped in enumerate(panels):
        axes = style.place(figure, 0.8 + 3.0 * k, 0.45, 2.65, 2.6)
        for scheme in numbers:
            values = scheme.warped if warped else scheme.plain
            counts = sorted(values)
            (handles[scheme.name],) = axes.plot(
                counts, [values[n] for n in counts], color=COLOURS[scheme.name], marker=MARKERS[scheme.name],
                markersize=4.5, markeredgewidth=0, linewidth=1.2, label=TITLES[scheme.name],
            )  # fmt: skip
        style.log_axis(axes, (0.8, 1.6 * max(every)), label=not k)
        _whole_numbers(axes, max(k for scheme in numbers for k in scheme.plain))
        style.beside(axes, "each cascade warped" if warped else "no warp", (0.5, 1), (0, 9), fontweight="bold")
        if not k:
            style.beside(axes, "error over the best's, warped", (0, 0.5), (-42, 0), rotation=90)
    style.legend_at(figure, 1.0 + 3.0 * len(panels), 0.45, list(handles.values()), "splits")
    return figure


@style.shared_style()
def texels_figure(texels: list[Texels]) -> Figure:
    """Texels over the bound against the number of maps, a colour for each angle; dashed without warps."""
    figure = style.new_figure(6.6, 3.75)
    axes = style.place(figure, 0.8, 0.3, 3.6, 2.8)
    handles = []
    for at, colour in zip(texels, _ANGLES, strict=False):
        counts = np.arange(1, len(at.warped) + 1)
        (line,) = axes.plot(counts, at.warped, color=colour, linewidth=1.7, label=f"{at.theta_deg:.3g}°")
        axes.plot(counts, at.plain, color=colour, linewidth=1.3, linestyle=(0, (3, 1.6)))
        for values in (at.warped, at.plain):
            least = at.best_number(values is at.warped) - 1
            axes.plot(counts[least], values[least], "o", color=colour, markerfacecolor="white", markersize=5.5)
        handles.append(line)
    every = np.concatenate([values for at in texels for values in (at.warped, at.plain)])
    style.log_axis(axes, (0.9, 1.5 * every.max()))
    _whole_numbers(axes, len(texels[0].warped))
    style.beside(axes, "texels over the bound", (0, 0.5), (-42, 0), rotation=90)
    style.legend_at(figure, 4.65, 0.3, handles, "light to view")
    words = "solid: each warped\ndashed: no warp\nring: the least"
    style.write_at(figure, 4.65, 1.7, words, va="top", color=style.MUTED, fontsize=8)
    return figure


@style.shared_style()
def path_figure(scene: SceneInput, rows: list[Row]) -> Figure:
    """The best splits' depths along the light's path, and at whole steps if asked; below the error."""
    steps = [step for step in scene.steps if step.light is not None]
    x = [step.index if step.hour is None else step.hour for step in steps]
    figure = style.new_figure(6.4, 4.6)
    upper, lower = style.place(figure, 0.8, 0.25, 3.9, 2.0), style.place(figure, 0.8, 2.45, 3.9, 1.5)

    def found(name: str, warped: bool) -> list[Row]:
        by_light = {row.light: row for row in rows if (row.name, row.warped) == (name, warped)}
        return [by_light[step.light] for step in steps if step.light in by_light]

    handles, errors = [], []
    warped = rows[0].warped
    for name, width in ((BEST, 1.5), (STEPPED, 1.1)):
        mine = found(name, warped)
        if not mine:
            continue
        for k in range(1, len(mine[0].plan.errors)):
            depths = [float(row.plan.splits[k]) for row in mine]
            drawn = "default" if name == BEST else "steps-mid"
            upper.plot(x, depths, color=COLOURS[name], linewidth=width, drawstyle=drawn)
        values = [float(row.plan.value) for row in mine]
        (line,) = lower.plot(x, values, color=COLOURS[name], linewidth=width, label=TITLES[name])
        handles.append(line)
        errors += values
    plain = found(BEST, False) if warped else []
    if plain:
        values = [float(row.plan.value) for row in plain]
        (line,) = lower.plot(
            x, values, color=COLOURS[BEST], linewidth=1.2, linestyle=(0, (1, 1.4)), label="the best, no warp"
        )
        handles.append(line)
        errors += values
    first, last = float(rows[0].plan.splits[0]), float(rows[0].plan.splits[-1])
    style.log_axis(upper, (first, last))
    errors = [v for v in errors if v > 0] or [1.0]
    style.log_axis(lower, (min(errors) / 1.15, max(errors) * 1.15))
    for axes in (upper, lower):
        axes.grid(color="#e4e4e4", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlim(min(x), max(x) if max(x) > min(x) else min(x) + 1)
    if steps[0].hour is None:
        for axes in (upper, lower):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    upper.tick_params(labelbottom=False)
    style.beside(upper, "view depth of splits", (0, 0.5), (-42, 0), rotation=90)
    style.beside(lower, "largest error", (0, 0.5), (-42, 0), rotation=90)
    hours = steps[0].hour is not None
    style.beside(lower, "solar time (hours)" if hours else "step of the light's path", (0.5, 0), (0, -24))
    style.legend_at(figure, 4.9, 0.3, handles, "splits")
    return figure


def _whole_numbers(axes: Axes, most: int) -> None:
    axes.set_xlim(0.75, most + 0.25)
    axes.set_xticks(range(1, most + 1))
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    style.beside(axes, "number of maps", (0.5, 0), (0, -24))

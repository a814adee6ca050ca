"""The pictures of docs/objectives.md: one view of the landscape under the warps that minimise different objectives.

Every map shows the same pixels and light; only what was minimised differs. Errors are pixels per texel.
"""

import argparse
import dataclasses
import tomllib
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import matplotlib
import numpy as np
from matplotlib.colors import LogNorm

import warpopt
from warpopt.app.common import figure_style as style
from warpopt.app.common.error_maps import Mapping, Seen, errors, image_of
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.inputs.scene_settings import SceneSettings
from warpopt.app.inputs.scene_values import camera_of

CONFIG = Path(__file__).parents[1] / "configs" / "landscape.toml"
HOUR = 11.0
_MAP, _GAP, _LEFT = 1.78, 0.09, 0.62  # inches
_SKY = "#dfe5ea"
_COLOURS = ("#8c8c8c", "#0072b2", "#009e73", "#d55e00", "#cc79a7")
_LINES = ("-", "-", (0, (5, 1.2)), "-", (0, (1.2, 1.0)))


@dataclasses.dataclass(frozen=True)
class Choice:
    """One column: what was minimised, over which receivers, and its warp."""

    title: str
    eta: float
    maps: dict[str, np.ndarray]

    def worst(self, metric: str) -> float:
        return float(np.nanmax(self.maps[metric]))


class View:
    """The landscape at one hour, and what any objective makes of it."""

    def __init__(self, short: bool):
        tables = tomllib.loads(CONFIG.read_text(encoding="utf-8"))
        config = SceneSettings.model_validate({name: table for name, table in tables.items() if name != "output"})
        scene = read_scene(config, CONFIG.parent)
        (step,) = [step for step in scene.steps if step.hour == HOUR]
        depth = scene.depths[0][::8, ::8] if short else scene.depths[0]
        self.camera = camera_of(scene.cameras[0])
        self.light = warpopt.DirectionalLight(scene.lights[step.light])
        self.resolutions = {"screen": config.objective.screen, "shadow_map": config.objective.shadow_map}
        self.receivers = warpopt.receivers.DepthBuffer(depth, scene.encoding)
        eye_depth = np.asarray(self.receivers.eye_depth(self.camera))
        self.seen: Seen = image_of(scene.cameras[0], eye_depth)

    def choice(self, title: str, *objective, receivers=None, warped: bool = True) -> Choice:
        receivers = self.receivers if receivers is None else receivers
        view = warpopt.SceneView(self.camera, self.light, receivers, **self.resolutions)
        found = warpopt.optimal_warp(view, warpopt.Objective(*objective))
        mapping = Mapping.of(found, *map(found.footprint.lateral_fit, (found.warp.eta, np.ones(()))))
        maps = {one: errors(mapping, self.seen, one, warped) for one in ("p", "q")}
        return Choice(title, float(found.warp.eta) if warped else 1.0, maps)


def metric_choices(view: View) -> list[Choice]:
    return [
        view.choice("no warp", warped=False),
        view.choice("least $E_p$", "p"),
        view.choice(r"least max($E_p, E_q$)", "max"),
        view.choice(r"least $E_{p\times q}$", "pxq"),
        view.choice("least $E_q$", "q"),
    ]


def norm_choices(view: View) -> list[Choice]:
    orders = ((r"least $L_\infty$", "inf"), ("least $L_8$", 8), ("least $L_2$", "l2"), ("least $L_1$", "l1"))
    return [view.choice("no warp", warped=False), *(view.choice(name, "p", order) for name, order in orders)]


def measure_choices(view: View) -> list[Choice]:
    measures = ("volume", "screen", "log_depth", "ground")
    everything = warpopt.receivers.WholeFrustum()
    columns = [view.choice(name.replace("_", " "), "p", "l2", name, receivers=everything) for name in measures]
    return [*columns, view.choice("what is seen", "p", "l2")]


@style.shared_style()
def picture(choices: list[Choice], metrics: tuple[str, ...], curves: bool):
    """A column for each choice and a row of maps for each metric; below, how many pixels are worse than any error."""
    rows, columns = choices[0].maps["p"].shape
    height = _MAP * rows / columns
    low = min(np.nanquantile(c.maps[m], 0.01) for c in choices for m in metrics)
    worst = sorted(c.worst(m) for c in choices for m in metrics)
    high = worst[-1] if worst[-1] < 2 * worst[-2] else worst[-2]  # one choice far off must not take all the colours
    scale = LogNorm(max(low, high / 100), high)
    row, top = height + 0.3, 0.52
    below = top + len(metrics) * row + 0.05
    plot = 1.75 if curves else 0.0
    wide = _LEFT + len(choices) * (_MAP + _GAP)
    figure = style.new_figure(wide + 0.75, below + (plot + 0.55 if curves else 0.0))
    colours = matplotlib.colormaps["magma"]
    for i, choice in enumerate(choices):
        for j, metric in enumerate(metrics):
            left, above = _LEFT + i * (_MAP + _GAP), top + j * row
            axes = style.place(figure, left, above, _MAP, height)
            axes.set(xticks=[], yticks=[], facecolor=_SKY)
            axes.spines[:].set_visible(False)
            image = axes.imshow(choice.maps[metric], norm=scale, cmap=colours, aspect="auto", interpolation="nearest")
            if np.nanmin(choice.maps[metric]) < 1 < choice.worst(metric):
                axes.contour(choice.maps[metric], levels=[1.0], colors=["#7fe7dc"], linewidths=0.7)
            words = f"{style.METRIC_LABELS[metric]} at worst {choice.worst(metric):.3g}"
            style.beside(axes, words, (0, 0), (0, -3), ha="left", va="top", color=style.MUTED, fontsize=8)
            if i == 0:
                style.beside(axes, style.METRIC_LABELS[metric], (0, 0.5), (-16, 0), fontsize=11)
            if j == 0:
                ink = _COLOURS[i] if curves else style.INK
                bold = {"ha": "left", "va": "bottom", "fontsize": 10, "fontweight": "bold", "color": ink}
                style.beside(axes, choice.title, (0, 1), (0, 15), **bold)
                words = f"η = {choice.eta:.3g}"
                style.beside(axes, words, (0, 1), (0, 3), ha="left", va="bottom", color=style.MUTED, fontsize=8)
    bar = style.place(figure, wide + 0.04, top, 0.13, len(metrics) * row - 0.3)
    figure.colorbar(image, cax=bar)
    _ticks(bar.yaxis, scale.vmin, scale.vmax)
    bar.yaxis.tick_right()
    bar.tick_params(labelleft=False, labelright=True)
    style.beside(bar, "pixels per texel", (1, 0.5), (33, 0), rotation=90)
    if curves:
        _curves(style.place(figure, _LEFT, below + 0.02, wide - _LEFT - _GAP, plot), choices, metrics[0])
    return figure


def _curves(axes, choices: list[Choice], metric: str) -> None:
    every = np.concatenate([c.maps[metric][np.isfinite(c.maps[metric])] for c in choices])
    low, high = np.quantile(every, 0.01), every.max()
    for choice, colour, line in zip(choices, _COLOURS, _LINES, strict=False):
        values = np.sort(choice.maps[metric][np.isfinite(choice.maps[metric])])
        share = 100 * (1 - np.arange(len(values)) / len(values))
        axes.plot(values, share, color=colour, linewidth=1.6, linestyle=line, label=choice.title)
        axes.plot(values[-1], 0, "o", color=colour, markersize=4, clip_on=False)
    axes.set_xscale("log")
    axes.set_xlim(low, high * 1.03)
    _ticks(axes.xaxis, low, high)
    axes.set_ylim(0, 100)
    axes.set_yticks([0, 50, 100], ["0", "50 %", "100 %"])
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper right", handlelength=2.6)
    style.beside(axes, "pixels that are worse", (0, 0.5), (-34, 0), rotation=90)
    style.beside(axes, f"{style.METRIC_LABELS[metric]}, pixels per texel", (0.5, 0), (0, -24))


def _ticks(axis, low: float, high: float) -> None:
    ticks = [t for t in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200) if low <= t <= high]
    axis.set_ticks(ticks, [f"{t:g}" for t in ticks])
    axis.set_ticks([], minor=True)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/objectives"))
    parser.add_argument("--short", action="store_true", help="an eighth of the image's rows and columns")
    arguments = parser.parse_args(words)
    view = View(arguments.short)
    arguments.directory.mkdir(parents=True, exist_ok=True)
    pictures = {
        "metric": (metric_choices(view), ("p", "q"), False),
        "norm": (norm_choices(view), ("p",), True),
        "measure": (measure_choices(view), ("p",), True),
    }
    for name, (choices, metrics, curves) in pictures.items():
        picture(choices, metrics, curves).savefig(arguments.directory / f"objective_{name}.png", dpi=140)
        for choice in choices:
            maps = choice.maps.items()
            numbers = [f"E_{m}: worst {np.nanmax(e):.3g}, rms {np.nanmean(e**2) ** 0.5:.3g}" for m, e in maps]
            print(f"{name}, {choice.title}: eta {choice.eta:.4g}; {'; '.join(numbers)}")


if __name__ == "__main__":
    main()

"""The pictures of `warpopt frames`: each frame under each warp, and the error over eta."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from warpopt.frames import Frame, LitScene, ShadowMap
from warpopt.frames.cascade_fits import Cascaded
from warpopt.frames.cascaded_map import CascadedMap
from warpopt.frames.fits import Fitted
from warpopt.frames.names import title_of
from warpopt.frames.pictures import map_picture, painted, worst_places, wrong_pixels
from warpopt.rules.registry import EVERY

from ..common import figure_style as style
from ..common.flicker_figure import COLOURS

_PIXELS = 100  # per inch: pictures are saved at 100 dpi, one pixel for one
_MOST = 960  # pixels of a frame's width; wider ones are reduced
_GAP = 0.12


def frame_pictures(
    crops: int, scene: LitScene, frame: Frame, fitted: list[Fitted | Cascaded], maps: list[ShadowMap | CascadedMap],
    rows: list[dict[str, Any]], shown: list[np.ndarray],
) -> Iterator[tuple[Fitted | Cascaded, Figure]]:  # fmt: skip
    """A picture for each warp: the frame, the places where all warps together are worst, and the map or maps."""
    height = len(frame.judged)
    wrong = np.sum([wrong_pixels(frame, each) for each in shown], 0)
    window = max(height // 6, 8), max(height // 6, 8)
    places = worst_places(wrong, window, crops) if frame.defined else []
    for made, shadow_map, row, each in zip(fitted, maps, rows, shown, strict=True):
        if isinstance(shadow_map, CascadedMap):
            texels = beside_each_other(shadow_map)
        else:
            texels = map_picture(shadow_map, 1024)
        yield made, frame_picture(painted(scene, frame, each), texels, places, window, made, row)


def beside_each_other(cascades: CascadedMap) -> np.ndarray:
    """The pictures of cascades in rows, the nearest first, each stretched to a square; NaN where there is none."""
    count = len(cascades.maps)
    across = int(np.ceil(np.sqrt(count)))
    side = 1024 // across
    picture = np.full((-(-count // across) * side, across * side), np.nan)
    for k, each in enumerate(cascades.maps):
        if each is not None:
            made, inner = map_picture(each, side), side - 8  # a gap between them
            rows, columns = (np.arange(inner) * n // inner for n in made.shape)
            row, column = divmod(k, across)
            picture[row * side :, column * side :][:inner, :inner] = made[np.ix_(rows, columns)]
    return picture


@style.shared_style()
def frame_picture(
    image: np.ndarray, texels: np.ndarray, places: list[tuple[int, int]], window: tuple[int, int],
    made: Fitted | Cascaded, row: dict[str, Any],
) -> Figure:  # fmt: skip
    """The frame to the left; to its right the map, and the worst places below it."""
    rows, columns = image.shape[:2]
    wide = min(columns, _MOST) / _PIXELS
    wide = max(wide, 4.0)
    high = wide * rows / columns
    panels = 1 + len(places)
    small = (high - (panels - 1) * _GAP) / panels if panels > 1 else min(high, 2.4)
    figure = style.new_figure(wide + small + 3 * _GAP, high + 0.62)
    main = style.place(figure, _GAP, 0.5, wide, high)
    _show(main, image, "nearest" if wide * _PIXELS % columns == 0 else "antialiased")
    eta = f", η = {made.eta:.3g}" if isinstance(made, Fitted) else ""
    style.beside(main, title_of(made.name) + eta, (0, 1), (0, 17), ha="left", va="bottom",
                 fontsize=10, fontweight="bold")  # fmt: skip
    style.beside(main, _words(row), (0, 1), (0, 4), ha="left", va="bottom", color=style.MUTED)
    side = style.place(figure, wide + 2 * _GAP, 0.5, small, small)
    _show(side, np.where(np.isnan(texels), 1.0, 0.15 + 0.7 * texels), "antialiased", cmap="gray", vmin=0, vmax=1)
    style.beside(
        side,
        "shadow map" if isinstance(made, Fitted) else "shadow maps",
        (0, 1),
        (0, 4),
        ha="left",
        va="bottom",
        color=style.MUTED,
    )
    for k, (top, left) in enumerate(places):
        axes = style.place(figure, wide + 2 * _GAP, 0.5 + (k + 1) * (small + _GAP), small, small)
        crop = image[top : top + window[0], left : left + window[1]]
        _show(axes, crop, "nearest")
        main.add_patch(_frame_of(left, top, crop.shape))
    return figure


def _words(row: dict[str, Any]) -> str:
    if row.get("wrong") is None:
        return f"error undefined: {row['excluded']}"
    return (
        f"{100 * row['wrong']:.2f} % wrong: {100 * row['false']:.2f} % false shadow (red), "
        f"{100 * row['missing']:.2f} % missing (blue)"
    )


def _frame_of(left: int, top: int, shape: tuple[int, ...]):
    from matplotlib.patches import Rectangle

    return Rectangle((left - 0.5, top - 0.5), shape[1], shape[0], fill=False, edgecolor="white", linewidth=1.2)


def _show(axes: Axes, image: np.ndarray, interpolation: str, **options) -> None:
    axes.imshow(image, aspect="auto", interpolation=interpolation, **options)
    axes.set_xticks([])
    axes.set_yticks([])


@style.shared_style()
def scan_figure(scan: dict[str, Any], rows: list[dict[str, Any]]) -> Figure:
    """Wrong pixels over eta; each warp at its eta and error."""
    eta, wrong = np.array(scan["eta"]), 100 * np.array(scan["wrong"], float)
    figure = style.new_figure(7.2, 3.3)
    axes = style.place(figure, 0.75, 0.2, 3.9, 2.55)
    axes.plot(eta, wrong, color=style.INK, linewidth=1.4, zorder=2)
    handles = []
    for k, row in enumerate(row for row in rows if row.get("wrong") is not None and "splits" not in row):
        name = row["warp"]
        colour = COLOURS.get(name) or (EVERY[name].colour if name in EVERY else "#cc79a7")
        value = 100 * row["wrong"]
        (line,) = axes.plot(row["eta"], value, "osD^vPX*<>"[k % 10], color=colour, markerfacecolor="none",
                            markeredgewidth=1.5, markersize=7, linestyle="", zorder=3,
                            label=f"{title_of(name)}: {value:.3g} %")  # fmt: skip
        handles.append(line)
    axes.set_xscale("log")
    every = np.concatenate([wrong[np.isfinite(wrong) & (wrong > 0)], *[h.get_ydata() for h in handles]])
    every = every[every > 0] if (every > 0).any() else np.ones(1)
    style.log_axis(axes, (every.min() / 1.15, every.max() * 1.15))
    axes.set_xlim(eta.min() / 1.1, 1.15)
    axes.set_xticks([], minor=True)
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    style.beside(axes, "η (1: no warp)", (0.5, 0), (0, -26))
    style.beside(axes, "wrong pixels (%)", (0, 0.5), (-44, 0), rotation=90)
    style.legend_at(figure, 4.85, 0.25, handles, "each warp, its wrong pixels")
    return figure

"""What the camera sees, and the error at each of its pixels: the parts of pictures of the screen."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from . import figure_style as style

_SKY = "#dfe5ea"
NAMES = {
    **style.METRIC_LABELS,
    "max": r"$\max(E_p, E_q)$",
    "storage": "area of a texel",
    "edge": "longer edge of a texel",
    "band": "expected offset of an edge",
}


def size_of(shape: tuple[int, int]) -> tuple[float, float]:
    """(width, height) of a panel in inches."""
    rows, columns = shape
    width = min(3.4, 3.4 * columns / rows)
    return width, width * rows / columns


def scale_of(*errors: np.ndarray) -> LogNorm:
    """One colour scale for several error maps: all but the least half per cent, over five decades at most."""
    every = np.concatenate([error[np.isfinite(error)] for error in errors])
    low, high = np.quantile(every, 0.005), every.max() or 1.0  # E_q of receivers without width is 0
    return LogNorm(max(min(low, high / 1.5), high * 1e-5), high)


def number(value: float) -> str:
    return f"{value:,.0f}" if 1000 <= value < 1e7 else f"{value:.3g}"


def panel(axes: Axes) -> None:
    """No ticks and no frame; the sky's colour behind."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor(_SKY)
    for spine in axes.spines.values():
        spine.set_visible(False)


def title(axes: Axes, title: str, words: str) -> None:
    """A title and a line of words above a panel."""
    style.beside(axes, title, (0, 1), (0, 17), ha="left", va="bottom", fontsize=9.5, fontweight="bold")
    style.beside(axes, words, (0, 1), (0, 4), ha="left", va="bottom", color=style.MUTED)


def error_panel(axes: Axes, error: np.ndarray, scale: LogNorm, pixels: bool) -> AxesImage:
    """An error map, its worst place in a ring; with `pixels` a line where a texel has the size of a pixel."""
    panel(axes)
    colours = colormaps["magma"]
    image = axes.imshow(error, norm=scale, cmap=colours, aspect="auto", interpolation="nearest")
    if pixels and np.nanmin(error) < 1 < np.nanmax(error):
        axes.contour(error, levels=[1.0], colors=["#7fe7dc"], linewidths=0.7)
    row, column = np.unravel_index(np.nanargmax(error), error.shape)
    for size, colour in ((2.2, "white"), (0.9, style.INK)):
        axes.plot(column, row, "o", mfc="none", mec=colour, mew=size, ms=7, clip_on=False)
    axes.set_xlim(-0.5, error.shape[1] - 0.5)
    axes.set_ylim(error.shape[0] - 0.5, -0.5)
    return image


def bar_beside(figure: Figure, image: AxesImage, place: tuple[float, float, float], metric: str, pixels: bool) -> None:
    """The colours' scale at (left, top, height), in inches, with the metric and its unit."""
    left, top, height = place
    bar = style.place(figure, left, top, 0.13, height)
    figure.colorbar(image, cax=bar)
    style.log_axis(bar, image.get_clim())
    bar.yaxis.tick_right()
    bar.tick_params(labelleft=False, labelright=True)
    unit = (", pixels per texel, squared" if metric == "pxq" else ", pixels per texel") if pixels else ""
    style.beside(bar, f"{NAMES[metric]}{unit}", (1, 0.5), (38, 0), rotation=90)


def tinted(shade: np.ndarray, colours: np.ndarray | None = None) -> np.ndarray:
    """Warm grey in the light, blue-grey in shade, and sky; with `colours`, (..., 3), those instead of the greys."""
    light = np.nan_to_num(shade)[..., None]
    dark, bright = np.array([0.16, 0.19, 0.25]), np.array([0.98, 0.95, 0.88])
    colour = dark + light * (bright - dark) if colours is None else (0.45 + 0.65 * light) * colours
    sky = np.array(to_rgb(_SKY))
    return np.clip(np.where(np.isfinite(shade)[..., None], colour, sky), 0, 1)

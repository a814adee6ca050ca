"""The frustum from the side, coloured by its aliasing error, and from the light, as deformed by TSM."""

import dataclasses
import fractions
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import ConnectionPatch, Polygon

import warpopt
from warpopt._checks import trusted
from warpopt.theory import aliasing_error, texture_coordinates

from ..common import figure_style as style
from ..frusta.problem import View
from . import curve_style as looks

METRICS = ("p", "q", "pxq")
TECHNIQUES = ("no warp", "LiSPSM", "TSM", "optimum")
THETAS_DEG = (90.0, 60.0, 30.0)
_SAMPLES = 112
# Red is highest, as in AT09; blue, orange and red with dark ends suit colour-blind readers.
_COLOURS = LinearSegmentedColormap.from_list(
    "errors", ("#1d2671", "#2f6db5", "#6fc0d6", "#f4eeb1", "#f8b34c", "#e2551d", "#8c0d1b"), N=1024
)
_LIGHT = "#b07900"
_PANEL = 1.2  # inches
_MAGNIFIED = 0.3  # size of the magnified near part, relative to the frustum
_LEAST_MAGNIFICATION = 1.5
_DEEP = View(1.0, 1000.0, 30.0)  # deep enough that VN's 1/4 and 4/7 hold to 0.001
_FOCUS, _FOCUS_FILL, _FOCUS_INK, _DISTANT = "#d55e00", "#fbe3d0", "#8f3d00", "#dfe6ec"


@dataclasses.dataclass(frozen=True)
class Distributions:
    """Errors over the side view of a frustum.

    Attributes:
        errors: shape (metrics, techniques, directions, 2, y, z); index 3 is 0 for the whole frustum, 1 for its near
            part. A point outside the frustum has the error of the nearest side plane at the same z.
        extents: (z0, z1, y0, y1) of the two.
    """

    errors: np.ndarray
    extents: tuple[tuple[float, float, float, float], ...]


def distributions(view: View, thetas_deg: tuple[float, ...] = THETAS_DEG, samples: int = _SAMPLES) -> Distributions:
    """E_p, E_q and E_pxq of no warp, LiSPSM, TSM and each metric's L-inf optimum, by one compiled call."""
    near, far, slope = view.near, view.far, math.tan(math.radians(view.half_fov_deg))
    ends = (far, near + min(4 * near, (far - near) / 2))
    z = np.stack([np.linspace(near, end, samples) for end in ends])[:, None, :]
    height = np.stack([np.linspace(-end, end, samples) for end in ends])[:, :, None]
    y = np.clip(height, -z, z) * slope
    extents = tuple((near, end, -end * slope, end * slope) for end in ends)
    frustum, theta = _single(view), np.deg2rad(np.array(thetas_deg))
    # Frustum and angles are constants of the compiled call: tracing them makes XLA three times slower.
    errors = jax.jit(lambda y, z: _errors(frustum, theta, y, z))(y, z)
    return Distributions(np.asarray(errors), extents)


def _single(view: View) -> "warpopt.ViewFrustum":
    return warpopt.ViewFrustum(view.near, view.far, math.radians(view.half_fov_deg))


def _errors(frustum: "warpopt.ViewFrustum", theta: np.ndarray, y: jax.Array, z: jax.Array) -> jax.Array:
    every = []
    with trusted():  # settings were checked
        published = [rule(frustum, theta) for rule in (warpopt.rules.ssm, warpopt.rules.lispsm, warpopt.rules.tsm)]
        view = warpopt.FrustumView(frustum, theta)
        for metric in METRICS:
            best = warpopt.optimal_warp(view, warpopt.Objective(metric), throw=False).warp
            warps = jax.tree.map(lambda *fields: jnp.stack(fields)[..., None, None, None], *published, best)
            every.append(aliasing_error(frustum, theta[:, None, None, None], warps, y, z, metric))
    return jnp.stack(every)


@style.shared_style()
def error_distribution_figure(view: View, data: Distributions | None = None) -> Figure:
    """AT09's Figure 3 with a column for the optimum: side views of the errors at theta = 90, 60 and 30 degrees.

    z runs to the right and y upwards, at the same scale; the free corner shows the magnified near part. The
    number is the panel's maximum. The optimum is the L-inf optimum of the panel's metric.
    """
    data = distributions(view) if data is None else data
    logs = np.log(data.errors) / math.log(5)
    low, high = _decades(logs)
    norm = Normalize(low, high)
    colours = ScalarMappable(norm, _COLOURS)
    slope = math.tan(math.radians(view.half_fov_deg))
    width = _PANEL
    tall = width * min(max(2 * slope, 0.75), 1.6)
    left, top, gap, block_gap = 1.15, 0.62, 0.13, 0.22
    bottom = top + 9 * (tall + gap) + 2 * block_gap
    total = left + len(TECHNIQUES) * (width + gap) + 0.05
    figure = style.new_figure(total, bottom + 0.72)
    # One set of axes in inches, negative downwards: forty axes would take most of the time.
    canvas = style.place(figure, 0, 0, *figure.get_size_inches())
    canvas.set_axis_off()
    style.write_at(figure, 0.1, 0.3, looks.view_label(view).replace("  ", "\n"), color=style.MUTED, va="center")
    for row in range(9):
        direction, metric = divmod(row, len(METRICS))
        y = top + row * (tall + gap) + direction * block_gap
        for column, technique in enumerate(TECHNIQUES):
            x = left + column * (width + gap)
            panel = metric, column, direction
            long = min(width, tall / (2 * slope))
            _side_view(canvas, data, logs[panel], colours, (x + width - long, -y - tall / 2), long)
            weight = "bold" if technique == "optimum" else "normal"
            canvas.text(x, -y - tall, _maximum_text(data.errors[panel].max()), size=7, weight=weight, va="bottom")
            if row == 0:
                canvas.text(x + width / 2, -0.3, technique, size=9.5, weight="bold", ha="center", va="center")
        label = style.METRIC_LABELS[METRICS[metric]]
        canvas.text(left - 0.1, -y - tall / 2, label, size=11, ha="right", va="center")
        if metric == 0:
            _direction_glyph(canvas, 0.1, -y, THETAS_DEG[direction], named=row == 0)
    magnification = _MAGNIFIED * view.far / data.extents[1][1]
    if magnification >= _LEAST_MAGNIFICATION:
        text = f"z ≤ {data.extents[1][1]:.4g}, ×{magnification:.3g}"
        canvas.text(left, 0.02 - top, text, size=6, color=style.MUTED, va="bottom")
    canvas.set_xlim(0, total)
    canvas.set_ylim(-bottom - 0.72, 0)
    _colour_bar(figure, colours, (low, high), (left, bottom + 0.1, len(TECHNIQUES) * (width + gap) - gap))
    return figure


def _side_view(
    axes: Axes,
    data: Distributions,
    logs: np.ndarray,
    colours: ScalarMappable,
    middle: tuple[float, float],
    width: float,
) -> None:
    """The frustum with its apex at `middle` and `width` inches long; its near part in the upper left corner."""
    _, far, _, high = data.extents[0]
    x, y = middle
    scale = width / far
    _area(axes, data.extents[0], logs[0], colours, scale, (x, y))
    magnified = _MAGNIFIED * width / data.extents[1][1]
    if magnified >= _LEAST_MAGNIFICATION * scale:
        _area(axes, data.extents[1], logs[1], colours, magnified, (x, y + (1 - _MAGNIFIED) * high * scale))


def _area(
    axes: Axes,
    extent: tuple[float, float, float, float],
    logs: np.ndarray,
    colours: ScalarMappable,
    scale: float,
    apex: tuple[float, float],
) -> None:
    z0, z1, y0, y1 = scale * np.array(extent)
    x, y = apex
    corners = [(x + z0, y + y1 * z0 / z1), (x + z1, y + y1), (x + z1, y + y0), (x + z0, y + y0 * z0 / z1)]
    shape = Polygon(corners, closed=True, facecolor="none", edgecolor=style.INK, linewidth=0.6, zorder=4)
    axes.add_patch(shape)
    box = (x + z0, x + z1, y + y0, y + y1)
    image = AxesImage(axes, extent=box, origin="lower", interpolation="bilinear", zorder=2)
    image.set_data(colours.cmap(colours.norm(logs), bytes=True))
    axes.add_image(image)
    image.set_clip_path(shape)
    finite = logs[np.isfinite(logs)]
    levels = [level for level in range(*_decades(logs)) if finite.size and finite.min() < level < finite.max()]
    if levels:
        across, up = np.linspace(*box[:2], logs.shape[1]), np.linspace(*box[2:], logs.shape[0])
        lines = axes.contour(
            across, up, logs, levels=levels, colors="#303030", linewidths=0.35, linestyles="-", zorder=3
        )
        lines.set_clip_path(shape)


def _decades(logs: np.ndarray) -> tuple[int, int]:
    """Integers that enclose all finite values, at least one apart."""
    finite = logs[np.isfinite(logs)]
    low, high = (math.floor(finite.min()), math.ceil(finite.max())) if finite.size else (0, 1)
    return low, max(high, low + 1)


def _maximum_text(largest: float) -> str:
    if largest >= 1e6:
        exponent = math.floor(math.log10(largest))
        return f"max {largest / 10.0**exponent:.2f}·10{style.superscript(exponent)}"
    return f"max {largest:,.0f}" if largest >= 100 else f"max {largest:.3g}"


def _colour_bar(
    figure: Figure, colours: ScalarMappable, exponents: tuple[int, int], place: tuple[float, float, float]
) -> None:
    (low, high), (left, top, width) = exponents, place
    bar = style.place(figure, left, top, width, 0.13)
    figure.colorbar(colours, cax=bar, orientation="horizontal")
    ticks = np.arange(low, high + 1, 1 + (high - low) // 16)
    bar.set_xticks(ticks, ["5" + style.superscript(int(tick)) for tick in ticks], fontsize=8)
    bar.vlines(ticks, 0, 1, color="#303030", linewidth=0.5)
    style.beside(bar, "aliasing error, on a logarithmic scale of base 5", (0.5, 0), (0, -25))


def _direction_glyph(axes: Axes, x: float, y: float, theta_deg: float, named: bool) -> None:
    """theta as text, above an arrow along the view direction and one along the light's rays."""
    axes.text(x, y - 0.06, f"θ = {theta_deg:g}°", size=9.5, weight="bold", va="center")
    size, floor = 0.42, y - 0.72
    light = x + size * math.cos(math.radians(theta_deg)), floor + size * math.sin(math.radians(theta_deg))
    arrow = {"arrowstyle": "-|>,head_width=0.16,head_length=0.32", "shrinkA": 0, "shrinkB": 0, "linewidth": 1.0}
    axes.annotate("", (x + size, floor), (x, floor), arrowprops={**arrow, "color": style.MUTED})
    axes.annotate("", (x, floor), light, arrowprops={**arrow, "color": _LIGHT})
    if named:
        axes.text(x + size / 2, floor - 0.05, "view, z", size=6.5, color=style.MUTED, ha="center", va="top")
        axes.text(light[0] + 0.06, light[1], "light", size=6.5, color=_LIGHT, va="top")


@dataclasses.dataclass(frozen=True)
class FocusRegion:
    """The frustum and TSM's focus region in shadow-map coordinates (t, s): index 0 without a warp, 1 with TSM's.

    Attributes:
        lam_over_mu: TSM's at theta = 0.
        grid: shape (2, lines, 2 ends, 2), straight lines over the frustum; a projective map keeps them straight.
        focus: shape (2, 4, 2), the corners of the focus region.
    """

    lam_over_mu: float
    grid: np.ndarray
    focus: np.ndarray

    @property
    def distant_share(self) -> float:
        """Share of the map's height in front of the focus region."""
        return float(self.focus[1, 0, 1])

    @property
    def focus_areas(self) -> tuple[float, float]:
        """Shares of the map's area that the focus region covers, without and with the warp."""
        return polygon_area(self.focus[0]), polygon_area(self.focus[1])


def focus_region(kappa: float = 0.5, xi: float = 0.8, view: View = _DEEP) -> FocusRegion:
    """TSM's focus region, eye depths up to n + (f - n) kappa, for a light at theta = 0, where d = -y."""
    far = view.far * math.tan(math.radians(view.half_fov_deg))
    depth = (view.near + (view.far - view.near) * kappa) / view.far
    steps, ends = np.linspace(-1, 1, 13), np.array([-1.0, 1.0])
    along_y = np.stack(np.broadcast_arrays(steps[:, None], ends), axis=-1)
    focus = depth * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    points = far * np.concatenate([along_y.reshape(-1, 2), along_y[..., ::-1].reshape(-1, 2), focus])
    lam_over_mu, coordinates = jax.jit(functools.partial(_mapped, _single(view), kappa, xi))(*points.T)
    coordinates = np.asarray(coordinates)
    return FocusRegion(float(lam_over_mu), coordinates[:, :-4].reshape(2, -1, 2, 2), coordinates[:, -4:])


def _mapped(
    frustum: "warpopt.ViewFrustum", kappa: float, xi: float, x: jax.Array, y: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """TSM's lambda / mu at theta = 0, and (t, s) of points of the far plane without and with its warp."""
    with trusted():  # settings were checked
        tsm = warpopt.rules.tsm(frustum, 0.0, kappa, xi)
        warps = (warpopt.rules.ssm(frustum, 0.0), tsm)
        maps = [jnp.stack(texture_coordinates(frustum, 0.0, warp, x, y, frustum.far), -1) for warp in warps]
    return tsm.lam_over_mu, jnp.stack(maps)


@style.shared_style()
def focus_region_figure(kappa: float = 0.5, xi: float = 0.8, data: FocusRegion | None = None) -> Figure:
    """VN's Figure 3: how TSM at theta = 0 deforms the focus region.

    Left: the frustum seen from the light; right: the warped map with the same grid; the tinted band is the distant
    region that comes first in the map. `data`, if given, is drawn instead of `focus_region(kappa, xi)`.
    """
    region = focus_region(kappa, xi) if data is None else data
    side, left, gap = 3.0, 0.75, 0.95
    figure = style.new_figure(left + 2 * side + gap + 0.75, side + 0.95)
    panels = [style.place(figure, left + i * (side + gap), 0.42, side, side) for i in (0, 1)]
    strength = f"λ/μ = {region.lam_over_mu:.3g}" if math.isfinite(region.lam_over_mu) else "no warp, λ = ∞"
    titles = ("Light space (no warp)", f"Map warped by TSM ({strength})")
    for index, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        _map_panel(axes, region, index)
        style.beside(axes, title, (0.5, 1), (0, 6), va="bottom", fontsize=9.5, fontweight="bold")
        style.beside(axes, "t", (0.5, 0), (0, -22))
    panels[1].yaxis.tick_right()
    style.beside(panels[0], "light-space depth δ", (0, 0.5), (-38, 0), rotation=90)
    style.beside(panels[1], "shadow-map coordinate s", (1, 0.5), (38, 0), rotation=90)
    for corner in (1, 2):
        ends = [(1.0, region.focus[0, corner, 1]), (0.0, region.focus[1, corner, 1])]
        line = {"color": _FOCUS, "linewidth": 0.9, "linestyle": (0, (3, 2))}
        figure.add_artist(ConnectionPatch(ends[0], ends[1], "data", "data", axesA=panels[0], axesB=panels[1], **line))
    return figure


def _map_panel(axes: Axes, region: FocusRegion, index: int) -> None:
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    start, stop = region.focus[index, 0, 1], region.focus[index, 2, 1]
    axes.set_xticks([0, 0.5, 1], ["0", "1/2", "1"])
    ticks = [0, start, stop, 1] if stop < 0.96 else [0, start, 1]
    axes.set_yticks(ticks, [fraction_text(tick) for tick in ticks])
    axes.axhspan(0, start, color=_DISTANT, linewidth=0, zorder=0)
    for line in region.grid[index]:
        axes.plot(*line.T, color="#9aa3ab", linewidth=0.5, zorder=1)
    half = len(region.grid[index]) // 2
    hull = np.array([*region.grid[index, 0], *region.grid[index, half - 1, ::-1]])
    axes.add_patch(Polygon(hull, closed=True, facecolor="none", edgecolor=style.INK, linewidth=1.2, zorder=2))
    look = {"facecolor": _FOCUS_FILL, "edgecolor": _FOCUS, "linewidth": 1.6, "alpha": 0.9}
    axes.add_patch(Polygon(region.focus[index], closed=True, zorder=3, **look))
    x, y = middle = region.focus[index].mean(axis=0)
    box = {"edgecolor": "none", "pad": 2.0, "alpha": 0.9}
    words = {"ha": "center", "va": "center", "fontsize": 7.5, "zorder": 5}
    area = f"focus region:\n{100 * region.focus_areas[index]:.0f} % of the map"
    if index == 0:
        axes.text(x, y, area, color=_FOCUS_INK, **words)
    else:
        leader = {"arrowstyle": "-", "color": _FOCUS, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
        axes.annotate(
            area, middle, (0.84, 0.88), color=_FOCUS_INK, bbox={**box, "facecolor": "white"}, arrowprops=leader, **words
        )
        empty = 1 - polygon_area(hull)
        if empty > 0.2:
            axes.text(0.16, 0.88, f"not used:\n{100 * empty:.0f} % of the map", color=style.MUTED, **words)
    text = f"distant region: the first {fraction_text(start)}"
    axes.text(0.5, start / 2, text, bbox={**box, "facecolor": _DISTANT}, **{**words, "fontsize": 8.5})


def polygon_area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def fraction_text(value: float) -> str:
    """A simple fraction within 0.003 of the value, else two decimals."""
    near = fractions.Fraction(float(value)).limit_denominator(7)
    return str(near) if abs(near - value) < 0.003 else f"{value:.2f}"

"""The light plane: receivers as the light sees them, and the texels of maps warped along several directions."""

import dataclasses

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

import warpopt

from . import figure_style as style

_CELLS = 12  # of the drawn grid along each side of a map
_SIDE = 2.9  # inches of a panel's longer side
_MOST = 20_000  # receivers that are drawn


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """A map on the light plane.

    Attributes:
        title, words: above it.
        solution: its direction, warp and fit.
    """

    title: str
    words: str
    solution: "warpopt.SceneSolution"


def grid_of(solution: "warpopt.SceneSolution", t: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(..., 2): places on the light plane, along X_w and Z_w, of texture coordinates."""
    footprint, eta = solution.footprint, solution.warp.eta
    fit = footprint.lateral_fit(eta)
    eta, m0, m1, left, right = (float(v) for v in (eta, fit.m0, fit.m1, fit.left, fit.right))
    delta = s * eta / (1 - s * (1 - eta))
    blend = (1 - delta) * eta + delta
    x = float(footprint.axis) + m0 + m1 * delta + (t * (left + right) - left) * blend
    return np.stack([x, float(footprint.start) + float(footprint.mu) * delta], -1)


@style.shared_style()
def light_plane_figure(eye_points: np.ndarray, maps: list[Drawn]) -> Figure:
    """One panel a map, all in the axes of the first: receivers by depth, the map's texels, and the warp's axis.

    Args:
        eye_points: (N, 3) receivers in eye coordinates.
        maps: of one light; the first one's X_w is to the right and its Z_w up.
    """
    first = maps[0].solution.frame
    basis = np.stack([np.asarray(first.x_axis), np.asarray(first.z_axis)], 1)
    kept = eye_points[:: max(1, len(eye_points) // _MOST)]
    order = np.argsort(-kept[:, 2])
    at, depth = (kept @ basis)[order], kept[order, 2]
    line = np.linspace(0, 1, 60)
    lines, outlines, axes_of = [], [], []
    for drawn in maps:
        own = np.stack([np.asarray(drawn.solution.frame.x_axis), np.asarray(drawn.solution.frame.z_axis)])
        turn = own @ basis
        every = [
            grid_of(drawn.solution, *pair) @ turn
            for k in np.linspace(0, 1, _CELLS + 1)
            for pair in ((np.full_like(line, k), line), (line, np.full_like(line, k)))
        ]
        lines.append(every)
        outlines.append(np.concatenate([every[i] for i in (0, 1, -2, -1)]))
        axes_of.append(grid_of(drawn.solution, np.full(2, 0.5), np.array([0.0, 1.0])) @ turn)
    # Every receiver is shown; of a turned map that reaches far beyond them, a part.
    low, high = at.min(0), at.max(0)
    size = max(np.ptp(at, 0).max(), 1e-12)
    reach = np.concatenate(outlines)
    low, high = np.maximum(low - 0.4 * size, reach.min(0)), np.minimum(high + 0.4 * size, reach.max(0))
    room = 0.03 * (high - low).max()
    low, high = low - room, high + room
    wide, tall = (_SIDE * (high - low) / (high - low).max()).tolist()
    gap, top = 0.25, 0.62
    wide, tall = max(wide, 0.5 * _SIDE), max(tall, 0.25 * _SIDE)
    figure = style.new_figure(len(maps) * (wide + gap) + 1.0, tall + top + 0.2)
    norm = LogNorm(float(depth.min()), max(float(depth.max()), 1.0001 * float(depth.min())))
    dots = None
    for k, drawn in enumerate(maps):
        axes = style.place(figure, 0.15 + k * (wide + gap), top, wide, tall)
        dots = axes.scatter(
            *at.T, c=depth, norm=norm, cmap=colormaps["viridis_r"], s=2.2, linewidths=0, rasterized=True
        )
        for i, each in enumerate(lines[k]):
            edge = i in (0, 1, 2 * _CELLS, 2 * _CELLS + 1)
            axes.plot(*each.T, color="#b1301c" if edge else "#c9583f", linewidth=1.2 if edge else 0.45)
        axes.annotate("", axes_of[k][1], axes_of[k][0], arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.3})
        axes.set_aspect("equal")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_xticks([])
        axes.set_yticks([])
        style.beside(axes, drawn.title, (0, 1), (0, 17), ha="left", va="bottom", fontsize=9.5, fontweight="bold")
        style.beside(axes, drawn.words, (0, 1), (0, 4), ha="left", va="bottom", color=style.MUTED)
    bar = style.place(figure, 0.15 + len(maps) * (wide + gap), top, 0.12, tall)
    if dots is not None:
        figure.colorbar(dots, cax=bar)
    style.log_axis(bar, (float(norm.vmin or 1), float(norm.vmax or 2)))
    bar.yaxis.tick_right()
    bar.tick_params(labelleft=False, labelright=True)
    style.beside(bar, "eye depth", (1, 0.5), (36, 0), rotation=90)
    return figure

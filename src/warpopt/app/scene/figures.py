"""The pictures of a scene: error maps over the image, and curves along the light's path."""

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import warpopt
from warpopt.theory.camera import camera_of

from ..common import figure_style as style
from ..common import screen_panels as screen
from ..common.error_maps import Seen, errors, image_of, section_of, shading
from ..common.words import phrase
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import body_of, buffer_of
from .settings import SceneConfig
from .solve import Solved

MOST_MAPS = 12
_DPI = 160
_SECTION = (270, 480)  # rows and columns
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


def write_scene_figures(
    config: SceneConfig, scene: SceneInput, solved: list[Solved], folder: Path
) -> list[tuple[str, str]]:
    """Write the pictures; (file stem, caption) of each."""
    figures = []
    drawable = [s for s in solved if s.outcome.succeeded and s.outcome is not warpopt.Outcome.empty]
    if len(scene.lights) > 1 and drawable:
        path_figure(config, scene, solved).savefig(folder / "light_path.png", dpi=_DPI)
        caption = "The optimal warp along the light's path, and the error with it and without a warp (dotted)."
        shown = min(len(_objectives(solved)), len(_COLOURS))
        if shown < len(_objectives(solved)):
            caption += f" The first {shown} of {len(_objectives(solved))} objectives."
        figures.append(("light_path", caption))
    # The same cameras and lights for every objective make the pictures comparable.
    places = sorted({(s.camera, s.light) for s in drawable})
    count = min(len(places), max(1, MOST_MAPS // max(1, len(_objectives(solved)))))
    shown_places = {places[i] for i in np.linspace(0, len(places) - 1, count).round().astype(int)} if places else set()
    chosen = [s for s in drawable if (s.camera, s.light) in shown_places][:MOST_MAPS]
    for s in chosen:
        if scene.cameras[s.camera].is_orthographic and not config.receivers.pixels:
            continue  # a section is drawn over log z and slopes
        seen = seen_of(config, scene, s)
        if not np.isfinite(seen.depth).any():
            continue  # a body between two pixels' centres
        norm = s.norm.replace(".", "_")
        stem = f"error_map_camera{s.camera}_light{s.light}_{s.metric}_{norm}"
        error_map(config, seen, s).savefig(folder / f"{stem}.png", dpi=_DPI)
        where = "pixel" if seen.extent is None else "point of a section along the light"
        hours = [f"{step.hour:.4g}" for step in scene.steps if step.light == s.light and step.hour is not None]
        when = f", at {phrase(hours)} h" if hours else ""
        caption = f"Error at each {where}, {s.title}{when}."
        if config.objective.screen:
            caption += " The thin line: one pixel per texel."
        if len(drawable) > len(chosen):
            caption += f" One of {len(chosen)} pictures, lights evenly chosen, from {len(drawable)} problems."
        figures.append((stem, caption))
    return figures


def seen_of(config: SceneConfig, scene: SceneInput, s: Solved) -> Seen:
    """The image if there is one, otherwise a section along the light: bodies have no visible surface."""
    camera, buffer, body = scene.cameras[s.camera], buffer_of(scene, s.camera), body_of(config)
    if buffer is not None:
        return image_of(camera, np.asarray(buffer.eye_depth(camera_of(camera))))
    planes = np.zeros((0, 4)) if body is None else np.asarray(body.planes)
    if body is not None and np.isinf(camera.far):  # use the body's end; the whole frustum has a far plane
        camera = dataclasses.replace(camera, far=float(body.depth_extent(camera_of(camera))[1]))
    return section_of(camera, planes, s.mapping, *_SECTION)


@style.shared_style()
def error_map(config: SceneConfig, seen: Seen, s: Solved) -> Figure:
    """The scene, its error with and without the optimal warp, on one colour scale."""
    best, plain = (errors(s.mapping, seen, s.metric, warped) for warped in (True, False))
    scale = screen.scale_of(best, plain)
    extent = seen.extent
    section = extent is not None
    width, height = screen.size_of(best.shape)
    panels = 2 if section else 3
    left, top, gap = (0.7 if section else 0.12), 0.5, (0.3 if section else 0.1)
    figure = style.new_figure(left + panels * (width + gap) + 0.95, top + height + (0.55 if section else 0.12))
    places = [style.place(figure, left + i * (width + gap), top, width, height) for i in range(panels)]
    if not section:
        screen.panel(places[0])
        places[0].imshow(screen.tinted(shading(seen, s.mapping.light)), aspect="auto", interpolation="antialiased")
        screen.title(places[0], "What the camera sees", f"light at θ = {s.row['theta_deg']:.0f}° to the view")
    strength = f"λ/μ = {s.row['lambda_over_mu']:.3g}" if s.row["lambda_over_mu"] is not None else "λ = ∞"
    titles = (
        ("Optimal warp" if not s.row["no_warp"] else "Optimal: no warp", f"{strength}, {_worst(s, 'value', best)}"),
        ("No warp", _worst(s, "unwarped", plain)),
    )
    images = [
        screen.error_panel(axes, error, scale, config.objective.screen is not None)
        for axes, error in zip(places[-2:], (best, plain), strict=True)
    ]
    for axes, error, title in zip(places[-2:], (best, plain), titles, strict=True):
        if section:
            _section_axes(axes, extent, error.shape)
        screen.title(axes, *title)
    if section:
        places[1].tick_params(labelleft=False)
        words = f"slope towards the light (θ = {s.row['theta_deg']:.0f}°)"
        style.beside(places[0], words, (0, 0.5), (-40, 0), rotation=90)
    place = left + panels * (width + gap) + 0.02, top, height
    screen.bar_beside(figure, images[0], place, s.metric, config.objective.screen is not None)
    return figure


def _worst(s: Solved, key: str, error: np.ndarray) -> str:
    worst = f"at worst {screen.number(np.nanmax(error))}"
    return worst if s.norm == "inf" else f"{style.norm_label(s.norm)} norm {screen.number(s.row[key])}, {worst}"


def _section_axes(axes: Axes, extent: tuple[float, float, float, float], shape: tuple[int, int]) -> None:
    """Ticks in eye depth, on a log scale, and in slopes; the image itself counts pixels."""
    first, last, low, high = extent
    rows, columns = shape
    decades = range(int(np.floor(np.log10(first))), int(np.ceil(np.log10(last))) + 1)
    steps = (1, 2, 5) if last / first < 1000 else (1,)
    depths = [step * 10.0**k for k in decades for step in steps if first <= step * 10.0**k <= last * (1 + 1e-12)]
    at = [np.log(z / first) / np.log(last / first) * columns - 0.5 for z in depths]
    axes.set_xticks(at, [style.power_text(z) for z in depths])
    slopes = [v for v in MaxNLocator(5).tick_values(low, high) if low <= v <= high]
    axes.set_yticks(
        [(high - v) / (high - low) * rows - 0.5 for v in slopes], [f"{v:.3g}".replace("-", "−") for v in slopes]
    )
    style.beside(axes, "eye depth", (0.5, 0), (0, -24))


def _objectives(solved: list[Solved]) -> list[tuple[int, str, str]]:
    return list(dict.fromkeys((s.camera, s.metric, s.norm) for s in solved))


@style.shared_style()
def path_figure(config: SceneConfig, scene: SceneInput, solved: list[Solved]) -> Figure:
    """Strength of the optimal warp, and errors with it and without, at every step of the light's path."""
    by_place = {(s.camera, s.light, s.metric, s.norm): s for s in solved}
    sun = scene.steps[0].hour is not None
    x = np.array([step.hour if sun else step.index for step in scene.steps])
    figure = style.new_figure(6.4, 4.9)
    upper = style.place(figure, 0.8, 0.25, 3.9, 1.85)
    lower = style.place(figure, 0.8, 2.3, 3.9, 1.95)
    handles, values = [], []
    for (camera, metric, norm), colour in zip(_objectives(solved), _COLOURS, strict=False):
        steps = [None if step.light is None else by_place[camera, step.light, metric, norm] for step in scene.steps]

        def curve(key: str, steps=steps) -> np.ndarray:
            found = [np.nan if s is None or s.row[key] is None else s.row[key] for s in steps]
            return np.array(found, float)

        label = f"{screen.NAMES[metric]}, {style.norm_label(norm)}"
        label += f", camera {camera}" if len(scene.cameras) > 1 else ""
        marker = "o" if len(x) <= 60 else ""
        (line,) = upper.plot(x, curve("eta"), color=colour, lw=1.6, marker=marker, ms=2.8, label=label)
        lower.plot(x, _positive(curve("value")), color=colour, lw=1.6, marker=marker, ms=2.8)
        lower.plot(x, _positive(curve("unwarped")), color=colour, lw=1.2, ls=(0, (1, 1.4)))
        handles.append(line)
        values += [curve("value"), curve("unwarped")]
    etas = np.concatenate([line.get_ydata() for line in handles])
    _log(upper, etas, most=1.0)
    _log(lower, np.concatenate(values))
    room = 0.02 * (np.ptp(x) or 1)
    for axes in (upper, lower):
        axes.set_xlim(x.min() - room, x.max() + room)
        axes.grid(axis="both", color="#e4e4e4", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    upper.tick_params(labelbottom=False)
    style.beside(upper, "η = λ/(λ + μ)", (0, 0.5), (-44, 0), rotation=90)
    unit = "error (pixels per texel)" if config.objective.screen else "error"
    style.beside(lower, unit, (0, 0.5), (-44, 0), rotation=90)
    style.beside(lower, "solar time (hours)" if sun else "step of the light's path", (0.5, 0), (0, -24))
    style.legend_at(figure, 4.95, 0.3, handles, "optimal warp")
    style.write_at(figure, 4.95, 2.4, "solid: optimal warp\ndotted: no warp", va="top", color=style.MUTED, fontsize=8)
    upper.axhline(1, color=style.MUTED, linewidth=0.9, linestyle=(0, (1, 1.4)), zorder=1)
    upper.annotate("no warp", (x.max(), 1), xytext=(0, 3), textcoords="offset points", ha="right", color=style.MUTED)
    return figure


def _positive(values: np.ndarray) -> np.ndarray:
    """Positive values only: empty scenes have error 0, which a log axis cannot show."""
    return np.where(values > 0, values, np.nan)


def _log(axes: Axes, values: np.ndarray, most: float | None = None) -> None:
    values = values[np.isfinite(values) & (values > 0)]
    if not len(values):
        values = np.ones(1)
    low, high = values.min(), max(values.max(), most or 0)
    span = max((high / low) ** 0.06, 1.08)
    style.log_axis(axes, (low / span, high * span))

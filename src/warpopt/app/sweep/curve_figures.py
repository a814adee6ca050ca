"""Curves over the light direction: each rule's and optimum's lambda, and each rule's error over the minimal one."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..common import figure_style as style
from ..frusta.solve import OptimumCurves, Sweep
from . import curve_style as looks

_BAND = "#f1efe9"


def drawn_views(sweep: Sweep) -> list[int]:
    """Indices into `sweep.all_views` of one view for each f/n with the first view's phi, by f/n; the first is kept."""
    first = sweep.all_views[0]
    ratios: dict[float, int] = {}
    for index, view in enumerate(sweep.all_views):
        if view.half_fov_deg == first.half_fov_deg:
            ratios.setdefault(view.far / view.near, index)
    return [index for _, index in sorted(list(ratios.items())[: looks.MOST_PANELS])]


def left_out_views(sweep: Sweep) -> int:
    """How many different views of the run `lambda_figure` does not show."""
    every = {(view.far / view.near, view.half_fov_deg) for view in sweep.all_views}
    return len(every) - len(drawn_views(sweep))


def no_warp_spans(theta_deg: np.ndarray, lam_over_mu: np.ndarray, limit: float) -> list[tuple[float, float]]:
    """(start, width) of every range of directions with eta = 1.

    A direction extends half-way to its neighbours, and at least 0.5 degrees, so that a single one is visible.
    """
    order = np.argsort(theta_deg, kind="stable")
    theta, flat = theta_deg[order], np.isposinf(lam_over_mu[order])
    middle = (theta[1:] + theta[:-1]) / 2
    start, stop = np.r_[theta[:1], middle], np.r_[middle, theta[-1:]]
    start, stop = np.minimum(start, theta - 0.5).clip(0, limit), np.maximum(stop, theta + 0.5).clip(0, limit)
    edges = np.flatnonzero(np.diff(np.r_[False, flat, False]))
    return [(float(start[i]), float(stop[j - 1] - start[i])) for i, j in edges.reshape(-1, 2)]


@style.shared_style()
def lambda_figure(sweep: Sweep) -> Figure:
    """lambda / mu against theta for every rule and every optimum, one panel for each f/n.

    Above each panel, a track for each optimum is filled where eta = 1 (no warp) minimises the norm.
    """
    views, optima = drawn_views(sweep), looks.drawn_optima(sweep)
    columns = 1 if len(views) == 1 else 2 if len(views) <= 4 else 3
    rows = -(-len(views) // columns)
    width = {1: 5.2, 2: 3.75, 3: 3.1}[columns]
    tracks = 0.135 * (len(optima) + 1)
    height, left, gap, right = 2.75, 1.2, 0.28, 2.05
    block = tracks + height + 0.5
    figure = style.new_figure(left + columns * (width + gap) - gap + right, rows * block + 0.37)
    curves = [*sweep.rules.values(), *optima]
    limits = style.decades(np.concatenate([c.lam_over_mu[views].ravel() for c in curves]), 0.02, 0.985)
    limit = looks.theta_limit(sweep)
    for place, view in enumerate(views):
        row, column = divmod(place, columns)
        x, y = left + column * (width + gap), row * block + 0.3
        band = style.place(figure, x, y, width, tracks)
        axes = style.place(figure, x, y + tracks, width, height)
        last = place + columns >= len(views)
        _lambda_panel(axes, sweep, view, optima, limits, limit)
        style.theta_axis(axes, limit, label=last)
        axes.tick_params(axis="y", labelleft=column == 0)
        _no_warp_band(band, sweep, view, optima, limit, labels=column == 0)
        style.beside(band, looks.view_label(sweep.all_views[view]), (0.5, 1), (0, 4), va="bottom", fontsize=9)
        if column == 0:
            style.beside(axes, "λ / μ", (0, 0.5), (-40, 0), rotation=90)
            style.beside(band, "no warp\n(λ = ∞)", (0, 0.5), (-60, 0), rotation=90, fontsize=7.5)
    x = left + columns * (width + gap) - gap + 0.22
    handles = [
        Line2D([], [], label=style.optimum_label(o.metric, o.norm), **looks.optimum_style(sweep, o)) for o in optima
    ]
    style.legend_at(figure, x, 0.3, handles, "Optimum of")
    style.legend_at(figure, x, 0.3 + 0.5 + 0.187 * len(handles), _rule_handles(looks.rules_of(sweep)), "Published rule")
    return figure


def _rule_handles(names: list[str]) -> list[Line2D]:
    return [Line2D([], [], label=looks.rule_label(name), **looks.rule_style(name)) for name in names]


def _lambda_panel(
    axes: Axes, sweep: Sweep, view: int, optima: list[OptimumCurves], limits: tuple[float, float], limit: float
) -> None:
    style.log_axis(axes, limits)
    axes.grid(axis="y", which="major", color="#e8e8e8", linewidth=0.6)
    axes.set_axisbelow(True)
    # Wide optima below narrow rules: where both agree, the rule's colour is visible inside the optimum's line.
    for optimum in optima:
        look = looks.optimum_style(sweep, optimum)
        values = optimum.lam_over_mu[view]
        style.draw_curve(axes, sweep.theta_deg, values, f"optimum {optimum.metric} {optimum.norm}", zorder=3, **look)
        for theta, value in exits(sweep.theta_deg, values):
            thin = {"color": look["color"], "linewidth": 0.9, "linestyle": (0, (1, 1))}
            axes.plot([theta, theta], [value, limits[1]], label="_exit", zorder=2.5, **thin)
    for name in looks.rules_of(sweep):
        rule = sweep.rules[name]
        values = np.where(rule.defined[view], rule.lam_over_mu[view], np.nan)
        style.draw_curve(axes, sweep.theta_deg, values, f"rule {name}", zorder=4, **looks.rule_style(name))
    looks.mark_field_of_view(axes, sweep.all_views[view].half_fov_deg, limit)


def exits(theta_deg: np.ndarray, lam_over_mu: np.ndarray) -> list[tuple[float, float]]:
    """(theta, lambda / mu) of the finite ends of a curve next to which lambda is infinite."""
    order = np.argsort(theta_deg, kind="stable")
    theta, values = theta_deg[order], lam_over_mu[order]
    finite, flat = np.isfinite(values), np.isposinf(values)
    beside = np.r_[False, flat[:-1]] | np.r_[flat[1:], False]
    return [(float(theta[i]), float(values[i])) for i in np.flatnonzero(finite & beside)]


def _no_warp_band(axes: Axes, sweep: Sweep, view: int, optima: list[OptimumCurves], limit: float, labels: bool) -> None:
    axes.set_facecolor(_BAND)
    tracks = [
        (style.optimum_label(o.metric, o.norm), o.lam_over_mu[view], looks.optimum_style(sweep, o)["color"])
        for o in optima
    ]
    if "ssm" in sweep.rules:
        tracks.append((looks.rule_label("ssm"), sweep.rules["ssm"].lam_over_mu[view], looks.rule_style("ssm")["color"]))
    for row, (label, values, colour) in enumerate(tracks):
        spans = no_warp_spans(sweep.theta_deg, values, limit)
        axes.broken_barh(spans, (row - 0.3, 0.6), facecolors=colour, linewidth=0, label=label)
    axes.set_xlim(0, limit)
    axes.set_ylim(max(len(tracks), 1) - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks(range(len(tracks)), [label for label, *_ in tracks], fontsize=6.8)
    axes.tick_params(axis="y", length=0, pad=3, labelleft=labels)


@style.shared_style()
def ratio_figure(sweep: Sweep) -> Figure:
    """value(rule) / value(optimum) against theta for the first view: a row for each metric, a column for each norm.

    Shaded above the curve of no warp: a rule is worse than no warp there. Rules that yield no lambda are left out.
    """
    optima = looks.drawn_optima(sweep)
    metrics, norms = looks.metrics_of(sweep), looks.norms_of(sweep)[: looks.MOST_NORMS]
    width, height = {1: 5.2, 2: 3.75, 3: 3.0, 4: 2.6}[len(norms)], 2.05 if len(metrics) > 1 else 3.0
    left, gap, right, down = 0.75, 0.28, 2.05, 0.3
    rows, columns = len(metrics), len(norms)
    figure = style.new_figure(left + columns * (width + gap) - gap + right, rows * (height + down) + 0.47)
    shown = [np.where(sweep.rules[n].defined[0], r[0], np.nan) for o in optima for n, r in o.ratios.items()]
    limits = 0.8, max(3.0, style.decades(np.concatenate(shown), 0.0, 0.997)[1])
    limit = looks.theta_limit(sweep)
    for optimum in optima:
        row, column = metrics.index(optimum.metric), norms.index(optimum.norm)
        axes = style.place(figure, left + column * (width + gap), row * (height + down) + 0.25, width, height)
        _ratio_panel(axes, sweep, optimum, limits, limit)
        style.theta_axis(axes, limit, label=row == rows - 1)
        axes.tick_params(axis="y", labelleft=column == 0)
        title = style.optimum_label(optimum.metric, optimum.norm)
        style.beside(axes, title, (0.5, 1), (0, 4), va="bottom", fontsize=9)
        if column == 0:
            style.beside(axes, "error / optimal error", (0, 0.5), (-38, 0), rotation=90)
        if row == column == 0:
            style.beside(axes, "worse than no warp", (0, 1), (6, -20), ha="left", fontsize=7.5, color=style.WORSE_INK)
    x = left + columns * (width + gap) - gap + 0.22
    handles = [
        Line2D([], [], color="black", linewidth=3.0, label="optimum (= 1)"),
        *_rule_handles(looks.rules_of(sweep)),
        Patch(facecolor=style.WORSE, label="worse than no warp"),
    ]
    style.legend_at(figure, x, 0.25, handles, looks.view_label(sweep.views[0]))
    return figure


def _ratio_panel(axes: Axes, sweep: Sweep, optimum: OptimumCurves, limits: tuple[float, float], limit: float) -> None:
    style.log_axis(axes, limits)
    axes.grid(axis="y", which="major", color="#e3e3e3", linewidth=0.6, zorder=0.5)
    order = np.argsort(sweep.theta_deg, kind="stable")
    if "ssm" in optimum.ratios:
        theta, ratio = sweep.theta_deg[order], optimum.ratios["ssm"][0][order]
        if theta.size == 1:
            theta, ratio = theta + np.array([-1.5, 1.5]), np.repeat(ratio, 2)
        axes.fill_between(theta, ratio, limits[1], where=np.isfinite(ratio), color=style.WORSE, linewidth=0, zorder=0)
    axes.axhline(1, color="black", linewidth=2.9, zorder=2)
    for name in looks.rules_of(sweep):
        values = np.where(sweep.rules[name].defined[0], optimum.ratios[name][0], np.nan)
        style.draw_curve(axes, sweep.theta_deg, values, f"rule {name}", zorder=4, **looks.rule_style(name))
    looks.mark_field_of_view(axes, sweep.views[0].half_fov_deg, limit, top=True)

"""The figures of a run: drawn, written as PNG and SVG, and described in captions."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..common.figure_style import save
from ..common.words import phrase
from ..frusta.problem import View
from ..frusta.solve import Sweep
from . import curve_style as looks
from .curve_figures import drawn_views, lambda_figure, left_out_views, ratio_figure
from .frustum_figures import (
    METRICS,
    THETAS_DEG,
    Distributions,
    FocusRegion,
    distributions,
    error_distribution_figure,
    focus_region,
    focus_region_figure,
    fraction_text,
)

__all__ = [
    "error_distribution_figure",
    "focus_region_figure",
    "lambda_figure",
    "ratio_figure",
    "write_figures",
    "write_view_figures",
]

_KAPPA, _XI = 0.5, 0.8


_Jobs = dict[str, Callable[[], tuple[Figure, str]]]


def write_figures(
    sweep: Sweep,
    directory: Path,
    progress: Callable[[str], None] = lambda stem: None,
    of_view: dict[str, str] | None = None,
) -> list[tuple[str, str]]:
    """Write every figure of a run as `<stem>.png` and `<stem>.svg`, equal sweeps give identical bytes.

    Args:
        sweep: the results.
        directory: an existing folder.
        progress: receives each stem when it is written.
        of_view: the result of `write_view_figures` for the first view, if already written.

    Returns:
        (stem, caption) of each figure, in order.
    """
    captions = of_view or write_view_figures(sweep.views, directory, progress)
    jobs: _Jobs = {
        "lambda": lambda: (lambda_figure(sweep), _lambda_caption(sweep)),
        "ratio": lambda: (ratio_figure(sweep), _ratio_caption(sweep)),
    }
    captions = captions | _written(jobs, directory, progress)
    return [(stem, captions[stem]) for stem in ("lambda", "error_distribution", "ratio", "focus_region")]


def write_view_figures(
    views: Sequence[View], directory: Path, progress: Callable[[str], None] = lambda stem: None
) -> dict[str, str]:
    """Write the first view's figures that need no results, while solves are compiled; returns their captions."""
    region = focus_region(_KAPPA, _XI)
    jobs: _Jobs = {
        "focus_region": lambda: (focus_region_figure(data=region), _focus_caption(region)),
        "error_distribution": lambda: _error_distribution(views, distributions(views[0])),
    }
    return _written(jobs, directory, progress)


def _written(jobs: _Jobs, directory: Path, progress: Callable[[str], None]) -> dict[str, str]:
    captions = {}
    for stem, job in jobs.items():
        figure, captions[stem] = job()
        save(figure, directory / stem)
        progress(stem)
    return captions


def _lambda_caption(sweep: Sweep) -> str:
    views, first = drawn_views(sweep), sweep.views[0]
    ratios = phrase([looks.ratio_text(sweep.all_views[view]) for view in views])
    sentences = [
        f"λ/μ against the angle θ between view and light, for every published rule and for the optimum of each "
        f"metric and norm (measure: {sweep.measure}), at f/n = {ratios} and φ = {first.half_fov_deg:g}°.",
        "The tracks above each panel are filled where η = 1 (no warp, λ = ∞) minimises the error; a grey dotted line "
        "marks θ = φ, a "
        "black one the direction where E_q's optimum jumps to no warp.",
        "A curve is missing where a rule yields no λ > 0 or leaves the axis.",
        _no_warp_sentence(sweep),
        _left_out_sentence(left_out_views(sweep), "view", "views with other f/n or φ"),
        _norms_sentence(sweep),
    ]
    return " ".join(filter(None, sentences))


def _no_warp_sentence(sweep: Sweep) -> str:
    """The last sampled direction, from theta = 0 on, for which eta = 1 minimises the first view's error."""
    ends: dict[str, list[str]] = {}
    for optimum in looks.drawn_optima(sweep):
        flat = sweep.theta_deg[np.isposinf(optimum.lam_over_mu[0]) & (sweep.theta_deg <= 90)]
        if flat.size:
            name = looks.plain_optimum_label(optimum.metric, optimum.norm)
            ends.setdefault(f"{flat.max():g}°", []).append(name)
    if not ends:
        return ""
    phrases = [f"θ = {end} for {phrase(names)}" for end, names in ends.items()]
    return (
        f"At f/n = {looks.ratio_text(sweep.views[0])}, η = 1 (no warp) minimises the error up to {'; '.join(phrases)}."
    )


def _left_out_sentence(count: int, one: str, many: str) -> str:
    if not count:
        return ""
    return f"1 more {one} of the run is not shown." if count == 1 else f"{count} more {many} are not shown."


def _norms_sentence(sweep: Sweep) -> str:
    return _left_out_sentence(max(len(looks.norms_of(sweep)) - looks.MOST_NORMS, 0), "norm", "norms of the run")


def _ratio_caption(sweep: Sweep) -> str:
    view = sweep.views[0]
    sentences = [
        f"Each rule's error over the minimal error against θ at f/n = {looks.ratio_text(view)}, "
        f"φ = {view.half_fov_deg:g}° (measure: {sweep.measure}), for each metric and norm; 1 is the optimum.",
        "In the shaded region, above the grey curve of no warp, a rule is worse than no warp at all.",
        _left_out_sentence(len(sweep.views) - 1, "view", "views of the run"),
        _norms_sentence(sweep),
    ]
    return " ".join(filter(None, sentences))


def _error_distribution(views: Sequence[View], errors: Distributions) -> tuple[Figure, str]:
    view = views[0]
    largest = errors.errors.max(axis=(3, 4, 5))
    gain = largest[:, 0, 0] / largest[:, 3, 0]
    gains = phrase([f"{looks.PLAIN_METRICS[m]} {g:.3g} times" for m, g in zip(METRICS, gain, strict=True)])
    sentences = [
        f"Side views of the aliasing errors E_p, E_q and E_p×q over the view frustum (f/n = {looks.ratio_text(view)}, "
        f"φ = {view.half_fov_deg:g}°) for θ = {phrase([f'{theta:g}°' for theta in THETAS_DEG])}, under no warp, "
        f"LiSPSM, TSM (κ = {_KAPPA}, ξ = {_XI}) and the L∞ optimum of the panel's metric.",
        "All panels share one logarithmic colour scale of base 5, with lines at the powers of 5; the near end is "
        "magnified in the upper left corner, and the number is the largest error over the frustum.",
        f"At θ = {THETAS_DEG[0]:g}° the largest error without a warp over the optimum's is, for {gains}.",
        _left_out_sentence(len(views) - 1, "view", "views of the run"),
    ]
    return error_distribution_figure(view, errors), " ".join(filter(None, sentences))


def _focus_caption(region: FocusRegion) -> str:
    before, after = region.focus_areas
    start = fraction_text(region.distant_share)
    return (
        f"The focus region of TSM (κ = {_KAPPA}, ξ = {_XI}) for a light at θ = 0, without a warp on the left and under "
        f"TSM's warp (λ/μ = {region.lam_over_mu:.3g}) on the right. "
        f"TSM spends the first {start} of the map's height on the distant region, which without a warp has the first "
        f"{fraction_text(float(region.focus[0, 0, 1]))}; the focus region's share of the map falls from "
        f"{100 * before:.0f} % to {100 * after:.0f} %."
    )

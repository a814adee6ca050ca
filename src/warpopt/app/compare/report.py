"""`report.md` of a comparison: a ranking as text, and the table."""

from typing import TYPE_CHECKING

import numpy as np

from warpopt.rules.registry import rule_title

from ..common.limits import least_and_largest, limit_sentence
from ..common.words import markdown_pictures, markdown_table
from ..splits.settings import TITLES
from .settings import CompareConfig, SceneCompareConfig
from .solve import Compared
from .splits import SplitsCompared

if TYPE_CHECKING:
    from ...compare.comparison import Worst

_POINT = 1e-5  # degrees: a shorter interval is one direction, such as theta = 0


def intervals_text(intervals: tuple[tuple[float, float], ...]) -> str:
    """Intervals in radians as "0 to 7.13 deg, at 90 deg"; empty if there are none."""
    words = []
    for low, high in np.rad2deg(np.array(intervals)).reshape(-1, 2).tolist():
        words.append(f"at {_angle(low)} deg" if high - low < _POINT else f"{_angle(low)} to {_angle(high)} deg")
    return ", ".join(words)


def _angle(degrees: float) -> str:
    return f"{degrees if degrees > _POINT else 0:.4g}"


def where_text(c: Compared, kind: str, name: str) -> str:
    """Where a rule is "worse" than no warp, gives "no_warp", or is "undefined"; empty if nowhere."""
    r = c.result
    if r.regions is not None:
        return intervals_text(r.regions[kind][name])
    i = r.names.index(name)
    masks = {"worse": r.worse, "no_warp": r.defined & (r.eta == 1), "undefined": ~r.defined}
    lights = np.flatnonzero(masks[kind][i])
    if len(lights) == len(r.theta):
        return "every light"
    return f"{'light' if len(lights) == 1 else 'lights'} {', '.join(map(str, lights))}" if len(lights) else ""


def ratio_text(ratio: float) -> str:
    """Text with three digits, "unbounded", or "-" if there is no ratio."""
    return f"{ratio:.3g}" if np.isfinite(ratio) else "-" if np.isnan(ratio) else "unbounded"


def place_text(c: Compared, worst: "Worst") -> str:
    """Where a rule is worst, as text."""
    if worst.nearest < 0:
        return "-"
    angle = f"{np.rad2deg(worst.theta):.4g} deg"
    return angle if c.result.regions is not None else f"{angle}, light {worst.nearest}"


def compare_report(
    config: CompareConfig | SceneCompareConfig, compared: list[Compared], splits: list[SplitsCompared],
    figures: list[tuple[str, str]],
) -> str:  # fmt: skip
    """The report as Markdown."""
    parts = ["# Rules for lambda against the optimum\n", _opening(config)]
    failures = sum(int(c.result.failed.sum()) for c in compared)
    if failures:
        parts.append(f"**{failures} optimum/optima could not be found**; `compare.json` says why.\n")
    if not compared:
        parts.append("The sun is below the horizon all the time: there is nothing to compare.\n")
    if figures:
        parts.append("## At a glance\n")
        parts += markdown_pictures(figures)
    for c in compared:
        parts += [f"## {c.title}\n", _verdict(c), _losses(c), _table(c)]
        parts += [_splits(config, told) for told in splits if (told.objective, told.camera) == (c.objective, c.camera)]
    return "\n".join(parts)


def _splits(config: CompareConfig | SceneCompareConfig, told: SplitsCompared) -> str:
    """A line for each way of splitting, by its mean: over the best with a warp in each cascade, and without."""
    assert config.cascades is not None  # compared because they are
    several = len({over for _, over, _ in told.keys}) > 1
    rows = []
    for name, over in dict.fromkeys((name, over) for name, over, _ in told.keys):
        both = told.warped_and_not(name, over)
        title = TITLES[name] + (f" (of the {'camera planes' if over == 'planes' else 'receivers'})" if several else "")
        cells = [["-", "-"] if v is None else [ratio_text(v.mean()), ratio_text(v.max())] for v in both]
        rows.append((float(next(v for v in both if v is not None).mean()), [title, *cells[0], *cells[1]]))
    heads = ["splits", "warped: mean", "worst", "no warp: mean", "worst"]
    count = config.cascades.count
    each = "the best splits' error, with a warp in each" if config.cascades.warp else "the best splits' error"
    repute = " Unreal's is by repute." if any(name == "unreal" for name, _, _ in told.keys) else ""
    words = f"### {count} cascades\n\nMultiples of {each}, over the light directions; `splits.csv` has each.{repute}"
    return f"{words}\n\n" + markdown_table(heads, [row for _, row in sorted(rows, key=lambda row: row[0])])


def _opening(config: CompareConfig | SceneCompareConfig) -> str:
    if isinstance(config, CompareConfig):
        view = config.view
        over = (
            f"The view frustum n = {view.near:g}, f = {view.far:g}, half field of view {view.half_fov_deg:g} deg; "
            f"norms over the measure `{config.objective.measure}`. The worst is searched between the directions too; "
            "an unbounded rule has no mean."
        )
    else:
        over = (
            f"The receivers of a scene ({config.receivers.kind}). Rules are applied as in their sources, to "
            "the receivers' eye depths and their extent along the warp (to the camera's near or far plane where a "
            "source uses those). Your own rules and the TSM alternative, which are made for the whole frustum, keep "
            "their apex: lambda over the receivers is lambda + (start of the receivers) - (start of the frustum). "
            "For points and depth buffers the limit is over "
            "maps that are linear within each of 256 depths; a warp may be up to 8 % below it."
        )
    return (
        f"{over}\n\n"
        "All numbers are multiples of the optimum's error, which is 1. A rule counts where it is defined; its mean is "
        "over the light directions. Only rules that are defined in every direction and bounded are ranked, by "
        "increasing mean. OSG is OpenSceneGraph. The limit is what the best monotone map of the depth would reach, "
        "perspective or not, where it is known. `ranking.csv` has the table, `compare.csv` and `compare.json` all "
        "numbers, `run.json` configuration and versions.\n"
    )


def _verdict(c: Compared) -> str:
    """Text: the best rule on average and at worst, the order of the others, and the possible gain of any other map."""
    r = c.result
    ranking = [name for name in r.ranking() if not np.isnan(r.mean(name))]
    words = [_ranking_words(c, ranking) if ranking else "No rule is defined and bounded in every direction."]
    words += [r.undefined_because] if r.undefined_because else []
    words.append(r.no_bound_because or limit_sentence(least_and_largest(r.optimum_over_bound)))
    return " ".join(filter(None, words)) + "\n"


def _ranking_words(c: Compared, ranking: list[str]) -> str:
    r, first = c.result, ranking[0]
    safest = min(ranking, key=lambda name: r.worst(name).ratio)
    worst = r.worst(first)
    words = [
        f"**{rule_title(first)}** is best on average: {r.mean(first):.3g} times the optimum's error in the mean and "
        f"{worst.ratio:.3g} times at worst ({place_text(c, worst)})."
    ]
    if safest == first:
        words.append("It is also the best at worst.")
    else:
        worst = r.worst(safest)
        words.append(
            f"At worst {rule_title(safest)} is best: never more than {worst.ratio:.3g} times ({place_text(c, worst)}), "
            f"{r.mean(safest):.3g} in the mean."
        )
    if ranking[1:]:
        others = ", ".join(f"{rule_title(name)} {r.mean(name):.3g}" for name in ranking[1:])
        words.append(f"The other means are: {others}.")
    return " ".join(words)


def _losses(c: Compared) -> str:
    """A sentence for each rule that is worse than no warp or is undefined somewhere, in the ranking's order."""
    lines = []
    for name in c.result.order():
        worse = where_text(c, "worse", name)
        none = "" if c.result.undefined_because else where_text(c, "undefined", name)
        clauses = []
        if worse:
            clauses.append(" ".join(filter(None, [f"is worse than no warp {_for(worse)}", harm_text(c, name)])))
        if none:
            clauses.append(f"yields no lambda > 0 {_for(none)}")
        worst = c.result.worst(name)
        if np.isinf(worst.ratio):
            clauses.append(f"is unbounded towards {place_text(c, worst)}")
        if clauses:
            clauses[:-1] = [", ".join(clauses[:-1])] if clauses[1:] else []
            lines.append(f"- {rule_title(name)} {' and '.join(clauses)}.")
    if not lines:
        return "No rule is worse than no warp anywhere.\n"
    return "\n".join(lines) + "\n"


def harm_text(c: Compared, name: str) -> str:
    """By how much a rule is worse than no warp: "by up to 1.5 %", "by a factor of up to 11.5"; empty if unbounded."""
    ratio = c.result.worst(name, "no_warp").ratio
    if not 1 < ratio < np.inf:
        return ""
    return f"by up to {100 * (ratio - 1):.2g} %" if ratio < 2 else f"by a factor of up to {ratio:.3g}"


def _for(where: str) -> str:
    return where if where.startswith("at ") else f"for {where}"


def _table(c: Compared) -> str:
    r = c.result
    ranking = r.ranking()
    heads = ["", "rule", "mean", "worst", "at", "worst over the limit", "at"]
    heads += ["worst over no warp", "worse than no warp", "no warp", "undefined"]
    rows = []
    for place, name in enumerate(r.order(), 1):
        numbers = [ratio_text(r.mean(name))]
        for one in (r.worst(name), r.worst(name, "bound")):
            numbers += [ratio_text(one.ratio), place_text(c, one)]
        numbers.append(ratio_text(r.worst(name, "no_warp").ratio))
        where = [where_text(c, kind, name) for kind in ("worse", "no_warp", "undefined")]
        first = [str(place) if name in ranking else "", rule_title(name)]
        rows.append([*first, *numbers, *where])
    return markdown_table(heads, rows)

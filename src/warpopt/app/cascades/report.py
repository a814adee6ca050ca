"""`report.md` of cascades."""

import itertools
from typing import TYPE_CHECKING

import numpy as np

from warpopt.cascades.splits import ENGINES

from ..common.words import markdown_pictures, markdown_table
from ..splits.settings import TITLES
from .rows import objective_of

if TYPE_CHECKING:
    from ..inputs.scene_files import SceneInput
    from .numbers import ByNumber, Texels
    from .rows import Config, Row

_SHOWN = 8  # numbers of maps in the table of texels


def cascades_report(
    config: "Config", scene: "SceneInput | None", rows: "list[Row]", figures: list[tuple[str, str]],
    numbers: "list[ByNumber]", texels: "list[Texels]",
) -> str:  # fmt: skip
    """The report as Markdown."""
    asked = config.cascades
    parts = [f"# {asked.count} cascades\n"]
    for camera in dict.fromkeys(row.camera for row in rows):
        mine = [row for row in rows if row.camera == camera]
        if len({row.camera for row in rows}) > 1:
            parts.append(f"## Camera {camera}\n")
        parts += [_best(mine, not objective_of(config).supremum), _steps(mine, asked.step), *_worst(mine), _table(mine)]
    if numbers or texels:
        parts.append("## How many\n")
    if numbers:
        parts.append(_by_number(numbers))
    if texels:
        own = [at for at in texels if scene is not None or at.theta_deg == getattr(config.light, "theta_deg", None)]
        for camera in dict.fromkeys(at.camera for at in own):
            parts.append(_texels([at for at in own if at.camera == camera]))
    if scene is not None and not scene.depths:
        parts.append("No picture of the screen: the receivers are not pixels.\n")
    if figures:
        parts.append("## Figures\n")
        parts += markdown_pictures(figures)
    return "\n".join(part for part in parts if part)


def spanned(values: "list[float]", digits: int = 3) -> str:
    """A value, or the least and the largest of those that differ in these digits."""
    low, high = (f"{v:.{digits}g}" for v in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _best(rows: "list[Row]", mean: bool) -> str:
    """A camera's best splits, under all its lights; `mean`: by a mean, not a maximum."""
    best = [row for row in rows if row.name == "best" and row.warped == rows[0].warped]
    if all(row.plan.solutions is not None and not (np.asarray(row.plan.errors) > 0).any() for row in best):
        return "The camera sees no receivers, or none that a map could alias: there is nothing to split.\n"
    depths = ", ".join(spanned([float(row.plan.splits[k]) for row in best], 5) for k in range(len(best[0].plan.splits)))
    over = "mean over all receivers" if mean else "largest of the cascades'"
    words = f"The best splits are at {depths}; the error is {spanned([float(r.plan.value) for r in best], 4)} ({over}"
    words += f", over {len(best)} lights). " if len(best) > 1 else "). "
    lower = [float(row.plan.lower) for row in best]
    reasons = dict.fromkeys(row.plan.lower_because for row, v in zip(best, lower, strict=True) if not np.isfinite(v))
    if not reasons:
        words += f"No splits of as many maps have one below {spanned(lower, 4)}: {best[0].plan.lower_because}. "
    else:
        words += "".join(f"A lower bound is {why}. " for why in reasons)
    plain = [row.lost for row in rows if row.name == "best" and not row.warped]
    if rows[0].warped and plain:
        words += f"Without warps the best splits have {spanned(plain)} times the error."
    return words.strip() + "\n"


def _steps(rows: "list[Row]", step: float | None) -> str:
    """What splits at whole steps cost, and how often they change along the light's path."""
    stepped = [row for row in rows if row.name == "stepped" and row.warped == rows[0].warped]
    if not stepped:
        return ""
    words = f"At whole steps of {step:g} they have {spanned([row.lost for row in stepped])} times the best error"
    if len(stepped) > 1:
        splits = [np.asarray(row.plan.splits) for row in stepped]
        moves = sum(not np.allclose(a, b, rtol=1e-9) for a, b in itertools.pairwise(splits))
        words += f", and change at {moves} of {len(stepped) - 1} steps of the light"
    return words + ".\n"


def _worst(rows: "list[Row]") -> list[str]:
    """A sentence for each engine's split, worst first."""
    told = []
    for alike in sorted(_alike(rows), key=lambda alike: -max(row.lost for row in alike)):
        first = alike[0]
        if first.name not in ENGINES:
            continue
        plain, warped = ([row.lost for row in alike if row.warped == warp] for warp in (False, True))
        name = TITLES[first.name] + (" (by repute)" if first.name == "unreal" else "")
        words = f"- {name} over the {_range(first)}: {spanned(plain)} times the best error without warps"
        words += f", {spanned(warped)} with" if warped else ""
        if all(row.balanced_from > float(row.plan.splits[0]) for row in alike):
            words += "; with nothing nearer than " + spanned([row.balanced_from for row in alike])
            words += " the first cascade would be no longer than the others"
        told.append(f"{words}.\n")
    return told


def _alike(rows: "list[Row]") -> "list[list[Row]]":
    """The rows of each split over the same range."""
    keys = dict.fromkeys((row.name, row.over) for row in rows)
    return [[row for row in rows if (row.name, row.over) == key] for key in keys]


def _range(row: "Row") -> str:
    if row.plan.views is None:
        return "frustum"
    return "camera's planes" if row.over == "planes" else "receivers' range"


def _table(rows: "list[Row]") -> str:
    return markdown_table(list(HEADS), lines_of(rows))


HEADS = ("splits", "of the", "error over the best's", "without warps", "largest far/near", "depths")


def lines_of(rows: "list[Row]") -> list[list[str]]:
    """A line of text for each split, warped and not, over all lights."""
    lines = []
    for alike in _alike(rows):
        lost = [[row.lost for row in alike if row.warped == warped] for warped in (True, False)]
        same = [row for row in alike if row.warped == alike[0].warped]
        depths = (spanned([float(row.plan.splits[k]) for row in same], 4) for k in range(1, len(same[0].plan.errors)))
        ratio = spanned([row.largest_ratio for row in same])
        told = [spanned(values) if values else "-" for values in lost]
        lines.append([TITLES[same[0].name], _range(same[0]), *told, ratio, ", ".join(depths)])
    return lines


def _by_number(numbers: "list[ByNumber]") -> str:
    """Each scheme's error over the best of as many, by number of maps."""
    counts = sorted({k for scheme in numbers for k in scheme.plain})

    def told(scheme: "ByNumber", k: int) -> str:
        both = [f"{values[k]:.3g}" for values in (scheme.warped, scheme.plain) if k in values]
        return " / ".join(both) or "-"

    lines = [[TITLES[scheme.name], *(told(scheme, k) for k in counts)] for scheme in numbers]
    warped = "with a warp in each / without" if any(scheme.warped for scheme in numbers) else "without warps"
    return f"Largest error over the best of as many maps, {warped}.\n\n" + markdown_table(
        ["maps", *map(str, counts)], lines
    )


def _texels(texels: "list[Texels]") -> str:
    """At the view's own angle, or under all lights of a camera; the figure has other angles."""
    rows = (("warped", True), ("no warp", False))
    lines = []
    for words, warped in rows:
        values = [at.warped if warped else at.plain for at in texels]
        lines.append([words, *(spanned([float(v[k]) for v in values]) for k in range(_SHOWN))])
    price, most = texels[0].price, len(texels[0].warped)
    cost = f"; each map costs {price:g} more" if price else ""
    numbers = [spanned([at.best_number(warped) for at in texels]) for _, warped in rows]
    capped = any(at.best_number(warped) == most for at in texels for _, warped in rows)
    still = " (no more were tried)" if capped else ""
    return (
        "Texels for one per pixel, divided by the lower bound; maps have their own aspect, splits are logarithmic"
        f"{cost}. Of 1 to {most} maps {numbers[0]} need the fewest with warps, {numbers[1]} without{still}.\n\n"
        + markdown_table(["maps", *(str(k + 1) for k in range(_SHOWN))], lines)
    )

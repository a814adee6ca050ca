"""`report.md` of cascades."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.words import markdown_pictures, markdown_table

if TYPE_CHECKING:
    from .rows import Config, Row

TITLES = {
    "best": "the best", "logarithmic": "logarithmic", "practical": "practical, 0.5", "uniform": "uniform",
    "godot": "Godot's fractions", "unity": "Unity's fractions", "unreal": "Unreal's exponent 3",
    "bevy": "Bevy's, first to 10", "three": "three.js's practical split", "filament": "Filament's halvings",
}  # fmt: skip


def cascades_report(
    config: "Config", rows: "list[Row]", figures: list[tuple[str, str]], storage: dict[str, Any] | None
) -> str:
    """The report as Markdown."""
    asked = config.cascades
    parts = [f"# {asked.count} cascades\n"]
    for camera in dict.fromkeys(row.camera for row in rows):
        mine = [row for row in rows if row.camera == camera]
        if len({row.camera for row in rows}) > 1:
            parts.append(f"## Camera {camera}\n")
        parts += [_best(mine), *_worst(mine), _table(mine)]
    if storage is not None:
        parts.append(_texels(storage))
    if figures:
        parts.append("## Figures\n")
        parts += markdown_pictures(figures)
    return "\n".join(part for part in parts if part)


def _best(rows: "list[Row]") -> str:
    best, plan = rows[0], rows[0].plan
    depths = ", ".join(f"{float(z):.5g}" for z in plan.splits)
    words = f"The best splits are at {depths}; the error is {float(plan.value):.4g} (largest of the cascades'). "
    if np.isfinite(float(plan.lower)):
        words += f"No splits of as many maps have one below {float(plan.lower):.4g}: {plan.lower_because}. "
    else:
        words += f"A lower bound is {plan.lower_because}. "
    plain = next((row for row in rows[1:] if row.name == best.name and not row.warped), None)
    if plain is not None:
        words += f"Without warps the best splits have {plain.lost:.3g} times the error."
    return words.strip() + "\n"


def _worst(rows: "list[Row]") -> list[str]:
    """A sentence for each engine's split, worst first."""
    engines = [row for row in rows if row.name in ("godot", "unity", "unreal", "bevy", "three", "filament")]
    told = []
    for row in sorted((row for row in engines if not row.warped), key=lambda row: -row.lost):
        words = f"- {TITLES[row.name]} over the {_range(row)}: {row.lost:.3g} times the best error without warps"
        warped = next((r for r in engines if r.warped and (r.name, r.over) == (row.name, row.over)), None)
        words += f", {warped.lost:.3g} with" if warped is not None else ""
        told.append(f"{words}; they would be balanced if nothing were nearer than {row.balanced_from:.3g}.\n")
    return told


def _range(row: "Row") -> str:
    if row.plan.views is None:
        return "frustum"
    return "camera's planes" if row.over == "planes" else "receivers' range"


def _table(rows: "list[Row]") -> str:
    return markdown_table(list(HEADS), lines_of(rows))


HEADS = ("splits", "of the", "error over the best's", "without warps", "largest far/near", "depths")


def lines_of(rows: "list[Row]") -> list[list[str]]:
    """A line of text for each split, warped and not."""
    lines = []
    for name, over in dict.fromkeys((row.name, row.over) for row in rows):
        both = {row.warped: row for row in rows if (row.name, row.over) == (name, over)}
        lost = [f"{both[warped].lost:.3g}" if warped in both else "-" for warped in (True, False)]
        row = both.get(True) or both[False]
        depths = ", ".join(f"{float(z):.4g}" for z in row.plan.splits[1:-1])
        lines.append([TITLES[name], _range(row), *lost, f"{row.largest_ratio:.3g}", depths])
    return lines


def _texels(storage: dict[str, Any]) -> str:
    heads = ["maps", *(str(k + 1) for k in range(8))]
    lines = [
        [words, *(f"{v:.3g}" for v in storage[key][:8])] for words, key in (("warped", "warped"), ("no warp", "plain"))
    ]
    return (
        "## How many\n\nTexels for one a pixel, of maps of their own aspect over logarithmic splits, over what no maps "
        "of any kind can better.\n\n" + markdown_table(heads, lines)
    )

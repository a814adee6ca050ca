"""`report.md` of a scene."""

from typing import Any

import numpy as np

import warpopt

from ..common.limits import least_and_largest, limit_sentence
from ..common.words import markdown_pictures, markdown_table
from ..inputs.scene_files import SceneInput
from .settings import SceneConfig
from .solve import Solved
from .stable import stable_words

_HEADS = {
    "camera": "camera",
    "light": "light",
    "theta_deg": "theta (deg)",
    "lambda_over_mu": "lambda / mu",
    "value": "error",
    "unwarped": "without warp",
    "over_limit": "error / limit",
    "margin": "margin",
    "outcome": "outcome",
}


def short(row: dict[str, Any], name: str) -> str:
    """A value of a problem's row, formatted for the report."""
    value = row[name]
    if name.startswith("lambda") and row["no_warp"]:
        return "inf: no warp"
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


_WEIGHTS = {
    "uniform": "every visible pixel counts alike",
    "depth": "a visible pixel counts by its eye depth, which stands for shadow edges",
    "edges": "only the pixels beside a shadow edge count; where there is no edge, pixels count by their depth",
}
_LIT = ", lit pixels only"


def scene_report(
    config: SceneConfig, scene: SceneInput, solved: list[Solved], figures: list[tuple[str, str]],
    window: list[dict[str, Any]],
) -> str:  # fmt: skip
    """The report as Markdown; `window` has the stable window's frames."""
    parts = ["# Optimal shadow-map warps of a scene\n", _opening(config, scene, solved)]
    failures = [s for s in solved if not s.outcome.succeeded]
    if failures:
        parts.append(f"**{len(failures)} problem(s) could not be solved**; `scene.json` says why.\n")
    parts += [f"**{words}**\n" for words in unmapped_words(solved)]
    empty = sum(s.outcome is warpopt.Outcome.empty for s in solved)
    if empty:
        parts.append(f"In {empty} problem(s) the camera sees no receivers: nothing needs a shadow map.\n")
    parts += [f"{note}\n" for note in scene.notes]
    if window:
        parts += ["## The stable window\n", stable_words(window)]
    if figures:
        parts.append("## Figures\n")
        parts += markdown_pictures(figures)
    for objective in config.objective.objectives():
        mine = [s for s in solved if s.objective == objective]
        if mine:
            rows = [[short(s.row, name) for name in _HEADS] for s in mine]
            parts += [
                f"## {objective.title}\n",
                _gain(mine),
                _turned(config, mine),
                _storage(config, mine),
                _limit(mine),
                markdown_table(list(_HEADS.values()), rows),
            ]
    return "\n".join(part for part in parts if part)


def unmapped_words(solved: list[Solved]) -> list[str]:
    """A sentence for each reason why warps that were found have no matrix."""
    reasons = [s.unmapped for s in solved if s.unmapped]
    return [f"{reasons.count(why)} problem(s) have no matrix: {why}" for why in dict.fromkeys(reasons)]


def _opening(config: SceneConfig, scene: SceneInput, solved: list[Solved]) -> str:
    below = sum(step.light is None for step in scene.steps)
    lines = [
        f"Receivers: {config.receivers.kind}. {len(scene.camera_of)} camera(s), {len(scene.cameras)} distinct; "
        f"{len(scene.steps)} step(s) of the light, {len(scene.lights)} distinct direction(s)."
    ]
    if config.receivers.pixels:
        # Edges count on both sides, and without one all pixels count.
        lit = _LIT if config.weights.lit and config.weights.by != "edges" else ""
        lines.append(f"In means, {_WEIGHTS[config.weights.by]}{lit}.")
    if below:
        lines.append(f"In {below} step(s) the sun is not above the horizon and gives no direction.")
    units = "screen pixels per texel" if config.objective.screen else "in the units of a screen 2 high and a map 1 by 1"
    lines.append(
        "lambda is the near-plane distance of the warping frustum (inf: no warp), mu its depth range. The margin is "
        "d log(error) / d log(eta) just below eta = 1: a warp helps where it is positive, which is known before "
        f"solving. Errors are {units}."
    )
    lines.append(
        "The limit is what the best monotone map of the depth would reach, perspective or not. For depth buffers it "
        "is over maps that are linear within each of 256 depths; a warp may be up to 8 % below it."
    )
    lines.append("`scene.json` has the matrices, `table.csv` all numbers, `run.json` configuration and versions.")
    return "\n".join(lines) + "\n"


def _gain(mine: list[Solved]) -> str:
    gains = [(s.row["unwarped"] / s.row["value"], s.row["light"]) for s in mine if s.row["value"] and s.row["unwarped"]]
    useless = sum(s.outcome is warpopt.Outcome.no_warp for s in mine)
    if not gains:
        return "No problem has receivers.\n"
    (most, where), (least, _) = max(gains), min(gains)
    words = f"The optimal warp divides the error by {most:.3g} at best (light {where}) and by {least:.3g} at worst."
    return words + (f" eta = 1 (no warp) minimises the error in {useless} problem(s).\n" if useless else "\n")


def _turned(config: SceneConfig, mine: list[Solved]) -> str:
    """What turning the warp promised, where the direction was searched."""
    searched = [s.row for s in mine if s.row["directions"] > 1 and s.row["value"] and s.row["unturned"]]
    parts = []
    if searched:
        turned = [row for row in searched if row["turn_deg"] > 1e-6]
        parts.append(
            f"The best of {searched[0]['directions']} directions is kept where it divides the view's error by at least "
            f"{config.warp.turn_only_if:g}: in {len(turned)} of {len(searched)} problem(s)."
        )
        if turned:
            gains = [(row["unturned"] / row["value"], row["light"], row["turn_deg"]) for row in turned]
            (most, where, degrees), (least, _, _) = max(gains), min(gains)
            factor = f"{least:.3g} to {most:.3g}" if len(gains) > 1 else f"{most:.3g}"
            parts.append(
                f"There, turning the warp divides the error by {factor} (light {where}: by {degrees:.0f} degrees). The "
                "best direction may jump from frame to frame."
            )
    if config.warp.aspect == "best":
        aspects = [row["shares"][0] / row["shares"][1] for row in (s.row for s in mine)]
        parts.append(f"Aspects are {min(aspects):.3g} to {max(aspects):.3g} times that of the map, at as many texels.")
    return " ".join(parts) + "\n" if parts else ""


def _storage(config: SceneConfig, mine: list[Solved]) -> str:
    """The texels that the first problem needs, in words."""
    row = mine[0].row
    if row["metric"] != "storage" or not row["value"] or not config.objective.shadow_map:
        return ""
    texels = config.objective.shadow_map[0] * config.objective.shadow_map[1] / 1e6
    numbers = [f"{row[key] * texels:.3g}" for key in ("unwarped", "value", "limit") if row[key] is not None]
    least = f", and any maps at least {numbers[2]}" if len(numbers) > 2 else ""
    return (
        f"For a texel at every pixel, light {row['light']} needs {numbers[0]} million texels without a warp, "
        f"{numbers[1]} with the optimal one{least}.\n"
    )


def _limit(mine: list[Solved]) -> str:
    over_limit = np.array([s.row["over_limit"] for s in mine], float)
    reasons = dict.fromkeys(s.row["no_limit_because"] for s in mine if s.row["no_limit_because"])
    return " ".join(filter(None, [limit_sentence(least_and_largest(over_limit)), *reasons])) + "\n"

"""`report.md` of a scene."""

from typing import Any

import numpy as np

import warpopt

from ..common.limits import least_and_largest, limit_sentence
from ..common.words import markdown_pictures, markdown_table
from ..inputs.scene_files import SceneInput
from .settings import SceneConfig
from .solve import Solved

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
_LIT = ", in the light alone"


def scene_report(config: SceneConfig, scene: SceneInput, solved: list[Solved], figures: list[tuple[str, str]]) -> str:
    """The report as Markdown."""
    parts = ["# Optimal shadow-map warps of a scene\n", _opening(config, scene, solved)]
    failures = [s for s in solved if not s.outcome.succeeded]
    if failures:
        parts.append(f"**{len(failures)} problem(s) could not be solved**; `scene.json` says why.\n")
    empty = sum(s.outcome is warpopt.Outcome.empty for s in solved)
    if empty:
        parts.append(f"In {empty} problem(s) the camera sees no receivers: nothing needs a shadow map.\n")
    parts += [f"{note}\n" for note in scene.notes]
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
                _limit(mine),
                markdown_table(list(_HEADS.values()), rows),
            ]
    return "\n".join(parts)


def _opening(config: SceneConfig, scene: SceneInput, solved: list[Solved]) -> str:
    below = sum(step.light is None for step in scene.steps)
    lines = [
        f"Receivers: {config.receivers.kind}. {len(scene.camera_of)} camera(s), {len(scene.cameras)} distinct; "
        f"{len(scene.steps)} step(s) of the light, {len(scene.lights)} distinct direction(s)."
    ]
    if config.receivers.pixels:
        lines.append(f"In means, {_WEIGHTS[config.weights.by]}{_LIT if config.weights.lit else ''}.")
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


def _limit(mine: list[Solved]) -> str:
    over_limit = np.array([s.row["over_limit"] for s in mine], float)
    reasons = dict.fromkeys(s.row["no_limit_because"] for s in mine if s.row["no_limit_because"])
    return " ".join(filter(None, [limit_sentence(least_and_largest(over_limit)), *reasons])) + "\n"

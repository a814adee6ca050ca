"""`report.md` of frames, and the summary in the terminal."""

from collections import Counter
from typing import Any

import numpy as np

from warpopt.frames.methods import method_title
from warpopt.frames.names import title_of

from ..common.words import markdown_pictures, markdown_table, phrase
from ..inputs.scene_files import SceneInput
from .settings import FramesConfig

_BAND = 0.05  # within which two errors of one frame do not differ: half the noise of a frame
Records = list[dict[str, Any]]


def _errors(records: Records, name: str) -> np.ndarray:
    """The share of wrong pixels of a warp in every frame; NaN where it is undefined."""
    rows = [row for record in records for row in record["rows"] if row["warp"] == name]
    return np.array([np.nan if row.get("wrong") is None else row["wrong"] for row in rows])


def _mean(records: Records, name: str, key: str) -> float:
    values = [row.get(key) for record in records for row in record["rows"] if row["warp"] == name]
    values = [value for value in values if value is not None]
    return float(np.mean(values)) if values else float("nan")


def _ratios(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """one/other where both are defined; half of the least error for none, so that no frame is lost."""
    good = np.isfinite(one) & np.isfinite(other)
    every = np.concatenate([one[good], other[good]])
    least = every[every > 0].min() / 2 if (every > 0).any() else 1.0
    return np.maximum(one[good], least) / np.maximum(other[good], least)


def _percent(value: float) -> str:
    return "-" if np.isnan(value) else f"{100 * value:.3g} %"


def summary(config: FramesConfig, records: Records) -> list[list[str]]:
    """A line for each warp: means over frames, and the geometric mean of its error over that of no warp."""
    lines, plain = [], _errors(records, "none") if "none" in config.frames.warps else None
    for name in config.frames.warps:
        line = [title_of(name), *(_percent(_mean(records, name, key)) for key in ("wrong", "false", "missing", "far"))]
        if plain is not None:
            ratios = _ratios(_errors(records, name), plain)
            line.append(f"{np.exp(np.log(ratios).mean()):.3g}" if len(ratios) else "-")
        lines.append(line)
    return lines


def frames_report(
    config: FramesConfig, scene: SceneInput, records: Records, course: dict[str, Any] | None = None
) -> str:
    """The report as Markdown; `course` is what a path's methods measured."""
    frames = config.frames
    parts = ["# Frames with the shadows of each warp\n", _opening(config, records)]
    parts += [f"{note}\n" for note in scene.notes]
    heads = ["warp", "wrong", "false shadow", "missing shadow", "wrong far from an edge", "times no warp"]
    lines = summary(config, records)
    parts += ["## Wrong pixels, means over frames\n", markdown_table(heads[: len(lines[0])], lines)]
    if "none" in frames.warps:
        parts += ["## Wins and losses against no warp\n", *_wins(config, records, "none")]
    if "best" in frames.warps:
        parts += ["## Against the best eta\n", *_wins(config, records, "best")]
    if course is not None:
        parts += _flicker(config, course)
    pictures = [picture for record in records for picture in record["pictures"]]
    if pictures:
        parts.append("## Pictures\n")
        parts.append(
            "Red: false shadow. Blue: missing shadow. The same places are enlarged for every warp. A picture shows one "
            "map as it lies; its numbers are means over shifts of the grid.\n"
        )
        parts += markdown_pictures([(name.removesuffix(".png"), caption) for name, caption in pictures])
    return "\n".join(parts)


def _flicker(config: FramesConfig, course: dict[str, Any]) -> list[str]:
    path = config.frames.path
    assert path is not None  # the course is its own
    rows = [
        [
            method_title(row["method"]),
            *(_percent(np.nan if row[key] is None else row[key]) for key in ("static", "flicker")),
            "-" if row["refits"] is None else str(row["refits"]),
            "-" if row["worst_pop"] is None else _percent(row["worst_pop"]),
        ]
        for row in course["rows"]
    ]
    count = max((row["frames"] for row in course["rows"]), default=0)
    return [
        f"## Along a path: {path.kind}, {count} frames, {path.rate:g} a second\n",
        "False flicker is the share of a frame's world points, seen in the next frame too and with unchanged truth, "
        "whose verdict changes. A method that changes nothing does not flicker, and may be wrong all the time. A "
        "stable window is fitted anew where it must be: each such refit flips points once.\n",
        markdown_table(["method", "wrong", "false flicker", "refits", "points flipped by the worst"], rows),
        *(["![Static error against flicker](flicker.png)\n"] if config.output.figures else []),
        *markdown_pictures([(name.removesuffix(".gif"), caption) for name, caption in course["pictures"]], ".gif"),
    ]


def _opening(config: FramesConfig, records: Records) -> str:
    frames, first = config.frames, [record["rows"][0] for record in records]
    pixels = frames.screen[0] * frames.screen[1]
    reading = frames.reading()
    lines = [
        f"{len(records)} frame(s) of {frames.screen[0]} x {frames.screen[1]} pixels, maps of {frames.shadow_map[0]} x "
        f"{frames.shadow_map[1]} texels, fitted to the {'receivers' if frames.fit == 'receivers' else 'cut frustum'}; "
        f"filter {reading.filter}, bias {reading.bias} ({reading.texels:g}). The truth is a ray from each pixel's "
        "receiver to the light. Errors are shares of the pixels that face the light, means over shifts of the grid."
    ]
    shares = {key: float(np.mean([row[key] for row in first])) / pixels for key in ("away", "grazing", "background")}
    lines.append(
        f"Not judged, in the mean of the frames: {_percent(shares['background'])} background, "
        f"{_percent(shares['away'])} that face away from the light, {_percent(shares['grazing'])} nearly parallel to "
        "it."
    )
    reasons = Counter(row["excluded"] for row in first if row["excluded"] not in ("", "the rule gives no warp"))
    if reasons:
        told = phrase([f"{count} with {reason}" for reason, count in reasons.items()])
        lines.append(f"Excluded, because their error is undefined: {told}.")
    undefined = Counter(
        row["warp"] for record in records for row in record["rows"] if row["excluded"] == "the rule gives no warp"
    )
    if undefined:
        told = phrase([f"{title_of(name)} in {count}" for name, count in undefined.items()])
        lines.append(f"Rules that give no warp, measured without one: {told} frame(s).")
    inside = [str(record["rows"][0]["frame"]) for record in records if record["inside"]]
    if inside:
        lines.append(f"The camera seems to be inside a mesh in frame(s) {phrase(inside)}.")
    return " ".join(lines) + "\n"


def _wins(config: FramesConfig, records: Records, against: str) -> list[str]:
    other, lines = _errors(records, against), []
    for name in config.frames.warps:
        ratios = _ratios(_errors(records, name), other)
        if name == against or not len(ratios):
            continue
        better, worse = ((ratios < 1 - _BAND).sum(), (ratios > 1 + _BAND).sum())
        words = f"{title_of(name)}: geometric mean {np.exp(np.log(ratios).mean()):.3g}, worst {ratios.max():.3g}, best "
        words += f"{ratios.min():.3g}; better by more than {100 * _BAND:g} % in {better} of {len(ratios)} frame(s), "
        lines.append(f"- {words}worse in {worse}.\n")
    return lines or ["No frame has wrong pixels under both.\n"]

"""The tables and pictures of `pixels.py`, from its measurements."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.patches import Rectangle
from pixels_scenes import CLASSES, SCENES, draw
from scipy.stats import spearmanr, t

from warpopt.app.common import figure_style as style
from warpopt.frames import Reading, measured, see
from warpopt.frames.fits import SCAN, Fitting
from warpopt.frames.names import title_of
from warpopt.frames.pictures import painted, worst_places, wrong_pixels

COUNT = 20  # wrong pixels, of which the standard deviation is a fifth
BAND = 0.05  # two errors of one frame that differ by less are called equal
LIST = ("none", "lispsm", "tsm", "filament", "p-inf", "edge", "band", "best")
RULES = ("none", "lispsm", "tsm", "filament")
Frames = list[dict]


def error(frames: Frames, name: str) -> np.ndarray:
    """Wrong share of each frame; half a pixel of its judged ones where none is wrong, so that ratios exist."""
    return np.array([max(each["error"][name]["wrong"], 0.5 / each["judged"]) for each in frames])


def engine_error(frames: Frames, name: str) -> np.ndarray:
    return np.array([max(each["engine"][name], 0.5 / each["judged"]) for each in frames])


def geometric(ratios: np.ndarray) -> str:
    """Geometric mean, and its 95 % interval over frames (Student's, of the logarithms)."""
    logs = np.log(ratios)
    half = t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs)) if len(logs) > 1 else np.nan
    return f"{np.exp(logs.mean()):.2f} ({np.exp(logs.mean() - half):.2f} to {np.exp(logs.mean() + half):.2f})"


def shares(ratios: np.ndarray, band: float = BAND) -> str:
    return f"{100 * (ratios < 1 - band).mean():.0f} / {100 * (ratios > 1 + band).mean():.0f} %"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in (heads, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(heads), *lines[1:]]) + "\n"


def tables(frames: Frames, size: tuple[int, int]) -> str:
    """Everything that the page shows between its marks."""
    counts = [sum(each["class"] == k for each in frames) for k in range(len(CLASSES))]
    classes = ", ".join(f"{n} at {a} to {b}" for n, (a, b) in zip(counts, CLASSES, strict=True))
    skipped = sum(each["skipped"] for each in frames)
    parts = [
        f"{len(frames)} frames of {len({each['scene'] for each in frames})} scenes, {size[0]} x {size[1]} pixels, by "
        f"theta in degrees: {classes}; {skipped} draws without a shadow's edge were drawn again. Maps of 1024 x 1024 "
        "texels, nearest texel, one texel of slope as bias, unless said. Intervals are 95 %, over frames.\n",
        "### Goals\n", goals(frames),
        "### One map\n", against(frames, "p-inf"),
        "### Against no warp\n", against(frames, "none"),
        "### By theta and by scene\n", by_class(frames),
        "### Wins and losses\n", extremes(frames),
        "### Which objective predicts the pixels\n", objectives(frames),
        "### The engines' fit\n", engines(frames),
        "### Map sizes and checks\n", checks(frames),
        "### Biases and filters\n", readings(frames),
    ]  # fmt: skip
    return "\n".join(parts)


def goals(frames: Frames) -> str:
    """Each goal, its number, and whether it is met: over all frames, and over those with enough wrong pixels."""
    many = [each for each in frames if each["error"]["best"]["wrong"] * each["judged"] >= COUNT]
    rows = []

    def goal(words: str, value, most: float, percent: bool = False) -> None:
        cells = [words, f"{100 * most:.0f} %" if percent else f"{most:g}"]
        for group in (frames, many):
            number = float(value(group)) if group else np.nan
            met = number >= most if percent else number <= most
            cells.append(
                (f"{100 * number:.0f} %" if percent else f"{number:.3f}") + (", met" if met else ", **missed**")
            )
        rows.append(cells)

    def over(name: str, other: str):
        return lambda group: error(group, name) / error(group, other)

    edge, band = over("edge", "best"), over("band", "best")
    goal("edge over the best eta, mean", lambda group: edge(group).mean(), 1.08)
    goal("edge over the best eta, median", lambda group: np.median(edge(group)), 1.03)
    goal("edge over the best eta, worst frame", lambda group: edge(group).max(), 2)
    goal("band over the best eta, mean", lambda group: band(group).mean(), 1.15)
    for name in ("edge", "band"):
        for rule in RULES[1:]:
            ratios = over(name, rule)
            goal(
                f"{name} over {title_of(rule)}, geometric mean",
                lambda group, ratios=ratios: np.exp(np.log(ratios(group)).mean()), 1,
            )  # fmt: skip
            goal(
                f"{name} within 5 % of {title_of(rule)} or better",
                lambda group, ratios=ratios: (ratios(group) <= 1.05).mean(), 0.8, True,
            )  # fmt: skip
        ratios = over(name, "none")
        goal(
            f"{name} within 2 % of no warp or better",
            lambda group, ratios=ratios: (ratios(group) <= 1.02).mean(), 0.92, True,
        )  # fmt: skip
    note = (
        f"A ratio of a handful of wrong pixels says little. The last column is over the {len(many)} frames with at "
        f"least {COUNT} wrong pixels at the best eta, whose noise is at most a fifth. Other tables have all frames.\n"
    )
    return note + "\n" + table(["goal", "bar", "all frames", f"{COUNT} wrong pixels and more"], rows)


def against(frames: Frames, other: str) -> str:
    base = error(frames, other)
    rows = []
    for name in LIST:
        if name == other:
            continue
        ratios = error(frames, name) / base
        wrong = 100 * np.mean([each["error"][name]["wrong"] for each in frames])
        far = 100 * np.mean([each["error"][name]["far"] for each in frames])
        rows.append([
            title_of(name), geometric(ratios), f"{ratios.mean():.2f} / {np.median(ratios):.2f}", shares(ratios),
            f"{ratios.min():.2f} / {ratios.max():.2f}", f"{wrong:.3f}", f"{far:.3f}",
        ])  # fmt: skip
    words = f"error over {title_of(other)}'s: geometric mean"
    heads = [words, "mean / median", "better / worse by 5 %", "best / worst frame", "wrong (%)", "> 2.5 pixels off (%)"]
    return table(["warp", *heads], rows)


def by_class(frames: Frames) -> str:
    groups = {f"theta {a} to {b}": [each for each in frames if each["class"] == k] for k, (a, b) in enumerate(CLASSES)}
    groups |= {name: [each for each in frames if each["scene"] == name] for name in SCENES}
    names = ("none", "lispsm", "tsm", "filament", "edge", "band", "best")
    rows = [
        [words, *(geometric(error(mine, name) / error(mine, "p-inf")) for name in names)]
        for words, mine in groups.items()
        if len(mine) > 1
    ]
    return "Error over that of E_p, norm inf, geometric means:\n\n" + table(["frames", *map(title_of, names)], rows)


def extremes(frames: Frames) -> str:
    """The same number of the best and of the worst frames of each objective, against the best of the rules."""
    lines = []
    for name in ("p-inf", "edge", "band"):
        rules = np.min([error(frames, rule) for rule in RULES], 0)
        ratios = error(frames, name) / rules
        order = np.argsort(ratios)

        def pixels(i: int, warp: str) -> int:
            return round(frames[i]["error"][warp]["wrong"] * frames[i]["judged"])

        def told(which: Iterable[int], ratios: np.ndarray = ratios, name: str = name) -> str:
            return "; ".join(
                f"{frames[i]['scene']} at theta {frames[i]['theta_deg']:.0f}: {ratios[i]:.2f} "
                f"({pixels(i, name)} pixels for {min(pixels(i, rule) for rule in RULES)})"
                for i in which
            )

        lines.append(
            f"**{title_of(name)}** over the best of no warp, LiSPSM, TSM and Filament, chosen afterwards for each "
            f"frame: {geometric(ratios)}. Best: {told(order[:4])}. Worst: {told(order[::-1][:4])}.\n"
        )
    return "\n".join(lines)


def objectives(frames: Frames) -> str:
    """Rank correlation over eta, and what each objective's optimum loses."""
    rows = []
    best = error(frames, "best")
    for name in frames[0]["objective"]:
        ranks = np.array([spearmanr(each["objective"][name], each["scan"]).statistic for each in frames])
        ranks = ranks[np.isfinite(ranks)]
        ratios = error(frames, name) / best
        rows.append((np.log(ratios).mean(), [
            title_of(name), f"{np.mean(ranks):.3f} / {np.median(ranks):.3f}", f"{ranks.min():.2f}", geometric(ratios),
            f"{ratios.mean():.3f} / {np.median(ratios):.3f}", f"{ratios.max():.2f}",
        ]))  # fmt: skip
    heads = [
        "objective",
        "rank correlation, mean / median",
        "least",
        "optimum over the best eta",
        "mean / median",
        "worst",
    ]
    note = (
        f"Spearman's rank correlation of objective and error over {len(SCAN)} eta from 1 to {SCAN[-1]:g}, and the "
        "error at the objective's optimum over that at the best eta. What chooses the best eta is not what judges it: "
        "two sets of shifts; so a ratio may be below 1.\n"
    )
    return note + "\n" + table(heads, [row for _, row in sorted(rows, key=lambda row: row[0])])


def engines(frames: Frames) -> str:
    base = error(frames, "p-inf")
    rows = []
    for name in frames[0]["engine"]:
        ratios = engine_error(frames, name) / base
        rows.append([title_of(name), geometric(ratios), shares(ratios), f"{ratios.min():.2f} / {ratios.max():.2f}"])
    note = "Rules over the view frustum cut by the scene's box, against E_p, norm inf, over the frame's receivers:\n"
    return note + "\n" + table(["rule, engine's fit", "error ratio", "better / worse by 5 %", "best / worst"], rows)


def checks(frames: Frames) -> str:
    sizes = list(frames[0]["sizes"])
    rows = []
    for name in LIST:
        means = [np.mean([each["sizes"][size][name] for each in frames]) for size in sizes]
        falls = np.polyfit(np.log([float(size) for size in sizes]), np.log(means), 1)[0]
        plain = [np.array([max(each["sizes"][size][key], 0.5 / each["judged"]) for each in frames]) for size in sizes
                 for key in (name, "p-inf")]  # fmt: skip
        over = [f"{np.exp(np.log(plain[2 * k] / plain[2 * k + 1]).mean()):.2f}" for k in range(len(sizes))]
        rows.append([title_of(name), *(f"{100 * mean:.3f}" for mean in means), f"{falls:.2f}", " / ".join(over)])
    heads = ["warp", *(f"{size}: wrong (%)" for size in sizes), "power of R", "over E_p inf's at each size"]
    ratio = np.array([
        each["error"][name]["wrong"] / each["predicted"][name]
        for each in frames for name in LIST
        if each["predicted"][name] * each["judged"] > 20
    ])  # fmt: skip
    low, middle, high = np.quantile(ratio, [0.1, 0.5, 0.9])
    fine = 100 * np.mean([each["fine"] for each in frames])
    words = (
        f"- Texel areas by differences through the matrix equal E_p E_q times the projection factor to "
        f"{max(each['footprint'] for each in frames):.1e}, every pixel of every frame (bar: 1e-3).\n"
        f"- Map and truth at R = 32768: {fine:.4f} % of the pixels differ, at E_p, norm inf; from 1024, an error that "
        f"falls as 1/R leaves {100 * np.mean(error(frames, 'p-inf')) / 32:.4f} %.\n"
        "- Edge length times offset predicts the count of wrong pixels: measured over predicted "
        f"{middle:.2f} in the median, {low:.2f} to {high:.2f} between the tenths ({len(ratio)} frames and warps with "
        "over 20 predicted).\n"
    )
    return table(heads, rows) + "\n" + words


def readings(frames: Frames) -> str:
    mine = [each for each in frames if "readings" in each]
    rows = []
    names = list(next(iter(mine[0]["readings"].values())))
    for words in mine[0]["readings"]:
        means = {name: 100 * np.mean([each["readings"][words][name] for each in mine], 0) for name in names}
        gain = np.array([
            max(each["readings"][words][names[-1]][1], 0.5 / each["judged"])
            / max(each["readings"][words]["none"][1], 0.5 / each["judged"])
            for each in mine
        ])  # fmt: skip
        cells = [f"{means[name][0]:.2f} / {means[name][1]:.2f}" for name in names]
        sides = f"{means[names[-1]][2]:.2f} / {means[names[-1]][3]:.2f}"
        rows.append([words, *cells, sides, f"{np.exp(np.log(gain).mean()):.2f}"])
    note = (
        f"Means over {len(mine)} frames in per cent: pixels on the wrong side of one half / mean difference of the lit "
        "share from the truth; and for the last warp, false and missing shadow.\n"
    )
    heads = [
        "filter and bias",
        *map(title_of, names),
        f"{title_of(names[-1])}: false / missing",
        "its gain: edge over none",
    ]
    return note + "\n" + table(heads, rows)


def write_between(page: Path, mark: str, text: str) -> None:
    """Replace what stands between a page's marks.

    Raises:
        ValueError: a page without them.
    """
    begin, end = f"<!-- {mark} -->\n", f"<!-- end {mark} -->"
    whole = page.read_text(encoding="utf-8")
    if begin not in whole or end not in whole:
        raise ValueError(f"{page}: got no mark {begin.strip()}, expected it and {end}")
    head, _, rest = whole.partition(begin)
    page.write_text(head + begin + text + rest[rest.index(end) :], encoding="utf-8")


def headline(frames: Frames) -> str:
    """README's sentences: what is won and what is lost, over all frames."""
    lines = []
    for name, other in (("edge", "none"), ("edge", "lispsm"), ("band", "none"), ("band", "lispsm")):
        ratios = error(frames, name) / error(frames, other)
        better, worse = 100 * (ratios < 1 - BAND).mean(), 100 * (ratios > 1 + BAND).mean()
        lines.append([
            f"{title_of(name)} against {title_of(other)}", geometric(ratios), f"{better:.0f} %", f"{worse:.0f} %",
            f"{ratios.max():.2f}",
        ])  # fmt: skip
    heads = ["wrong pixels", "geometric mean of the ratio (95 %)", "better by 5 %", "worse by 5 %", "worst frame"]
    return table(heads, lines)


def median_frame(frames: Frames) -> tuple[str, int]:
    """(scene, number in it) of the frame whose gain by "edge" over no warp is the median of all: not chosen by eye."""
    gain = error(frames, "edge") / error(frames, "none")
    which = int(np.argsort(gain)[len(gain) // 2])
    scene = frames[which]["scene"]
    return scene, sum(each["scene"] == scene for each in frames[:which])


def write_pictures(frames: Frames, folder: Path) -> None:
    """README's picture: truth and three maps of equal texels, at the median frame."""
    name, number = median_frame(frames)
    count = max(1, sum(each["scene"] == name for each in frames) // len(CLASSES))
    size = (384, 240)
    drawn = next(each for k, each in enumerate(draw(name, count, *size)) if k == number)
    frame = see(drawn.lit, drawn.frame.camera, 400, 640)
    fitting = Fitting(drawn.lit, frame, (1024, 1024))
    picture(drawn.lit, frame, fitting).savefig(folder / "frames.png", dpi=110, pil_kwargs={"optimize": True})


@style.shared_style()
def picture(lit, frame, fitting: Fitting):
    """Truth, no warp, LiSPSM and ours; below each the place where the maps together are worst."""
    wide, gap, high = 2.42, 0.08, 2.42 * frame.judged.shape[0] / frame.judged.shape[1]
    crop = (66, 106)
    low = wide * crop[0] / crop[1]
    names = ("none", "lispsm", "edge")
    made = {name: fitting.fitted(name) for name in names}
    shown = {name: fitting.map_of(each).visibility(frame, Reading()) for name, each in made.items()}
    ((top, left),) = worst_places(np.sum([wrong_pixels(frame, each) for each in shown.values()], 0), crop, 1)
    figure = style.new_figure(4 * wide + 5 * gap, high + low + 0.62)
    panels = [("Truth", "a ray from each pixel to the light", frame.lit.astype(float))]
    titles = {"none": "No warp", "lispsm": "LiSPSM", "edge": "warpopt, edges"}
    for name in names:
        verdict = measured(frame, fitting.map_of(made[name]))
        panels.append((titles[name], f"{100 * verdict.wrong:.2f} % of pixels wrong", shown[name]))
    for k, (title, words, values) in enumerate(panels):
        x = gap + k * (wide + gap)
        image = painted(lit, frame, values)
        axes = style.place(figure, x, 0.44, wide, high)
        axes.imshow(image, aspect="auto", interpolation="antialiased")
        axes.add_patch(Rectangle((left, top), crop[1], crop[0], fill=False, edgecolor="white", linewidth=1.0))
        style.beside(axes, title, (0, 1), (0, 15), ha="left", va="bottom", fontsize=10, fontweight="bold")
        style.beside(axes, words, (0, 1), (0, 3), ha="left", va="bottom", color=style.MUTED)
        close = style.place(figure, x, 0.44 + high + gap, wide, low)
        close.imshow(image[top : top + crop[0], left : left + crop[1]], aspect="auto", interpolation="nearest")
        for each in (axes, close):
            each.set_xticks([])
            each.set_yticks([])
    return figure

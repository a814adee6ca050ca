"""The figure of a comparison's ways of splitting: a line for each over the directions, warped and not."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..common import figure_style as style
from ..splits.looks import COLOURS, DASHES
from ..splits.settings import TITLES
from .splits import SplitsCompared

_MOST_ROWS = 4


def write_split_figure(splits: list[SplitsCompared], folder: Path) -> list[tuple[str, str]]:
    """Write it as PNG and SVG if there are directions in order: over a view frustum.

    Returns:
        (stem, caption), or none.
    """
    if not splits or splits[0].camera is not None or len(splits[0].theta) < 2:
        return []
    style.save(split_figure(splits[:_MOST_ROWS]), folder / "splits")
    more = len(splits) - _MOST_ROWS
    rest = f" {more} more objective(s) of the run are not shown." if more > 0 else ""
    words = "Each way of splitting into cascades against the angle between view and light: its error over that of the "
    return [("splits", words + "best splits, with a warp in each cascade on the left, without on the right." + rest)]


@style.shared_style()
def split_figure(splits: list[SplitsCompared]) -> Figure:
    """A row for each objective; the two panels of a row have one scale."""
    panels = [warped for warped in (True, False) if any(key[2] == warped for key in splits[0].keys)]
    figure = style.new_figure(1.0 + 2.95 * len(panels) + 1.9, 0.55 + 2.95 * len(splits))
    handles: dict[str, object] = {}
    for row, told in enumerate(splits):
        degrees = np.rad2deg(told.theta)
        highest = told.ratio[np.isfinite(told.ratio)].max()
        for column, warped in enumerate(panels):
            axes = style.place(figure, 0.8 + 2.95 * column, 0.4 + 2.95 * row, 2.6, 2.3)
            for (name, _, own), ratio in zip(told.keys, told.ratio, strict=True):
                if own == warped:
                    (handles[name],) = axes.plot(
                        degrees, ratio, color=COLOURS[name], linestyle=DASHES[name],
                        linewidth=2.6 if name == "best" else 1.3, label=TITLES[name],
                    )  # fmt: skip
            style.log_axis(axes, (0.9, 1.3 * highest), label=not column)
            axes.set_xlim(degrees[0], degrees[-1])
            axes.grid(color="#e4e4e4", linewidth=0.6)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            if not row:
                style.beside(axes, "each cascade warped" if warped else "no warp", (0.5, 1), (0, 9), fontweight="bold")
            if not column:
                style.beside(axes, f"{told.objective.title}, over the best", (0, 0.5), (-42, 0), rotation=90)
            if row == len(splits) - 1:
                style.beside(axes, "light to view (degrees)", (0.5, 0), (0, -24))
    style.legend_at(figure, 0.95 + 2.95 * len(panels), 0.4, list(handles.values()), "splits")
    return figure

"""The screen coloured by cascade, and the error at each pixel."""

import jax
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from warpopt.theory.camera import camera_of

from ..common import figure_style as style
from ..common import screen_panels as screen
from ..common.error_maps import Mapping, Seen, errors, image_of, shading
from ..inputs.scene_files import SceneInput
from ..inputs.scene_values import buffer_of
from .rows import Row, objective_of
from .settings import SceneCascadesConfig

_CASCADES = ("#d1495b", "#edae49", "#3f9c6b", "#30638e")  # from the nearest, again beyond the fourth


def screen_figure(config: SceneCascadesConfig, scene: SceneInput, rows: list[Row]) -> Figure | None:
    """One camera under one light: the picture by cascade, and the error of each row's splits; None if all is sky."""
    camera, buffer = scene.cameras[rows[0].camera], buffer_of(scene, rows[0].camera)
    assert buffer is not None  # asked for pixels alone
    seen = image_of(camera, np.asarray(buffer.eye_depth(camera_of(camera))))
    if not np.isfinite(seen.depth).any():
        return None
    assert rows[0].plan.solutions is not None  # over a scene
    light = np.asarray(rows[0].plan.solutions.frame.light)[0]
    return _drawn(config, seen, rows, [errors_of(seen, row, objective_of(config).name) for row in rows], light)


def cascade_of(seen: Seen, row: Row) -> np.ndarray:
    """(height, width): the cascade that holds each pixel's depth; a pixel at a split is the nearer one's.

    Of those that hold something: a split may be the nearest pixel's depth itself.
    """
    assert row.plan.solutions is not None  # over a scene
    used = np.flatnonzero(~np.asarray(row.plan.solutions.footprint.empty))
    ends = np.asarray(row.plan.splits)[1:][used]
    return used[np.searchsorted(ends[:-1], seen.depth)]


def errors_of(seen: Seen, row: Row, metric: str) -> np.ndarray:
    """(height, width): the error of each pixel in its cascade's map; NaN where there is none."""
    number, solutions = cascade_of(seen, row), row.plan.solutions
    made = np.full(seen.depth.shape, np.nan)
    for k in np.unique(number[np.isfinite(seen.depth)]):
        one = jax.tree.map(lambda v, k=k: v[k], solutions)
        fit = one.footprint.lateral_fit(one.warp.eta)
        made = np.where(number == k, errors(Mapping.of(one, fit, fit), seen, metric, True), made)
    return made


@style.shared_style()
def _drawn(
    config: SceneCascadesConfig, seen: Seen, rows: list[Row], found: list[np.ndarray], light: np.ndarray
) -> Figure:  # fmt: skip
    width, height = screen.size_of(seen.depth.shape)
    left, top, gap = 0.12, 0.5, 0.1
    figure = style.new_figure(left + (1 + len(rows)) * (width + gap) + 0.95, top + height + 0.12)
    places = [style.place(figure, left + i * (width + gap), top, width, height) for i in range(1 + len(rows))]
    number = cascade_of(seen, rows[0])
    colours = np.array([to_rgb(_CASCADES[k % len(_CASCADES)]) for k in range(len(rows[0].plan.errors))])
    screen.panel(places[0])
    tint = screen.tinted(shading(seen, light), colours[np.minimum(number, len(colours) - 1)])
    places[0].imshow(tint, aspect="auto", interpolation="antialiased")
    splits = ", ".join(f"{float(z):.3g}" for z in rows[0].plan.splits[1:-1])
    screen.title(places[0], "By cascade", f"split at {splits}" if splits else "one map")
    scale, pixels = screen.scale_of(*found), config.objective.screen is not None
    images = [
        screen.error_panel(axes, error, scale, pixels) for axes, error in zip(places[1:], found, strict=True)
    ]  # fmt: skip
    for axes, row, error in zip(places[1:], rows, found, strict=True):
        words = f"at worst {screen.number(float(np.nanmax(error)))}"
        screen.title(axes, "The best, a warp in each" if row.warped else "The best without warps", words)
    place = left + (1 + len(rows)) * (width + gap) + 0.02, top, height
    screen.bar_beside(figure, images[0], place, objective_of(config).name, pixels)
    return figure

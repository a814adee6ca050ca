"""AT09's Figure 3, complete: error in the side view, shadow map and close view, at theta = 90, 60 and 30 degrees.

    python experiments/figure3.py --image docs/images/figure3.png

n = 1, f = 100, phi = 30 degrees as there; 25 copies of a hand stand where there were 25 dragons. All four warps are
fitted to the same receivers, what the camera sees; ours minimises the expected offset of a shadow's edge ("band"),
which needs no edges. The close view is at the place where all four together are worst.
"""

import argparse
from pathlib import Path

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm
from pixels_scenes import model_grid

from warpopt import theory
from warpopt.app.common import figure_style as style
from warpopt.frames import LitScene, Reading, measured, see
from warpopt.frames.fits import Fitting
from warpopt.frames.pictures import map_picture, painted, worst_places, wrong_pixels
from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation

THETAS = (90, 60, 30)
WARPS = {"none": "SSM", "lispsm": "LiSPSM", "tsm": "TSM", "band": "ours (band)"}
NEAR, FAR, HALF_FOV = 1.0, 100.0, np.pi / 6
SCALE, EYE = 3.6, np.array([0.0, 7.0, 48.0])  # hands 7.2 high and 18 apart
CELL, GAP, LEFT, TOP = 2.0, 0.09, 0.52, 0.42  # inches
SIDE = (CELL - GAP) / 2


def side_view(fitting: Fitting, eta: float, side: tuple[int, int] = (150, 300)) -> np.ndarray:
    """E_pxq at each point of the view frustum's section x = 0, in pixels per texel squared; NaN outside of it."""
    view = fitting.view("depth")
    frame, footprint = view.frame(), view.footprint()
    y, z = np.meshgrid(
        np.linspace(1, -1, side[0]) * FAR * np.tan(HALF_FOV), np.linspace(0, FAR, side[1]), indexing="ij"
    )
    inside = (np.abs(y) <= z * np.tan(HALF_FOV)) & (z >= NEAR)
    z = np.where(inside, z, 1)
    axis = np.asarray(frame.z_axis)
    mu = float(footprint.mu)
    blend = (1 - eta) * (y * axis[1] + z * axis[2] - float(footprint.start)) / mu + eta
    width = float(sum(footprint.half_widths(eta)))
    e_p, e_q = theory.errors(blend, eta, float(frame.density_p) * mu / z, float(frame.density_q) * width / z)
    return np.where(inside & (blend > 0), e_p * e_q, np.nan)


@style.shared_style()
def drawn(width: int = 640, texels: int = 512) -> tuple[object, dict]:
    """The figure, and what was measured."""
    scene = model_grid("hand.glb")
    triangles = scene.triangles * SCALE
    turn = orientation(np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), "right")
    camera = SceneCamera(EYE, turn, NEAR, FAR, centred_window(HALF_FOV, 1.6))
    figure = style.new_figure(LEFT + 4 * (CELL + 2 * GAP) + 0.62, TOP + 3 * (CELL / 2 + SIDE + 0.36))
    told, image = {}, None
    for row, theta in enumerate(THETAS):
        angle = np.deg2rad(theta)
        lit = LitScene(triangles, np.array([0, -np.sin(angle), -np.cos(angle)]))
        frame = see(lit, camera, round(width / 1.6), width)
        fitting = Fitting(lit, frame, (texels, texels))
        made = {name: fitting.fitted(name) for name in WARPS}
        shown = {name: fitting.map_of(each).visibility(frame, Reading()) for name, each in made.items()}
        window = max(width // 9, 12)
        wrong = np.sum([wrong_pixels(frame, each) for each in shown.values()], 0)
        ((first, left), *_) = worst_places(wrong, (window, window), 1)
        top = TOP + row * (CELL / 2 + SIDE + 0.36)
        for column, (name, title) in enumerate(WARPS.items()):
            x = LEFT + column * (CELL + 2 * GAP)
            share = measured(frame, fitting.map_of(made[name])).wrong
            told[theta, name] = share
            axes = style.place(figure, x, top, CELL, CELL / 2)
            image = axes.imshow(side_view(fitting, made[name].eta), norm=LogNorm(5**-3, 5**4), cmap=colormaps["turbo"],
                                aspect="auto", extent=(0, FAR, -1, 1))  # fmt: skip
            bare(axes)
            axes.set_frame_on(False)
            if row == 0:
                style.beside(axes, title, (0.5, 1), (0, 12), fontsize=10, fontweight="bold")
            words = f"η = {made[name].eta:.3g}, {100 * share:.2f} % wrong"
            style.beside(axes, words, (0, 0), (2, 5), ha="left", color=style.MUTED, fontsize=7.5)
            if column == 0:
                style.beside(axes, f"θ = {theta}°", (0, 0), (-22, 0), rotation=90, fontsize=10, fontweight="bold")
            axes = style.place(figure, x, top + CELL / 2 + GAP, SIDE, SIDE)
            depth = map_picture(fitting.map_of(made[name]), 384)
            axes.imshow(np.where(np.isnan(depth), 1.0, 0.12 + 0.75 * depth), cmap="gray", vmin=0, vmax=1, aspect="auto")
            bare(axes)
            axes = style.place(figure, x + SIDE + GAP, top + CELL / 2 + GAP, SIDE, SIDE)
            picture = painted(lit, frame, shown[name])
            axes.imshow(picture[first : first + window, left : left + window], interpolation="nearest", aspect="auto")
            bare(axes)
    bar = style.place(figure, LEFT + 4 * (CELL + 2 * GAP) + 0.02, TOP, 0.11, CELL)
    figure.colorbar(image, cax=bar)
    powers = range(-3, 5)
    bar.set_yticks([5.0**k for k in powers], [f"$5^{{{k}}}$" for k in powers])
    bar.set_yticks([], minor=True)
    style.beside(bar, r"$E_{p\times q}$", (0.5, 1), (0, 10))
    return figure, told


def bare(axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--image", type=Path, default=Path("figure3.png"))
    parser.add_argument("--short", action="store_true", help="a small picture")
    asked = parser.parse_args(arguments)
    figure, told = drawn(*((96, 64) if asked.short else ()))
    figure.savefig(asked.image, dpi=110, pil_kwargs={"optimize": True})
    for (theta, name), share in told.items():
        print(f"theta {theta}, {WARPS[name]}: {100 * share:.3f} % wrong")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""What `warpopt cascades` says of a frustum for every number of maps: splits' errors, and texels."""

import dataclasses

import numpy as np

import warpopt
from warpopt.cascades.counts import in_world

from ..common.settings import ConfigError
from ..splits.plans import split_of
from .rows import objective_of
from .settings import CascadesConfig, SceneCascadesConfig

MOST = 8  # maps, of splits, and in the report
_ANGLES = (90.0, 60.0, 30.0, 10.0)


@dataclasses.dataclass(frozen=True)
class ByNumber:
    """One scheme's error over the best of as many warped maps: by number of maps, warped and not."""

    name: str
    warped: dict[int, float]
    plain: dict[int, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Texels:
    """Texels over the bound, for 1 to 16 maps, warped and not.

    Attributes:
        theta_deg: the angle between light and view direction.
        price: of one more map, over the bound.
        camera, light: their numbers; 0 for a frustum.
    """

    theta_deg: float
    warped: np.ndarray
    plain: np.ndarray
    price: float = 0.0
    camera: int = 0
    light: int = 0

    def best_number(self, warped: bool) -> int:
        """The number of maps that needs least, with the price of each."""
        values = self.warped if warped else self.plain
        return int(np.argmin(values + self.price * np.arange(1, len(values) + 1))) + 1


def frustum_view(config: CascadesConfig, theta_deg: float | None = None) -> "warpopt.FrustumView":
    """The configuration's view, or at another angle."""
    frustum = warpopt.ViewFrustum(config.view.near, config.view.far, np.deg2rad(config.view.half_fov_deg))
    theta = config.light.theta_deg if theta_deg is None else theta_deg
    return warpopt.FrustumView(frustum, np.deg2rad(theta))


def errors_by_number(config: CascadesConfig) -> list[ByNumber]:
    """Every scheme's error over the best, for 1 to `MOST` maps; none for means, and for maps of unequal resolution.

    Over a whole frustum a split's largest error is that of its longest cascade in far/near, and the same as that of a
    frustum of that ratio (docs/cascades.md): all are solved in one call.
    """
    asked, objective = config.cascades, objective_of(config)
    if asked.shares is not None or not objective.supremum:
        return []
    near, far = config.view.near, config.view.far
    band = np.log1p(-asked.overlap)
    counts = np.arange(1, MOST + 1)
    longest = {("", k): np.exp((np.log1p((far - near) / near) - (k - 1) * band) / k) for k in counts.tolist()}
    for name in asked.beside:
        for k in counts.tolist():
            made = split_of(name, near, far, k)
            if made is not None:
                starts = np.append(made[:1], np.maximum(made[1:-1] * (1 - asked.overlap), made[0]))
                longest[name, k] = (made[1:] / starts).max()
    ratios = np.array(list(longest.values()))
    ones = np.ones_like(ratios)
    frustum = warpopt.ViewFrustum(ones, ratios, np.deg2rad(config.view.half_fov_deg))
    view = warpopt.FrustumView(frustum, np.deg2rad(config.light.theta_deg))
    whole = np.stack([ones, ratios], -1)
    values = {}
    for warp in (True, False):
        told = warpopt.cascades.errors(view, whole, objective, warp=warp)
        values[warp] = dict(zip(longest, np.asarray(told.value).tolist(), strict=True))

    def over_best(name: str, warp: bool) -> dict[int, float]:
        best = values[asked.warp]
        return {k: v / best["", k] for (n, k), v in values[warp].items() if n == name}

    names = [name for name in asked.beside if any((name, k) in longest for k in counts.tolist())]
    return [ByNumber(name, over_best(name, True) if asked.warp else {}, over_best(name, False)) for name in names]


def texels(config: CascadesConfig) -> list[Texels]:
    """Texels for one per pixel with logarithmic splits, divided by the lower bound: at the view's angle and others."""
    price = config.cascades.price or 0.0
    angles = sorted({*_ANGLES, config.light.theta_deg}, reverse=True)
    views = {angle: frustum_view(config, angle) for angle in angles}
    return [Texels(angle, *_over_the_bound(view, in_world(view)), price) for angle, view in views.items()]


def texels_of_scene(config: SceneCascadesConfig, views: "dict[tuple[int, int], warpopt.SceneView]") -> list[Texels]:
    """The same over a scene's receivers, for each (camera, light); none if no price is given.

    Raises:
        ConfigError: receivers for which no bound is known, or that do not end.
    """
    if config.cascades.price is None:
        return []
    made = []
    for (camera, light), view in views.items():
        theta = float(np.rad2deg(view.frame_along("view").theta))
        try:
            values = _over_the_bound(view, view)
        except ValueError as error:
            raise ConfigError(f"cascades.price: {error}") from None
        made.append(Texels(theta, *values, config.cascades.price, camera, light))
    return made


def _over_the_bound(
    view: "warpopt.FrustumView | warpopt.SceneView", scene: "warpopt.SceneView"
) -> tuple[np.ndarray, np.ndarray]:
    bound = warpopt.lower_bound(scene, warpopt.Objective("storage"))
    warped, plain = (np.asarray(warpopt.cascades.count(view, warp=warp)[1]) for warp in (True, False))
    return warped / bound, plain / bound

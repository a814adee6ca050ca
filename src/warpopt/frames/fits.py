"""Warps by name, fitted to a frame: published and engines' rules, optima of objectives, and the best of a scan."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from .._words import one_of
from ..compare.compare_rules import compare_rules
from ..compare.comparison import Comparison
from ..objective import Objective
from ..receivers.bodies.convex_body import ConvexBody
from ..receivers.depth_buffer import DepthBuffer
from ..receivers.receivers import Receivers
from ..receivers.weighted.weights import EdgeWeights
from ..render.edge_weights import edge_weights
from ..render.shadow_matrix import shadow_matrix
from ..solve.optimal_warp import optimal_warp
from ..theory.camera import DirectionalLight, camera_of
from ..theory.warp import Warp
from ..views import SceneView
from .light_rays import LitScene
from .measure import measured
from .names import objective_of, turn_of
from .seen import Frame
from .shadow_map import Reading, ShadowMap

Fit = Literal["receivers", "engine"]
SCAN = tuple(np.geomspace(1, 1e-3, 25).tolist())
"""The eta of a scan: a factor of 1.33 from one to the next, over which an error changes by less than its noise."""
_MASK = 512  # side of the unwarped map in which edges are found
_SCAN_SEED, _FRESH_SEED = 101, 202  # of the grid shifts: what chooses the best eta does not also judge it


@dataclasses.dataclass(frozen=True, eq=False)
class Fitted:
    """One warp, fitted to a frame.

    Attributes:
        name: of the rule or objective.
        eta: of the warp over the receivers that it was fitted to.
        matrix: (4, 4) world to clip space, OpenGL's convention, for column vectors.
        defined: False where a rule gives no warp; eta is then 1.
        size: texels along (t, s), if the map has an aspect of its own; at as many texels, up to rounding.
        promised: for a turned warp, the factor by which its objective is less than along the view.
    """

    name: str
    eta: float
    matrix: Float[np.ndarray, "4 4"]
    defined: bool = True
    size: tuple[int, int] | None = None
    promised: float | None = None


class Fitting:
    """The views that fit warps to one frame; each is made once, when it is needed.

    Args:
        scene, frame: what casts shadows and what is seen.
        size: texels along (t, s).
        fit: "receivers", the frame's depth buffer; "engine", the view frustum cut by the scene's box, for rules, "none"
            and norms inf. Means over receivers ("edge", "band", norms L_P) are of the depth buffer in both.

    Raises:
        ValueError: an unknown fit, or a frame that sees nothing.

    Attributes:
        best_splits: of cascades, by their number, objective and whether each is warped: found once.
    """

    def __init__(
        self,
        scene: LitScene,
        frame: Frame,
        size: tuple[int, int],
        fit: Fit = "receivers",
        turn_only_if: float = 1.1,
    ):
        one_of("fit", fit, ("receivers", "engine"))
        if not np.isfinite(frame.depth).any():
            raise ValueError("frame: got only background, expected a surface that the camera sees")
        self.scene, self.frame, self.size, self.fit = scene, frame, size, fit
        self.turn_only_if = turn_only_if
        self._camera = camera_of(frame.camera)
        self._views: dict[str, SceneView] = {}
        self._every_rule: Comparison | None = None
        self.best_splits: dict[tuple[int, str, bool], np.ndarray] = {}

    def view(self, kind: str) -> SceneView:
        """The view with receivers "plain" (by `fit`), "depth" (the depth buffer), "edge" or "band" (with weights)."""
        if kind not in self._views:
            depth = self.frame.depth
            if kind == "plain" and self.fit == "engine":
                receivers: Receivers = ConvexBody.box(*self.scene.corners)
            elif kind == "edge":
                receivers = DepthBuffer(depth, weights=edges_in_map(self.scene, self.frame, self._unwarped()))
            elif kind == "band":
                receivers = DepthBuffer(depth, weights="depth", lit=self.frame.judged)
            else:
                receivers = DepthBuffer(depth)
            height, width = depth.shape
            made = SceneView(
                self._camera, DirectionalLight(self.scene.axes[2]), receivers, screen=(width, height),
                shadow_map=self.size,
            )  # fmt: skip
            self._views[kind] = made if kind in ("edge", "band") else made.reduced()
        return self._views[kind]

    def fitted(self, name: str, eta: float | None = None) -> Fitted:
        """A warp by name; with `eta`, that of this eta over the receivers.

        Raises:
            ValueError: an unknown name; "best", which needs `scan`.
        """
        objective = objective_of(name)
        plain = self.view("plain")
        if eta is not None:
            return self._of(name, plain, Warp.from_eta(eta, plain.footprint()))
        if name == "none":
            return self._of(name, plain, Warp.from_eta(1.0, plain.footprint()))
        if objective is None:
            if self._every_rule is None:  # together they are one program, whatever the names that are asked for
                self._every_rule = compare_rules(plain)
            k = self._every_rule.names.index(name)
            warp = Warp.from_eta(float(self._every_rule.eta[k, 0]), plain.footprint())
            return self._of(name, plain, warp, bool(self._every_rule.defined[k, 0]))
        prefix, rest = turn_of(name)
        if prefix:
            return self._turned(name, rest, objective, prefix == "shaped-")
        if objective.supremum:
            return self._of(name, plain, optimal_warp(plain, objective, throw=False).warp)
        kind = name if name in ("edge", "band") else "depth"
        weighted = self.view(kind) if kind != "depth" else self.uniform()
        solution = optimal_warp(weighted, objective, throw=False)
        return self._of(name, self.view("depth"), solution.warp)

    def _turned(self, name: str, kind: str, objective: Objective, shaped: bool) -> Fitted:
        straight = self.view(kind) if kind in ("edge", "band") else self.uniform()
        view = SceneView(
            straight.camera, straight.light, straight.receivers, screen=straight.screen, shadow_map=straight.shadow_map,
            warp_direction="best", map_aspect="best" if shaped and objective.kernel is not None else 1.0,
            turn_only_if=self.turn_only_if,
        )  # fmt: skip
        solution = optimal_warp(view, objective, throw=False)
        matrix = np.asarray(shadow_matrix(view, solution, casters=self.scene.corners_all), float)
        size = of_aspect(self.size, float(solution.shares[0])) if shaped else None
        gain = float(solution.unturned / solution.value) if solution.value > 0 else 1.0
        return Fitted(name, float(solution.warp.eta), matrix, size=size, promised=gain)

    def _of(self, name: str, view: SceneView, warp: Warp, defined: bool = True) -> Fitted:
        matrix = shadow_matrix(view, warp, casters=self.scene.corners_all)
        return Fitted(name, float(warp.eta), np.asarray(matrix, float), defined)

    def uniform(self) -> SceneView:
        """The depth buffer as it is, not reduced: for norms L_P."""
        if "uniform" not in self._views:
            height, width = self.frame.depth.shape
            self._views["uniform"] = SceneView(
                self._camera, DirectionalLight(self.scene.axes[2]), DepthBuffer(self.frame.depth),
                screen=(width, height), shadow_map=self.size,
            )  # fmt: skip
        return self._views["uniform"]

    def _unwarped(self) -> Fitted:
        depth = self.view("depth")
        return self._of("none", depth, Warp.from_eta(1.0, depth.footprint()))

    def scan(self, reading: Reading, etas: tuple[float, ...] = SCAN) -> tuple[Fitted, Float[np.ndarray, " E"]]:
        """(the warp of the eta with the least error, the errors of all): over the depth buffer's receivers.

        The error that chooses comes from grid shifts of its own, so that the chosen one's own error, measured with
        others, is not the luckiest of many.
        """
        view = self.view("depth")
        footprint = view.footprint()
        made = [self._of("best", view, Warp.from_eta(eta, footprint)) for eta in etas]
        errors = np.array(
            [measured(self.frame, self.map_of(each), reading, _SCAN_SEED).wrong for each in made]
        )  # fmt: skip
        return made[int(np.argmin(np.where(np.isfinite(errors), errors, np.inf)))], errors

    def whole(self, objective: Objective | None) -> SceneView:
        """What the frame's maps must hold, not reduced: by `fit` for norms inf and no warp, else the depth buffer."""
        if self.fit == "engine" and (objective is None or objective.supremum):
            plain = self.view("depth")
            return SceneView(plain.camera, plain.light, ConvexBody.box(*self.scene.corners), screen=plain.screen)
        return self.uniform()

    def map_of(self, fitted: Fitted) -> ShadowMap:
        """The shadow map rendered with a fitted matrix."""
        return ShadowMap(self.scene, fitted.matrix, fitted.size or self.size)

    def error(self, fitted: Fitted, reading: Reading):
        """The frame's `Verdict` under a fitted warp."""
        return measured(self.frame, self.map_of(fitted), reading, _FRESH_SEED)


def of_aspect(size: tuple[int, int], share: float) -> tuple[int, int]:
    """(across, along): `share` times as many texels across, and as many in all, up to rounding."""
    across = max(1, round(size[0] * share))
    return across, max(1, round(size[0] * size[1] / across))


def edges_in_map(scene: LitScene, frame: Frame, unwarped: Fitted) -> EdgeWeights:
    """Judged pixels beside a shadow's edge in an unwarped map of the same frame, of 512 x 512 texels."""
    shown = ShadowMap(scene, unwarped.matrix, (_MASK, _MASK)).visibility(frame, Reading())
    judged = DepthBuffer(np.where(frame.judged, frame.depth, np.inf))
    return edge_weights(frame.image(shown > 0.5, False), judged, camera_of(frame.camera))

"""Results of a solve."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from .._checks import checked, floats_of, is_traced, points_of
from .._words import shown
from ..objective import Metric
from ..receivers.footprint import Footprint
from ..theory.aliasing import aggregate, errors
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from ..theory.warp import Warp
from ..views import SceneView
from .outcome import Outcome, failed, failed_on_host


class Solution(eqx.Module):
    """An optimal warp over a view frustum with its certificate. Accepted wherever a warp is.

    Attributes:
        warp: the optimal `Warp` (eta, lam, mu).
        value: the minimal norm.
        result: array of `Outcome`, the condition that fixed the optimum or the reason for failure.
        residual: residual of the equation that fixed eta: |log P+ - log P-| of the stationarity condition, or the
            relative gap of the tie; 0 for a kink or no warp. Where the optimum is stationary, the condition changes
            sign once and its slope in log(eta) is at least 1 (moments, L-inf), so log(eta) differs from the global
            optimum by at most the residual plus its rounding.

    Example:
        >>> import warpopt
        >>> solution = warpopt.optimal_warp(warpopt.FrustumView(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 0.0))
        >>> warpopt.Outcome(int(solution.result)).name, float(solution.warp.eta), float(solution.residual)
        ('no_warp', 1.0, 0.0)
    """

    warp: Warp
    value: Float[Array, "..."]
    result: Int[Array, "..."]
    residual: Float[Array, "..."]


class SceneSolution(eqx.Module):
    """An optimal warp for a scene, with the data needed to render with it. Accepted wherever a warp is.

    Attributes:
        warp: the optimal `Warp`; its lam and mu are lengths along W's axis, over the receivers.
        value: the minimal norm, in the units of `LightFrame`'s densities; 0 for no receivers, and 0 for E_p with
            receivers at one depth.
        result: an `Outcome`.
        residual: as `Solution.residual`.
        margin: d log(norm) / d log(eta) just below eta = 1. A warp helps iff it is positive; its size says by how much.
            0 where there is nothing to warp (flat, empty).
        unwarped: the norm without a warp.
        excess: bound on the regret due to conservative grouping of many points or pixels: `value` over a lower bound of
            the minimum for the individual receivers, minus 1. 0 where nothing is grouped, inf where that bound is 0,
            NaN where receivers are grouped in a map of free lateral fit.
        gap: `value` over a lower bound of the norm for all eta in [min_eta, 1], minus 1, for a mean of "max", "edge" or
            "band", which may have several local minima, and inf where nothing is proved; 0 for all other norms, which
            are proved to have one.
        frame: W's axes.
        footprint: the receivers' extents.
        direction: (3,) world unit vector of W's axis, across the light.
        shares: what the map's texels along (t, s) are multiplied by for its aspect, at as many texels.
        unturned: where the direction was searched, the minimal norm of a map along the view; else `value`.
        directions: how many directions were compared, of which the last refine the best of 32 even ones; `value` is the
            global minimum in eta along the chosen one, and the least of those compared.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> solution = warpopt.optimal_warp(warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0))))
        >>> near, far = camera.to_eye([(0.0, 0.0, -1.0), (0.0, 0.0, -100.0)])
        >>> [round(float(solution.aliasing_error(point)), 2) for point in (near, far)]   # a tie: the optimum
        [17.15, 17.15]
    """

    warp: Warp
    value: Float[Array, ""]
    result: Int[Array, ""]
    residual: Float[Array, ""]
    margin: Float[Array, ""]
    unwarped: Float[Array, ""]
    excess: Float[Array, ""]
    gap: Float[Array, ""]
    frame: LightFrame
    footprint: Footprint
    direction: Float[Array, "3"]
    shares: Float[Array, "2"]
    unturned: Float[Array, ""]
    directions: Int[Array, ""]

    def coordinates(
        self, eye_points: Float[Array | np.ndarray, "... 3"]
    ) -> tuple[LightDepth, Float[Array, "..."], Float[Array, "..."]]:
        """(depth as delta and 1 - delta, x from W's axis, eye depth z) of points in eye coordinates.

        Args:
            eye_points: (..., 3), as of `Camera.to_eye`.

        Returns:
            A `LightDepth`, x and z, each (...).

        Raises:
            ValueError: another shape.
        """
        return self.footprint.coordinates(self.frame, points_of(self.footprint.mu.dtype, "eye_points", eye_points))

    def aliasing_error(
        self, eye_points: Float[Array | np.ndarray, "... 3"], metric: str | Metric = "p", eta: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """E at points in eye coordinates (`Camera.to_eye`), for the optimal warp or any other eta.

        E_p = density_p mu A^2 / (z eta), E_q = density_q width A / z: AT09 (13), (14) along W's axes.

        Args:
            eye_points: (..., 3).
            metric: "p", "q", "pxq", "max", "edge", "band" or a `Metric`.
            eta: in (0, 1], a number.

        Returns:
            (...), in pixels per texel if the view has resolutions, else in the units of `theory.aliasing_error`.

        Raises:
            ValueError: an unknown metric, or eta outside (0, 1].
        """
        if eta is None:
            eta = self.warp.eta
        else:
            (eta,) = floats_of(self.warp.eta.dtype, eta=eta)
            if eta.shape:
                raise ValueError(f"eta: got shape {eta.shape}, expected one number; use jax.vmap over more")
            eta = checked("eta", eta, lambda v: (v > 0) & (v <= 1), "a number in (0, 1]")
        depth, x, z = self.coordinates(eye_points)
        along = self.frame.density_p * self.footprint.mu / z
        across = self.frame.density_q * sum(self.footprint.half_widths(eta)) / z
        blend = depth.blend(eta)
        shear = self.footprint.lateral_fit(eta).shear(depth, x, eta)
        sigma = jnp.abs(shear) * self.frame.pixel_ratio / self.footprint.mu
        return aggregate(metric, *errors(blend, eta, along, across), sigma)


def warp_of(warp: Warp | Solution | SceneSolution) -> Warp:
    """The warp, or the solution's.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(warp, Solution | SceneSolution):
        return warp.warp
    if not isinstance(warp, Warp):
        raise ValueError(f"warp: got {shown(warp)}, expected a warpopt.Warp or a solution")
    return warp


def placed(view: SceneView, warp: "Warp | Solution | SceneSolution") -> tuple[SceneView, Warp]:
    """(the view, with a solution's direction and aspect where these were searched; the warp).

    Raises:
        ValueError: no warp and no solution.
    """
    if view.searched and isinstance(warp, SceneSolution):
        view = view.along(warp)
    return view, warp_of(warp)


def raised(solution: Solution | SceneSolution) -> Solution | SceneSolution:
    """The solution, if every problem was solved.

    Raises:
        RuntimeError: some failed (`equinox.EquinoxRuntimeError` when traced; use what is returned).
    """
    traced = is_traced(solution.result)
    bad = failed(solution.result) if traced else failed_on_host(solution.result)
    words = "optimal_warp failed; pass throw=False to get the solution's result, an array of warpopt.Outcome"
    if traced:
        return eqx.error_if(solution, bad, words)
    if bool(bad.any()):
        first = Outcome(int(np.asarray(solution.result)[bad].flat[0]))
        raise RuntimeError(f"{int(bad.sum())} of {bad.size} problems failed, the first: {first.sentence} ({words})")
    return solution

"""The optimal warp, and the norm of any warp, for a view and an objective."""

from collections.abc import Sequence
from typing import overload

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._checks import checked, float_arrays, joint_shape
from .._words import flag, one_of, shown, whole_number
from ..objective import Objective, objective_or_default
from ..theory.warp import Warp, refuse_lost
from ..views import FrustumView, SceneView, refuse_other
from .chunks import in_blocks
from .frusta import Method, norms_over_frusta, solve_and_compare, solve_frusta
from .scene import norms_over_scene, settled_scene, solve_scene
from .solution import SceneSolution, Solution, placed, raised, warp_of

_MOST_NODES = 10_000  # Gauss nodes come from the eigenvalues of a matrix of their number


@overload
def optimal_warp(
    view: FrustumView,
    objective: Objective | None = None,
    *,
    throw: bool = True,
    min_eta: ArrayLike = 1e-4,
    method: str = "auto",
    quadrature_nodes: int | None = None,
) -> Solution: ...
@overload
def optimal_warp(
    view: SceneView, objective: Objective | None = None, *, throw: bool = True, min_eta: ArrayLike = 1e-4,
    previous: SceneSolution | None = None,
) -> SceneSolution: ...  # fmt: skip
def optimal_warp(
    view: FrustumView | SceneView,
    objective: Objective | None = None,
    *,
    throw: bool = True,
    min_eta: ArrayLike = 1e-4,
    method: str = "auto",
    quadrature_nodes: int | None = None,
    previous: SceneSolution | None = None,
) -> Solution | SceneSolution:
    """The warp that minimises the norm of an aliasing error over the receivers; the global minimum.

    Args:
        view: a `FrustumView`, of any shape, or a `SceneView`; use `jax.vmap` for several scenes (with `throw=False`).
        objective: E_p in L-inf if None. Over a frustum a single product of E_p and E_q; over a scene
            (2 alpha + beta) order must be an integer.
        throw: raise if any problem failed; otherwise see the solution's `result`.
        min_eta: over a scene, the smallest eta, for metrics without E_p, whose infimum may be at eta = 0
            (`Outcome.unbounded`). A whole frustum has no such case.
        method: over a frustum, "auto" uses a closed form if there is one; "iterative" forces the root finder
            everywhere.
        quadrature_nodes: over a frustum, nodes over the depth for norms whose M = (2 alpha + beta) order is not an
            integer, which are integrated numerically (default: 64, and more for large orders, whose integrands have
            sharp peaks; above an order of about 100 pass more, or the outcome is `inaccurate`). If given, it forces
            quadrature for every L_P norm.
        previous: over a scene with `warp_direction="steady"`, the last frame's solution: a map without a warp keeps
            its axes unless others are better by 1 %.

    Returns:
        A `Solution` of the view's shape over a `FrustumView`; a `SceneSolution` over a `SceneView`.

    Raises:
        ValueError: bad arguments, or a norm whose optimum could not be certified.
        RuntimeError: a failed solve, with `throw` (`equinox.EquinoxRuntimeError` when traced).

    No receivers, receivers at one depth, and a light along the view are outcomes, not errors. Derivatives (jvp, grad)
    of eta, lam and value are implicit, through the root, tie or kink that fixed eta; zero where eta is clamped to 1.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236)
        >>> solution = warpopt.optimal_warp(warpopt.FrustumView(frustum, 1.5707963))
        >>> round(float(solution.warp.lam), 3)   # n + sqrt(f n), LiSPSM's
        11.0
    """
    refuse_other(view)
    objective = objective_or_default(objective)
    flag("throw", throw)
    how, min_eta = _checked_method(method, quadrature_nodes), checked_min_eta(min_eta)
    steady = isinstance(view, SceneView) and view.warp_direction == "steady"
    if previous is not None and not (steady and isinstance(previous, SceneSolution)):
        raise ValueError(
            f"previous: got {shown(previous)}, expected None, or a SceneSolution with a SceneView of direction 'steady'"
        )
    if isinstance(view, FrustumView):
        objective.metric  # noqa: B018, raises: one term
        solution = in_blocks(solve_frusta, (view.frustum, view.theta), objective, how)
    else:
        if how != Method():
            raise ValueError(
                f"method, quadrature_nodes: got {method!r}, {quadrature_nodes!r}, expected the defaults for a scene"
            )
        before = None if previous is None else previous.direction
        solution = solve_scene(settled_scene(view, objective), objective, min_eta, before)
    return raised(solution) if throw else solution


def error_norm(
    view: FrustumView | SceneView,
    warp: Warp | Solution | SceneSolution,
    objective: Objective | None = None,
    *,
    quadrature_nodes: int | None = None,
) -> Float[Array, "..."]:
    """The norm of an aliasing error over the receivers, for any warp: the quantity that `optimal_warp` minimises.

    Args:
        view, objective, quadrature_nodes: as for `optimal_warp`.
        warp: of any shape; over a frustum it must broadcast with the view. A warp made for another body keeps its
            apex: see `Warp.over`.

    Returns:
        The norm, of the joint shape of view and warp.

    Raises:
        ValueError: as `optimal_warp`, or an apex that is not before the receivers (NaN when traced).

    Example:
        >>> import warpopt
        >>> view = warpopt.FrustumView(warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5236), 1.5707963)
        >>> unwarped = warpopt.error_norm(view, warpopt.Warp.from_eta(1.0, view))
        >>> round(float(unwarped / warpopt.optimal_warp(view).value), 2)
        10.0
    """
    refuse_other(view)
    if isinstance(view, SceneView):
        view, warp = placed(view, warp)
    warp = warp_of(warp)
    objective = objective_or_default(objective)
    how = _checked_method("auto", quadrature_nodes)
    if isinstance(view, FrustumView):
        objective.metric  # noqa: B018, raises: one term
        joint_shape(frustum=view.frustum.near, theta=view.theta, warp=warp.eta)
        values, lost = in_blocks(norms_over_frusta, (view.frustum, view.theta, warp), objective, how)
    else:
        if how != Method():
            raise ValueError(f"quadrature_nodes: got {quadrature_nodes!r}, expected None for a scene")
        values, lost = norms_over_scene(settled_scene(view, objective), warp, objective)
    refuse_lost(lost)
    return values


def optimum_and_norms(
    view: FrustumView, etas: Sequence[Float[Array, "..."]], objective: Objective
) -> tuple[Solution, list[Float[Array, "..."]]]:
    """The optima over frusta, and the norms of other warps over V for each, in one call that shares their common work.

    Args:
        view: of any shape.
        etas: one array per warp, of shapes that broadcast with the view's.
        objective: as for `optimal_warp`. `Solution.result` reports failed solves.
    """
    return in_blocks(solve_and_compare, (view.frustum, view.theta, list(etas)), objective)


def checked_min_eta(min_eta: ArrayLike) -> Array | np.ndarray:
    """The lower limit of eta as an array.

    Raises:
        ValueError: not a number in (0, 1).
    """
    if isinstance(min_eta, float) and 0 < min_eta < 1:  # the common case, without work on the device
        return np.asarray(min_eta)
    (value,) = float_arrays(min_eta=min_eta)
    if value.shape:
        raise ValueError(f"min_eta: got shape {value.shape}, expected one number")
    return checked("min_eta", value, lambda v: (v > 0) & (v < 1), "a number in (0, 1)")


def _checked_method(method: str, nodes: int | None) -> Method:
    one_of("method", method, ("auto", "iterative"))
    if nodes is not None:
        whole_number("quadrature_nodes", nodes, 2, _MOST_NODES, ", or None")
    return Method(method == "iterative", nodes)

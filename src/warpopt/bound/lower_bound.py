"""The least norm of any map of the depth along Z_w, perspective or not, and the map that attains it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import refuse_traced
from .._words import whole_number
from ..objective import Metric, Objective, objective_or_default
from ..receivers.answers import profile_of
from ..receivers.bins import BINS
from ..receivers.profiles.profile import DepthProfile
from ..solve.chunks import in_blocks
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightSpace
from ..views import FrustumView, SceneView, one_light, refuse_other
from .frustum import bound_frusta, storage_of_frusta
from .frustum_map import frustum_stretches
from .map import BoundMap, running

_KNOTS_OF_FRUSTUM, _KNOTS_OF_BODY = 96, 16
_MOST = 1_000_000  # knots or bins


def lower_bound(
    view: FrustumView | SceneView, objective: Objective | None = None, *, bins: int = BINS
) -> Float[Array, "..."] | float:
    """A lower bound: the least norm of any reparameterisation along Z_w, in `error_norm`'s units.

    For E_p (and its powers): any monotone map s(delta), for every norm and measure. For E_q in L-inf: any map width per
    delta that contains the receivers; over V the optimal warp attains it. For "max": the larger of the two, as slope
    and width can be chosen independently. For "storage": any number of maps of any kind, one sample per texel, in any
    directions ((T60) of docs/theory.md).

    Over a `FrustumView`: closed forms, except for L_P off the axis (integrals tabulated to 1e-12; NaN above f/n =
    7.9e13, where no L_P optimum is found either); differentiable in near, far, half_fov and theta, one-sided at
    theta = phi and where n b = f a. On the axis the bound of E_p is 0 for a light along the view.

    Over a `SceneView`: a number, computed in float64. For the whole frustum, bodies and histograms (a slab of the
    frustum per bin): exact in L-inf, by vertices; E_p in L_P by quadrature, to 1e-12 for f/n up to 1e4 and 2e-8 for
    1e12 (a histogram: 1e-7 while no bin spans a depth ratio above 30). For points and depth buffers: the best map that
    is linear, and of one width, within each bin of depth. Finitely many points would have the bound 0, with every
    texel row at a point: the bins stand for the surfaces between them. A warp, whose slope and width vary within a
    bin, can be up to 8 % below this (E_q: 4 %). 0 for no receivers, or a single depth. "storage" is exact over frusta,
    bodies and planes; over points and depth buffers it sums square cells 8 / bins of their depth wide, which count with
    their nearest receiver. An orthographic camera's screen sees all depths alike: "storage" is then the area that the
    receivers cover on the light plane (of points, in cells 8 / bins of the window's height wide), and E_p's bound in
    L-inf over a body is its error without a warp.

    Args:
        view: a `FrustumView` of any shape, or a `SceneView`.
        objective: E_p in L-inf if None.
        bins: number of depth bins for points and depth buffers.

    Returns:
        Over a `FrustumView` an array of its shape, over a `SceneView` a float.

    Raises:
        ValueError: bad arguments, a traced `SceneView`, or no bound is known: E_q in L_P, a product of E_p and E_q, or
            receivers of a kind that has no depth profile.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> view = warpopt.FrustumView(frustum, 1.5707963267948966)
        >>> round(float(warpopt.optimal_warp(view).value / lower_bound(view)), 2)
        2.15
    """
    refuse_other(view)
    objective = objective_or_default(objective)
    whole_number("bins", bins, 1, _MOST)
    if objective.no_bound_because:
        raise ValueError(f"objective: got {objective.title}, expected E_p in any norm, E_q in L-inf or storage: "
                         f"{objective.no_bound_because}")  # fmt: skip
    if isinstance(view, FrustumView):
        if objective.storage:
            return in_blocks(storage_of_frusta, (view.frustum, view.theta))
        objective.metric  # noqa: B018, raises: one term
        return in_blocks(bound_frusta, (view.frustum, view.theta), objective)
    if objective.storage:
        refuse_traced("lower bound over a scene", view)
        one_light(view, "call it for each").receivers.check(view.camera, view.light, objective)
        frame = _frame_ahead(view)  # areas do not depend on direction and aspect
        return float(frame.density_p * frame.density_q) * view.receivers.nearness(view.camera, frame, bins)
    frame, profile = _profile(view, objective, bins)
    values = []
    for metric in objective.terms:
        if metric.beta:
            values.append((float(frame.density_q) * profile.widest()) ** metric.beta)
        else:
            values.append(profile.stretches(objective.order * metric.alpha, parts=1).value ** metric.alpha)
    return max(values)


def lower_bound_map(
    view: FrustumView | SceneView,
    objective: Objective | None = None,
    *,
    knots: int | None = None,
    bins: int = BINS,
) -> BoundMap:
    """The map that attains `lower_bound` of E_p; in float64 whatever JAX's dtype.

    Args:
        view: one frustum and one light, or a scene.
        objective: of E_p, in L-inf if None.
        knots: over a frustum, the least number on each of its three parts (segments of V at one depth growing, longest,
            shrinking; 96 if None); over bodies, for each stretch between the depths of two vertices (16 if None).
        bins: for points and depth buffers: the map is linear within each bin.

    Returns:
        A `BoundMap`.

    Raises:
        ValueError: bad arguments, a traced view; no receivers, or all at one depth.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> best = lower_bound_map(warpopt.FrustumView(frustum, 1.5707963267948966))   # the logarithm of z
        >>> round(float(best(9 / 99)), 4)   # z = 10
        0.5
    """
    refuse_other(view)
    objective = objective_or_default(objective)
    whole_number("bins", bins, 1, _MOST)
    if objective.terms != (Metric(1, 0),):
        raise ValueError(f"objective: got {objective.title}, expected E_p")
    if knots is not None:
        whole_number("knots", knots, 2, _MOST, ", or None")
    if isinstance(view, FrustumView):
        refuse_traced("lower_bound_map", view)
        return _over_frustum(view, objective, knots or _KNOTS_OF_FRUSTUM)
    frame, profile = _profile(view, objective, bins)
    stretches = profile.stretches(objective.order, knots or _KNOTS_OF_BODY)
    if not stretches.value > 0:
        raise ValueError("receivers: got none, or all at one depth, expected receivers at more than one")
    delta, s = running(np.diff(stretches.at), stretches.shares)
    return BoundMap(
        delta,
        s,
        value=stretches.value,
        start=float(stretches.at[0]),
        mu=float(stretches.at[-1] - stretches.at[0]),
        density=float(frame.density_p),
        near=float(view.camera.near),
        far=float(view.camera.far),
        theta=float(frame.theta),
        order=objective.order,
        measure=objective.measure if len(view.receivers.measures) > 1 else "receivers",
    )


def _over_frustum(view: FrustumView, objective: Objective, knots: int) -> BoundMap:
    value = jnp.asarray(lower_bound(view, objective))
    if value.shape:
        raise ValueError(f"view: got shape {value.shape}, expected one frustum and one light")
    if not value > 0:
        raise ValueError(
            f"theta: got {float(view.theta)} with measure 'axis', expected receivers at more than one depth"
        )
    frustum, space = view.frustum, LightSpace(view.frustum, view.theta)
    delta, s = running(*frustum_stretches(space, objective, knots))
    return BoundMap(
        delta,
        s,
        value=float(value),
        start=float(space.start),
        mu=float(space.mu),
        density=float(1 / space.tan_phi),
        near=float(frustum.near),
        far=float(frustum.far),
        theta=float(view.theta),
        order=objective.order,
        measure=objective.measure,
    )


# Compiled: op by op, its many small operations take a hundred times as long.
@jax.jit
def _frame(view: SceneView) -> LightFrame:
    return view.frame()


@jax.jit
def _frame_ahead(view: SceneView) -> LightFrame:
    return view.frame_along("view")


def _profile(view: SceneView, objective: Objective, bins: int) -> tuple[LightFrame, DepthProfile]:
    refuse_traced("lower bound over a scene", view)
    one_light(view, "call it for each").receivers.check(view.camera, view.light, objective)
    frame = _frame(view)
    return frame, profile_of(view.receivers, view.camera, frame, objective, bins)

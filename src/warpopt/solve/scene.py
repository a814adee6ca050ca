"""One scene view: the receivers' footprint, eta and its certificate, in one compiled call."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..objective import MOST_MOMENTS, Objective
from ..receivers.footprint import Footprint
from ..theory.direction import shares_of
from ..theory.light_frame import LightFrame
from ..theory.warp import Warp
from ..views import SceneView, one_light, settled
from .directions import best_aspect, best_turn
from .footprint_optimum import LogNorm, minimise, no_warp
from .means.cell_bounds import excess_of_cells
from .means.sample_norm import SampleNorm
from .means.sample_optimum import minimise_mean
from .outcome import Outcome, failed
from .pieces import Optimum, value_at
from .scene_norm import log_norm_of
from .solution import SceneSolution


def settled_scene(view: SceneView, objective: Objective) -> SceneView:
    """The view, `settled` for a solve.

    Raises:
        ValueError: several lights, a measure that the receivers do not support, an order without moments, an answer of
            a user's receivers that none can have.
    """
    one_light(view)
    if view.warp_direction == "best" and not objective.in_any_direction:
        raise ValueError(
            f"warp_direction: got 'best' with {objective.title}, which does not compare maps of different directions, "
            "expected 'pxq', 'storage', 'edge' or 'band'"
        )
    if view.map_aspect is None and not objective.in_any_aspect:
        raise ValueError(
            f"map_aspect: got 'best' with {objective.title}, which a map of slivers minimises, expected 'max', 'edge' "
            "or 'band'"
        )
    if view.lateral == "free" and objective.kernel is not None:
        raise ValueError(
            f"lateral: got 'free' with {objective.title}, whose shear would change with the axis, expected 'eye', or a "
            "metric without shear"
        )
    if objective.over_receivers:
        return settled(view, objective)
    if objective.blend_degree != round(objective.blend_degree):
        raise ValueError(
            f"norm: got order {objective.order:g} over receivers, expected one with (2 alpha + beta) order an integer"
        )
    raise ValueError(
        f"norm: got order {objective.order:g} over receivers, expected (2 alpha + beta) order at most {MOST_MOMENTS}, "
        "or inf"
    )


LEAST_ETA = 1e-4
"""The smallest eta where nobody asks for another: for metrics whose infimum may be at 0."""

_AS_GOOD = 0.01  # of the error: axes that are this much worse are kept from the last frame


@functools.partial(jax.jit, static_argnames=("objective",))
def solve_scene(
    view: SceneView, objective: Objective, min_eta: ArrayLike = LEAST_ETA, previous: Float[Array, "3"] | None = None
) -> SceneSolution:
    """The optimum of one view; `previous` is the last frame's direction, for "steady"."""
    # One dtype, the camera's: a float64 limit would widen a loop's carry.
    min_eta = jnp.asarray(min_eta, view.camera.position.dtype)
    if view.warp_direction == "steady":
        return _steady(view, objective, min_eta, previous)
    if view.warp_direction != "best":
        return _solve_along(view, view.frame_along(view.warp_direction), objective, min_eta)
    ahead = view.frame_along("view")
    cosine, sine, count = best_turn(view, ahead, objective, min_eta)
    # Mapped, so that the solve is compiled once. The turned map is kept only if it is the better over the receivers
    # themselves, which the search saw as cells.
    both = jax.lax.map(
        lambda turn: _solve_along(view, ahead.turned(*turn), objective, min_eta),
        (jnp.stack([jnp.ones_like(cosine), cosine]), jnp.stack([jnp.zeros_like(sine), sine])),
    )
    kept, turned = (jax.tree.map(lambda v, i=i: v[i], both) for i in (0, 1))
    turn = (kept.value > view.turn_only_if * turned.value) & ~failed(turned.result)
    chosen = jax.tree.map(lambda own, other: jnp.where(turn, other, own), kept, turned)
    return eqx.tree_at(lambda s: (s.unturned, s.directions), chosen, (kept.value, count))


def _steady(view: SceneView, objective: Objective, min_eta: Array, previous: Array | None) -> SceneSolution:
    """The optimum along the view, or no warp along the screen's columns or rows if its error is no larger.

    The least error is continuous; between axes of nearly equal error those of the last frame are kept.
    """
    ahead = view.frame_along("view")
    vectors = [jnp.array([0.0, -1.0, 0.0]), jnp.array([1.0, 0.0, 0.0])]
    if previous is not None:
        vectors.append(view.camera.rotation @ previous.astype(view.camera.rotation.dtype))
    turned = [ahead, *(ahead.towards(v.astype(ahead.light.dtype)) for v in vectors)]
    turns = tuple(jnp.stack([frame.z_axis @ axis for frame in turned]) for axis in (ahead.z_axis, ahead.x_axis))
    every = jax.lax.map(lambda turn: _solve_along(view, ahead.turned(*turn), objective, min_eta), turns)
    values = every.unwarped.at[0].set(every.value[0])
    # A failure along the view stays one; receivers that are no one's have one set of axes.
    own = failed(every.result[0]) | (every.result[0] == Outcome.empty)
    chosen = jnp.where(own, 0, jnp.argmin(values))
    if previous is not None:
        warped = (chosen == 0) & ~every.warp.no_warp[0]
        kept = (values[-1] <= (1 + _AS_GOOD) * values[chosen]) & ~(warped | own)
        chosen = jnp.where(kept, len(turned) - 1, chosen)
    solution = jax.tree.map(lambda v: v[chosen], every)
    unwarped = chosen > 0
    one, zero = jnp.ones_like(solution.value), jnp.zeros_like(solution.value)
    outcome = jnp.where(solution.result == Outcome.flat, Outcome.flat, Outcome.no_warp).astype(jnp.int32)
    plain = eqx.tree_at(
        lambda s: (s.warp.eta, s.warp.one_minus_eta, s.value, s.result, s.residual, s.gap),
        solution, (one, zero, solution.unwarped, outcome, zero, zero),
    )  # fmt: skip
    solution = jax.tree.map(lambda a, b: jnp.where(unwarped, a, b), plain, solution)
    count = jnp.full((), len(turned), jnp.int32)
    return eqx.tree_at(lambda s: (s.unturned, s.directions), solution, (every.value[0], count))


def _solve_along(view: SceneView, frame: LightFrame, objective: Objective, min_eta: Float[Array, ""]) -> SceneSolution:
    footprint = view.footprint_in(frame, objective)
    if view.map_aspect is None:
        shares = shares_of(best_aspect(footprint, frame, objective, min_eta))
        frame = frame.shared(shares)
    else:
        shares = shares_of(view.map_aspect)
    log_norm = log_norm_of(footprint, frame, objective)
    if isinstance(log_norm, SampleNorm):
        optimum, value, unwarped, excess, gap = _of_samples(log_norm, min_eta)
    else:
        # For an L_P norm of E_p the moments come from the individual receivers: grouping loses nothing.
        grouped = footprint.grouped and (objective.supremum or objective.has_beta)
        loose = grouped and footprint.free is not None
        # Under parallel rays no warp is best for every maximum (T65).
        best_known = frame.is_orthographic and objective.supremum
        optimum, value, excess = _of_extents(log_norm, grouped and not loose, min_eta, best_known)
        # Moving a receiver within its group may widen a free fit or narrow it: no bound is known.
        excess = jnp.where(loose, jnp.nan, excess)
        unwarped, gap = value_at(log_norm, jnp.zeros_like(value)), jnp.zeros_like(value)
    value, unwarped, excess, gap = (jnp.where(footprint.empty, 0, v) for v in (value, unwarped, excess, gap))
    gap = jnp.where(footprint.flat, 0, gap)  # the same for all eta
    finite = jnp.isfinite(value) & jnp.isfinite(optimum.log_eta)
    outcome = optimum.outcome
    if footprint.depth_weighted is not None:
        said = (outcome != Outcome.empty) & (outcome != Outcome.not_converged)
        outcome = jnp.where(footprint.depth_weighted & said, Outcome.depth_weighted, outcome)
    outcome = jnp.where(finite, outcome, Outcome.not_finite).astype(jnp.int32)
    log_eta = jnp.where(finite, optimum.log_eta, jnp.nan)
    warp = Warp(jnp.exp(log_eta), -jnp.expm1(log_eta), footprint.start, footprint.mu, jnp.ones((), bool))
    direction = view.camera.rotation.T @ frame.z_axis
    one = jnp.ones((), jnp.int32)
    return SceneSolution(
        warp, value, outcome, optimum.residual, optimum.margin, unwarped, excess, gap, frame, footprint, direction,
        shares, value, one,
    )  # fmt: skip


def _of_extents(log_norm: LogNorm, grouped: bool, min_eta: Array, without: bool) -> tuple[Optimum, Array, Array]:
    """(the optimum, the norm, its excess over the individual receivers').

    Args:
        without: whether the optimum is known to be no warp.
    """
    find = no_warp if without else minimise
    if not grouped:
        optimum = find(log_norm, min_eta)
        value = value_at(log_norm, optimum.log_eta)
        return optimum, value, jnp.zeros_like(value)
    best_case = eqx.tree_at(lambda n: n.footprint, log_norm, log_norm.footprint.at_best())
    # Both in one map: the search is compiled once.
    both = jax.tree.map(lambda *v: jnp.stack(v), log_norm, best_case)
    optima = jax.vmap(find, (0, None))(both, min_eta)
    value, least = jax.vmap(value_at)(both, optima.log_eta)
    return jax.tree.map(lambda v: v[0], optima), value, _over(value, least)


def _of_samples(norm: SampleNorm, min_eta: Array) -> tuple[Optimum, Array, Array, Array, Array]:
    """(the optimum, the norm, that of no warp, the norm's excess over the individual receivers', its gap to the lower
    bound over all eta)."""
    optimum, mean, value, unwarped, lower, search = minimise_mean(norm, min_eta)
    # Of a mean this small some powers of sizes were flushed to 0, or all.
    numbers = jnp.finfo(value.dtype)
    lost = (search.value < numbers.tiny / numbers.eps) & (unwarped > 0)
    optimum = optimum._replace(outcome=jnp.where(lost, Outcome.inaccurate, optimum.outcome))
    best_case = eqx.tree_at(lambda n: n.footprint, norm, norm.footprint.at_best())
    exact = norm.samples.corners is None and not norm.footprint.grouped
    excess = (
        jnp.zeros_like(value) if exact else excess_of_cells(norm, best_case, search, optimum.log_eta, mean, min_eta)
    )
    return optimum, value, unwarped, excess, _over(value, lower)


def _over(value: Array, least: Array) -> Array:
    """value / least - 1, at least 0; inf where the bound says nothing, but for no error at all."""
    none = jnp.where(value > 0, jnp.inf, 0)
    over = jnp.where(least > 0, value / jnp.where(least > 0, least, 1) - 1, none)
    return jnp.where(over > 0, over, 0)


@functools.partial(jax.jit, static_argnames=("objective",))
def norms_over_scene(
    view: SceneView, warp: Warp, objective: Objective
) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """(the norm of every warp over one view's receivers, whether the apex is not before them: NaN)."""
    frame = view.frame()
    footprint = view.footprint_in(frame, objective)
    own = warp.over(footprint)
    return norms_at(footprint, frame, objective, own.eta), warp.lost_over(own)


def norms_at(
    footprint: Footprint, frame: LightFrame, objective: Objective, eta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The norm for every eta over a footprint made for the objective; 0 for no receivers."""
    log_norm = log_norm_of(footprint, frame, objective)
    values = jax.vmap(lambda u: value_at(log_norm, u))(jnp.log(eta).ravel())
    return jnp.where(footprint.empty, 0, values).reshape(eta.shape)

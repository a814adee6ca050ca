"""The direction of a warp, and its map's aspect: which of many have the least norm over eta."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..objective import Objective
from ..receivers.footprint import Footprint
from ..theory.direction import gradient, shares_of
from ..theory.light_frame import LightFrame
from ..views import SceneView
from .footprint_optimum import minimise
from .means.sample_norm import SampleNorm
from .means.weak_convexity import least
from .pieces import value_at
from .scene_norm import log_norm_of, product_norm

_EVEN = 32  # directions, the view's among them; the norm has 4 to 10 local minima over them, storage dozens
_TOGETHER = 12  # directions in one batch
# Rounds of refinement: how many of the best, and where around each, as a share of the spacing. From 11 degrees to 0.1.
_FEW = np.array([-2, -1, 1, 2]) / 3
_ROUNDS = (6, np.array([-1, 1]) / 2), (3, _FEW / 2), (3, _FEW / 6), (1, np.delete(np.arange(-6, 7), 6) / 108)
_TOLERANCE = 1e-3  # of a norm in the search; the warp that is returned has its own certificate
_MOST_ASPECT = 8.0
_ALTERNATIONS = 3  # of eta and aspect
_HALVINGS = 24  # of log(aspect)


def best_turn(
    view: SceneView, ahead: LightFrame, objective: Objective, min_eta: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """(cosine and sine of the turn from a frame's Z_w towards its X_w with the least norm, how many were tried).

    32 even turns and the gradient's; then, ever closer, around the six best, twice the three best, and the best one. Of
    the search nothing is differentiated: at the best turn the norm's derivative is that of a fixed direction (the
    envelope theorem).
    """
    view, ahead, min_eta = jax.lax.stop_gradient((view, ahead, min_eta))
    receivers = view.receivers.sketch(view.camera, objective)
    dtype = ahead.z_axis.dtype

    def norm_of(turn: Array) -> Array:
        frame = ahead.turned(jnp.cos(turn), jnp.sin(turn))
        footprint = view.footprint_in(frame, objective, receivers)
        if view.map_aspect is None:
            frame = frame.shared(shares_of(best_aspect(footprint, frame, objective, min_eta, 1)))
        value = _least(footprint, frame, objective, min_eta)
        # Over nothing, and over receivers at one depth, no direction is better than another.
        return jnp.where(jnp.isfinite(value), value, jnp.inf)

    spacing = 2 * math.pi / _EVEN
    first = jnp.arange(_EVEN, dtype=dtype) * spacing
    try:
        rise = gradient(ahead, *receivers.places(view.camera))
        toward = jnp.arctan2(ahead.x_axis @ rise, ahead.z_axis @ rise)
    except ValueError:  # receivers that have no places
        toward = jnp.zeros((), dtype)
    given = -(-(_EVEN + 1) // _TOGETHER)
    first = jnp.concatenate([first, jnp.full(given * _TOGETHER - _EVEN, toward)]).reshape(given, _TOGETHER)
    ranks = np.array([np.repeat(np.arange(best), _TOGETHER // best) for best, _ in _ROUNDS])
    offsets = spacing * np.array([np.tile(around, best) for best, around in _ROUNDS])

    def tried(state: tuple[Array, Array], step: Array) -> tuple[tuple[Array, Array], None]:
        turns, values = state
        # The best ones that are not next to a better one.
        apart = jnp.abs(jnp.remainder(turns[:, None] - turns + math.pi, 2 * math.pi) - math.pi) < spacing / 2
        earlier = jnp.arange(len(values))
        better = (values < values[:, None]) | ((values == values[:, None]) & (earlier < earlier[:, None]))
        alone = jnp.where((apart & better).any(1), jnp.inf, values)
        _, best = jax.lax.top_k(-alone, ranks.max() + 1)
        now = jnp.maximum(step - given, 0)
        refined = turns[best][jnp.asarray(ranks)[now]] + jnp.asarray(offsets, dtype)[now]
        new = jnp.where(step < given, first[jnp.minimum(step, given - 1)], refined)
        at = step * _TOGETHER
        turns = jax.lax.dynamic_update_slice(turns, new, (at,))
        values = jax.lax.dynamic_update_slice(values, jax.vmap(norm_of)(new), (at,))
        return (turns, values), None

    count = (given + len(_ROUNDS)) * _TOGETHER
    nothing = jnp.zeros(count, dtype), jnp.full(count, jnp.inf, dtype)
    (turns, values), _ = jax.lax.scan(tried, nothing, jnp.arange(given + len(_ROUNDS)))
    turn = turns[jnp.argmin(values)]
    return jnp.cos(turn), jnp.sin(turn), jnp.asarray(count, jnp.int32)


def _least(footprint: Footprint, frame: LightFrame, objective: Objective, min_eta: Array) -> Array:
    """The least norm over eta, to the search's tolerance."""
    norm = log_norm_of(footprint, frame, objective)
    if isinstance(norm, SampleNorm):
        found = least(norm.touch, min_eta.astype(norm.along.dtype), tolerance=_TOLERANCE)
        return jnp.where(found.value > 0, found.value, 0) ** (1 / norm.order) * jnp.exp(norm.log_scale)
    known = frame.is_orthographic and objective.supremum  # no warp, (T65)
    return value_at(norm, jnp.zeros_like(footprint.mu) if known else minimise(norm, min_eta).log_eta)


def best_aspect(
    footprint: Footprint,
    frame: LightFrame,
    objective: Objective,
    min_eta: Float[Array, ""],
    rounds: int = _ALTERNATIONS,
) -> Float[Array, ""]:
    """The aspect with the least norm over eta, between 1/8 and 8, found by turns: eta, aspect, eta, and so on.

    For a given eta both edges of a texel are powers of the aspect, and so convex in its logarithm. "pxq" and "storage"
    do not depend on it: 1.
    """
    one = jnp.ones_like(frame.density_p)
    if objective.kernel is None and objective.name != "max":
        return one
    footprint, frame, min_eta = jax.lax.stop_gradient((footprint, frame, min_eta))
    limit = math.log(_MOST_ASPECT)

    def norm_at(log_aspect: Array):
        return log_norm_of(footprint, frame.shared(shares_of(jnp.exp(log_aspect))), objective)

    def turn_about(_, log_aspect: Array) -> Array:
        norm = norm_at(log_aspect)
        if isinstance(norm, SampleNorm):
            u = jnp.log(least(norm.touch, min_eta.astype(norm.along.dtype), tolerance=_TOLERANCE).eta)
        else:  # max: sqrt(max E_p max E_q) with the aspect that makes them equal
            u = minimise(product_norm(footprint, frame, Objective("storage")), min_eta).log_eta

        def halved(_, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = (low + high) / 2
            slope = jax.jvp(lambda v: value_at(norm_at(v), u), (middle,), (jnp.ones_like(middle),))[1]
            return jnp.where(slope < 0, middle, low), jnp.where(slope < 0, high, middle)

        low, high = jax.lax.fori_loop(0, _HALVINGS, halved, (-limit * one, limit * one))
        return (low + high) / 2

    return jnp.exp(jax.lax.fori_loop(0, rounds, turn_about, 0 * one))

"""A function of u = log(eta) made of smooth pieces: its value, and the condition that holds at its minimum.

The condition (a stationary point, a tie of two receivers, a kink of the width) is identified by evaluating just below
and just above; solving it gives the last digits and the derivatives.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._parallel import first_at_least, wide
from .outcome import Outcome


@runtime_checkable
class Pieces(Protocol):
    """Which pieces are active at some u; an array or a tuple of arrays."""

    def same_top(self, other: Any) -> Bool[Array, ""]:
        """Whether the same receivers decide."""
        ...

    def same_sides(self, other: Any) -> Bool[Array, ""]:
        """Whether the same receivers span the map's width."""
        ...


@runtime_checkable
class PiecewiseLog(Protocol):
    """log of a norm."""

    def active(self, u: Float[Array, ""]) -> Any:
        """The active pieces at u: `Pieces`."""
        ...

    def value(self, u: Float[Array, ""], active: Any) -> Float[Array, ""]:
        """The logarithm on the smooth piece selected by `active`."""
        ...

    def slope(self, u: Float[Array, ""], active: Any) -> Float[Array, ""]:
        """d value / du on that piece."""
        ...

    def value_and_slope(self, u: Float[Array, ""], active: Any) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Both, which share their work."""
        ...


_SLOPES_AT_ONCE = 720  # on devices of many threads: two or four rounds over all eta that a dtype holds


class Optimum(NamedTuple):
    """eta, its outcome, the residual of its equation, and the margin by which a warp helps at eta = 1."""

    log_eta: Float[Array, ""]
    outcome: Int[Array, ""]
    residual: Float[Array, ""]
    margin: Float[Array, ""]


def slope_at(log_norm: PiecewiseLog, u: Float[Array, ""]) -> Float[Array, ""]:
    """d log(norm) / du at u."""
    return log_norm.slope(u, log_norm.active(u))


def zero_of_slope(
    log_norm: PiecewiseLog,
    beside: Float[Array, " K"],
    inside_of: Callable[[Float[Array, " K"]], Bool[Array, ""]],
    start: Array,
    lower: Array,
    upper: Array,
    noise: float,
    longest: float,
) -> tuple[Float[Array, ""], Bool[Array, ""], Float[Array, " K"]]:
    """(where the slope passes `noise` from below, whether it was found, the slopes at `beside`), without derivatives.

    Args:
        log_norm: with its derivatives stopped.
        beside: where the slope is asked for too: mapped with what else is evaluated, each formula is compiled once.
        inside_of: from those slopes, whether there is a zero to find; else `start` comes back.
        start: where the search begins.
        lower, upper: where it ends.
        noise: slopes below it are rounding.
        longest: upper - lower at most.
    """
    slopes_at = jax.vmap(lambda u: slope_at(log_norm, u))
    if wide():
        return _zero_by_rounds(slopes_at, beside, inside_of, start, lower, upper, noise, longest)
    import optimistix as optx  # see `positive_root`

    from .bracketed_newton import BracketedNewton

    slopes = slopes_at(beside)
    inside = inside_of(slopes)
    root = optx.root_find(
        lambda u, _: (jnp.where(inside, slope_at(log_norm, u) - noise, u - start), None),
        BracketedNewton(rtol=0.5 * float(jnp.finfo(lower.dtype).eps) ** 0.5, atol=0.0),
        start,
        options={"lower": lower, "upper": upper},
        has_aux=True,
        max_steps=256,
        throw=False,
    )
    return root.value, root.stats["converged"], slopes


def _zero_by_rounds(
    slopes_at: Callable[[Array], Array], beside: Array, inside_of: Callable[[Array], Array], start: Array,
    lower: Array, upper: Array, noise: float, longest: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """As `zero_of_slope`: a fixed number of rounds, each of which evaluates many slopes at once."""
    eps = float(jnp.finfo(lower.dtype).eps)
    parts = longest / (0.5 * eps**0.5)
    rounds = math.ceil(math.log(parts) / math.log(_SLOPES_AT_ONCE))
    count = 1 + math.ceil(parts ** (1 / rounds))
    share = jnp.linspace(0, 1, count, dtype=lower.dtype)
    at = lower + (upper - lower) * share
    slopes, of_beside = jnp.split(slopes_at(jnp.concatenate([at, beside])), [count])
    lower, upper, below, above = _bracket(at, slopes - noise)
    for _ in range(rounds - 1):
        at = lower + (upper - lower) * share
        lower, upper, below, above = _bracket(at, slopes_at(at) - noise)
    rise = above - below
    share = jnp.clip(-below / jnp.where(rise > 0, rise, 1), 0, 1)
    zero, inside = lower + (upper - lower) * jnp.where(rise > 0, share, 0.5), inside_of(of_beside)
    return jnp.where(inside, zero, start), ~inside | (jnp.isfinite(below) & jnp.isfinite(above)), of_beside


def _bracket(at: Array, slopes: Array) -> tuple[Array, Array, Array, Array]:
    """Two neighbours between which the slope comes to 0 from below, and their slopes."""
    last = jnp.clip(first_at_least(slopes, 0.0)[0], 1, len(at) - 1)
    return at[last - 1], at[last], slopes[last - 1], slopes[last]


def settled(log_norm: PiecewiseLog, found: Array, eps: float) -> tuple[Array, Array, Array]:
    """(u, outcome, residual): one Newton step on the condition at the root, which carries the derivatives.

    The root finder's u is off by at most about sqrt(eps); the active candidates on both sides identify the condition.
    """
    fixed = jax.lax.stop_gradient(log_norm)
    reach = 4 * eps**0.5
    # Mapped, here and below, over the pieces below, at and above the root: each formula is compiled once.
    near = jax.vmap(fixed.active)(jnp.stack([found - reach, found, found + reach]))
    below, above = (jax.tree.map(lambda v, i=i: v[i], near) for i in (0, 2))
    same_top, same_sides = below.same_top(above), below.same_sides(above)

    def step(gap, slope, usable):
        """-gap/slope with gap's derivative in the inputs, 0 where not usable."""
        slope = jnp.where(usable, jax.lax.stop_gradient(slope), 1)
        return jnp.where(usable, -gap / slope, 0)

    def at_found(active):
        return jax.jvp(lambda u: log_norm.value_and_slope(u, active), (found,), (jnp.ones_like(found),))

    # Where two pieces meet: the crossing of their values, if the minimum is there (one falls, one rises).
    (values, slopes), (_, curvatures) = jax.vmap(at_found)(near)
    crossing = found + step(values[0] - values[2], slopes[0] - slopes[2], slopes[0] != slopes[2])
    # Where one piece is stationary.
    stationary = found + step(slopes[1], curvatures[1], curvatures[1] > eps**0.5)
    stationary = jnp.where(jnp.abs(jax.lax.stop_gradient(stationary) - found) <= reach, stationary, found)
    meeting, resting = jax.lax.stop_gradient((crossing, stationary))
    values, slopes = jax.vmap(fixed.value_and_slope)(jnp.stack([meeting, resting, meeting]), near)
    met = ~(same_top & same_sides) & (jnp.abs(meeting - found) <= 2 * reach)
    met = met & (slopes[0] <= 0) & (slopes[2] >= 0)
    u = jnp.where(met, crossing, stationary)
    gap = jnp.where(met, values[0] - values[2], slopes[1])
    outcome = jnp.where(met, jnp.where(same_top, Outcome.kink, Outcome.tie), Outcome.stationary)
    return u, outcome, jnp.abs(gap)


def value_at(log_norm: PiecewiseLog, u: Float[Array, ""]) -> Float[Array, ""]:
    """The norm at u, differentiable in the footprint and in u."""
    return jnp.exp(log_norm.value(u, jax.lax.stop_gradient(log_norm.active(u))))

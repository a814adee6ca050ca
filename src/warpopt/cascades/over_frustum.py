"""Cascades of whole frusta: pieces are similar about the eye, so an error depends on far/near alone."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._checks import assembled
from ..objective import Objective
from ..receivers.bodies.whole_frustum import mass_between
from ..solve.bracketed_newton import increasing_root
from ..solve.chunks import in_blocks
from ..solve.frusta import Method, norms_over_frusta, solve_frusta
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from ..views import FrustumView
from .chain import best_chain, refined

_GRID, _ZOOMS = 96, 13  # depths tried at first, even in the logarithm; then finer ones about each split


@jax.jit
def ends_of(view: FrustumView) -> tuple[Array, Array]:
    """(near, far) in the view's shape."""
    near, far, _ = jnp.broadcast_arrays(view.frustum.near, view.frustum.far, view.theta)
    return near, far


@jax.jit
def pieces(view: FrustumView, starts: Array, ends: Array) -> tuple[ViewFrustum, Array]:
    """(the pieces as frusta, the light's angle), with a last axis for cascades; some length for those of none."""
    phi, theta, starts = jnp.broadcast_arrays(view.frustum.half_fov[..., None], view.theta[..., None], starts)
    ends = jnp.where(ends > starts, ends, 2 * starts)
    return assembled(ViewFrustum, near=starts, far=ends, half_fov=phi), theta


def errors_over_frusta(
    view: FrustumView, starts: Float[Array, "... K"], ends: Float[Array, "... K"], objective: Objective, warp: bool
) -> tuple[Float[Array, "... K"], Warp]:
    """(the norm in each piece, its warp), with the best warp or without; 0 for pieces of no length."""
    frustum, theta = pieces(view, starts, ends)
    solution = in_blocks(solve_frusta, (frustum, theta), objective, Method())
    values, warps = solution.value, solution.warp
    if not warp:
        warps = warps.unwarped
        values, _ = in_blocks(norms_over_frusta, (frustum, theta, warps), objective, Method())
    return _of_length(values, starts, ends), warps


@jax.jit
def _of_length(values: Array, starts: Array, ends: Array) -> Array:
    return jnp.where(ends > starts, values, 0)


def errors_of_similar(
    view: FrustumView, starts: Float[Array, "... K"], ends: Float[Array, "... K"], objective: Objective, warp: bool
) -> tuple[Float[Array, "... K"], Warp]:
    """`errors_over_frusta` of pieces of equal far/near: the first one's error and eta, its lengths in proportion."""
    first, end = _first(starts, ends)
    each, warps = errors_over_frusta(view, first, end, objective, warp)
    return _in_proportion(starts, each, warps)


@jax.jit
def _first(starts: Array, ends: Array) -> tuple[Array, Array]:
    return starts[..., :1], ends[..., :1]


@jax.jit
def _in_proportion(starts: Array, each: Array, warps: Warp) -> tuple[Array, Warp]:
    scale = starts / starts[..., :1]
    whole = jax.tree.map(lambda v: jnp.broadcast_to(v, scale.shape), warps)
    lengths = eqx.tree_at(lambda w: (w.start, w.mu), whole, (warps.start * scale, warps.mu * scale))
    return jnp.broadcast_to(each, scale.shape), lengths


@functools.partial(jax.jit, static_argnames=("objective",))
def masses(starts: Array, ends: Array, near: Array, far: Array, objective: Objective) -> Float[Array, "... K"]:
    """Each piece's part of the measure over the whole frustum: of z^(2 - m) dz, or dz on the axis."""
    growth = 1 - objective.volume_exponent
    return mass_between(starts, ends, growth) / mass_between(near, far, growth)[..., None]


def splits_of_shares(
    view: FrustumView, objective: Objective, shares: np.ndarray, overlap: float, warp: bool
) -> Float[Array, "... K1"]:
    """Maps of unequal resolution in L-inf: all errors over shares equal, or a cascade unused (docs/cascades.md).

    The root of "all lengths the whole" in the common error, and in each share that of "this error" in the length: both
    increase. Their derivatives are the implicit functions'.
    """
    return _balanced(view, jnp.asarray(shares), overlap, objective, warp)


@functools.partial(jax.jit, static_argnames=("objective", "warp"))
def _balanced(view: FrustumView, shares: Array, overlap: Array | float, objective: Objective, warp: bool) -> Array:
    near, far = ends_of(view)
    whole = jnp.log(far / near)
    phi, theta, _ = jnp.broadcast_arrays(view.frustum.half_fov, view.theta, near)
    lengths = _Lengths(objective, warp)
    log_scale = objective.resolution_power * jnp.log(shares.astype(near.dtype))
    ends = (lengths.log_error(jnp.broadcast_to(u, near.shape), (phi, theta)) for u in (_thin(near.dtype), whole))
    band = jnp.log1p(-jnp.asarray(overlap, near.dtype))
    args = phi, theta, whole, log_scale, band, tuple(jax.lax.stop_gradient(v) for v in ends)
    least, most = (v - log_scale.max() for v in args[-1])
    least = jnp.where(least > -jnp.inf, least, most - 50)
    level, _ = increasing_root(lengths, args, jax.lax.stop_gradient(least), jax.lax.stop_gradient(most))
    made = near[..., None] * jnp.exp(lengths.ends(level, args))
    # What is left by rounding before the far plane is no map of its own.
    last = far[..., None]
    return jnp.where(made >= last * (1 - 64 * jnp.finfo(made.dtype).eps), last, made).at[..., -1].set(far)


def _thin(dtype) -> float:
    """The length in the logarithm of a piece of nearly none, whose error is the least of any."""
    return 8 * float(jnp.finfo(dtype).eps)


@dataclasses.dataclass(frozen=True)
class _LogError:
    """The logarithm of a piece's error over a target; increasing in the length u of the piece in the logarithm."""

    objective: Objective
    warp: bool

    def __call__(self, u: Array, args: tuple[Array, Array, Array]) -> Array:
        phi, theta, target = args
        one = jnp.ones_like(u)
        piece = FrustumView(assembled(ViewFrustum, near=one, far=2 * one, half_fov=phi), theta)
        value, _ = errors_over_frusta(piece, one[..., None], jnp.exp(u)[..., None], self.objective, self.warp)
        return jnp.log(value[..., 0]) - target


@dataclasses.dataclass(frozen=True)
class _Lengths:
    """By how much the maps reach beyond the whole at a common error, each as long as that allows; in its logarithm."""

    objective: Objective
    warp: bool

    def log_error(self, u: Array, args: tuple[Array, Array]) -> Array:
        """Of a piece of length u."""
        return _LogError(self.objective, self.warp)(u, (*args, jnp.zeros_like(u)))

    def of(self, level: Array, args: PyTree) -> Array:
        """Each map's length, (..., K), at most the whole; 0 for one that would exceed the level alone."""
        phi, theta, whole, log_scale, _, (least, most) = args
        phi, theta, whole, least, most = (v[..., None] for v in (phi, theta, whole, least, most))
        target = level[..., None] + log_scale
        inside = (target > least) & (target < most)
        safe = jnp.where(inside, target, (jnp.maximum(least, most - 50) + most) / 2)
        phi, theta, high = (jnp.broadcast_to(v, target.shape) for v in (phi, theta, whole))
        error = _LogError(self.objective, self.warp)
        found, _ = increasing_root(error, (phi, theta, safe), jnp.zeros_like(high), jax.lax.stop_gradient(high))
        return jnp.where(inside, found, jnp.where(target > least, high, 0))

    def ends(self, level: Array, args: PyTree) -> Array:
        """Where each begins and the last one ends, (..., K + 1) logarithms from the near plane.

        A map begins a band before the one before ends, but not before the near plane; one that would not reach farther
        is not used.
        """
        band, each = args[4], self.of(level, args)
        ends = [jnp.zeros_like(level)]
        for k in range(each.shape[-1]):
            ends.append(jnp.maximum(ends[-1], jnp.maximum(ends[-1] + band, 0) + each[..., k]))
        return jnp.stack(ends, -1)

    def __call__(self, level: Array, args: PyTree) -> Array:
        return self.ends(level, args)[..., -1] - args[2]


def splits_of_means(
    view: FrustumView, objective: Objective, shares: np.ndarray, overlap: float, warp: bool
) -> Float[Array, "... K1"]:
    """The least L_P norm: the sum over cascades of the mean of E^P times the measure, by a dynamic programme.

    Over a grid of depths that is even in log z the best chain of cascades is found, then again over finer grids about
    it. That no better chain lies elsewhere is not proved (the condition in docs/cascades.md is only necessary).
    """
    near, far = ends_of(view)
    weights = shares ** (-objective.resolution_power * objective.order)

    def chain(depths: Array, pairs: np.ndarray) -> Array:
        return best_chain(depths, pairs, _costs(view, depths, pairs, overlap, objective, warp), weights)

    found = refined(chain, near, far, len(shares) - 1, _GRID, _ZOOMS)
    return jnp.concatenate([near[..., None], found, far[..., None]], -1)


@functools.partial(jax.jit, static_argnames=("objective", "warp"))
def _costs(
    view: FrustumView, depths: Array, pairs: Array, overlap: Array | float, objective: Objective, warp: bool
) -> Array:
    """What cascades between two depths add to the sum of E^P over the frustum; inf for a negative length."""
    near, far = ends_of(view)
    a, b = depths[..., pairs[:, 0]], depths[..., pairs[:, 1]]
    start = jnp.maximum(a * (1 - overlap), near[..., None])
    each = errors_over_frusta(view, start, b, objective, warp)[0]
    whole = masses(a, b, near, far, objective) * each**objective.order
    return jnp.where(b > a, whole, jnp.where(b == a, 0, jnp.inf))

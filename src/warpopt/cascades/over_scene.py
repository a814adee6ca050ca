"""Cascades over receivers: the errors of any range of view depths, and the splits that equalise or minimise them.

A range of depths is the same view with other near and far planes, so every kind of receivers can be split, and each
cascade is an `optimal_warp`. To find splits, many receivers are first reduced to points (`sketch`), few are taken one
by one; what is found is then solved over the receivers themselves, so that errors and certificate are theirs.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from ..objective import Objective
from ..receivers.one_by_one import OneByOne
from ..receivers.receivers import Receivers
from ..receivers.weighted.cells import EXACT
from ..solve.scene import settled_scene, solve_scene
from ..solve.solution import SceneSolution
from ..views import SceneView, one_light
from .chain import best_chain, pairs_of, refined
from .splits import even_in_the_logarithm

_STEPS = 60  # of the search for the common error: bisection shrinks its interval to rounding
_FEW = 64  # depths that means are split at: up to 2,016 cascades between them
_OF_BODY = 24  # of a body and a histogram, whose means are smooth, and take longer
_ZOOMS = 4  # then finer ones about each split: the last steps are a 16,000th of the range's logarithm
_TOGETHER = 64  # cascades in one call
_CELLS = 4097  # depths to split cells of many pixels at for a maximum: far/near of 1e4 in steps of 0.2 %
_BODY = 65_537  # the same for a body: of 0.014 %
_CLOSE = 2e-3  # of the common error, over cells


Mass = Callable[[Float[Array, "..."]], Float[Array, "..."]]
"""The sum of the weights up to a depth, a pytree."""


def within(view: SceneView, near: Float[Array, ""], far: Float[Array, ""]) -> SceneView:
    """The same view with the receivers of a range of view depths alone."""
    part = view.receivers.between(view.camera, near, far)
    return eqx.tree_at(lambda v: (v.camera, v.receivers), view, part)


def weighted(receivers: Receivers) -> bool:
    """Whether receivers have weights of their own: numbers, not a name."""
    return isinstance(receivers, OneByOne) and receivers.weights.values is not None


@jax.jit
def _extent(view: SceneView) -> tuple[Array, Array]:
    return view.receivers.depth_extent(view.camera)


def depth_range(view: SceneView) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(nearest, farthest) view depth of the receivers; (inf, -inf) for none."""
    return _extent(one_light(view))


def errors_over_scene(
    view: SceneView, starts: Array, splits: Array, objective: Objective
) -> tuple[SceneView, SceneSolution, Array | None]:
    """(each cascade's view, its solution, each one's part of all weights for a mean), stacked."""
    settled_scene(view, objective)
    views, solutions = solved_between(view, starts, splits[1:], objective)
    mass = None
    if not objective.supremum:
        mass = jnp.ones_like(starts) if len(starts) == 1 else _masses(view, splits, objective)
    if view.searched:
        views = jax.vmap(lambda v, s: v.along(s))(views, solutions)
    return views, solutions, mass


def solved_between(
    view: SceneView, starts: Array, ends: Array, objective: Objective
) -> tuple[SceneView, SceneSolution]:
    """(the view of each range of depths, its solution), stacked."""
    views = _views(view, starts, ends)
    return views, _solved(views, objective)


@jax.jit
def _views(view: SceneView, starts: Array, ends: Array) -> SceneView:
    return jax.vmap(lambda a, b: within(view, a, b))(starts, ends)


@functools.partial(jax.jit, static_argnames=("objective",))
def _solved(views: SceneView, objective: Objective) -> SceneSolution:
    # One after the other: a pass over many receivers uses all cores.
    return jax.lax.map(lambda v: solve_scene(v, objective), views)


@functools.partial(jax.jit, static_argnames=("objective",))
def _masses(view: SceneView, splits: Array, objective: Objective) -> Array:
    """Each cascade's part of all weights; a receiver at a split is the nearer cascade's."""
    mass = view.receivers.mass_up_to(view.camera, objective)(splits.at[0].set(0).at[-1].set(jnp.inf))
    return jnp.diff(mass) / jnp.where(mass[-1] > 0, mass[-1], 1)


def splits_of_scene(
    view: SceneView, extent: tuple[Array, Array], count: int, objective: Objective, shares: np.ndarray, overlap: float,
    warp: bool,
) -> Float[Array, " K1"]:  # fmt: skip
    """The splits of least error; the receivers' range for one cascade, all at its end for empty ones.

    `extent` is the view's `depth_range`.
    """
    settled_scene(view, objective)
    least, largest = extent
    if not float(least) <= float(largest):  # no receivers: nothing to split
        near, far = view.camera.near, view.camera.far
        return jnp.stack([near, *[jnp.where(jnp.isfinite(far), far, 2 * near)] * count])
    ends = jnp.stack([least, largest])
    if count == 1 or float(least) == float(largest):
        return jnp.concatenate([ends[:1], jnp.broadcast_to(ends[1], count)])
    scale = jnp.asarray(shares**objective.resolution_power, ends.dtype)
    fixed = _fixed(view, objective)
    if objective.supremum:
        return _equalised(fixed, ends, scale, overlap, objective, warp, not overlap)
    return _least_sum(fixed, _mass(view, objective), ends, scale, overlap, objective, warp)


@functools.partial(jax.jit, static_argnames=("objective",))
def _fixed(view: SceneView, objective: Objective) -> SceneView:
    """The view over few receivers, along one direction for all cascades."""
    if view.searched:
        view = view.along(solve_scene(view, objective))
    receivers = view.receivers.sketch(view.camera, objective)
    return eqx.tree_at(lambda v: v.receivers, view, receivers)


def _error(view: SceneView, near: Array, far: Array, objective: Objective, warp: bool) -> Array:
    solution = solve_scene(within(view, near, far), objective)
    return solution.value if warp else solution.unwarped


class _Levels(NamedTuple):
    """The search for the common error: logs of levels, and the chains found at them.

    Attributes:
        low: a level that no chain betters; `shortest`, where its cascades end; `over`, by how much the last exceeds it.
        value: the least error attained, by the chain that ends at `best`.
        farthest, under: as `shortest` and `over`, of the last level that was not below the last one's error.
    """

    low: Float[Array, ""]
    value: Float[Array, ""]
    shortest: Int[Array, " K"]
    farthest: Int[Array, " K"]
    over: Float[Array, ""]
    under: Float[Array, ""]
    best: Int[Array, " K"]
    step: Int[Array, ""]


@functools.partial(jax.jit, static_argnames=("objective", "warp", "apart"))
def _equalised(
    view: SceneView, ends: Array, scale: Array, overlap: ArrayLike, objective: Objective, warp: bool, apart: bool
) -> Array:
    """L-inf: all cascades but the last as long as a common level allows, and the level at which the last one has it.

    Errors grow with what a cascade holds (docs/cascades.md), so the longest is right, and the last one's error falls
    as the level rises. What any chain attains bounds the least error from above; from below do the levels that the last
    cascade exceeds, and at first the least error of the logarithmic split.
    """
    coarse = view.receivers.of_cells
    depths = _between_all(view, ends, EXACT, apart)
    if depths is None:
        depths = even_in_the_logarithm(ends[0], ends[1], np.linspace(0, 1, _CELLS if coarse else _BODY))
    # Cells are coarser than a thousandth; points are exact.
    close = _CLOSE if coarse else 4 * jnp.finfo(ends.dtype).eps
    count, last = len(scale), len(depths) - 1
    starts = jnp.maximum(depths * (1 - overlap), ends[0])
    numbers = jnp.arange(count, dtype=jnp.int32)
    logarithmic = even_in_the_logarithm(ends[0], ends[1], (numbers + 1).astype(ends.dtype) / count)
    at_first = jnp.searchsorted(depths, logarithmic).astype(jnp.int32).at[-1].set(last)

    def error(i: Array, j: Array, k: Array) -> Array:
        start = jnp.where(k == 0, depths[i], starts[i])
        value = _error(view, start, depths[jnp.maximum(j, i + 1)], objective, warp) / scale[k]
        return jnp.where(j > i, jnp.log(value), -jnp.inf)

    def longest(level: Array, i: Array, k: Array, low: Array, high: Array, given: Array) -> tuple[Array, Array]:
        """(the largest j in [low, high] whose cascade from i has at most this error, its error); `high` if given.

        By interpolation, as the error is nearly a power of the depth; every third step halves the interval.
        """
        low = jnp.where(given, high, jnp.maximum(low, i))
        high = jnp.maximum(high, low)

        def step(state):
            low, high, below, above, found, turn = state
            share = (level - below) / (above - below)
            share = jnp.where((turn % 3 < 2) & jnp.isfinite(share), share, 0.5)
            reach = high - low
            at = low + jnp.clip((share * (reach + 1)).astype(jnp.int32), jnp.minimum(1, reach), reach)
            value = error(i, at, k)
            fits = value <= level
            return (
                jnp.where(fits | given, at, low), jnp.where(fits | given, high, at - 1), jnp.where(fits, value, below),
                jnp.where(fits, above, value), jnp.where(fits | given, value, found), turn + 1,
            )  # fmt: skip

        def open_(state):
            return jnp.where(given, state[-1] < 1, state[0] < state[1])

        start = low, high, -inf, inf, -inf, jnp.zeros((), jnp.int32)
        low, _, _, _, found, _ = jax.lax.while_loop(open_, step, start)
        return low, found

    def narrower(state: _Levels) -> _Levels:
        first = state.step == 0
        middle = jnp.where(jnp.isfinite(state.low), (state.low + state.value) / 2, state.value - 3)
        level = middle
        if coarse:
            secant = state.low + state.over / (state.over - state.under) * (state.value - state.low)
            level = jnp.where((secant > state.low) & (secant < state.value) & (state.step % 3 < 2), secant, middle)
        given = first | (numbers == count - 1)

        def one(i: Array, part: tuple[Array, Array, Array, Array]):
            j, found = longest(level, i, *part)
            return j, (j, found)

        parts = numbers, jnp.where(first, at_first, state.shortest), jnp.where(first, at_first, state.farthest), given
        _, (at, found) = jax.lax.scan(one, jnp.zeros((), jnp.int32), parts)
        value, miss = found.max(), found[-1] - level
        below = ~first & (miss <= 0)
        above = ~first & (miss > 0)
        low = jnp.where(first, found.min(), jnp.where(above, level, state.low))
        return _Levels(
            low, jnp.minimum(value, state.value),
            jnp.where(above, at, state.shortest), jnp.where(below, at, state.farthest),
            jnp.where(above, miss, state.over), jnp.where(below, miss, state.under),
            jnp.where(value < state.value, at, state.best), state.step + 1,
        )  # fmt: skip

    def wide(state: _Levels) -> Array:
        return (state.step <= _STEPS) & (state.value > state.low + jnp.log1p(close)) & (state.value > -jnp.inf)

    inf, none = jnp.full((), jnp.inf, ends.dtype), jnp.zeros((), jnp.int32)
    whole = jnp.full(count, last, jnp.int32)
    begin = _Levels(-inf, inf, jnp.zeros_like(whole), whole, inf, -inf, at_first, none)
    at = jax.lax.while_loop(wide, narrower, begin).best
    return jnp.concatenate([ends[:1], depths[at[:-1]], ends[1:]])


@functools.partial(jax.jit, static_argnames=("most", "apart"))
def _between_all(view: SceneView, ends: Array, most: int, apart: bool) -> Array | None:
    """Depths between every two receivers, and the ends; None for more than `most`, and for others than points.

    `apart`: in the middle; else next to the farther one, where a map that overlaps the one before begins latest.
    """
    if not isinstance(view.receivers, OneByOne):
        return None
    points, there = view.receivers.places(view.camera)
    if len(points) > most:
        return None
    z = jnp.sort(jnp.where(there > 0, points[:, 2], ends[1]))
    place = 0.5 if apart else 1 - float(jnp.finfo(z.dtype).eps) ** 0.5
    between = z[:-1] * (z[1:] / z[:-1]) ** place
    return jnp.concatenate([ends[:1], jnp.clip(between, *ends), ends[1:]])


def _least_sum(
    view: SceneView, mass: Mass, ends: Array, scale: Array, overlap: float, objective: Objective, warp: bool
) -> Array:
    """Means: a dynamic programme over depths, exact where those are between all receivers; else again over finer ones
    about each split."""

    def chain(depths: Array, pairs: np.ndarray) -> Array:
        at, weight = np.asarray(depths), np.asarray(_mass_at(mass, depths))
        before = np.where(at <= at[0], 0, weight)  # the first cascade holds the receivers at its very beginning
        (a, b), costs = pairs.T, []
        rows = np.stack([at[a], at[b], weight[b] - before[a]], 1)
        for part in np.split(rows, range(_TOGETHER, len(rows), _TOGETHER)):  # as many in each call: one program
            a, b, share = np.pad(part, ((0, _TOGETHER - len(part)), (0, 0)), mode="edge").T
            costs.append(np.asarray(_costs(view, ends, a, b, share, overlap, objective, warp))[: len(part)])
        return best_chain(depths, pairs, np.concatenate(costs), scale**-objective.order)

    depths = _between_all(view, ends, _FEW, not overlap)
    if depths is not None:
        found = chain(depths, pairs_of(len(depths), len(scale) - 1))
    else:
        count = _FEW if view.receivers.of_cells else _OF_BODY
        found = refined(chain, ends[0], ends[1], len(scale) - 1, count, _ZOOMS)
    return jnp.concatenate([ends[:1], found, ends[1:]])


@functools.partial(jax.jit, static_argnames=("objective", "warp"))
def _costs(
    view: SceneView, ends: Array, a: Array, b: Array, shares: Array, overlap: ArrayLike, objective: Objective,
    warp: bool,
) -> Array:  # fmt: skip
    """What cascades between two depths add to the sum of E^P over all receivers; inf for a negative length.

    `shares`: of all weights, between the two depths.
    """

    def one(part: tuple[Array, Array, Array]) -> Array:
        a, b, share = part
        start = jnp.maximum(a * (1 - overlap), ends[0])
        value = _error(view, start, jnp.maximum(b, start * (1 + 1e-6)), objective, warp)
        return jnp.where(b > a, share * value**objective.order, jnp.where(b == a, 0, jnp.inf))

    return jax.vmap(one)((a, b, shares))


@jax.jit
def _mass_at(mass: Mass, depths: Array) -> Array:
    return mass(depths)


@functools.partial(jax.jit, static_argnames=("objective",))
def _mass(view: SceneView, objective: Objective) -> Mass:
    return view.receivers.mass_up_to(view.camera, objective)

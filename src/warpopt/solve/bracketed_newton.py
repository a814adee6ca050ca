"""Newton's method inside a bracket, as an optimistix root finder."""

import functools
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from .._parallel import wide

# Steps that a device of many threads takes in one kernel, before a loop that moves all lanes to memory and back at each
# step. Most lanes need no more, and with more of them a kernel of many coefficients runs out of registers.
_AT_ONCE = 4


class _State(eqx.Module):
    lower: Float[Array, "..."]
    upper: Float[Array, "..."]
    stride: Float[Array, "..."]
    done: Bool[Array, "..."]


class BracketedNewton(optx.AbstractRootFinder):
    """Newton's method for increasing functions, elementwise on arrays, guarded by bisection.

    Every evaluation tightens the bracket given as `options=dict(lower=..., upper=...)`, or as dict(state=...) by steps
    before; a Newton step that would leave it, or is more than half as long as the step before, is replaced by
    bisection. A lane stops when a Newton step is below `rtol`: the next step would be below rtol^2, which is the
    accuracy reached. (optimistix's `Newton` has no guard and diverges on these objectives; `Bisection` uses no
    derivative.)
    """

    rtol: float
    atol: float
    norm: ClassVar[Callable[[PyTree], Array]] = jnp.abs

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> _State:
        if "state" in options:
            return options["state"]
        lower, upper = (jnp.broadcast_to(options[name], y.shape).astype(y.dtype) for name in ("lower", "upper"))
        return _State(lower, upper, upper - lower, jnp.zeros(y.shape, bool))

    def step(self, fn, y, args, options, state: _State, tags):
        value, slope, aux = _value_and_slope(fn, y, args)
        below = value < 0
        lower, upper = jnp.where(below, y, state.lower), jnp.where(below, state.upper, y)
        newton = y - value / slope
        stride = jnp.abs(newton - y)
        # Inside the bracket, and at most half as long as the step before; NaN fails this test.
        trusted = (newton >= lower) & (newton <= upper) & (stride <= 0.5 * state.stride)
        new = jnp.where(trusted, newton, lower + (upper - lower) / 2)
        small = trusted & (stride <= self.rtol)
        collapsed = upper - lower <= 2 * jnp.finfo(y.dtype).eps * jnp.maximum(jnp.abs(lower), jnp.abs(upper))
        new = jnp.where(state.done, y, new)
        stride = jnp.where(trusted, stride, upper - lower)
        return new, _State(lower, upper, stride, state.done | small | collapsed), aux

    def terminate(self, fn, y, args, options, state: _State, tags) -> tuple[Array, Any]:  # a checker sees a str
        return jnp.all(state.done), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state: _State, tags, result):
        return y, aux, {"converged": state.done}


def _value_and_slope(fn: Callable, y: Array, args: Any) -> tuple[Array, Array, Any]:
    # The functions act elementwise, so that one tangent of ones carries every lane's derivative.
    (value, aux), (slope, _) = jax.jvp(lambda at: fn(at, args), (y,), (jnp.ones_like(y),))
    return value, slope, aux


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def increasing_root(
    fn: Callable[[Array, PyTree], Array], args: PyTree, lower: Array, upper: Array
) -> tuple[Float[Array, "..."], Bool[Array, "..."]]:
    """The root u in [lower, upper] of an increasing elementwise function fn(u, args), and whether it converged.

    Its derivative in `args`, of any order, is that of the implicit function theorem; `fn` must be hashable.
    """
    # Newton's error after a step of size h is about h^2 C, with C = (change of slope)/(2 slope) of order one here.
    rtol = 0.5 * float(jnp.finfo(lower.dtype).eps) ** 0.5
    solver = BracketedNewton(rtol=rtol, atol=0.0)
    start, options = jnp.clip(jnp.zeros_like(lower), lower, upper), {"lower": lower, "upper": upper}
    if wide():

        def with_aux(u: Array, args: PyTree) -> tuple[Array, None]:
            return fn(u, args), None

        state = solver.init(with_aux, start, args, options, None, None, frozenset())
        for _ in range(_AT_ONCE):
            start, state, _ = solver.step(with_aux, start, args, options, state, frozenset())
        options = {"state": state}
    solution = optx.root_find(
        fn,
        solver,
        start,
        args=args,
        options=options,
        max_steps=192,  # pure bisection needs 60; at worst every third step is a bisection
        throw=False,
    )
    return solution.value, solution.stats["converged"]


@increasing_root.defjvp
def _increasing_root_jvp(fn, primals, tangents):
    args, lower, upper = primals
    root, converged = increasing_root(fn, args, lower, upper)
    _, change = jax.jvp(lambda a: fn(root, a), (args,), (tangents[0],))
    _, slope = jax.jvp(lambda u: fn(u, args), (root,), (jnp.ones_like(root),))
    return (root, converged), (-change / slope, np.zeros(converged.shape, jax.dtypes.float0))

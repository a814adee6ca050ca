"""Small numerical tools that JAX lacks."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Of a function of arrays, also called uncompiled: one compilation for each new shape, not one per operation.

    Where it is traced, its operations become the caller's, as if it were not compiled.
    """
    return cast(_Function, jax.jit(function, inline=True))


def power(base: Float[Array, "..."], exponent: float) -> Float[Array, "..."]:
    """base ** exponent for a static exponent: by multiplications or a root if possible, which round better.

    A third is no float: its rounding alone costs base ** (1/3) up to eps log(base)/12, 60 eps for 1e-307. A step of
    Newton's method mends that, where `jnp.cbrt` is itself such a power with some of XLA's settings.
    """
    if exponent == int(exponent):
        return base ** int(exponent)
    if 2 * exponent == int(2 * exponent):
        return base ** int(exponent) * jnp.sqrt(base) if exponent > 0 else 1 / power(base, -exponent)
    if exponent == round(3 * exponent) / 3:
        root = base ** (1 / 3)
        some = jnp.where(root > 0, root, 1)
        return (root - (root - base / (some * some)) / 3) ** round(3 * exponent)
    return base**exponent


def picked(values: Float[Array, "..."], i: Int[Array, "..."]) -> Float[Array, "..."]:
    """values[i] for an index that an argmax gave: half the operations to compile, as none are for other indices."""
    return values.at[i].get(mode="promise_in_bounds", wrap_negative_indices=False)


@jax.custom_jvp
def least_of(values: Float[Array, "*B N"]) -> Float[Array, "*B"]:
    """The least along the last axis, with the derivative of the first that is.

    `jnp.min` finds those by comparing, see `larger`: where none is equal to the least its derivative is NaN.
    """
    return values.min(-1)


@least_of.defjvp
def _least_of_jvp(primals, tangents):
    (values,), (change,) = primals, tangents
    first = jnp.argmin(values, -1)[..., None]
    return least_of(values), jnp.take_along_axis(change, first, -1)[..., 0]


def largest_of(values: Float[Array, "*B N"]) -> Float[Array, "*B"]:
    """The largest along the last axis; see `least_of`."""
    return -least_of(-values)


def least_of_each(*arrays: Float[Array, "..."]) -> list[Float[Array, ""]]:
    """The least of each array; of those of one size by one reduction.

    A kernel for each would take longer to compile, and on a device of many threads to start, than it runs.
    """
    found = {}
    for size in dict.fromkeys(values.size for values in arrays):
        which = [i for i, values in enumerate(arrays) if values.size == size]
        found |= zip(which, least_of(jnp.stack([arrays[i].ravel() for i in which])), strict=True)
    return [found[i] for i in range(len(arrays))]


def least_and_largest(
    least: Float[Array, "..."], largest: Float[Array, "..."]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The least of one array and the largest of another; see `least_of_each`."""
    low, high = least_of_each(least, -largest)
    return low, -high


def larger(x: Array | float, y: Array | float) -> Float[Array, "..."]:
    """max(x, y), with the derivative of one of them also where they tie.

    `jnp.maximum` differentiates by comparing its result with its arguments. A compiler that computes an argument twice,
    rounded differently, then finds neither equal and the derivative is lost (seen with jax 0.10.1 on CPU).
    """
    return jnp.where(x > y, x, y)


def smaller(x: Array | float, y: Array | float) -> Float[Array, "..."]:
    """min(x, y); see `larger`."""
    return jnp.where(x < y, x, y)


def positive(value: Float[Array, "..."]) -> Float[Array, "..."]:
    """The value, or 1 where it is 0: a divisor."""
    return jnp.where(value > 0, value, 1)


@jax.custom_jvp
def over(x: Float[Array, "..."], y: Float[Array, "..."]) -> Float[Array, "..."]:
    """x / y for a small y, with derivatives that stay in range.

    JAX's derivative multiplies by 1/y^2 before it multiplies by x, which overflows single precision even where the
    product is of order one (x = 1e-30, y = 1e-10).
    """
    return x / y


@over.defjvp
def _over_jvp(primals, tangents):
    x, y = primals
    dx, dy = tangents
    quotient = over(x, y)
    # This order makes the transpose multiply by the quotient before it divides.
    return quotient, dx / y - (dy / y) * quotient


def horner(coefficients: Sequence[Any], at: Float[Array, "..."]) -> Float[Array, "..."]:
    """The polynomial of the given coefficients, highest power first."""
    total = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * at + coefficient
    return total


def staged(function, *args):
    """function(*args), computed once: keeps XLA's CPU backend from repeating it inside each consumer.

    That backend fuses producers into every consumer, including trigonometry and table lookups, and drops optimisation
    barriers before it does (a million E_p L2 solves: 780 ms without stages, 285 ms with). It does not fuse across a
    conditional, so the stage is a conditional whose condition always holds but is unknown to the compiler.
    """
    first = jax.tree.leaves(args)[0]
    if first.size == 0 or jax.default_backend() != "cpu":
        return function(*args)

    compiled_once = jax.jit(function)  # traced once for its shapes and its branch
    shapes = jax.eval_shape(compiled_once, *args)
    never = first.ravel()[0] < 0  # every stage's first array is non-negative, or NaN
    return jax.lax.cond(
        never, lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes), compiled_once, *args
    )


def unit_nodes(count: int, dtype) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return ((1 + nodes) / 2).astype(dtype), (weights / 2).astype(dtype)

"""What runs one way on a CPU and another on a device with thousands of threads, each behind one name.

XLA compiles a scan over rows to one kernel after another, and a loop or branch that depends on data to a message to the
host and back at each step (22 us on an H200, where a sum over two million pixels takes 10). There all rows are taken at
once, and extremes of groups are kept in several copies that few threads share.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

_ACCUMULATORS = 65_536  # for extremes of groups: copies of few groups up to this number in all


def wide() -> bool:
    """Whether the device runs thousands of threads: any but a CPU. Known while tracing."""
    return jax.default_backend() != "cpu"


def sweep(step: Callable[[Any, Any], tuple[Any, Any]], start: PyTree, rows: PyTree) -> tuple[PyTree, PyTree]:
    """`jax.lax.scan(step, start, rows)`, where `start` is 0 or None and a step adds its row: by rows or all at once."""
    if not wide():
        return jax.lax.scan(step, start, rows)
    found, kept = jax.vmap(step, (None, 0))(start, rows)
    return jax.tree.map(lambda values: values.sum(0), found), kept


def sweep_points(
    step: Callable[[Any, Any], tuple[Any, Any]],
    start: Callable[[tuple[int, ...]], PyTree],
    points_of: Callable[[PyTree], PyTree],
    rows: PyTree,
) -> PyTree:
    """`step` folded over rows of points; or once, over all of them as one row, where they are scattered anyway.

    Args:
        step: takes what was found and `points_of` a row.
        start: gives what is found in no rows, for rows of a shape.
        points_of: gives arrays of one number for each point.
    """
    shape = jax.tree.leaves(jax.eval_shape(points_of, jax.tree.map(lambda v: v[0], rows)))[0].shape
    if not wide():
        return jax.lax.scan(lambda found, row: step(found, points_of(row)), start(shape), rows)[0]
    points = jax.tree.map(jnp.ravel, jax.vmap(points_of)(rows))
    return step(start(jax.tree.leaves(points)[0].shape), points)[0]


def sums(terms: Sequence[Float[Array, "N ..."]]) -> list[Float[Array, "..."]]:
    """The sum of each over its first axis; on a device of many threads all of them in one kernel, with all that gives
    the terms."""
    return _sums_at_once(*terms) if wide() else [values.sum(0) for values in terms]


@jax.custom_jvp
def _sums_at_once(*terms: Array) -> list[Array]:
    zero = jnp.zeros((), terms[0].dtype)
    return list(jax.lax.reduce(terms, (zero,) * len(terms), lambda x, y: jax.tree.map(jnp.add, x, y), (0,)))


@_sums_at_once.defjvp
def _sums_at_once_jvp(primals, tangents):
    return _sums_at_once(*primals), list(jnp.stack(tangents).sum(1))  # which can be transposed


def mapped(function: Callable[[Any], Any], values: PyTree) -> PyTree:
    """`jax.lax.map`, one by one or all at once."""
    return jax.vmap(function)(values) if wide() else jax.lax.map(function, values)


def extremes(values: PyTree, signs: PyTree, which: Int[Array, " N"], count: int) -> PyTree:
    """The least (sign 1) or the largest (sign -1) of each group's values; inf or -inf for empty groups.

    Args:
        values: arrays (N,).
        signs: of the same structure.
        which: each one's group, in [0, count).
    """
    if not wide():
        return jax.tree.map(
            lambda v, sign: (jax.ops.segment_min if sign > 0 else jax.ops.segment_max)(v, which, count), values, signs
        )
    leaves, structure = jax.tree.flatten(values)
    turned = jnp.stack([-sign * leaf for leaf, sign in zip(leaves, jax.tree.leaves(signs), strict=True)], -1)
    found = raised(jnp.full((count, len(leaves)), -jnp.inf, turned.dtype), which, turned)
    return jax.tree.unflatten(structure, [-sign * v for sign, v in zip(jax.tree.leaves(signs), found.T, strict=True)])


def raised(table: Float[Array, "G K"], which: Int[Array, " N"], values: Float[Array, "N K"]) -> Float[Array, "G K"]:
    """The table with each row raised to the largest of the values that belong to it."""
    if not wide():
        return table.at[which].max(values, mode="promise_in_bounds")
    return _raised_at_once(table, values, which)


@jax.custom_jvp
def _raised_at_once(table: Array, values: Array, which: Array) -> Array:
    # Devices have such an atomic operation for integers; for floats it is a loop.
    count, (groups, columns) = len(values), table.shape
    copies = max(1, _ACCUMULATORS // groups)
    place = which * copies + jnp.arange(count, dtype=which.dtype) % copies
    least = jnp.full((groups * copies, columns), np.iinfo(_bits_of(table.dtype)).min, _bits_of(table.dtype))
    found = least.at[place].max(_ordered(values), mode="promise_in_bounds")
    found = found.reshape(groups, copies, columns).max(1)
    return _floats(jnp.maximum(found, _ordered(table)), table.dtype)


@_raised_at_once.defjvp
def _raised_at_once_jvp(primals, tangents):
    table, values, which = primals
    _, change = jax.jvp(lambda t, v: t.at[which].max(v, mode="promise_in_bounds"), (table, values), tuple(tangents[:2]))
    return _raised_at_once(table, values, which), change


def _bits_of(dtype: Any) -> Any:
    return {4: jnp.int32, 8: jnp.int64}[jnp.dtype(dtype).itemsize]


def _ordered(values: Float[Array, "..."]) -> Int[Array, "..."]:
    """Integers in the order of the numbers."""
    return _swapped(jax.lax.bitcast_convert_type(values, _bits_of(values.dtype)))


def _floats(values: Int[Array, "..."], dtype: Any) -> Float[Array, "..."]:
    return jax.lax.bitcast_convert_type(_swapped(values), dtype)


def _swapped(bits: Int[Array, "..."]) -> Int[Array, "..."]:
    """Negative numbers' bits, whose size falls as the number grows, turned round; its own inverse."""
    return jnp.where(bits < 0, bits ^ np.iinfo(bits.dtype).max, bits)


def first_at_least(
    values: Float[Array, " N"], limit: Float[Array, ""] | float
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """(the index of the first value that is not below the limit, the last if all are; whether there is one)."""
    reached = values >= limit
    there = reached.any()
    return jnp.where(there, jnp.argmax(reached), len(values) - 1), there

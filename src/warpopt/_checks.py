"""Input checks whose messages name the argument, the value and what was expected."""

import contextlib
import contextvars
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.experimental import checkify
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, PyTree

from ._parallel import wide
from ._words import shown

Numbers = ArrayLike | Sequence[ArrayLike] | Sequence[Sequence[ArrayLike]]
"""What public functions take: a number, an array, or a list or table of numbers."""


def float_arrays(**named: Numbers) -> list[Array]:
    """The values as arrays of their common floating dtype, which is JAX's promotion.

    Raises:
        ValueError: text, complex numbers, or anything else that is not an array of real numbers.
    """
    values = {}
    for name, value in named.items():
        try:
            # JAX accepts None and the name of a dtype as a dtype.
            plain = value is None or isinstance(value, list | tuple | str | type)
            values[name] = (jnp if is_traced(value) else np).asarray(value) if plain else value
            dtype = jnp.result_type(values[name])
        except (TypeError, ValueError):
            raise ValueError(f"{name}: got {shown(value)}, expected real numbers") from None
        if not (jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)):
            raise ValueError(f"{name}: got values of type {dtype}, expected real numbers")
    dtype = jnp.result_type(*values.values(), float)
    try:
        return [jnp.asarray(value, dtype) for value in values.values()]
    except OverflowError:  # Python's integers have no largest
        name = next(name for name, value in values.items() if isinstance(value, int) and abs(value) > 2**63)
        raise ValueError(f"{name}: got {shown(values[name])}, expected real numbers") from None


def floats_of(dtype: Any, **named: Numbers) -> list[Array]:
    """The values as arrays of a given dtype; raises as `float_arrays`."""
    return [value.astype(dtype) for value in float_arrays(**named)]


def points_of(dtype: Any, name: str, points: Numbers) -> Float[Array, "... 3"]:
    """The points as an array of a given dtype.

    Raises:
        ValueError: not real numbers, or no points of three.
    """
    (points,) = floats_of(dtype, **{name: points})
    if points.shape[-1:] != (3,):
        raise ValueError(f"{name}: got shape {points.shape}, expected (..., 3)")
    return points


def pair(name: str, value: Any, valid: Callable[[Any], Any], expected: str) -> tuple[float, float]:
    """Two numbers, each valid.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    try:
        one, other = map(float, value)
    except (TypeError, ValueError, OverflowError):
        one = other = float("nan")
    if not (valid(one) and valid(other)):
        raise ValueError(f"{name}: got {shown(value)}, expected {expected}")
    return one, other


def instance(name: str, value: Any, kind: type) -> None:
    """Refuse a value of another class.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(f"{name}: got {shown(value)}, expected {article} {kind.__name__}")


def assembled(kind: type, **fields: Any) -> Any:
    """An equinox module with the given fields, which must be valid: nothing is checked or compiled again."""
    module = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(module, name, value)
    return module


def joint_shape(**named: Array) -> tuple[int, ...]:
    """The shape that the arrays broadcast to.

    Raises:
        ValueError: the shapes do not broadcast; the message lists them.
    """
    try:
        return np.broadcast_shapes(*(value.shape for value in named.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in named.items())
        raise ValueError(f"shapes: got {shapes}, expected ones that broadcast") from None


def is_traced(*values: Any) -> bool:
    """Whether any of the values is known only at run time of a compiled program."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values))


def refuse_traced(verb: str, *values: Any) -> None:
    """Refuse traced values where a result is computed on the host.

    Raises:
        ValueError: some value is traced.
    """
    if is_traced(values):
        raise ValueError(f"{verb}: got traced values, expected concrete ones: call it outside jax.jit, vmap and grad")


_Way = Literal["raised", "trusted", "gathered"]
_WAY: contextvars.ContextVar[_Way] = contextvars.ContextVar("way", default="raised")  # of a check of a traced value
_SMALL = 1024  # entries: below this a comparison on the host is cheaper than one on any device


@contextlib.contextmanager
def trusted() -> Iterator[None]:
    """A context in which `checked` accepts traced values unchecked: the caller has checked the inputs they come from.

    A check of a traced value is a callback to the host, which prevents caching of the compiled program.
    """
    with _in_the_way("trusted"):
        yield


def gathered(function: Callable[[], PyTree]) -> tuple[Bool[Array, ""], PyTree]:
    """(whether a check of a traced value failed in the function, what it returned), under `jax.jit`.

    Without a callback to the host, which would end the program with JAX's own error.
    """
    with _in_the_way("gathered"):
        error, result = checkify.checkify(function)()
    flags = [leaf for leaf in jax.tree.leaves(error) if leaf.dtype == bool]
    return functools.reduce(jnp.logical_or, flags, jnp.zeros((), bool)), result


@contextlib.contextmanager
def _in_the_way(way: _Way) -> Iterator[None]:
    token = _WAY.set(way)
    try:
        yield
    finally:
        _WAY.reset(token)


def checked(name: str, value: Any, valid: Callable[..., Any], expected: str, *others: Any) -> Array:
    """Return `value` if `valid(value, *others)` holds everywhere.

    Args:
        name: the argument's name.
        value: the argument's value.
        valid: maps arrays (JAX or NumPy) to where `value` is valid.
        expected: the condition in words.
        others: values to compare with, of shapes that broadcast.

    Raises:
        ValueError: for a concrete value, naming the argument, the first invalid entry and what was expected.
            For a traced value, `equinox.error_if` raises the same message at run time; use the returned array.
    """
    arrays = value, *others
    traced = is_traced(arrays)
    if traced and _WAY.get() == "trusted":
        return value
    if not traced and all(_cheap_on_host(array) for array in arrays):
        arrays = map(np.asarray, arrays)
    good = valid(*arrays)
    if traced:
        words = f"{name}: got a value out of range, expected {expected}"
        if _WAY.get() == "gathered":
            checkify.check(jnp.all(good), words)
            return value
        return eqx.error_if(value, ~good, words)
    good = np.asarray(good)
    if not good.all():
        raise ValueError(f"{name}: got {np.asarray(value)[~good].flat[0]}, expected {expected}")
    return value


def _cheap_on_host(array: Any) -> bool:
    """Whether NumPy compares it at once: a CPU's memory is the host's, and JAX would compile each comparison."""
    here = getattr(array, "is_fully_addressable", True)
    return here and (array.size <= _SMALL or not wide())

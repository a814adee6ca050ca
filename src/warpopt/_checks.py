"""Refusing bad input in words: what was named, what was got, what was expected."""

import contextlib
import contextvars
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array

Numbers = ArrayLike | Sequence[ArrayLike] | Sequence[Sequence[ArrayLike]]
"""What public functions take: a number, an array, or a list or table of numbers."""


def float_arrays(**named: Numbers) -> list[Array]:
    """The values as arrays of their common floating dtype, which is JAX's promotion.

    Raises:
        ValueError: for text, complex numbers, or anything else that is no array of real numbers, naming it.
    """
    values = {}
    for name, value in named.items():
        try:
            # JAX takes None and the name of a dtype for a dtype.
            plain = value is None or isinstance(value, list | tuple | str | type)
            values[name] = np.asarray(value) if plain else value
            dtype = jnp.result_type(values[name])
        except (TypeError, ValueError):
            raise ValueError(f"{name}: got {value!r}, expected real numbers") from None
        if not (jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)):
            raise ValueError(f"{name}: got values of type {dtype}, expected real numbers")
    dtype = jnp.result_type(*values.values(), float)
    return [jnp.asarray(value, dtype) for value in values.values()]


def shown(value: Any) -> str:
    """A value as it is written, or its type where that would take more than a line."""
    text = repr(value)
    return text if len(text) <= 60 and "\n" not in text else type(value).__name__


def pair(name: str, value: Any, valid: Callable[[Any], Any], expected: str) -> tuple[float, float]:
    """Two numbers, each valid.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    try:
        one, other = map(float, value)
    except (TypeError, ValueError):
        one = other = float("nan")
    if not (valid(one) and valid(other)):
        raise ValueError(f"{name}: got {shown(value)}, expected {expected}")
    return one, other


def instance(name: str, value: Any, kind: type) -> None:
    """Refuse what is of another class.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(f"{name}: got {shown(value)}, expected {article} {kind.__name__}")


def assembled(kind: type, **fields: Any) -> Any:
    """An equinox module of the given fields, which are known to be good: nothing is checked, or compiled, again."""
    module = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(module, name, value)
    return module


def joint_shape(**named: Array) -> tuple[int, ...]:
    """The shape that the arrays broadcast to.

    Raises:
        ValueError: if they do not, naming each with its shape.
    """
    try:
        return np.broadcast_shapes(*(value.shape for value in named.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in named.items())
        raise ValueError(f"shapes: got {shapes}, expected ones that broadcast") from None


def is_traced(*values: Any) -> bool:
    """Whether something of the values is known only when a compiled program runs."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values))


_TRUSTED = contextvars.ContextVar("trusted", default=False)
_SMALL = 1024  # entries: a comparison of its own on the device costs more than these do on the host


@contextlib.contextmanager
def trusted() -> Iterator[None]:
    """While it lasts, `checked` takes traced values as they are: the caller has checked what they are made of.

    A check of a traced value is a call back to the host, which no compilation cache keeps.
    """
    token = _TRUSTED.set(True)
    try:
        yield
    finally:
        _TRUSTED.reset(token)


def checked(name: str, value: Any, valid: Callable[..., Any], expected: str, *others: Any) -> Array:
    """Return `value` if `valid(value, *others)` holds everywhere.

    Args:
        name: of the argument.
        value: its value.
        valid: of arrays, JAX's or NumPy's, to where the first is good.
        expected: in words.
        others: that the first is compared with, of shapes that broadcast.

    Raises:
        ValueError: for a concrete value, naming the argument, the first offending entry and what was expected.
            For a traced value the same words come from `equinox.error_if` at run time; use the returned array.
    """
    arrays = value, *others
    traced = is_traced(arrays)
    if traced and _TRUSTED.get():
        return value
    if not traced and all(array.size <= _SMALL for array in arrays):
        arrays = map(np.asarray, arrays)
    good = valid(*arrays)
    if traced:
        return eqx.error_if(value, ~good, f"{name}: got a value out of range, expected {expected}")
    good = np.asarray(good)
    if not good.all():
        raise ValueError(f"{name}: got {np.asarray(value)[~good].flat[0]}, expected {expected}")
    return value

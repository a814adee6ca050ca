"""Refusing bad input in words: what was named, what was got, what was expected."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array


def float_arrays(**named: ArrayLike) -> list[Array]:
    """The values as arrays of their common floating dtype, which is JAX's promotion.

    Raises:
        ValueError: for text, complex numbers, or anything else that is no array of real numbers, naming it.
    """
    values = {}
    for name, value in named.items():
        try:
            values[name] = np.asarray(value) if isinstance(value, list | tuple) else value
            dtype = jnp.result_type(values[name])
        except (TypeError, ValueError):
            raise ValueError(f"{name}: got {value!r}, expected real numbers") from None
        if not (jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)):
            raise ValueError(f"{name}: got values of type {dtype}, expected real numbers")
    dtype = jnp.result_type(*values.values(), float)
    return [jnp.asarray(value, dtype) for value in values.values()]


def instance(name: str, value: Any, kind: type) -> None:
    """Refuse what is of another class.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(f"{name}: got {value!r}, expected {article} {kind.__name__}")


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


def checked(name: str, value: Array, valid: Callable[[Any], Any], expected: str) -> Array:
    """Return `value` if `valid(value)` holds everywhere.

    Raises:
        ValueError: for a concrete value, naming the argument, the first offending entry and what was expected.
            For a traced value the same words come from `equinox.error_if` at run time; use the returned array.
    """
    good = valid(value)
    if isinstance(good, jax.core.Tracer) or isinstance(value, jax.core.Tracer):
        return eqx.error_if(value, ~good, f"{name}: got a value out of range, expected {expected}")
    good = np.asarray(good)
    if not good.all():
        raise ValueError(f"{name}: got {np.asarray(value)[~good].flat[0]}, expected {expected}")
    return value

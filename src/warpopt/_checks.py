"""Refusing bad input in words: what was named, what was got, what was expected."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array


def checked(name: str, value: Array, valid: Callable[[Any], Any], expected: str) -> Array:
    """Return `value` if `valid(value)` holds everywhere.

    Raises:
        ValueError: for a concrete value, naming the argument, the first offending entry and what was expected.
            For a traced value the same words come from `equinox.error_if` at run time; use the returned array.
    """
    if isinstance(value, jax.core.Tracer):
        return eqx.error_if(value, ~valid(value), f"{name}: got a value out of range, expected {expected}")
    concrete = np.asarray(value)
    good = np.asarray(valid(concrete))
    if not good.all():
        raise ValueError(f"{name}: got {concrete[~good].flat[0]}, expected {expected}")
    return value

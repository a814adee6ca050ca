"""Refusals that need no JAX: a value in a sentence, and choices by name, flags and whole numbers."""

from collections.abc import Collection
from typing import Any

import numpy as np


def shown(value: Any) -> str:
    """A value as text, or its type if the text is longer than a line."""
    if isinstance(value, int) and abs(value) >= 10**60:  # Python refuses to print the largest
        return "a huge integer"
    text = repr(value)
    return text if len(text) <= 60 and "\n" not in text else type(value).__name__


def one_of(name: str, value: Any, known: Collection[str]) -> None:
    """Refuse what is not one of some words.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if not (isinstance(value, str) and value in known):
        *others, last = map(repr, known)
        expected = f"{', '.join(others)} or {last}" if others else last
        raise ValueError(f"{name}: got {shown(value)}, expected {expected}")


def flag(name: str, value: Any) -> None:
    """Refuse what is not True or False: every other object would pass for one of them.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name}: got {shown(value)}, expected True or False")


def whole_number(name: str, value: Any, least: int, most: int, otherwise: str = "") -> None:
    """Refuse what is not an integer in [least, most]; true is none.

    Raises:
        ValueError: naming the argument, what was got and what was expected.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{name}: got {shown(value)}, expected an integer >= {least} and <= {most:,}{otherwise}")

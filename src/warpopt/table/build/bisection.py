"""Bisection of many brackets at once."""

from collections.abc import Callable

import numpy as np
from jax.typing import ArrayLike


def bisected(holds: Callable, good: ArrayLike, bad: ArrayLike, steps: int = 45) -> tuple[np.ndarray, np.ndarray]:
    """(good, bad) ends of the brackets after `steps` halvings (45 take a thousandth of a radian to the last bit).

    Args:
        holds: maps an array like the ends to whether each entry is on the good side.
        good, bad: ends at which `holds` is true and false; either may be the larger.
    """
    good, bad = np.asarray(good), np.asarray(bad)
    for _ in range(steps):
        middle = (good + bad) / 2
        kept = holds(middle)
        good, bad = np.where(kept, middle, good), np.where(kept, bad, middle)
    return good, bad

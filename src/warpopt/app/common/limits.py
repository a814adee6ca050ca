"""Text for reports about the lower bound ("limit"): the best that any map of the depth could reach."""

import numpy as np


def least_and_largest(values: np.ndarray) -> tuple[float, float] | None:
    """The least and largest finite value; None if there are none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else None


def limit_sentence(over_limit: tuple[float, float] | None) -> str:
    """How far the optimum is from the limit; empty where there is none."""
    if over_limit is None:
        return ""
    low, high = (f"{value:.3g}" for value in over_limit)
    if low == high == "1":
        return "The optimum attains the limit."
    return f"The optimum's error is {low if low == high else f'{low} to {high}'} times the limit."

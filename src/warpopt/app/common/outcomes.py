"""How solves ended: which of them found what they looked for, and how many of each there are."""

from typing import Any

import numpy as np

import warpopt


def succeeded(results: Any) -> np.ndarray:
    """Whether each of `warpopt.Outcome`'s numbers is a success."""
    good = [outcome for outcome in warpopt.Outcome if outcome.succeeded]
    return np.isin(results, good)


def outcome_counts(results: Any) -> dict[str, int]:
    """How many of each outcome there are, by name."""
    values, counts = np.unique(np.asarray(results, int), return_counts=True)
    return {warpopt.Outcome(v).name: n for v, n in zip(values.tolist(), counts.tolist(), strict=True)}

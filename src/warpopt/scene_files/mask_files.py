"""Masks of a frame from files: which pixels the light reaches."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .depth_files import read_values


def read_mask(path: Path) -> NDArray[np.bool_]:
    """(H, W), true where the value is above half of the file's largest possible one; row 0 is the top.

    Args:
        path: `.npy`, `.npz` or `.png`, one channel: booleans, integers of the whole range, or numbers in [0, 1].

    Raises:
        ValueError: one sentence that names the file, what was got and what was expected.
        OSError: a file that cannot be read.
    """
    values, _ = read_values(path)
    values = np.asarray(values)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2 or 0 in values.shape:
        raise ValueError(f"{path}: got shape {values.shape}, expected (height, width)")
    if values.dtype == np.bool_:
        return values
    if values.dtype.kind in "iu":
        # Integers that are 0 and 1 alone are a mask already; others fill the range of their type.
        most = 1 if values.max() <= 1 else np.iinfo(values.dtype).max
        return values > most / 2
    if not ((values >= 0) & (values <= 1)).all():
        raise ValueError(f"{path}: got {values[~((values >= 0) & (values <= 1))].flat[0]}, expected numbers in [0, 1]")
    return values > 0.5

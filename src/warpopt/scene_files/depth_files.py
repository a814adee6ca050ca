"""Depth images from `.npy` and OpenEXR files."""

from pathlib import Path

import numpy as np

_EXR_MAGIC = bytes.fromhex("762f3101")


def read_depth(path: Path, encoding: str, channel: str | None = None) -> np.ndarray:
    """The depths of a file, (height, width), row 0 at the top.

    Args:
        path: `.npy` or `.exr`.
        encoding: "linear", "standard" or "reversed", see `warpopt.DepthBuffer`.
        channel: of an OpenEXR file with more than one; "Z" by default.

    Raises:
        ValueError: for what is no such file, and for depths that are NaN, infinite or outside the encoding's range.
        OSError: for a file that cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(6)
    if start[:4] == _EXR_MAGIC:
        depth = _exr(path, channel)
    elif start == b"\x93NUMPY":
        try:
            depth = np.load(path, allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(f"{path}: cannot be read as .npy: {error}") from None
    else:
        raise ValueError(f"{path}: got a file that is neither .npy nor OpenEXR, expected one of them")
    return _checked(depth, encoding, path)


def _checked(depth: np.ndarray, encoding: str, path: Path) -> np.ndarray:
    if depth.ndim != 2 or 0 in depth.shape:
        raise ValueError(f"{path}: got an array of shape {depth.shape}, expected (height, width)")
    if not (np.issubdtype(depth.dtype, np.floating) or np.issubdtype(depth.dtype, np.integer)):
        raise ValueError(f"{path}: got values of type {depth.dtype}, expected real numbers")
    depth = depth.astype(float)
    high = np.inf if encoding == "linear" else 1.0
    for bad, got, expected in (
        (np.isnan(depth), "NaN", "finite depths"),
        (np.isinf(depth), "infinity", "finite depths"),
        ((depth < 0) | (depth > high), None, "eye depths >= 0" if encoding == "linear" else "numbers in [0, 1]"),
    ):
        if bad.any():
            row, column = (int(i) for i in np.argwhere(bad)[0])
            value = got or f"{depth[row, column]:g}"
            raise ValueError(
                f"{path}: got {value} in row {row}, column {column} ({int(bad.sum())} of {depth.size} pixels are like "
                f"that), expected {expected} for encoding {encoding!r}"
            )
    return depth


def _exr(path: Path, channel: str | None) -> np.ndarray:
    try:
        import OpenEXR
    except ImportError:
        raise ValueError(
            f"{path}: got an OpenEXR file, expected the package OpenEXR to read it with: pip install 'warpopt[scene]'"
        ) from None
    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except Exception as error:  # the reader has no error class of its own
        raise ValueError(f"{path}: cannot be read as OpenEXR: {error}") from None
    names = sorted(channels)
    wanted = channel or ("Z" if "Z" in channels or len(names) != 1 else names[0])
    if wanted not in channels:
        raise ValueError(f"{path}: got channels {', '.join(names) or 'none'}, expected {wanted!r} among them")
    return np.asarray(channels[wanted].pixels)

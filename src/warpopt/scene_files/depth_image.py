"""Depth images as renderers write them, converted to one convention."""

import dataclasses
from typing import Literal

import numpy as np

Encoding = Literal["linear", "standard", "reversed"]
_BACKGROUND = {"linear": np.inf, "standard": 1.0, "reversed": 0.0}


@dataclasses.dataclass(frozen=True, eq=False)
class DepthImage:
    """Depths with one value for background.

    Attributes:
        depth: (height, width), row 0 at the top: eye depth if `encoding` is "linear", otherwise values in [0, 1].
            Background is inf, 1 ("standard") or 0 ("reversed").
        encoding: see `warpopt.DepthBuffer`.
        seen: number of pixels that are not background.
        smallest: the least value, including background; if linear, the least that is finite and > 0; nan if none.
        limit: values at or beyond it are background.
        limit_name: "far" or "background", the setting that gave the limit.
    """

    depth: np.ndarray
    encoding: Encoding
    seen: int
    smallest: float
    limit: float
    limit_name: str

    def why_blank(self) -> str | None:
        """A sentence on why all pixels are background; None if some are not."""
        if self.seen:
            return None
        count = f"all {self.depth.size:,} values are"
        if np.isnan(self.smallest):
            return (
                f"{count} infinite, 0, negative or missing: nothing is seen" if self._linear else f"{count} background"
            )
        if not self._linear:
            return f"{count} background for encoding {self.encoding!r}"
        return f"{count} at or beyond {self.limit_name} = {self.limit:,g}; the smallest is {self.smallest:,g}: units?"

    @property
    def _linear(self) -> bool:
        return self.encoding == "linear"


def decoded_image(
    values: np.ndarray,
    there: np.ndarray | None = None,
    *,
    encoding: Encoding = "linear",
    scale: float | None = None,
    background: float | None = None,
    far: float = np.inf,
    nan_is_background: bool = False,
    rows: str = "top_down",
    distance: str = "planar",
    window: tuple[float, float, float, float] | None = None,
) -> DepthImage:
    """A file's values in one convention; see `depth_files.read_depth_image`.

    Args:
        values: (height, width), real.
        there: which pixels have a value; all if not given.

    Raises:
        ValueError: values that are NaN or outside the encoding's range, or incompatible settings.
    """
    for name, got, known in (
        ("encoding", encoding, tuple(_BACKGROUND)),
        ("rows", rows, ("top_down", "bottom_up")),
        ("distance", distance, ("planar", "ray")),
    ):
        if got not in known:
            raise ValueError(f"{name}: got {got!r}, expected one of {', '.join(map(repr, known))}")
    if distance == "ray" and (encoding != "linear" or window is None):
        raise ValueError("distance: got 'ray', expected linear encoding and a window with it")
    if values.dtype.kind == "b":
        raise ValueError("got true and false, expected depths")
    if scale is None and values.dtype.kind != "f":
        raise ValueError(f"got integers ({values.dtype}), expected scale with them (0.001 for millimetres)")
    if scale is not None and not 0 < scale < np.inf:
        raise ValueError(f"scale: got {scale:g}, expected a finite number > 0")
    if background is not None and not background > 0 and encoding != "reversed":
        raise ValueError(f"background: got {background:g}, expected a number > 0")
    there = np.ones(values.shape, bool) if there is None else there
    if rows == "bottom_up":
        values, there = values[::-1], there[::-1]
    with np.errstate(invalid="ignore", over="ignore"):  # signalling NaN, and overflow to infinity
        depth = values.astype(float)
        if scale is not None:
            depth = depth * scale
    missing = np.isnan(depth) & there
    if missing.any() and not nan_is_background:
        raise _refused(depth, missing, encoding, "NaN", "numbers (or nan_is_background)")
    empty = ~there | missing
    if encoding == "linear":
        return _linear(depth, empty, background, far, distance, window)
    beyond = ((depth < 0) | (depth > 1)) & ~empty
    if beyond.any():
        raise _refused(depth, beyond, encoding, None, "numbers in [0, 1]")
    if encoding == "standard":
        limit = 1.0 if background is None else min(background, 1.0)
        marked = empty | (depth >= limit)
    else:
        limit = 0.0 if background is None else max(background, 0.0)
        marked = empty | (depth <= limit)
    smallest = float(depth[~empty].min()) if not empty.all() else np.nan
    name = "far" if background is None else "background"
    depth = np.where(marked, _BACKGROUND[encoding], depth)
    return DepthImage(depth, encoding, int((~marked).sum()), smallest, limit, name)


def _linear(
    depth: np.ndarray,
    empty: np.ndarray,
    background: float | None,
    far: float,
    distance: str,
    window: tuple[float, float, float, float] | None,
) -> DepthImage:
    # NaN compares false, so it is not a depth either.
    real = (depth > 0) & (depth < np.inf) & ~empty
    smallest = float(depth[real].min()) if real.any() else np.nan
    marked = ~real
    limit, name = far, "far"
    if background is not None:
        marked |= depth >= background
        if background < far:
            limit, name = background, "background"
    if distance == "ray":
        assert window is not None  # the caller checked this
        depth = depth / ray_lengths(window, *depth.shape)
        if name == "far":
            smallest = float(depth[real].min()) if real.any() else np.nan
    marked |= depth >= far
    return DepthImage(np.where(marked, np.inf, depth), "linear", int((~marked).sum()), smallest, limit, name)


def ray_lengths(window: tuple[float, float, float, float], height: int, width: int) -> np.ndarray:
    """(height, width): distance along each pixel's ray over eye depth, at pixels' centres, row 0 at the top.

    Args:
        window: slopes (left, right, bottom, top) of the side planes.
    """
    left, right, bottom, top = window
    across = left + (right - left) * (np.arange(width) + 0.5) / width
    up = top - (top - bottom) * (np.arange(height) + 0.5) / height
    return np.sqrt(1 + across * across + (up * up)[:, None])


def pinhole_window(
    fx: float, fy: float, cx: float, cy: float, width: int, height: int, *, first_centre: float = 0.5
) -> tuple[float, float, float, float]:
    """Slopes (left, right, bottom, top) of the side planes of a pinhole camera.

    Args:
        fx, fy: focal lengths in pixels.
        cx, cy: principal point in pixels, to the right and down from the top left.
        width, height: of the image in pixels.
        first_centre: position of the first pixel's centre: 0.5 if the image begins at 0, so that the middle is
            width / 2; 0 if pixel centres are integers, as in OpenCV, so that the middle is (width - 1) / 2.

    Raises:
        ValueError: numbers that are not finite, or not positive where required.
    """
    for name, value, positive in (
        ("fx", fx, True), ("fy", fy, True), ("cx", cx, False), ("cy", cy, False), ("width", width, True),
        ("height", height, True),
    ):  # fmt: skip
        if not np.isfinite(value) or (positive and value <= 0):
            raise ValueError(f"{name}: got {value:g}, expected a finite number" + (" > 0" if positive else ""))
    edge = first_centre - 0.5
    return (edge - cx) / fx, (edge + width - cx) / fx, (cy - edge - height) / fy, (cy - edge) / fy


def _refused(depth: np.ndarray, bad: np.ndarray, encoding: str, got: str | None, expected: str) -> ValueError:
    row, column = (int(i) for i in np.argwhere(bad)[0])
    return ValueError(
        f"got {got or f'{depth[row, column]:g}'} in row {row}, column {column} ({int(bad.sum()):,} of {depth.size:,} "
        f"pixels are like that), expected {expected} for encoding {encoding!r}"
    )

"""The map's depth as numbers that an engine can set."""

from typing import Any

import numpy as np

from warpopt.render.map_depth import DepthCells, MapDepth

_FIXED = {"d16": 2**16 - 1, "d24": 2**24 - 1}
# Nearest lookup is off by at most half a texel along each axis of the map: half the sum of two slopes, which is at most
# the larger, the m of a polygon offset.
SLOPE_SCALE = 1.0


def depth_numbers(depth: MapDepth, cells: DepthCells, reversed_z: bool, texels: bool) -> dict[str, Any]:
    """Steps of depth formats along the light over the receivers, in world units, and the bias for one texel.

    Args:
        depth, cells: of one map with at least one receiver.
        reversed_z: whether the buffer holds 1 - u.
        texels: whether the map's texels are known.
    """
    there = np.asarray(cells.there)
    low, high = (np.asarray(v, float)[there] for v in cells.blend)
    span = float(depth.largest) - float(depth.least)
    steps = {name: _pair(low * span / count, high * span / count) for name, count in _FIXED.items()}
    first, last = (np.asarray(v, float)[there] for v in cells.depth)
    if reversed_z:
        first, last = 1 - last, 1 - first
    steps["d32f"] = _pair(*(blend * span * _spacing(u) for blend, u in ((low, first), (high, last))))
    edges = [np.hypot(*(np.asarray(v[i], float)[there] for v in (cells.along, cells.across))) for i in (0, 1)]
    return {
        "receivers_share": float(depth.share),
        "extent": float(depth.extent),
        "steps": steps,
        "slope_scale": SLOPE_SCALE,
        "bias_at_45_deg": _pair(*(edge / 2 for edge in edges)) if texels else None,
    }


def _spacing(u: np.ndarray) -> np.ndarray:
    """Between u and the float32 before it: 1 is the largest that a buffer holds."""
    single = u.astype(np.float32)
    return np.where(
        single > 0, single.astype(float) - np.nextafter(single, np.float32(0)), np.finfo(np.float32).smallest_subnormal
    )


def _pair(smallest: np.ndarray, largest: np.ndarray) -> dict[str, float]:
    return {"smallest": float(smallest.min()), "largest": float(largest.max())}

"""The surface of the convex hull of points, as triangles; on the host."""

import itertools

import numpy as np
from jaxtyping import Float

_FLAT = 1e-12  # of the largest extent: what is thinner has no inside that the hull could be found by


def hull_triangles(points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "T 3 3"]:
    """The hull's faces; of points in a plane, on a line or in one place, a fan that covers them, of no thickness.

    As many as a power of two, the last one repeated: another set of points of that size compiles nothing anew.

    Args:
        points: finite, at least one.

    Example:
        >>> corners = np.array([(x, y, 0.0) for x in (0, 1) for y in (0, 1)])
        >>> hull_triangles(corners).shape
        (2, 3, 3)
    """
    faces = _faces(np.asarray(points, float))
    count = 1 << (len(faces) - 1).bit_length()
    return points[np.pad(faces, ((0, count - len(faces)), (0, 0)), mode="edge")]


def _faces(points: np.ndarray) -> np.ndarray:
    """(T, 3) indices of corners."""
    from scipy.spatial import ConvexHull, QhullError  # importing it takes 0.1 s, a third of warpopt's own

    # Of unit size, so that no square over- or underflows.
    centred = points / max(np.abs(points).max(), np.finfo(float).tiny)
    centred = centred - centred.mean(0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    rank = int((sizes > _FLAT * max(sizes[0], np.finfo(float).tiny)).sum()) if len(points) > 1 else 0
    if rank == 3:
        try:
            return ConvexHull(centred).simplices
        except QhullError:  # thinner than its rounding: joggled, which moves no corner
            return ConvexHull(centred, qhull_options="QJ").simplices
    if rank == 2:
        around = ConvexHull(centred @ axes[:2].T).vertices
        return np.array([(around[0], *pair) for pair in itertools.pairwise(around[1:])])
    along = centred @ axes[0] if rank else np.zeros(len(points))
    return np.array([[along.argmin(), along.argmax(), along.argmax()]])

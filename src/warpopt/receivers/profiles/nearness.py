"""The integral over the light plane of max 1/z^2 among the receivers on each ray: the texels that any maps need.

A map that has a texel per pixel is at least 1/z^2 dense at every receiver, in units of the screen at z = 1; of the
receivers on a ray of the light the nearest decides (T60).
"""

import numpy as np
from numpy.typing import NDArray

_FLAT = 1e-9  # of a body's size: thinner ones are polygons


def over_body(vertices: NDArray, light: NDArray, parallel: bool = False) -> float:
    """Over a convex body, or a polygon: exact, face by face.

    A ray's nearest receiver is where it leaves the body towards smaller z.

    Args:
        vertices: (N, 3) in eye coordinates, z > 0; more than those of the hull may be given.
        light: (3,) unit vector in eye coordinates.
        parallel: whether all receivers count alike, as under parallel rays: the body's area as the light sees it.
    """
    from scipy.spatial import ConvexHull  # importing it takes 0.1 s, a third of warpopt's own

    vertices = np.unique(np.asarray(vertices, np.float64), axis=0)
    if len(vertices) < 3:
        return 0.0
    centred = vertices - vertices.mean(0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    if sizes[1] <= _FLAT * sizes[0]:
        return 0.0
    if sizes[2] <= _FLAT * sizes[0]:
        ring = vertices[ConvexHull(centred @ axes[:2].T).vertices]
        triangles = np.stack([np.broadcast_to(ring[0], ring[2:].shape), ring[1:-1], ring[2:]], 1)
    else:
        hull = ConvexHull(vertices)
        nearer = light * (-1.0 if light[2] > 0 else 1.0)
        triangles = vertices[hull.simplices[hull.equations[:, :3] @ nearer > 0]]
    first, second, third = np.moveaxis(triangles, 1, 0)
    areas = np.abs(np.cross(second - first, third - first) @ light)
    return float(areas.sum() / 2 if parallel else areas @ _mean_nearness(np.sort(triangles[..., 2], -1)))


def _mean_nearness(z: NDArray) -> NDArray:
    """Half the mean of 1/z^2 over triangles with these depths (T, 3), ascending: a divided difference of -log z."""
    a, b, c = z.T

    def slope(low: NDArray, high: NDArray) -> NDArray:
        """(log high - log low)/(high - low)."""
        x = (high - low) / low
        safe = np.where(x > 1e-8, x, 1)
        return np.where(x > 1e-8, np.log1p(safe) / safe, 1 - x / 2) / low

    spread = (c - a) / a
    close = spread < 1e-5  # then the difference has lost ten digits, and the middle's value is right to as many
    middle = (a + b + c) / 3
    return np.where(close, 0.5 / middle**2, (slope(a, b) - slope(b, c)) / np.where(close, 1, c - a))


def over_points(points: NDArray, z: NDArray, light: NDArray, side: float) -> float:
    """Over a set of points that stand for the surfaces between them: in square cells, the finest where z is least.

    A cell counts with the least z of its points, so the sum falls to the integral as cells shrink, as long as they are
    not smaller than the gaps between points. Cells of far points have the part of their area that finer cells leave.

    Args:
        points: (N, 3) in eye coordinates.
        z: (N,) > 0, of which 1/z^2 counts: their eye depths, or ones.
        light: (3,) unit vector in eye coordinates.
        side: of a cell, over the least depth of its octave.
    """
    points = np.asarray(points, np.float64)
    if not len(points):
        return 0.0
    other = np.eye(3)[np.argmin(np.abs(light))]
    one = np.cross(light, other)
    one /= np.linalg.norm(one)
    plane = points @ np.stack([one, np.cross(light, one)], 1)
    octave = np.floor(np.log2(z)).astype(int)
    plane = plane / (side * 2.0 ** octave.min())  # in cells of the finest octave
    total, unit = 0.0, (side * 2.0 ** octave.min()) ** 2
    covered = np.zeros((0, 2), np.int64), np.zeros(0)  # finer cells and their covered areas, in the octave's cells
    for level in range(octave.max() - octave.min() + 1):
        mine = octave == octave.min() + level
        where = np.floor(plane[mine] / 2.0**level).astype(np.int64)
        cells, index = np.unique(np.concatenate([where, covered[0]]), axis=0, return_inverse=True)
        index = index.ravel()
        least = np.full(len(cells), np.inf)
        np.minimum.at(least, index[: len(where)], z[mine])
        finer = np.bincount(index[len(where) :], covered[1], len(cells))
        area = 4.0**level
        occupied = np.isfinite(least)
        total += unit * ((area - finer)[occupied] / least[occupied] ** 2).sum()
        covered = cells // 2, np.where(occupied, area, finer)
    return float(total)

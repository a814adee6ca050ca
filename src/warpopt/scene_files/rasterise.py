"""Triangles to a depth image: a z-buffer in NumPy."""

import numpy as np

from .scene_camera import SceneCamera

_CANDIDATES = 1_000_000  # bounding-box pixels tested at once: 100 MB of work arrays


def rasterise(triangles: np.ndarray, camera: SceneCamera, height: int, width: int) -> np.ndarray:
    """Eye depth of the nearest surface at every pixel's centre, (height, width); 0 for background.

    In homogeneous form (Olano and Greer 1997): the ray c = z s hits a triangle with vertices a, b, c where its
    barycentric coordinates over z, s . (b x c)/det and so on, are >= 0; their sum is 1/z. Vertices behind the eye need
    no clipping; depths outside [near, far) are not hits. Both faces are visible. For parallel rays (x, y, 1) takes the
    place of a vertex (x, y, z): the coordinates' sum is 1, and z is linear in them.

    Args:
        triangles: (N, 3, 3) world points.
    """
    eye = camera.to_eye(np.asarray(triangles, float))
    eye = eye[(eye[..., 2].max(1) > camera.near) & (eye[..., 2].min(1) < camera.far)]
    parallel = camera.is_orthographic
    rays = np.concatenate([eye[..., :2], np.ones_like(eye[..., 2:])], -1) if parallel else eye
    size = np.abs(rays).max((1, 2), initial=0)[:, None, None]  # per triangle, so that no product over- or underflows
    unit = rays / size
    normals = np.cross(unit[:, [1, 2, 0]], unit[:, [2, 0, 1]])  # edge functions: one vector for each vertex
    volume = (unit[:, 0] * normals[:, 0]).sum(1)
    seen = np.abs(volume) > np.finfo(float).tiny  # not edge-on, and with nonzero area
    eye, weights = eye[seen], normals[seen] / volume[seen, None, None] / size[seen]
    first, counts = _pixel_boxes(eye, camera, height, width)
    depth = np.full(height * width, np.inf)
    across, up = camera.slopes(height, width)
    sizes = counts.prod(1)
    start = 0
    ends = np.cumsum(sizes)
    while start < len(eye):
        before = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + _CANDIDATES, side="right")))
        which = np.repeat(np.arange(start, stop), sizes[start:stop])
        place = np.arange(len(which)) - np.repeat(ends[start:stop] - sizes[start:stop] - before, sizes[start:stop])
        column = first[which, 0] + place % np.maximum(counts[which, 0], 1)
        row = first[which, 1] + place // np.maximum(counts[which, 0], 1)
        w = weights[which]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # inf and NaN are not hits
            shares = w[..., 0] * across[column][:, None] + w[..., 1] * up[row][:, None] + w[..., 2]
            z = (shares * eye[which][..., 2]).sum(1) if parallel else 1 / shares.sum(1)
        hit = (shares >= 0).all(1) & (z < camera.far) & (z >= camera.near)
        np.minimum.at(depth, (row * width + column)[hit], z[hit])
        start = stop
    return np.where(np.isfinite(depth), depth, 0).reshape(height, width)


def _pixel_boxes(eye: np.ndarray, camera: SceneCamera, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """(first column and row, columns and rows) of each triangle's part beyond the near plane."""
    other = eye[:, [1, 2, 0]]
    z, z_other = eye[..., 2], other[..., 2]
    ahead = z >= camera.near
    crossing = ahead != (z_other >= camera.near)
    share = np.where(crossing, (camera.near - z) / np.where(crossing, z_other - z, 1), 0)
    cut = eye + share[..., None] * (other - eye)
    cut[..., 2] = camera.near  # exactly: rounding loses a near plane much nearer than the vertices
    points = np.concatenate([eye, cut], axis=1)
    there = np.concatenate([ahead, crossing], axis=1)
    slopes = points[..., :2] / np.where(there & (not camera.is_orthographic), points[..., 2], 1)[..., None]
    least = np.where(there[..., None], slopes, np.inf).min(1)
    most = np.where(there[..., None], slopes, -np.inf).max(1)
    left, right, bottom, top = camera.window
    size = np.array([width, height])
    scale = size / np.array([right - left, top - bottom])
    low = np.stack([least[:, 0] - left, top - most[:, 1]], 1) * scale - 0.5
    high = np.stack([most[:, 0] - left, top - least[:, 1]], 1) * scale - 0.5
    # One more pixel on each side, as rounding must not lose any; the exact test is the barycentric one.
    begin = np.clip(np.floor(low), 0, size).astype(int)
    end = np.clip(np.ceil(high) + 1, 0, size).astype(int)
    return begin, np.maximum(end - begin, 0)

"""What a camera sees, in the light's coordinates, and the truth: which of it the light reaches."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..render.edge_weights import edges_between
from ..scene_files.scene_camera import SceneCamera
from .light_rays import LitScene

LEAST_COSINE = 0.05
"""Between normal and light, below which a pixel is not judged: 2.9 degrees, where a texel is 20 times its size."""


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """The pixels of one camera under one light; row 0 is the top of the screen.

    Attributes:
        camera: whose view it is.
        depth: (H, W) eye depths of the pixels' centres; inf for background.
        judged: (H, W) which pixels have a surface that faces the light, more than grazingly.
        grazing: (H, W) pixels whose surface faces the light, but less than `LEAST_COSINE`.
        away: (H, W) pixels whose surface faces away from the light.
        places: (P, 2) of the judged pixels, in row order: (a, b) in the light's coordinates.
        heights: (P,) their depths h along the light.
        slopes: (P, 2) dh/da and dh/db of their surfaces.
        triangles: (P,) the triangles seen.
        lit: (P,) the truth: whether a ray from the light reaches them.
        inside: whether the camera seems to be inside a mesh.
    """

    camera: SceneCamera
    depth: Float[np.ndarray, "H W"]
    judged: Bool[np.ndarray, "H W"]
    grazing: Bool[np.ndarray, "H W"]
    away: Bool[np.ndarray, "H W"]
    places: Float[np.ndarray, "P 2"]
    heights: Float[np.ndarray, " P"]
    slopes: Float[np.ndarray, "P 2"]
    triangles: Int[np.ndarray, " P"]
    lit: Bool[np.ndarray, " P"]
    inside: bool

    @property
    def defined(self) -> bool:
        """Whether some pixel is lit and some is in shadow; without both, the error says nothing."""
        return bool(self.lit.any() and not self.lit.all())

    @functools.cached_property
    def true_edges(self) -> Bool[np.ndarray, "H W"]:
        """Judged pixels with a judged neighbour, across or up, whose truth differs."""
        return edges_of(self.judged, self.image(self.lit, False))

    @functools.cached_property
    def edge_distance(self) -> Float[np.ndarray, "H W"]:
        """Pixels from each pixel's centre to the nearest true edge's; inf if there is none."""
        if not self.true_edges.any():
            return np.full(self.judged.shape, np.inf)
        return np.asarray(ndimage.distance_transform_edt(~self.true_edges))

    def only(self, choose: Bool[np.ndarray, " P"]) -> "Frame":
        """The frame with some of its judged receivers alone, as what a map is read for.

        Args:
            choose: which of the P judged pixels.
        """
        return dataclasses.replace(
            self, places=self.places[choose], heights=self.heights[choose], slopes=self.slopes[choose],
            triangles=self.triangles[choose], lit=self.lit[choose],
        )  # fmt: skip

    def image(self, values: np.ndarray, fill: float | bool) -> np.ndarray:
        """(H, W): values of the judged pixels, and a fill elsewhere.

        Args:
            values: (P,), of the judged pixels.
            fill: of all others.
        """
        made = np.full(self.judged.shape, fill, np.asarray(values).dtype)
        made[self.judged] = values
        return made


def edges_of(judged: Bool[np.ndarray, "H W"], lit: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """Pixels beside a shadow's edge in a mask: of both sides, among judged pixels."""
    return np.asarray(edges_between(lit, judged))


def see(scene: LitScene, camera: SceneCamera, height: int, width: int) -> Frame:
    """Cast a ray through each pixel's centre, and one from the light to each receiver.

    Args:
        scene: triangles and light.
        camera: in the same world.
        height, width: pixels.

    Returns:
        A `Frame`.

    Raises:
        ValueError: no pixels.

    Example:
        >>> import numpy as np
        >>> from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation
        >>> floor = np.array([[[-9, 0, -9], [-9, 0, 9], [9, 0, 9]], [[-9, 0, -9], [9, 0, 9], [9, 0, -9]]], float)
        >>> turn = orientation(np.array([0, -1.0, 0]), np.array([0, 0, -1.0]), "right")
        >>> camera = SceneCamera(np.array([0, 4.0, 0]), turn, 0.1, 50.0, centred_window(0.4, 1.0))
        >>> frame = see(LitScene(floor, np.array([0.2, -1, 0])), camera, 4, 4)
        >>> round(float(frame.depth.max()), 9), bool(frame.lit.all()), frame.defined
        (4.0, True, False)
    """
    if height < 1 or width < 1:
        raise ValueError(f"screen: got {width} x {height} pixels, expected at least one")
    across, up = camera.slopes(height, width)
    eye, (begin, rays) = (
        scene.coordinates(camera.position),
        (
            v @ camera.rotation @ scene.axes.T
            for v in camera.rays_at(np.stack(np.broadcast_arrays(across, up[:, None]), -1).reshape(-1, 2))
        ),
    )
    depth, which = scene.seen_from(eye + begin, rays, camera.near, camera.far)
    hit = which >= 0
    normals = scene.normals[which]
    # The side that the camera sees; normals have h <= 0, so it faces the light where the camera is on that side.
    towards = np.einsum("ij,ij->i", normals, rays) < 0
    cosine = -normals[:, 2]
    judged = hit & towards & (cosine >= LEAST_COSINE)
    grazing = hit & towards & ~judged
    at = eye + begin[judged] + depth[judged, None] * rays[judged]
    which = which[judged]
    places, heights = at[:, :2], at[:, 2]
    first, blocker = scene.first_hits(places)
    slopes = scene.slopes[which]
    reach = heights - scene.tolerance(np.abs(slopes).sum(1))
    lit = (blocker == which) | ~(first < reach)
    shape = (height, width)
    return Frame(
        camera, depth.reshape(shape), judged.reshape(shape), grazing.reshape(shape),
        (hit & ~towards).reshape(shape), places, heights, slopes, which, lit, scene.is_inside(eye),
    )  # fmt: skip

"""A scene in the light's coordinates, and rays along the light: what shadow maps and the truth are made of."""

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..scene_files.scene_camera import unit

_FLOAT32 = float(np.finfo(np.float32).eps)


class NoRayCaster(ImportError):
    """The package that casts rays is missing."""


def ray_caster() -> tuple[Any, Any]:
    """embreex's scene and mesh classes.

    Raises:
        NoRayCaster: one sentence with the command that installs it.
    """
    try:
        scene = importlib.import_module("embreex.rtcore_scene")
        mesh = importlib.import_module("embreex.mesh_construction")
    except ImportError:
        raise NoRayCaster(
            "rays: got no embreex, expected the package that casts them: pip install 'warpopt[frames]'"
        ) from None
    return scene.EmbreeScene, mesh.TriangleMesh


class LitScene:
    """Triangles in coordinates (a, b, h): h along a directional light, a and b across it, about the scene's middle.

    Rays find a triangle in single precision; where they meet its plane is computed in double. They begin outside the
    scene, so that no surface shadows itself by rounding.

    Args:
        triangles: (N, 3, 3) world points.
        light: world direction in which the light travels, of any length.

    Raises:
        ValueError: no triangle, a wrong shape, numbers that are not finite, or a direction of length zero.
        NoRayCaster: embreex is missing.

    Attributes:
        axes: (3, 3) unit rows: a, b and the light, in world coordinates.
        corners: (2, 3) lower and upper corner of the scene's box, in the world.
        origin: (3,) world point with coordinates (0, 0, 0).
        points: (N, 3, 3) the triangles in (a, b, h).
        slopes: (N, 2) dh/da and dh/db of each triangle's plane; infinite where the light grazes it.
        normals: (N, 3) unit normals in (a, b, h), with h <= 0: towards the light.
        outward: (N,) whether the triangle's winding (counter-clockwise from outside) faces the light.
        size: half the diagonal of the scene's box.

    Example:
        >>> import numpy as np
        >>> floor = np.array([[[-1, 0, -1], [-1, 0, 1], [1, 0, 1]], [[-1, 0, -1], [1, 0, 1], [1, 0, -1]]], float)
        >>> scene = LitScene(floor, np.array([0, -2.0, 0]))
        >>> depth, which = scene.first_hits(scene.coordinates(np.array([[0.2, 5.0, 0.1]]))[:, :2])
        >>> round(float(depth[0]), 12), int(which[0]), bool(scene.outward.all())
        (0.0, 1, True)
    """

    def __init__(self, triangles: Float[np.ndarray, "N 3 3"], light: Float[np.ndarray, "3"]):
        self._kinds = ray_caster()
        triangles, light = np.asarray(triangles, float), np.asarray(light, float)
        if triangles.ndim != 3 or triangles.shape[1:] != (3, 3):
            raise ValueError(f"triangles: got shape {triangles.shape}, expected (N, 3, 3)")
        if not len(triangles):
            raise ValueError("triangles: got none, expected at least one shadow caster")
        if not np.isfinite(triangles).all():
            raise ValueError("triangles: got a coordinate that is not finite, expected finite numbers")
        if light.shape != (3,) or not np.isfinite(light).all() or not light.any():
            raise ValueError(f"light: got {light.tolist()}, expected a direction that is not zero")
        along = unit(light)
        side = np.eye(3)[np.abs(along).argmin()]
        across = unit(np.cross(along, side))
        self.axes = np.stack([across, np.cross(along, across), along])
        lower, upper = triangles.min((0, 1)), triangles.max((0, 1))
        self.corners = np.stack([lower, upper])
        self.origin = (lower + upper) / 2
        self.size = float(np.linalg.norm(upper - lower) / 2) or 1.0
        self.points = (triangles - self.origin) @ self.axes.T
        first = self.points[:, 0]
        normals = np.cross(self.points[:, 1] - first, self.points[:, 2] - first)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(length > 0, length, 1)
        self.outward = normals[:, 2] < 0
        self.normals = np.where(normals[:, 2:] > 0, -normals, normals)
        # Steeper than this, a ray's single-precision place decides the depth; the triangle's range bounds it.
        steep = np.abs(self.normals[:, 2]) < _FLOAT32
        self.slopes = -self.normals[:, :2] / np.where(steep, np.nan, self.normals[:, 2])[:, None]
        self.slopes = np.where(steep[:, None], np.inf, self.slopes)
        self.least, self.most = self.points[..., 2].min(1), self.points[..., 2].max(1)
        self._top = float(self.least.min()) - 0.1 * self.size
        self._every: Any = None
        self._backs: Any = None

    @property
    def corners_all(self) -> Float[np.ndarray, "8 3"]:
        """The eight corners of the scene's box."""
        return np.stack(np.meshgrid(*self.corners.T, indexing="ij"), -1).reshape(-1, 3)

    def coordinates(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """World points in (a, b, h).

        Args:
            points: (..., 3).
        """
        return (np.asarray(points) - self.origin) @ self.axes.T

    def world(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """Points in (a, b, h) in world space.

        Args:
            points: (..., 3).
        """
        return points @ self.axes + self.origin

    def tolerance(self, slope: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """By how much a single-precision place moves a depth on a surface of this slope, at most.

        Args:
            slope: |dh/da| + |dh/db|.
        """
        # Of a ray's two coordinates each is rounded to half a unit in its last place, as are three vertices.
        return 4 * _FLOAT32 * self.size * (1 + slope)

    def first_hits(self, places: Float[np.ndarray, "P 2"]) -> tuple[Float[np.ndarray, " P"], Int[np.ndarray, " P"]]:
        """(depth h of the first surface on the ray at each place (a, b), its triangle); (inf, -1) for none.

        Args:
            places: (P, 2).
        """
        return self._cast(places, None, self._scene())

    def back_hits(self, places: Float[np.ndarray, "P 2"]) -> tuple[Float[np.ndarray, " P"], Int[np.ndarray, " P"]]:
        """As `first_hits`, of the triangles whose winding turns them away from the light only.

        Args:
            places: (P, 2).
        """
        if self._backs is None:
            self._backs = self._build(np.flatnonzero(~self.outward))
        return self._cast(places, None, self._backs)

    def second_hits(self, places: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, " P"]:
        """Depth of the second surface on each ray, beyond what rounding cannot tell from the first; inf for none.

        Args:
            places: (P, 2).
        """
        first, _ = self.first_hits(places)
        hit = np.isfinite(first)
        begin = np.where(hit, first, self._top) + 64 * _FLOAT32 * self.size
        second, _ = self._cast(places, begin, self._scene())
        return np.where(hit, second, np.inf)

    def seen_from(
        self, eye: Float[np.ndarray, "P 3"], rays: Float[np.ndarray, "P 3"], near: float, far: float
    ) -> tuple[Float[np.ndarray, " P"], Int[np.ndarray, " P"]]:
        """(how many rays' lengths from the eye the first surface is in [near, far), its triangle); (inf, -1) for none.

        Args:
            near, far: in rays' lengths.
            eye: where each ray begins, in (a, b, h).
            rays: directions in (a, b, h), of any length: with eye depth 1, the answer is the eye depth.
        """
        scene, which = self._scene()
        origins = (eye + near * rays).astype(np.float32)
        found = np.asarray(scene.run(origins, rays.astype(np.float32)))
        hit = found >= 0
        number = np.where(hit, which[np.where(hit, found, 0)], -1)
        plane, at = self.normals[number], self.points[number, 0]
        across = np.einsum("ij,ij->i", plane, rays)
        hit &= across != 0
        depth = np.einsum("ij,ij->i", plane, at - eye) / np.where(hit, across, 1)
        # The plane of a triangle that is seen edge-on is met far away: the single-precision ray hit it all the same.
        hit &= (depth > near * (1 - 1e-3)) & (depth < far)
        return np.where(hit, np.maximum(depth, near), np.inf), np.where(hit, number, -1)

    def depth_at(self, which: Int[np.ndarray, " P"], places: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, " P"]:
        """Depth h of each triangle's plane at a place, within the triangle's own range of depths.

        Args:
            which: numbers of triangles.
            places: (a, b).
        """
        offset = places - self.points[which, 0, :2]
        with np.errstate(invalid="ignore", over="ignore"):
            depth = self.points[which, 0, 2] + (self.slopes[which] * offset).sum(1)
        middle = (self.least[which] + self.most[which]) / 2
        return np.clip(np.where(np.isfinite(depth), depth, middle), self.least[which], self.most[which])

    def is_inside(self, point: Float[np.ndarray, "3"]) -> bool:
        """Whether the nearest surfaces before and behind a point (a, b, h), along the light, turn their backs to it.

        Args:
            point: (3,).
        """
        a, b, c = (self.points[:, k, :2] - point[:2] for k in range(3))
        turns = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))])
        on = np.flatnonzero((turns > 0).all(0) | (turns < 0).all(0))
        depth = self.depth_at(on, np.broadcast_to(point[:2], (len(on), 2)))
        before, behind = depth < point[2], depth > point[2]
        if not before.any() or not behind.any():
            return False
        above = on[np.where(before, depth, -np.inf).argmax()]
        below = on[np.where(behind, depth, np.inf).argmin()]
        return bool(self.outward[above] and not self.outward[below])

    def _scene(self) -> tuple[Any, np.ndarray]:
        if self._every is None:
            self._every = self._build(np.arange(len(self.points)))
        return self._every

    def _build(self, which: np.ndarray) -> tuple[Any, np.ndarray]:
        scene_kind, mesh_kind = self._kinds
        scene = scene_kind()
        if len(which):
            mesh_kind(scene, np.ascontiguousarray(self.points[which], np.float32))
        return scene, which

    def _cast(self, places: np.ndarray, begin: np.ndarray | None, built: tuple[Any, np.ndarray]):
        scene, which = built
        if not len(places) or not len(which):
            return np.full(len(places), np.inf), np.full(len(places), -1)
        origins = np.empty((len(places), 3), np.float32)
        origins[:, :2] = places
        origins[:, 2] = self._top if begin is None else begin
        found = np.asarray(scene.run(origins, np.tile(np.array([[0, 0, 1]], np.float32), (len(places), 1))))
        hit = found >= 0
        number = which[np.where(hit, found, 0)]
        return np.where(hit, self.depth_at(number, places), np.inf), np.where(hit, number, -1)

"""A camera in plain NumPy for the rasteriser and the pictures; does not need JAX."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class SceneCamera:
    """Position, orientation and view frustum; the fields mean the same as in `warpopt.Camera`.

    Attributes:
        position: (3,) in world space.
        rotation: (3, 3), rows right, up and forward in world coordinates, orthonormal.
        near, far: distances of the near and far planes.
        window: slopes (left, right, bottom, top) of the side planes; lengths if orthographic.
        is_orthographic: whether its rays are parallel.
    """

    position: np.ndarray
    rotation: np.ndarray
    near: float
    far: float
    window: tuple[float, float, float, float]
    is_orthographic: bool = False

    @property
    def aspect(self) -> float:
        """Width over height."""
        left, right, bottom, top = self.window
        return (right - left) / (top - bottom)

    @property
    def handedness(self) -> str:
        """Handedness of the world's axes, as in `warpopt.Camera`; a mirrored view counts as the other hand."""
        return "right" if np.linalg.det(self.rotation) < 0 else "left"

    @property
    def key(self) -> tuple:
        """A key that is equal for equal cameras."""
        numbers = (*self.position.tolist(), *self.rotation.ravel().tolist(), self.near, self.far, *self.window)
        numbers = (*numbers, float(self.is_orthographic))
        return tuple(number + 0.0 for number in numbers)  # -0.0 is 0.0

    def to_eye(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) in eye coordinates: x right, y up, z along the view."""
        return (points - self.position) @ self.rotation.T

    def on_window(self, eye: np.ndarray) -> np.ndarray:
        """Where points (..., 3) in eye coordinates are in the window: (x/z, y/z), or (x, y) if orthographic."""
        return eye[..., :2] if self.is_orthographic else eye[..., :2] / eye[..., 2:]

    def rays_at(self, window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(where the rays through places (..., 2) of the window have eye depth 0, their steps to eye depth 1)."""
        flat = np.concatenate([window, np.zeros((*window.shape[:-1], 1))], -1)
        ahead = np.array([0.0, 0.0, 1.0])
        return (flat, ahead + 0 * flat) if self.is_orthographic else (0 * flat, flat + ahead)

    def slopes(self, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """(x/z of the columns, y/z of the rows) at pixel centres, row 0 at the top; x and y if orthographic."""
        left, right, bottom, top = self.window
        across = left + (right - left) * (np.arange(width) + 0.5) / width
        up = top - (top - bottom) * (np.arange(height) + 0.5) / height
        return across, up


def orientation(forward: np.ndarray, up: np.ndarray, handedness: str) -> np.ndarray:
    """Rows right, up and forward.

    Raises:
        ValueError: parallel directions.
    """
    side = 1 if handedness == "right" else -1
    forward, up = unit(forward), unit(up)
    right = side * np.cross(forward, up)
    if np.linalg.norm(right) < 1e-12:
        raise ValueError("expected a direction that is not parallel to the view")
    right = unit(right)
    return np.stack([right, side * np.cross(right, forward), forward])


def unit(vector: np.ndarray) -> np.ndarray:
    """The unit vector; divides by the largest component first, so that no square over- or underflows."""
    vector = np.asarray(vector, float)
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)


def centred_window(half_fov: float, aspect: float) -> tuple[float, float, float, float]:
    """The window from half the vertical field of view, in radians."""
    top = float(np.tan(half_fov))
    return -top * aspect, top * aspect, -top, top


def centred_window_across(half_fov_x: float, aspect: float) -> tuple[float, float, float, float]:
    """The window from half the horizontal field of view, in radians."""
    right = float(np.tan(half_fov_x))
    return -right, right, -right / aspect, right / aspect

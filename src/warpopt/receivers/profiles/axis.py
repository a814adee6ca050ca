"""The view axis by depth along Z_w."""

import dataclasses

import numpy as np

from ...theory.camera import Camera
from ...theory.light_frame import LightFrame
from .hulls import hull_stretches, slab
from .profile import NOTHING, Stretches


@dataclasses.dataclass(frozen=True, eq=False)
class AxisProfile:
    """The view axis between the camera's planes; see `DepthProfile`."""

    camera: Camera
    frame: LightFrame

    def stretches(self, order: float, parts: int) -> Stretches:
        """Depth and eye depth are proportional and W is z^-P, so the map is that of z^(1/(P+1))."""
        near, far = float(self.camera.near), float(self.camera.far)
        if np.isinf(order):
            return hull_stretches([slab(np.array([[0.0, 0.0, 1.0]]), near, far)], self.frame, parts)
        z = np.geomspace(near, far, parts + 1)
        rate, root = abs(float(self.frame.z_axis[2])), 1 / (order + 1)
        shares = np.diff(z**root) / root
        value = float(self.frame.density_p) * rate * shares.sum() * (shares.sum() / (z[-1] - z[0])) ** (1 / order)
        return Stretches(rate * z, shares, float(value)) if value else NOTHING

    def widest(self) -> float:
        """A line has no width."""
        return 0.0

"""A plane as receivers: outdoors, what a camera sees most of."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._checks import Numbers, checked, float_arrays, is_traced
from ..._numerics import compiled
from ...objective import Objective
from ...theory.camera import Camera, DirectionalLight, normalised
from ...theory.light_frame import LightFrame
from ..bins import extent_of, from_groups, singles
from ..footprint import Footprint
from ..polytope import edges_between
from ..profiles.nearness import over_body
from ..receivers import Receivers


class GroundPlane(Receivers):
    """The part of a plane that the camera sees, as far as its far plane.

    A polygon: maxima are at its vertices. Where the plane is seen across the full width, as level ground is, the warp
    along "gradient" with lateral fit "free" is `theory.ground_optimum`'s.

    Args:
        normal: (3,) world normal of any length.
        offset: of the plane normal . p + offset = 0.

    Raises:
        ValueError: for a zero normal or values that are not finite.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.4)
        >>> ground = GroundPlane((0, 1, 0), 0)
        >>> [round(float(z), 3) for z in ground.depth_extent(camera)]   # from the lower edge of the screen
        [4.73, 100.0]
    """

    measures = ()
    any_projection = True
    weighted = False

    normal: Float[Array, "3"]
    offset: Float[Array, ""]

    def __init__(self, normal: Numbers, offset: Numbers):
        normal, offset = float_arrays(normal=normal, offset=offset)
        for name, value, shape in (("normal", normal, (3,)), ("offset", offset, ())):
            if value.shape != shape:
                raise ValueError(f"{name}: got shape {value.shape}, expected {shape or 'one number'}")
        normal = checked("normal", normal, lambda v: abs(v) < np.inf, "finite numbers")
        self.normal = normalised("normal", normal)
        largest = jnp.abs(normal).max()
        length = largest * jnp.sqrt(((normal / largest) ** 2).sum())
        offset = checked("offset", offset, lambda v: abs(v) < np.inf, "a finite number") / length
        self.offset = checked("offset", offset, lambda v: abs(v) < np.inf, "a finite number of lengths of the normal")

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`."""
        points, there, endless = self._polygon(camera)
        return from_groups(singles(there, points, frame), camera.near, grouped=False).lost_where(endless)

    @compiled
    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        points, there, _ = self._polygon(camera)
        return extent_of(points[:, 2], there)

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: the polygon's vertices."""
        points, there, _ = self._polygon(camera)
        return points, there.astype(points.dtype)

    def nearness(self, camera: Camera, frame: LightFrame, bins: int) -> float:
        """See `Receivers`: exact."""
        points, weights = (np.asarray(v, np.float64) for v in self.places(camera))
        return over_body(points[weights > 0], np.asarray(frame.light, np.float64), frame.is_orthographic)

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """See `Receivers`.

        Raises:
            ValueError: a norm other than inf; a plane that a camera without a far plane sees to its horizon.
        """
        if objective is not None and not objective.supremum:
            raise ValueError(f"norm: got {objective.norm!r} with {type(self).__name__}, expected 'inf'")
        if not is_traced(camera.far, self.normal) and np.isinf(camera.far) and self._polygon(camera)[2]:
            raise ValueError(
                "receivers: got a plane that a camera with far = inf sees to its horizon, expected a finite far"
            )

    def in_eye(self, camera: Camera) -> tuple[Float[Array, "3"], Float[Array, ""]]:
        """(unit normal, offset) of the plane in eye coordinates.

        Args:
            camera: whose coordinates are meant.
        """
        normal = self.normal.astype(camera.position.dtype)
        return camera.rotation @ normal, self.offset.astype(normal.dtype) + normal @ camera.position

    @compiled
    def _polygon(self, camera: Camera) -> tuple[Float[Array, "12 3"], Bool[Array, " 12"], Bool[Array, ""]]:
        """(both ends of each side, which there are, whether a side is unbounded): the plane's line in each of the
        frustum's planes, clipped by the others."""
        normal, offset = self.in_eye(camera)
        planes = camera.planes()
        ground = jnp.broadcast_to(jnp.append(normal, offset), planes.shape)
        return edges_between(planes, ground, planes, ~np.eye(len(planes), dtype=bool))

"""The whole view frustum as receivers, for any camera and light."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._checks import is_traced
from ..._numerics import larger, unit_nodes
from ...objective import DENSITY_EXPONENT, Measure, Objective
from ...theory.camera import Camera, DirectionalLight
from ...theory.light_frame import LightFrame
from ...theory.light_space import LightDepth
from ..bins import from_groups, singles
from ..footprint import Footprint, Nearest, Sides, axis_inside, range_of
from ..profiles.axis import AxisProfile
from ..profiles.hulls import BodyProfile, slab
from ..profiles.nearness import over_body
from ..profiles.slices import Solid
from ..receivers import EVERY_MEASURE, Receivers
from .convex_body import moments_of_body
from .frustum_moments import segment_moments


class WholeFrustum(Receivers):
    """Everything that the camera could see, weighted by the objective's measure; with "axis" only the view axis.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5236)
        >>> [float(depth) for depth in WholeFrustum().depth_extent(camera)]
        [1.0, 100.0]
    """

    measures = EVERY_MEASURE
    weighted = False
    any_projection = True

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """See `Receivers`.

        Raises:
            ValueError: also for a camera without a far plane.
        """
        Receivers.check(self, camera, light, objective)
        if not is_traced(camera.far) and np.isinf(camera.far).any():
            raise ValueError(
                "camera: got far = inf with the whole frustum as receivers, expected a finite far, or receivers that "
                "know their depths"
            )

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. All lengths are sums of non-negative terms, so depths near 0 or 1 stay accurate."""
        if camera.is_orthographic:
            return _box(camera, frame, objective)
        n, f = camera.near, camera.far
        edges = camera.corner_slopes()
        slopes, across, along = frame.depth(edges), frame.lateral(edges), frame.along_light(edges)
        least, largest = slopes.min(), slopes.max()
        # The frustum begins at the near or the far end of its lowest edge; likewise for the end.
        start, end = jnp.where(least > 0, n * least, f * least), jnp.where(largest > 0, f * largest, n * largest)
        _, flat = range_of(start, end, f * jnp.abs(slopes).max())
        ahead = f * (largest - least) + (f - n) * larger(least, 0)
        behind = n * (largest - least) + (f - n) * larger(-least, 0)
        mu = jnp.where(flat, 1, jnp.where(largest > 0, ahead, behind))

        def depth(slope: Array, z: Array) -> LightDepth:
            above = z * (slope - least) + (z - n) * larger(least, 0) + (f - z) * larger(-least, 0)
            below = z * (largest - slope) + (f - z) * larger(largest, 0) + (z - n) * larger(-largest, 0)
            return LightDepth(jnp.where(flat, 0, above / mu), jnp.where(flat, 1, below / mu))

        z = jnp.stack([n, f])[:, None]
        corners = depth(slopes, z)
        x = across * z
        axis = axis_inside(x.min(), x.max())
        right, left = (jnp.where(side > 0, side, 0).ravel() for side in (x - axis, axis - x))
        every = LightDepth(corners.delta.ravel(), corners.one_minus_delta.ravel())
        if objective.measure == "axis":
            middle = depth(frame.z_axis[2], jnp.stack([n, f]))
            nearest = Nearest(middle, jnp.stack([n, f]))
        else:
            nearest = Nearest(every, jnp.broadcast_to(z, x.shape).ravel())
        moments = None
        if not objective.supremum:
            heights, weights = window_nodes(camera, objective.measure, round(objective.blend_degree))
            heights = frame.depth(heights)
            largest_near = nearest.depth.delta[0] if objective.measure == "axis" else corners.delta[0].max()
            ratio = (f - n) / n
            moments = segment_moments(
                depth(heights, n), depth(heights, f), weights, largest_near, ratio, jnp.log1p(ratio), objective
            )
        h = (along * z).ravel()
        across_axis = (x - axis).ravel()
        all_sides = Sides(every, every, right, left, h, h, signed=(across_axis, across_axis))
        footprint = Footprint(start, mu, axis, nearest, all_sides, moments, n, jnp.zeros((), bool), flat)
        return footprint.lost_where(jnp.isinf(f))  # a traced camera cannot be refused earlier

    def nearness(self, camera: Camera, frame: LightFrame, bins: int) -> float:
        """See `Receivers`: exact."""
        points, weights = (np.asarray(v, np.float64) for v in self.places(camera))
        return over_body(points[weights > 0], np.asarray(frame.light, np.float64), frame.is_orthographic)

    def mass_up_to(self, camera: Camera, objective: Objective) -> Callable[[Float[Array, "..."]], Float[Array, "..."]]:
        """See `Receivers`; of dz under parallel rays."""
        return MassOfFrustum(camera.near, camera.far, 1 if camera.is_orthographic else 1 - objective.volume_exponent)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        return camera.near, camera.far

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: the corners."""
        corners = camera.corners()
        return corners, jnp.ones_like(corners[:, 0])

    def depth_profile(
        self, camera: Camera, frame: LightFrame, objective: Objective, bins: int
    ) -> BodyProfile | AxisProfile:
        """See `Receivers`."""
        if objective.measure == "axis":
            return AxisProfile(camera, frame)
        solid = Solid.uniform(camera.planes(), DENSITY_EXPONENT[objective.measure])
        box = camera.corners() if camera.is_orthographic else slab(camera.corner_slopes(), camera.near, camera.far)
        return BodyProfile([np.asarray(box, np.float64)], solid, camera, frame)


def mass_between(start: Float[Array, "..."], end: Float[Array, "..."], growth: float) -> Float[Array, "..."]:
    """The integral of z^(growth - 1) dz, without a difference."""
    length = jnp.log(end / start)
    return length if growth == 0 else start**growth * jnp.expm1(growth * length) / growth


class MassOfFrustum(eqx.Module):
    """`mass_between` the near plane and a depth."""

    near: Float[Array, ""]
    far: Float[Array, ""]
    growth: float = eqx.field(static=True)

    def __call__(self, depth: Float[Array, "..."]) -> Float[Array, "..."]:
        return mass_between(self.near, jnp.clip(depth, self.near, self.far), self.growth)


def _box(camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
    """What an orthographic camera sees."""
    corners, there = camera.corners(), jnp.ones(8, bool)
    footprint = from_groups(singles(there, corners, frame), camera.near, grouped=False)
    if not objective.supremum:
        moments = moments_of_body(camera.planes(), corners, there, frame, footprint, objective)
        footprint = footprint.with_moments(*moments)
    return footprint.lost_where(jnp.isinf(camera.far))


def window_nodes(camera: Camera, measure: Measure, degree: int) -> tuple[Array, Array]:
    """Points (x/z, y/z, 1) and weights, exact for polynomials of the degree in both; the axis for measure "axis"."""
    if measure == "axis":
        return jnp.array([[0.0, 0.0, 1.0]], camera.window.dtype), jnp.ones((1,), camera.window.dtype)
    nodes, weights = unit_nodes(degree // 2 + 1, camera.window.dtype)
    left, right, bottom, top = camera.window
    u, v = (axis.ravel() for axis in np.meshgrid(nodes, nodes, indexing="ij"))
    x, y = left * (1 - u) + right * u, bottom * (1 - v) + top * v
    points = jnp.stack([x, y, jnp.ones_like(x)], -1)
    return points, jnp.asarray(np.outer(weights, weights).ravel(), points.dtype)

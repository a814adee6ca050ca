"""The whole view frustum as receivers, for any camera and light."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._numerics import larger
from ..theory.camera import Camera
from ..theory.error_norm import ErrorNorm, Measure
from ..theory.light_frame import LightFrame
from ..theory.light_space import Depth
from .footprint import Footprint, Nearest, Sides, axis_inside, range_of
from .whole_frustum import segment_moments, unit_nodes


class WholeFrustum(eqx.Module):
    """Everything that the camera could see, weighted by a measure.

    Args:
        measure: "volume", "screen", "log_depth", "ground" or "axis" (the view axis alone), as in `optimal_warp`.

    Example:
        >>> WholeFrustum("ground").measure
        'ground'
    """

    measure: Measure = eqx.field(static=True, default="screen")

    def footprint(self, camera: Camera, frame: LightFrame, norm: ErrorNorm) -> Footprint:
        """See `Receivers`. All lengths from sums of non-negative terms: no depth near 0 or 1 loses its digits."""
        n, f = camera.near, camera.far
        edges = camera.corner_slopes()
        slopes, across, along = frame.depth(edges), frame.lateral(edges), frame.along_light(edges)
        least, largest = slopes.min(), slopes.max()
        # The frustum begins at the near or the far end of its lowest edge, and ends likewise.
        start, end = jnp.where(least > 0, n * least, f * least), jnp.where(largest > 0, f * largest, n * largest)
        _, flat = range_of(start, end, f * jnp.abs(slopes).max())
        ahead = f * (largest - least) + (f - n) * larger(least, 0)
        behind = n * (largest - least) + (f - n) * larger(-least, 0)
        mu = jnp.where(flat, 1, jnp.where(largest > 0, ahead, behind))

        def depth(slope: Array, z: Array) -> Depth:
            above = z * (slope - least) + (z - n) * larger(least, 0) + (f - z) * larger(-least, 0)
            below = z * (largest - slope) + (f - z) * larger(largest, 0) + (z - n) * larger(-largest, 0)
            return Depth(jnp.where(flat, 0, above / mu), jnp.where(flat, 1, below / mu))

        z = jnp.stack([n, f])[:, None]
        corners = depth(slopes, z)
        x = across * z
        axis = axis_inside(x.min(), x.max())
        sides = [jnp.where(side > 0, side, 0).ravel() for side in (x - axis, axis - x)]
        every = Depth(corners.delta.ravel(), corners.one_minus_delta.ravel())
        if self.measure == "axis":
            middle = depth(frame.z_axis[2], jnp.stack([n, f]))
            nearest = Nearest(middle, jnp.stack([n, f]))
        else:
            nearest = Nearest(every, jnp.broadcast_to(z, x.shape).ravel())
        moments = None
        if not norm.supremum:
            heights, weights = window_nodes(camera, self.measure, round(norm.blend_degree))
            heights = frame.depth(heights)
            largest_near = nearest.depth.delta[0] if self.measure == "axis" else corners.delta[0].max()
            ratio = (f - n) / n
            moments = segment_moments(
                depth(heights, n), depth(heights, f), weights, largest_near, ratio, jnp.log1p(ratio), norm
            )
        h = (along * z).ravel()
        all_sides = Sides(every, every, *sides, h, h)
        return Footprint(start, mu, axis, nearest, all_sides, moments, n, jnp.zeros((), bool), flat)


def window_nodes(camera: Camera, measure: Measure, degree: int) -> tuple[Array, Array]:
    """Points (x/z, y/z, 1) and weights, exact for polynomials of the degree in both; the axis for its measure."""
    if measure == "axis":
        return jnp.array([[0.0, 0.0, 1.0]], camera.window.dtype), jnp.ones((1,), camera.window.dtype)
    nodes, weights = unit_nodes(degree // 2 + 1, camera.window.dtype)
    left, right, bottom, top = camera.window
    u, v = (axis.ravel() for axis in np.meshgrid(nodes, nodes, indexing="ij"))
    x, y = left * (1 - u) + right * u, bottom * (1 - v) + top * v
    points = jnp.stack([x, y, jnp.ones_like(x)], -1)
    return points, jnp.asarray(np.outer(weights, weights).ravel(), points.dtype)

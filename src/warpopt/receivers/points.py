"""Points as receivers."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays
from ..objective import Objective
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .bins import BINS, bin_of, ends, extent_of, from_groups, grouped, with_moments
from .cells import EXACT, with_samples
from .footprint import Footprint
from .profiles.binned import BinnedProfile, PointSet
from .receivers import Receivers


class PointReceivers(Receivers):
    """Points, such as a sample of the visible surfaces.

    Points outside the view frustum and points of weight 0 are ignored. No points at all are an empty scene.


    Args:
        points: (N, 3) in world space.
        weights: (N,), >= 0; equal by default. The measure of an L_P norm; L-inf uses only their sign.

    Raises:
        ValueError: for a wrong shape, NaN, infinite points, or a negative weight.

    Example:
        >>> import numpy as np, warpopt
        >>> points = np.stack([np.linspace(-3, 3, 50), np.zeros(50), np.linspace(-5, -90, 50)], axis=1)
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4)
        >>> light = warpopt.DirectionalLight((0, -1, -0.2))
        >>> view = warpopt.SceneView(camera, light, PointReceivers(points))
        >>> solution = warpopt.optimal_warp(view, warpopt.Objective("p", "l2"))
        >>> bool(solution.value < solution.unwarped)
        True
    """

    points: Float[Array, "N 3"]
    weights: Float[Array, " N"]

    def __init__(self, points: Numbers, weights: Numbers | None = None):
        (points,) = float_arrays(points=points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points: got shape {points.shape}, expected (N, 3)")
        weights = jnp.ones(len(points), points.dtype) if weights is None else weights
        points, weights = float_arrays(points=points, weights=weights)
        if weights.shape != points.shape[:1]:
            raise ValueError(f"weights: got shape {weights.shape}, expected {points.shape[:1]}, one for each point")
        self.points = checked("points", points, lambda v: abs(v) < np.inf, "finite numbers")
        self.weights = checked("weights", weights, lambda w: (w >= 0) & (w < np.inf), "finite numbers >= 0")

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. Exact for at most `BINS` points, conservative for more (grouped)."""
        world, weights = self.points, self.weights
        if not len(world):  # empty: one point of weight 0
            world, weights = jnp.zeros((1, 3), world.dtype), jnp.zeros((1,), world.dtype)
        points = camera.to_eye(world)
        seen = (weights > 0) & seen_from(camera, points)
        points = jnp.where(seen[:, None], points, jnp.array([0.0, 0.0, 1.0], points.dtype))
        d, x, z = frame.depth(points), frame.lateral(points), points[:, 2]
        h = frame.along_light(points)
        exact = len(points) <= (BINS if objective.kernel is None else EXACT)
        if exact:
            groups = grouped(seen, d, x, h, z, jnp.arange(len(points)), len(points))
        else:
            start, end = ends(seen, d)
            share = (d - start) / jnp.where(end > start, end - start, 1)
            groups = grouped(seen, d, x, h, z, bin_of(jnp.where(seen, share, 0)), BINS)
        footprint = from_groups(groups, camera.near, not exact)
        if objective.supremum:
            return footprint
        unit = jnp.where(seen.any(), jnp.where(seen, z, jnp.inf).min(), 1)
        weights = jnp.where(seen, weights, 0)
        if objective.kernel is not None:
            return with_samples(footprint, d, x, unit / z, weights, unit, objective)
        rows = tuple(_in_rows(v, fill) for v, fill in ((d, footprint.start), (z, unit), (weights, 0)))
        return with_moments(footprint, rows, lambda row: (row[0], unit / row[1], row[2]), unit, objective)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        points = camera.to_eye(self.points)
        return extent_of(points[:, 2], (self.weights > 0) & seen_from(camera, points))

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BinnedProfile:
        """See `Receivers`."""
        return BinnedProfile(_weighted(self, camera), frame, bins)


@jax.jit
def _weighted(receivers: PointReceivers, camera: Camera) -> PointSet:
    points = camera.to_eye(receivers.points)
    return PointSet(points, jnp.where(seen_from(camera, points), receivers.weights, 0))


def seen_from(camera: Camera, points: Float[Array, "N 3"]) -> Bool[Array, " N"]:
    """Which points in eye coordinates are in the view frustum."""
    planes = camera.planes()
    # The boundary counts as seen: rounding of the transformation must not lose a far plane's corner.
    size = jnp.abs(points).max(1) + jnp.abs(camera.position).max()
    slack = 64 * jnp.finfo(points.dtype).eps * size[:, None]
    return (points @ planes[:, :3].T + planes[:, 3] >= -slack).all(1)


def _in_rows(values: Array, fill: ArrayLike) -> Array:
    width = min(values.size, 2048)
    rows = -(-values.size // width)
    return jnp.concatenate([values, jnp.full(rows * width - values.size, fill, values.dtype)]).reshape(rows, width)

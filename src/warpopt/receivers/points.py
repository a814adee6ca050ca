"""Points as receivers."""

import functools
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays
from ..objective import Objective
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .bins import BINS, bin_of, each_alone, ends, extent_of, from_groups, grouped, with_moments
from .footprint import Footprint
from .one_by_one import OneByOne
from .profiles.binned import BinnedProfile, PointSet
from .receivers import Receivers
from .samples import Counted
from .sketch import sketch_of_points
from .weighted.cells import EXACT, with_samples
from .weighted.weights import Weighting, Weights


class PointReceivers(OneByOne):
    """Points, such as a sample of the visible surfaces.

    Points outside the view frustum are ignored. No points at all are an empty scene.

    Args:
        points: (N, 3) in world space.
        weights: (N,), >= 0, or `EdgeWeights`, or "uniform" (the default) or "depth": what each point counts for in an
            L_P norm. Norms inf are over all points, and the map holds all, whatever their weight. If all are 0, weights
            are eye depths.
        lit: (N,), which points the light reaches; others have the weight 0.

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

    any_projection: ClassVar[bool] = True

    points: Float[Array, "N 3"]
    weights: Weights

    def __init__(self, points: Numbers, weights: Weighting | None = None, lit: Numbers | None = None):
        (points,) = float_arrays(points=points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points: got shape {points.shape}, expected (N, 3)")
        self.points = checked("points", points, lambda v: abs(v) < np.inf, "finite numbers")
        self.weights = Weights(weights, lit, points.shape[:1])

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. Exact for at most `BINS` points, conservative for more (grouped)."""
        points, seen = self._seen(camera)
        points = jnp.where(seen[:, None], points, jnp.array([0.0, 0.0, 1.0], points.dtype))
        d, x, z = frame.depth(points), frame.lateral(points), frame.eye_depth(points)
        h = frame.along_light(points)
        exact = len(points) <= (BINS if objective.kernel is None else EXACT)
        if exact:
            groups = each_alone(seen, d, x, h, z)
        else:
            start, end = ends(seen, d)
            share = (d - start) / jnp.where(end > start, end - start, 1)
            groups = grouped(seen, d, x, h, z, bin_of(jnp.where(seen, share, 0)), BINS)
        footprint = from_groups(groups, camera.near, not exact)
        if objective.supremum:
            return footprint
        unit = jnp.where(seen.any(), jnp.where(seen, z, jnp.inf).min(), 1)
        # What is not seen is in the scene's own units, so that its powers, which are weighed 0, stay in range.
        d, x, z = (jnp.where(seen, v, fill) for v, fill in ((d, footprint.start), (x, footprint.axis), (z, unit)))
        weights, by_depth = self._weights(z, seen)
        footprint = footprint.weighted_by_depth(by_depth)
        if objective.kernel is not None:
            normals = self.weights.normals_for(objective.kernel)
            if normals is not None:
                normals = frame.across_edges(*(jnp.where(by_depth, 0, n) for n in normals))
            fills = (d, footprint.start), (x, footprint.axis), (z, unit), (weights, 0), (seen, False)
            rows = *(_in_rows(v, fill) for v, fill in fills), jax.tree.map(lambda n: _in_rows(n, 0), normals)
            return with_samples(footprint, rows, lambda row: row, unit, objective)
        rows = tuple(_in_rows(v, fill) for v, fill in ((d, footprint.start), (z, unit), (weights, 0)))
        return with_moments(footprint, rows, lambda row: (row[0], unit / row[1], row[2]), unit, objective)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        points, seen = self._seen(camera)
        return extent_of(points[:, 2], seen)

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: all that are seen, whatever their weight."""
        points, seen = self._seen(camera)
        return points, seen.astype(points.dtype)

    def counted(self, camera: Camera, objective: Objective) -> Counted:
        """See `Receivers`."""
        points, seen = self._seen(camera)
        if not len(self.points):
            return Counted(points, jnp.zeros_like(points[:, 2]), None)
        return self.weights.counted(points, camera, seen, objective.kernel)

    def sketch(self, camera: Camera, objective: Objective) -> Receivers:
        """See `Receivers`: themselves if they are few."""
        if len(self.points) <= EXACT:
            return self
        points, seen = self._seen(camera)
        weights, _ = self._weights(camera.screen_depth(points[:, 2]), seen)
        return sketch_of_points(camera, points, seen, weights, objective)

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BinnedProfile:
        """See `Receivers`."""
        return BinnedProfile(_weighted(self, camera, objective.supremum), frame, bins)

    def _seen(self, camera: Camera) -> tuple[Array, Array]:
        """(points in eye coordinates, at least one; which are in the view frustum)."""
        if not len(self.points):
            return jnp.ones((1, 3), self.points.dtype), jnp.zeros(1, bool)
        points = camera.to_eye(self.points)
        return points, seen_from(camera, points)

    def _weights(self, z: Array, seen: Array) -> tuple[Array, Array]:
        if not len(self.points):
            return jnp.zeros_like(z), jnp.zeros((), bool)
        return self.weights.of(z, seen)


@functools.partial(jax.jit, static_argnames=("supremum",))
def _weighted(receivers: PointReceivers, camera: Camera, supremum: bool) -> PointSet:
    points, seen = receivers._seen(camera)
    weights = seen.astype(points.dtype) if supremum else receivers._weights(camera.screen_depth(points[:, 2]), seen)[0]
    return PointSet(points, weights)


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

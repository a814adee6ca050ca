"""A depth histogram as receivers, as kept by automatic exposure or cascade fitting."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays
from .._numerics import unit_nodes
from ..objective import DENSITY_EXPONENT, Objective
from ..theory.camera import Camera, far_plane
from ..theory.light_frame import LightFrame
from .bins import extent_of, from_groups, singles, with_moments
from .bodies.whole_frustum import window_nodes
from .footprint import Footprint
from .profiles.hulls import BodyProfile, slab
from .profiles.slices import Solid
from .receivers import Receivers
from .weighted.cells import with_samples
from .weighted.weights import EdgeWeights, Weighting, Weights

_DEGREE_WITH_KINKS = 22  # 12 by 12 nodes on the screen, 19 in each bin


class DepthHistogram(Receivers):
    """Receivers spread evenly over the screen at each depth, and evenly in depth within each bin.

    A histogram does not say where on the screen its receivers are. Where the scene is uneven on the screen (ground
    below, sky above), a `DepthBuffer` is more accurate: on hills, over light directions, the L2 norm with a
    histogram's warp is up to 6 (E_p) and 250 times (E_pxq) the optimum's, little better than ignoring the scene
    (docs/performance.md).

    Args:
        edges: (K + 1,) eye depths, increasing, > 0. The part outside the view frustum is cut off.
        counts: (K,), >= 0: how many receivers each bin holds.
        weights: (K,), >= 0, what a receiver of each bin counts for in an L_P norm, or "uniform" (the default) or
            "depth", its eye depth. The map holds all receivers, whatever their weight. If all are 0, weights are eye
            depths.

    Raises:
        ValueError: for wrong shapes, edges that do not increase, negative counts, or values that are not finite.

    Example:
        >>> import warpopt
        >>> histogram = DepthHistogram(edges=(1.0, 10.0, 100.0), counts=(3.0, 1.0))
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4)
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0)), histogram)
        >>> round(float(warpopt.optimal_warp(view).warp.mu), 3)   # nothing is nearer than 1 or farther than 100
        99.0
    """

    edges: Float[Array, " E"]
    counts: Float[Array, " K"]
    weights: Weights

    def __init__(self, edges: Numbers, counts: Numbers, weights: Weighting | None = None):
        edges, counts = float_arrays(edges=edges, counts=counts)
        if edges.ndim != 1 or counts.shape != (len(edges) - 1,) or not len(counts):
            raise ValueError(f"counts: got shape {counts.shape} with edges {edges.shape}, expected one count for a bin")
        edges = checked("edges", edges, lambda e: (e > 0) & (e < np.inf), "finite depths > 0")
        self.edges = checked(
            "edges", edges, lambda e: jnp.concatenate([jnp.diff(e) > 0, jnp.ones(1, bool)]), "increasing depths"
        )
        self.counts = checked("counts", counts, lambda c: (c >= 0) & (c < np.inf), "finite numbers >= 0")
        if isinstance(weights, EdgeWeights):
            raise ValueError("weights: got EdgeWeights with a DepthHistogram, expected one number for each bin")
        self.weights = Weights(weights, None, counts.shape)

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. Each bin is a slab of the frustum."""
        whole = self.edges.astype(camera.near.dtype)
        edges = jnp.clip(whole, camera.near, camera.far)
        counts = self.counts * jnp.diff(edges) / jnp.diff(whole)  # cut bins keep their share of the count
        there = (counts > 0) & (edges[1:] > edges[:-1])
        # A slab's errors are largest, and its extents attained, at its corners.
        corners = camera.corner_slopes()[:, None, None] * jnp.stack([edges[:-1], edges[1:]])[..., None]
        valid = jnp.broadcast_to(there, corners.shape[:-1])
        footprint = from_groups(singles(valid.ravel(), corners.reshape(-1, 3), frame), camera.near, grouped=False)
        if objective.supremum:
            return footprint
        # Means of a size with kinks converge with the square of the number of nodes; these are off by some 1e-4.
        degree = _DEGREE_WITH_KINKS if objective.kernel is not None else round(objective.blend_degree)
        points, share = window_nodes(camera, "screen", degree)
        # In log z, where a bin of any ratio is smooth: 32 nodes leave 1e-10 for a ratio of 4000.
        t, w = unit_nodes(degree // 2 + 32, edges.dtype)
        span = jnp.log(jnp.where(there, edges[1:] / edges[:-1], 2))[:, None]
        inner = edges[:-1, None] * jnp.exp(span * t)
        w = w * inner * span / jnp.where(there, jnp.diff(edges), 1)[:, None]
        d = (points @ frame.z_axis)[:, None, None] * inner
        unit = jnp.where(footprint.empty, 1, jnp.where(there, edges[:-1], jnp.inf).min())
        inner = jnp.where(there[:, None], inner, unit)
        weights, by_depth = self.weights.of_groups(inner, there & (counts > 0))
        if not self.weights.uniform:
            footprint = footprint.weighted_by_depth(by_depth)
        mass = jnp.where(there, counts, 0)[:, None] * w * weights * share[:, None, None]
        rows = d, jnp.broadcast_to(inner, d.shape), mass
        if objective.kernel is not None:
            x = (points @ frame.x_axis)[:, None, None] * inner
            seen = jnp.broadcast_to(there[:, None], d.shape)
            rows = jnp.where(seen, d, footprint.start), x, *rows[1:], seen, None
            return with_samples(footprint, rows, lambda row: row, unit, objective, own_sides=True)
        return with_moments(footprint, rows, lambda row: (row[0], unit / row[1], row[2]), unit, objective)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        there = (self.counts > 0) & (self.edges[1:] > camera.near) & (self.edges[:-1] < camera.far)
        z = jnp.clip(jnp.stack([self.edges[:-1], self.edges[1:]]), camera.near, camera.far)
        return extent_of(z, jnp.broadcast_to(there, z.shape))

    def mass_up_to(self, camera: Camera, objective: Objective) -> Callable[[Float[Array, "..."]], Float[Array, "..."]]:
        """See `Receivers`: a bin's count is spread evenly over its depths."""
        whole = self.edges.astype(camera.near.dtype)
        density = self.counts.astype(whole.dtype) / jnp.diff(whole)
        if self.weights.values is not None:
            density = density * self.weights.values.astype(whole.dtype)
        low, high = jnp.clip(jnp.stack([whole[:-1], whole[1:]]), camera.near, camera.far)
        # Weights that are all 0 are eye depths instead, as in the footprint.
        by_depth = ~(density * (high > low) > 0).any() | self.weights.by_depth
        density = jnp.where(by_depth, self.counts.astype(whole.dtype) / jnp.diff(whole), density)

        return MassOfBins(density, low, high, by_depth)

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: the corners of each bin's slab, which count as its receivers do."""
        edges = jnp.clip(self.edges.astype(camera.near.dtype), camera.near, camera.far)
        ends = jnp.stack([edges[:-1], edges[1:]], 1)
        counts = jnp.where(edges[1:] > edges[:-1], self.counts.astype(edges.dtype), 0)
        corners = camera.corner_slopes() * ends[..., None, None]
        return corners.reshape(-1, 3), jnp.broadcast_to(counts[:, None, None], corners.shape[:-1]).ravel()

    def nearness(self, camera: Camera, frame: LightFrame, bins: int) -> float:
        """See `Receivers`.

        Raises:
            ValueError: always: bins do not say which receivers share a ray.
        """
        raise ValueError(f"receivers: got {type(self).__name__}, for which no lower bound of 'storage' is known")

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BodyProfile:
        """See `Receivers`. Each bin is a slab of the frustum.

        Raises:
            ValueError: weights that are eye depths, with an L_P norm.
        """
        whole = self.edges.astype(camera.near.dtype)
        edges = jnp.clip(whole, camera.near, camera.far)
        counts = self.counts.astype(edges.dtype)
        if not (objective.supremum or self.weights.uniform):
            if self.weights.values is None or not bool((self.weights.values * counts > 0).any()):
                raise ValueError(
                    "weights: got eye depths in a DepthHistogram, for which no lower bound is known, expected one "
                    "number for each bin"
                )
            counts = counts * self.weights.values.astype(edges.dtype)
        weights = counts / jnp.diff(whole)  # cut bins keep their share of the count
        weights = jnp.where(edges[1:] > edges[:-1], weights, 0)
        planes = camera.planes().at[4, 3].set(-edges[0]).at[5].set(far_plane(edges[-1]))
        near, far = (np.asarray(v) for v in (edges[:-1], edges[1:]))
        filled = (np.asarray(self.counts) > 0) & (far > near)
        slabs = [slab(camera.corner_slopes(), n, f) for n, f in zip(near[filled], far[filled], strict=True)]
        return BodyProfile(slabs, Solid(planes, edges[1:-1], weights, DENSITY_EXPONENT["screen"]), camera, frame)


class MassOfBins(eqx.Module):
    """The sum of the weights up to a depth, of bins from `low` to `high` with as much to a length."""

    density: Float[Array, " K"]
    low: Float[Array, " K"]
    high: Float[Array, " K"]
    by_depth: Bool[Array, ""]

    def __call__(self, depth: Float[Array, "..."]) -> Float[Array, "..."]:
        end = jnp.clip(depth[..., None], self.low, self.high)
        middle = jnp.where(self.by_depth, (end + self.low) / 2, 1)
        return (self.density * (end - self.low) * middle).sum(-1)

"""A depth histogram as receivers, as kept by automatic exposure or cascade fitting."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays
from .._numerics import unit_nodes
from ..objective import DENSITY_EXPONENT, Objective
from ..theory.camera import Camera, far_plane
from ..theory.light_frame import LightFrame
from .bins import Groups, extent_of, from_groups, with_moments
from .footprint import Footprint
from .profiles.hulls import BodyProfile, slab
from .profiles.slices import Solid
from .receivers import Receivers
from .whole_frustum import window_nodes


class DepthHistogram(Receivers):
    """Receivers spread evenly over the screen at each depth, and evenly in depth within each bin.

    A histogram contains no more information. Where the scene is uneven on the screen (ground below, sky above), a
    `DepthBuffer` is more accurate: on hills, over light directions, the L2 norm with a histogram's warp is up to 6
    (E_p) and 250 times (E_pxq) the optimum's, little better than ignoring the scene (docs/performance.md).

    Args:
        edges: (K + 1,) eye depths, increasing, > 0. The part outside the view frustum is cut off.
        counts: (K,), >= 0: the weight of each bin; a bin of 0 holds no receivers.

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

    def __init__(self, edges: Numbers, counts: Numbers):
        edges, counts = float_arrays(edges=edges, counts=counts)
        if edges.ndim != 1 or counts.shape != (len(edges) - 1,) or not len(counts):
            raise ValueError(f"counts: got shape {counts.shape} with edges {edges.shape}, expected one count for a bin")
        edges = checked("edges", edges, lambda e: (e > 0) & (e < np.inf), "finite depths > 0")
        self.edges = checked(
            "edges", edges, lambda e: jnp.concatenate([jnp.diff(e) > 0, jnp.ones(1, bool)]), "increasing depths"
        )
        self.counts = checked("counts", counts, lambda c: (c >= 0) & (c < np.inf), "finite numbers >= 0")

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. Each bin is a slab of the frustum, and a group."""
        whole = self.edges.astype(camera.near.dtype)
        edges = jnp.clip(whole, camera.near, camera.far)
        counts = self.counts * jnp.diff(edges) / jnp.diff(whole)  # cut bins keep their share of the count
        there = (counts > 0) & (edges[1:] > edges[:-1])
        corners = camera.corner_slopes()

        def ends(axis: Array) -> tuple[Array, Array]:
            values = (corners @ axis)[:, None, None] * jnp.stack([edges[:-1], edges[1:]])
            return jnp.where(there, values.min((0, 1)), jnp.inf), jnp.where(there, values.max((0, 1)), -jnp.inf)

        z = jnp.where(there, edges[:-1], jnp.inf)
        (d_least, d_largest), (x_least, x_largest), (h_least, h_largest) = map(
            ends, (frame.z_axis, frame.x_axis, frame.light)
        )
        footprint = from_groups(Groups(d_least, d_largest, x_least, x_largest, h_least, h_largest, z), camera.near)
        if objective.supremum:
            return footprint
        degree = round(objective.blend_degree)
        points, weights = window_nodes(camera, "screen", degree)
        t, w = unit_nodes(degree // 2 + 8, edges.dtype)  # error 1e-10 for a bin with a z ratio of 10
        inner = edges[:-1, None] + jnp.diff(edges)[:, None] * t
        d = (points @ frame.z_axis)[:, None, None] * inner
        mass = jnp.where(there, counts, 0)[:, None] * w * weights[:, None, None]
        unit = jnp.where(footprint.empty, 1, z.min())
        rows = d, jnp.broadcast_to(jnp.where(there[:, None], inner, unit), d.shape), mass
        return with_moments(footprint, rows, lambda row: (row[0], unit / row[1], row[2]), unit, objective)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        there = (self.counts > 0) & (self.edges[1:] > camera.near) & (self.edges[:-1] < camera.far)
        z = jnp.clip(jnp.stack([self.edges[:-1], self.edges[1:]]), camera.near, camera.far)
        return extent_of(z, jnp.broadcast_to(there, z.shape))

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BodyProfile:
        """See `Receivers`. Each bin is a slab of the frustum."""
        whole = self.edges.astype(camera.near.dtype)
        edges = jnp.clip(whole, camera.near, camera.far)
        weights = self.counts.astype(edges.dtype) / jnp.diff(whole)  # cut bins keep their share of the count
        weights = jnp.where(edges[1:] > edges[:-1], weights, 0)
        planes = camera.planes().at[4, 3].set(-edges[0]).at[5].set(far_plane(edges[-1]))
        near, far = (np.asarray(v) for v in (edges[:-1], edges[1:]))
        filled = (np.asarray(self.counts) > 0) & (far > near)
        slabs = [slab(camera.corner_slopes(), n, f) for n, f in zip(near[filled], far[filled], strict=True)]
        return BodyProfile(slabs, Solid(planes, edges[1:-1], weights, DENSITY_EXPONENT["screen"]), camera, frame)

"""Weighted receivers for means that have no moments.

E_p, E_q and the shear depend on a receiver's depth along Z_w and its distance from W's axis; its eye depth is only a
factor, 1/z, and so part of its weight.
"""

import equinox as eqx
from jaxtyping import Array, Float

from ..theory.light_space import LightDepth


class Corners(eqx.Module):
    """The cells that the samples stand for, as rectangles, and the means over a cell's receivers of their place in it.

    The place is (u, v), each from 0 at the near or inner end to 1 at the other.
    """

    near: LightDepth
    far: LightDepth
    inner: Float[Array, " S"]
    outer: Float[Array, " S"]
    u: Float[Array, " S"]
    v: Float[Array, " S"]
    uv: Float[Array, " S"]


class Samples(eqx.Module):
    """Receivers, or the centroids of cells, over which an error is averaged.

    Attributes:
        depth: along Z_w.
        lateral: |x - axis| / mu.
        weight: w (unit / z)^P / (sum of all w).
        corners: for cells.
    """

    depth: LightDepth
    lateral: Float[Array, " S"]
    weight: Float[Array, " S"]
    corners: Corners | None

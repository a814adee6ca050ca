"""Weighted receivers for means that have no moments.

E_p, E_q and the shear depend on a receiver's depth along Z_w and its distance from W's axis; its eye depth is only a
factor, 1/z, and so part of its weight.
"""

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from ..theory.light_space import LightDepth

Normal = tuple[Array, Array]
"""Components of an edge's unit normal along the screen images of Z_w and X_w."""


class Counted(NamedTuple):
    """Receivers one by one, in eye coordinates.

    Attributes:
        points: where they are.
        weights: what each counts for in a mean.
        normals: of the edge beside each on the screen, (right, up); None where edges' directions are unknown.
    """

    points: Float[Array, "N 3"]
    weights: Float[Array, " N"]
    normals: tuple[Float[Array, " N"], Float[Array, " N"]] | None


class Corners(eqx.Module):
    """Cells as rectangles, and the means over a cell's receivers of their place in it.

    The place is (u, v), each from 0 at the near or inner end to 1 at the other. `weight` and `normal` are as in
    `Samples`; cells may be smaller than those of the samples.
    """

    near: LightDepth
    far: LightDepth
    inner: Float[Array, " C"]
    outer: Float[Array, " C"]
    u: Float[Array, " C"]
    v: Float[Array, " C"]
    uv: Float[Array, " C"]
    weight: Float[Array, " C"]
    normal: Normal | None


class Spread(eqx.Module):
    """How a sample's receivers lie about their centroid: the covariance of delta and |x| / mu, a bound of delta's
    variance, and the ranges of both."""

    covariance: Float[Array, " S"]
    variance: Float[Array, " S"]
    depth: Float[Array, " S"]
    lateral: Float[Array, " S"]


class Samples(eqx.Module):
    """Receivers, or the centroids of cells, over which an error is averaged.

    Attributes:
        depth: along Z_w.
        lateral: |x - axis| / mu.
        weight: w (unit / z)^P / (sum of all w).
        normal: of the edge beside each, with the sign of the first component >= 0 and the second as seen where x is
            positive; None where edges' directions are unknown.
        spread, corners: for cells.
    """

    depth: LightDepth
    lateral: Float[Array, " S"]
    weight: Float[Array, " S"]
    normal: Normal | None = None
    spread: Spread | None = None
    corners: Corners | None = None

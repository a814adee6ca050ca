"""Directions of a warp on the light plane, from where the receivers are."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .light_frame import LightFrame


def gradient(frame: LightFrame, points: Float[Array, "N 3"], weights: Float[Array, " N"]) -> Float[Array, "3"]:
    """The direction on the light plane in which the eye depth z of points rises, by least squares weighted with z^-2.

    On a plane it is the G of (T61) in docs/theory.md, along which z is a function of the depth in the map. Without a
    division: the normal equations' adjugate gives the direction, and 0 where the points do not tell one.

    Args:
        frame: any of the light.
        points: in eye coordinates.
        weights: >= 0; points of weight 0 do not count.

    Returns:
        A vector in eye coordinates, of any length.
    """
    there = weights > 0
    points = jnp.where(there[:, None], points, jnp.array([0.0, 0.0, 1.0], points.dtype))
    z = frame.eye_depth(points)
    largest = jnp.where(there, jnp.abs(points).max(1), 0).max()
    unit = jnp.where(largest > 0, largest, 1)  # no power of a length over- or underflows
    share = jnp.where(there, weights, 0) * (jnp.where(there, z, 1) / unit) ** -2
    total = share.sum()
    share = share / jnp.where(total > 0, total, 1)
    x, d, z = (v / unit for v in (frame.lateral(points), frame.depth(points), z))
    x, d, z = (v - (share * v).sum() for v in (x, d, z))
    xx, xd, dd, xz, dz = ((share * v).sum() for v in (x * x, x * d, d * d, x * z, d * z))
    across, along = dd * xz - xd * dz, xx * dz - xd * xz
    # Sums of rounding errors, where the points lie on a line in the map or at one depth, are no direction.
    scale = 64 * jnp.finfo(z.dtype).eps * (xx + dd) * (jnp.abs(xz) + jnp.abs(dz))
    usable = jnp.maximum(jnp.abs(across), jnp.abs(along)) > scale
    return jnp.where(usable, across * frame.x_axis + along * frame.z_axis, 0)


def middle(points: Float[Array, "N 3"], weights: Float[Array, " N"]) -> Float[Array, "3"]:
    """The sum of the vectors from the eye to points: SC's middle vector (4.4), in eye coordinates."""
    return (jnp.where((weights > 0)[:, None], points, 0) * weights[:, None]).sum(0)


def shares_of(aspect: Float[Array, ""]) -> Float[Array, "2"]:
    """What texels along (t, s) are multiplied by for an aspect, at as many texels.

    Example:
        >>> shares_of(jnp.asarray(4.0)).tolist()
        [2.0, 0.5]
    """
    root = jnp.sqrt(aspect)
    return jnp.stack([root, 1 / root])

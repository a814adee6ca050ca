"""A plane seen by a camera: the direction of the warp and its optimum in closed form (T61).

With nu the plane's normal, v the view direction and R = z_max/z_min of what is seen,

    S* = (|l.nu| / |nu x v|) 2 aspect (R - 1) / tan(phi)    for all eta in [1/R, R^(-1/2)],
    (E_p E_q)* = S* R^(-1/3)                                at eta = R^(-2/3).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class GroundOptimum(NamedTuple):
    """The optimal map of a plane whose chord at depth z is proportional to z, such as level ground seen full width.

    In a screen of height 2 and a map of 1 by 1, with the map's axis free (lateral fit "free").

    Attributes:
        direction: (3,) unit vector of W's axis in eye coordinates.
        storage: (max E_p)(max E_q), the same for every eta in [1/R, R^(-1/2)], R = z_max / z_min.
        storage_eta: the largest of these.
        area: the largest E_p E_q.
        area_eta: where it is least.
    """

    direction: Float[Array, "3"]
    storage: Float[Array, ""]
    storage_eta: Float[Array, ""]
    area: Float[Array, ""]
    area_eta: Float[Array, ""]


def ground_direction(normal: Float[Array, "3"], light: Float[Array, "3"]) -> Float[Array, "3"]:
    """G up to its length: where the eye depth rises on the light plane, sign(l.nu) ((l.nu) v - (l.v) nu).

    0 for a plane that faces the viewer (z is constant). For a light along the plane it is the plane's normal: the
    limit, in which receivers are a line in the map.

    Args:
        normal: unit normal of the plane in eye coordinates; either side.
        light: unit vector in eye coordinates.

    Example:
        >>> up, down = jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, -1.0, 0.0])
        >>> ground_direction(up, down).tolist()   # a light from above: the view direction
        [0.0, 0.0, 1.0]
    """
    facing, ahead = light @ normal, light[2]
    view = jnp.zeros_like(normal).at[2].set(1)
    return jnp.where(facing < 0, -1, 1) * (facing * view - ahead * normal)


def ground_optimum(
    normal: Float[Array, "3"],
    light: Float[Array, "3"],
    near: Float[Array, ""],
    far: Float[Array, ""],
    half_fov: Float[Array, ""],
    aspect: Float[Array, ""],
) -> GroundOptimum:
    """The optimal map of level ground, or of any plane whose chord at depth z is proportional to z.

    Args:
        normal: unit normal in eye coordinates.
        light: unit vector in eye coordinates.
        near, far: least and largest eye depth of the visible part.
        half_fov: half the vertical field of view.
        aspect: width over height of the screen.

    Example:
        >>> up, down = jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, -1.0, 0.0])
        >>> one = jnp.ones(())
        >>> found = ground_optimum(up, down, one, 100 * one, jnp.asarray(0.5236), one)
        >>> round(float(found.storage), 1), round(float(found.storage_eta), 2)
        (342.9, 0.1)
    """
    direction = ground_direction(normal, light)
    length = jnp.sqrt((direction * direction).sum())
    safe = jnp.where(length > 0, length, 1)
    ratio = far / near
    # |l.nu| is the light plane's area over the plane's; on it, depths that differ by dz are dz / steepness apart.
    # (T61) has no steepness: it is 1 for a plane along the view direction.
    steepness = jnp.sqrt(normal[0] ** 2 + normal[1] ** 2)
    safe_steepness = jnp.where(steepness > 0, steepness, 1)
    storage = jnp.abs(light @ normal) / safe_steepness * 2 * aspect * ((far - near) / near) / jnp.tan(half_fov)
    return GroundOptimum(
        direction / safe, storage, ratio**-0.5, storage * jnp.exp(-jnp.log(ratio) / 3), ratio ** (-2 / 3)
    )

"""The view frustum V of AT09 section 1.2."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._checks import checked


def _joint_shape(near: Array, far: Array) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(near.shape, far.shape)
    except ValueError:
        raise ValueError(f"far: got shape {far.shape}, expected one that broadcasts with near's {near.shape}") from None


class ViewFrustum(eqx.Module):
    """A symmetric view frustum: near <= z <= far, |x|, |y| <= z tan(half_fov), the viewer looking along +z.

    Scalars or arrays that broadcast against each other; the dtype is JAX's promotion of the three.

    Args:
        near: distance of the near plane, > 0.
        far: distance of the far plane, > near.
        half_fov: half the field of view phi, in radians, in (0, pi/2); the same for both screen axes.

    Raises:
        ValueError: for a value out of range or NaN, naming the argument (`equinox.error_if` when traced).

    Example:
        >>> float(ViewFrustum(near=1.0, far=100.0, half_fov=0.5236).depth_ratio)
        100.0
    """

    near: Float[Array, "..."]
    far: Float[Array, "..."]
    half_fov: Float[Array, "..."]

    def __init__(self, near: ArrayLike, far: ArrayLike, half_fov: ArrayLike):
        dtype = jnp.result_type(near, far, half_fov, float)
        near, far, half_fov = (jnp.asarray(v, dtype) for v in (near, far, half_fov))
        self.near = checked("near", near, lambda v: (v > 0) & (v < np.inf), "a finite number > 0")
        self.far = checked(
            "far",
            jnp.broadcast_to(far, _joint_shape(near, far)),
            lambda v: (v > near) & (v < np.inf),
            "a finite number > near",
        )
        self.half_fov = checked("half_fov", half_fov, lambda v: (v > 0) & (v < np.pi / 2), "radians in (0, pi/2)")

    @property
    def depth_ratio(self) -> Float[Array, "..."]:
        """far / near."""
        return self.far / self.near

"""The view frustum V of AT09 section 1.2."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays, joint_shape


class ViewFrustum(eqx.Module):
    """A symmetric view frustum: near <= z <= far, |x|, |y| <= z tan(half_fov), the viewer looking along +z.

    Scalars or arrays that broadcast against each other; the dtype is JAX's promotion of the three.

    Args:
        near: distance of the near plane, > 0.
        far: distance of the far plane, > near; far / near is at most a quarter of what the dtype's reciprocals hold,
            2.1e37 in float32. Without a far plane no map of all of V has both a finite error and an eta > 0: inf is
            refused, and `warpopt.theory.far_limit` is what the optimum tends to.
        half_fov: half the field of view phi, in radians, in (0, pi/2); the same for both screen axes.

    Raises:
        ValueError: for a value out of range or NaN, or shapes that do not broadcast, naming the argument
            (`equinox.error_if` when traced).

    Example:
        >>> float(ViewFrustum(near=1.0, far=100.0, half_fov=0.5236).depth_ratio)
        100.0
    """

    near: Float[Array, "..."]
    far: Float[Array, "..."]
    half_fov: Float[Array, "..."]

    def __init__(self, near: Numbers, far: Numbers, half_fov: Numbers):
        near, far, half_fov = float_arrays(near=near, far=far, half_fov=half_fov)
        shape = joint_shape(near=near, far=far, half_fov=half_fov)
        near, far, half_fov = (jnp.broadcast_to(v, shape) for v in (near, far, half_fov))
        # A device takes numbers below the least normal one for 0.
        least = float(jnp.finfo(near.dtype).tiny)
        words = f"a finite number > 0 that {near.dtype} holds with all digits, >= {least:.3g}"
        self.near = checked("near", near, lambda v: (v >= least) & (v < np.inf), words)
        largest = 0.25 / least
        words = (
            f"a finite number > near, of a far/near up to {largest:.3g} ({far.dtype}); for no far plane see "
            "warpopt.theory.far_limit"
        )
        # By a product: the quotient may overflow.
        self.far = checked(
            "far", far, lambda v, near: (v > near) & (v < np.inf) & (v * (1 / largest) <= near), words, near
        )
        self.half_fov = checked("half_fov", half_fov, lambda v: (v > 0) & (v < np.pi / 2), "radians in (0, pi/2)")

    @property
    def depth_ratio(self) -> Float[Array, "..."]:
        """far / near."""
        return self.far / self.near

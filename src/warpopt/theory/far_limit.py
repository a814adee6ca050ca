"""The optimum over the whole frustum as its far plane moves away without end."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays, joint_shape
from .._numerics import smaller
from ..objective import Metric, Objective
from .light_space import side_slopes


class FarLimit(NamedTuple):
    """What eta, lambda (a length) and the L-inf norm of the optimum tend to.

    eta of 0 is no warp that a map can have: it says that any warp that is strong enough for a far plane is too weak for
    one farther away.

    Attributes:
        eta, lam, value: (...), of the same shape.
    """

    eta: Float[Array, "..."]
    lam: Float[Array, "..."]
    value: Float[Array, "..."]


def far_limit(near: Numbers, half_fov: Numbers, theta: Numbers, metric: str | Metric = "p") -> FarLimit:
    """The limit of the L-inf optimum over the whole view frustum as far grows without end; derived here, (T63).

    For a light flatter than half the field of view eta tends to (1 + beta/alpha) (T - sin(theta))/(T + sin(theta)), at
    most 1, with T = tan(half_fov) |cos(theta)|; for a steeper one to 0. Only E_q keeps a finite error, 2 b/a, and a
    finite lambda, n a, for a light that is steeper.

    Args:
        near, half_fov, theta: as for `ViewFrustum` and `FrustumView`, of shapes that broadcast.
        metric: "p", "q", "pxq" or a `Metric`.

    Returns:
        A `FarLimit`, each field of the joint shape.

    Raises:
        ValueError: a value out of range, or a metric that is no product of E_p and E_q.

    Example:
        >>> limit = far_limit(1.0, 0.5236, [1.0472, 0.2618])
        >>> [round(float(v), 4) for v in limit.eta]
        [0.0, 0.366]
        >>> round(float(far_limit(1.0, 0.5236, 1.0472, "q").value), 3)   # 2 b/a
        4.0
    """
    near, half_fov, theta = float_arrays(near=near, half_fov=half_fov, theta=theta)
    joint_shape(near=near, half_fov=half_fov, theta=theta)
    near = checked("near", near, lambda v: (v > 0) & (v < jnp.inf), "a finite number > 0")
    half_fov = checked("half_fov", half_fov, lambda v: (v > 0) & (v < jnp.pi / 2), "radians in (0, pi/2)")
    top = float(jnp.float32(jnp.pi))  # as float32 users write pi
    theta = checked("theta", theta, lambda v: (v >= 0) & (v <= top), "radians in [0, pi]")
    product = Objective(metric).metric
    slopes = side_slopes(half_fov, theta)
    a, flatness, b = slopes.a_plus, slopes.a_minus, slopes.b
    steep = a > 0
    if product.alpha:
        eta = smaller((1 + product.beta / product.alpha) * flatness / b, 1)
        endless = jnp.full_like(near + eta, jnp.inf)
        return FarLimit(eta + 0 * near, endless, endless)
    eta = jnp.where(steep, 0.0, 1.0) + 0 * near
    value = jnp.where(steep, 2 * b / jnp.where(steep, a, 1), jnp.inf) ** product.beta
    return FarLimit(eta, jnp.where(steep, near * a, jnp.inf), value + 0 * near)

"""One number for a texel's size on the screen, from the texel's two edges.

A texel of the shadow map is a parallelogram on the light plane. With light-plane lengths over z as its screen image,
its column edge is (E_p, sigma E_p) and its row edge (0, E_q), in pixels along the screen images of Z_w and X_w; sigma
is the shear, dx/dd at constant t. Every function here is convex and homogeneous of degree 1 in the lengths E_p,
|sigma E_p| and E_q, and falls in none of them: the certificate of `solve.weak_convexity` rests on that.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._numerics import larger


def longest_edge(e_p: Float[Array, "..."], sigma: Float[Array, "..."], e_q: Float[Array, "..."]) -> Float[Array, "..."]:
    """max(E_p sqrt(1 + sigma^2), E_q): the longer of a texel's two edges.

    Args:
        e_p, e_q: >= 0, pixels per texel, of shapes that broadcast.
        sigma: the texel's shear.

    Returns:
        Pixels, of the joint shape.

    Example:
        >>> float(longest_edge(*map(jnp.asarray, (4.0, 0.75, 3.0))))
        5.0
    """
    return larger(e_p * jnp.sqrt(1 + sigma * sigma), e_q)


def larger_error(e_p: Float[Array, "..."], sigma: Float[Array, "..."], e_q: Float[Array, "..."]) -> Float[Array, "..."]:
    """max(E_p, E_q), without the shear.

    Args:
        e_p, e_q: >= 0, pixels per texel, of shapes that broadcast.
        sigma: the texel's shear, which does not count.

    Returns:
        Pixels, of the joint shape.

    Example:
        >>> float(larger_error(*map(jnp.asarray, (4.0, 0.75, 3.0))))
        4.0
    """
    del sigma
    return larger(e_p, e_q)


def edge_offset(e_p: Float[Array, "..."], sigma: Float[Array, "..."], e_q: Float[Array, "..."]) -> Float[Array, "..."]:
    """The expected offset of a shadow edge of unknown direction: how far nearest lookup moves it, in pixels.

    The true edge passes anywhere through the texel, whose centre decides: the offset across an edge with unit normal n
    is |n . r|, r uniform over the texel, and its mean over all n is 2/pi times the mean of |r|. Over a parallelogram
    that is a third of the mean distances from its centre to a side of each kind,

        (2/pi) (m_1 + m_2) / 3,    m = R/4 + s^2/(4 R) + h^2 atanh(L/R)/L

    for a side of length L whose line is h from the centre, with s twice its middle's distance from the foot of the
    perpendicular, and R the sum of the distances from the centre to its ends: half the sum of the two diagonals.

    Args:
        e_p, e_q: >= 0, pixels per texel, of shapes that broadcast.
        sigma: the texel's shear.

    Returns:
        Pixels, of the joint shape.

    Example:
        >>> one_direction = [float(edge_offset(*map(jnp.asarray, v))) for v in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))]
        >>> [round(v * 2 * 3.14159265, 4) for v in one_direction]   # a segment of length 1: (2/pi) / 4
        [1.0, 1.0]
    """
    scale = larger(e_p, e_q)
    safe = jnp.where(scale > 0, scale, 1)
    p, q = e_p / safe, e_q / safe
    secant = jnp.sqrt(1 + sigma * sigma)
    shear = p * jnp.abs(sigma)
    ends = (_length(p, shear + q) + _length(p, shear - q)) / 2
    rows = _side(q, ends, shear, p / 2)
    columns = _side(p * secant, ends, q * jnp.abs(sigma) / secant, q / (2 * secant))
    return jnp.where(scale > 0, scale * (2 / (3 * jnp.pi)) * (rows + columns), 0)


def lean(
    e_p: Float[Array, "..."], sigma: Float[Array, "..."], normal: tuple[Float[Array, "..."], Float[Array, "..."]]
) -> Float[Array, "..."]:
    """A texel column's signed extent across a shadow edge: E_p (c + sigma s), for the edge's unit normal (c, s).

    Args:
        e_p: >= 0, pixels per texel.
        sigma: the texel's shear.
        normal: (c, s), along the screen images of Z_w and X_w.

    Returns:
        Pixels, of the joint shape.

    Example:
        >>> float(lean(*map(jnp.asarray, (2.0, 0.5)), (jnp.asarray(0.75), jnp.asarray(-0.5))))
        1.0
    """
    return e_p * (normal[0] + sigma * normal[1])


def offset_across(column: Float[Array, "..."], row: Float[Array, "..."]) -> Float[Array, "..."]:
    """The expected offset of a shadow edge, from a texel's two extents across it, in pixels.

    The mean of |u a + v b| with u and v uniform in [-1/2, 1/2]: max/4 + min^2/(12 max) of |a| and |b|.

    Args:
        column, row: extents in pixels, of either sign and of shapes that broadcast.

    Returns:
        Pixels, of the joint shape.

    Example:
        >>> [float(offset_across(*map(jnp.asarray, extents))) for extents in ((-4.0, 0.0), (3.0, 3.0))]
        [1.0, 1.0]
    """
    a, b = jnp.abs(column), jnp.abs(row)
    most, least = larger(a, b), jnp.where(a > b, b, a)  # where they tie, one of each: the derivative is both's
    return most / 4 + least * least / (12 * jnp.where(most > 0, most, 1))


def _side(length: Array, ends: Array, middle: Array, height: Array) -> Array:
    """The mean distance from the centre to a side."""
    safe = jnp.where(ends > 0, ends, 1)
    # atanh diverges where the centre lies on the side's line, as height^2 vanishes faster.
    highest = 1 - 4 * jnp.finfo(ends.dtype).eps
    ratio = jnp.clip(length / safe, 0, highest)
    return ends / 4 + (middle * middle) / (4 * safe) + height * height * _atanh_over(ratio) / safe


def _atanh_over(t: Array) -> Array:
    """atanh(t) / t, also at 0."""
    small = t < 0.05
    square = t * t
    series = 1 + square * (1 / 3 + square * (1 / 5 + square * (1 / 7 + square * (1 / 9 + square / 11))))
    safe = jnp.where(small, 0.5, t)
    # One logarithm of a quotient instead of arctanh's two: as exact where t is not small, and half the time.
    return jnp.where(small, series, jnp.log((1 + safe) / (1 - safe)) / (2 * safe))


def _length(x: Array, y: Array) -> Array:
    square = x * x + y * y
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)


Kernel = Callable[[Array, Array, Array], Array]

KERNELS: dict[str, Kernel] = {"max": larger_error, "edge": longest_edge, "band": edge_offset}
"""The size that each metric averages, by the metric's name."""

"""One number for a texel's size on the screen, from the texel's two edges.

A texel of the shadow map is a parallelogram on the light plane. With light-plane lengths over z as its screen image,
its column edge is (E_p, sigma E_p) and its row edge (0, E_q), in pixels along the screen images of Z_w and X_w; sigma
is the shear, dx/dd at constant t. Every function here is convex and homogeneous of degree 1 in the lengths E_p,
|sigma E_p| and E_q, and falls in none of them: the certificate of `solve.weak_convexity` rests on that.
"""

import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._numerics import horner, larger, over, positive

_SERIES = 0.0625  # squares below which a series is used, each of whose terms is smaller by this


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
    is |n . r|, r uniform over the texel, and its mean over all n is 2/pi times the mean of |r| (T53).

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
    dtype = jnp.result_type(e_p, sigma, e_q, 1.0)  # integers become floats
    return _offset(*(v.astype(dtype) for v in jnp.broadcast_arrays(e_p, sigma, e_q)))


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


@jax.custom_jvp
def _offset(e_p: Array, sigma: Array, e_q: Array) -> Array:
    return _offset_and_slopes(e_p, sigma, e_q)[0]


@_offset.defjvp
def _offset_jvp(primals, tangents):
    # By hand: automatic differentiation of the value takes three times the operations, on a CPU thirty times as long.
    value, (by_p, by_sigma, by_q) = _offset_and_slopes(*primals)
    p, sigma, q = tangents
    return value, by_p * p + by_sigma * sigma + by_q * q


def _offset_and_slopes(e_p: Array, sigma: Array, e_q: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    scale, turn = _scale_of(e_p, e_q), jnp.abs(sigma)
    p, q = (v * (1 / scale) for v in (e_p, e_q))
    value, (by_p, by_s, by_q) = _mean_distance(p, p * turn, q)
    by_s = by_s * (2 / jnp.pi)
    slopes = by_p * (2 / jnp.pi) + turn * by_s, jnp.sign(sigma) * e_p * by_s, by_q * (2 / jnp.pi)
    return scale * (value * (2 / jnp.pi)), slopes


def _mean_distance(p: Array, s: Array, q: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """(the mean distance from the centre of a texel with the edges (p, s) and (0, q), its derivatives by p, s and q):
    (T53). None of the lengths is negative."""
    scale = _scale_of(p, s, q)
    p, s, q = (v * (1 / scale) for v in (p, s, q))
    longer, shorter = _length(p, s + q), _length(p, s - q)  # the diagonals
    half = (longer + shorter) / 2
    # half - max(s, q), half - s and half - q: differences of large numbers where p is small.
    outer, inner = longer + s + q, shorter + jnp.abs(s - q)
    rest = p * p * (outer + inner) / positive(2 * outer * inner)
    over_s, over_q = (rest + jnp.where(change > 0, change, 0) for change in (q - s, s - q))
    unit = 1 / positive(half)
    P, S, Q = p * unit, s * unit, q * unit
    PP, SS, QQ = P * P, S * S, Q * Q
    side, square = _length(P, S), PP + SS
    inverse = 1 / positive(square)
    of_side = _atanh_rest(side, square, inverse, QQ * (over_s * unit) * (1 + S))
    of_row = _atanh_rest(Q, QQ, 1 / positive(QQ), (over_q * unit) * (1 + Q))
    towards, across = QQ * SS * inverse, QQ * PP * inverse
    value = half * (3 + SS * QQ + PP * QQ * (of_side + of_row))
    by_p = P * (3 - towards + (2 * towards - across) * of_side + 2 * QQ * of_row)
    by_s = S * (3 - towards - 3 * across * of_side)
    by_q = Q * (3 - SS + PP * (2 * of_side - of_row))
    return scale * (value / 12), (by_p / 12, by_s / 12, by_q / 12)


def _scale_of(*lengths: Array) -> Array:
    """A number of their size, 1 if all are 0, whose inverse is in range: functions homogeneous in them are computed in
    units of it.

    The result does not depend on it, so that it needs no derivative.
    """
    tiny, largest = float(jnp.finfo(lengths[0].dtype).tiny), functools.reduce(larger, lengths)
    return jax.lax.stop_gradient(jnp.where(largest > 0, jnp.clip(largest, 4 * tiny, 0.25 / tiny), 1))


def _atanh_rest(t: Array, square: Array, inverse: Array, rest: Array) -> Array:
    """(atanh(t) / t - 1) / t^2 for 0 <= t <= 1, from t, t^2, 1/t^2 and 1 - t^2.

    It diverges at 1, where it is multiplied by 0.
    """
    numbers = jnp.finfo(t.dtype)
    small, terms = square < _SERIES, math.ceil(math.log(float(numbers.eps)) / math.log(_SERIES))
    series = horner([1 / (2 * k + 3) for k in reversed(range(terms))], jnp.where(small, square, 0))
    large, inverse = (jnp.where(small, 1, v) for v in (t, inverse))
    away = jnp.where(rest > 16 * numbers.tiny, rest, 16 * numbers.tiny)
    direct = (jnp.log(over((1 + large) * (1 + large), away)) * (0.5 * large * inverse) - 1) * inverse
    return jnp.where(small, series, direct)


def _length(x: Array, y: Array) -> Array:
    square = x * x + y * y
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)


Kernel = Callable[[Array, Array, Array], Array]

KERNELS: dict[str, Kernel] = {"max": larger_error, "edge": longest_edge, "band": edge_offset}
"""The size that each metric averages, by the metric's name."""

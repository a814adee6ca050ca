"""eta of a table at any direction: the definition shared by NumPy, JAX and the exported code."""

from typing import NamedTuple

import numpy as np


class Rows(NamedTuple):
    """Polylines of eta over theta, one for each far/near and half field of view.

    Attributes:
        depth_ratio: (R,) far/near, increasing.
        half_fov: (H,) radians, increasing.
        theta: (R, H, N) knots, not decreasing along N; the first and the last are the same in all rows.
        eta: (R, H, N) heights > 0. Above 1 the lookup gives eta = 1 (no warp).
    """

    depth_ratio: np.ndarray
    half_fov: np.ndarray
    theta: np.ndarray
    eta: np.ndarray

    @property
    def size(self) -> int:
        """How many numbers a lookup reads; an axis of one row needs none."""
        axes = sum(len(axis) for axis in (self.depth_ratio, self.half_fov) if len(axis) > 1)
        return axes + self.theta.size + self.eta.size


def lookup(theta, depth_ratio, half_fov, rows: Rows, xp):
    """eta in (0, 1].

    Between rows the knots move, linearly in the field of view and nearly so in log(far/near) (`between_ratios`), so
    that moving kinks are followed. On each row eta is linear between its knots; between rows log(eta) is. Values beyond
    the ends of an axis are clamped. NaN, or far/near <= 0, gives 1.

    Args:
        theta, depth_ratio, half_fov: arrays of one dtype that broadcast; an axis of one row needs none (None).
        rows: the table.
        xp: numpy or jax.numpy.
    """
    dtype = theta.dtype
    rows = Rows(*(xp.asarray(v.astype(dtype)) for v in rows))
    pi, half = np.asarray(np.pi, dtype), np.asarray(np.pi / 2, dtype)
    rest = np.asarray(np.pi - float(pi), dtype)  # the rounding error of single precision's pi matters at steep kinks
    # Two selections: in a single one, compilers add the two constants, and the remainder is lost.
    folded = xp.where(theta > half, pi - theta, theta) + xp.where(theta > half, rest, 0)
    axes = [
        of(value, axis, xp)
        for value, axis, of in (
            (depth_ratio, rows.depth_ratio, between_ratios), (half_fov, rows.half_fov, between_fovs)
        )
        if axis.shape[0] > 1
    ]  # fmt: skip
    shape = tuple(size for size in rows.theta.shape[:2] if size > 1)
    knots, heights = (v.reshape(*shape, v.shape[-1]) for v in (rows.theta, rows.eta))
    per_knot = [(row, share[..., None]) for row, share in axes]
    positions = _blended(per_knot, lambda corner: knots[corner])
    piece, share = on_piece(folded, positions, xp)

    def height(corner: tuple):
        low, high = (heights[(*corner, piece + k)] for k in (0, 1))
        return low + share * (high - low)

    eta = height(tuple(row for row, _ in axes))
    if axes:
        # Logarithms of ratios, which are small: the logarithm of eta itself would lose digits.
        first = eta
        eta = first * xp.exp(_blended(axes, lambda corner: xp.log(height(corner) / first)))
    nan = sum(xp.isnan(v) for v in (theta, *(t for _, t in axes)))
    return xp.where((eta < 1) & (nan == 0), eta, 1).astype(dtype)


def on_piece(theta, knots, xp):
    """(piece, share of it passed, in [0, 1]) of each theta on polylines with knots (..., N).

    The piece whose end is the first knot not before theta: found by summing comparisons, fast for short tables.
    """
    piece = (theta[..., None] > knots[..., 1:-1]).astype(np.int32).sum(-1)
    knots = xp.broadcast_to(knots, (*piece.shape, knots.shape[-1]))
    start, end = (xp.take_along_axis(knots, (piece + k)[..., None], -1)[..., 0] for k in (0, 1))
    share = (theta - start) / xp.where(end > start, end - start, 1)
    return piece, xp.where(share >= 0, xp.where(share <= 1, share, 1), 0).astype(theta.dtype)


def between_ratios(value, axis, xp):
    """(row, fraction of the way to the next row) of far/near.

    g' (v - g^2) / ((g' - g) (v + g g')), with g, g' the square roots of the rows' far/near: the Moebius map that equals
    the logarithmic fraction at 0, 1/2 and 1. It differs by at most 2e-3 for rows a factor of 2 apart, and gives equal
    bits in every language, which a logarithm does not: near steep kinks the difference would be visible.
    """
    root = xp.sqrt(axis)
    row = (value[..., None] > (root * root)[1:-1]).astype(np.int32).sum(-1)
    low, high = root[row], root[row + 1]
    beyond, inside = value > high * high, value > low * low
    between = xp.where(inside & ~beyond, value, low * low)
    share = high * (between - low * low) / ((high - low) * (between + low * high))
    share = xp.where(beyond, 1, xp.where(share > 1, 1, share))
    return row, xp.where(value > 0, share, np.nan).astype(value.dtype)  # not a frustum


def between_fovs(value, axis, xp):
    """(row, fraction of the way to the next row) of the half field of view."""
    row = (value[..., None] > axis[1:-1]).astype(np.int32).sum(-1)
    share = (value - axis[row]) / (axis[row + 1] - axis[row])
    return row, xp.where(share < 0, 0, xp.where(share > 1, 1, share)).astype(value.dtype)


def _blended(axes: list, of, corner: tuple = ()):
    """Linear between the rows' values, axis by axis; `of` is given the row on each axis."""
    if len(corner) == len(axes):
        return of(corner)
    row, share = axes[len(corner)]
    low, high = (_blended(axes, of, (*corner, row + k)) for k in (0, 1))
    return low + share * (high - low)

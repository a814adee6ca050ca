"""Convex polytopes as half-spaces normal . c + offset >= 0: their vertices, and a minimal thickness."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._numerics import largest_of, least_of


def vertices_of(planes: Float[Array, "K 4"]) -> tuple[Float[Array, "N 3"], Bool[Array, " N"], Bool[Array, ""]]:
    """(points, which of them are vertices, whether an edge is unbounded) of a polytope.

    The points are both ends of its edges, first one of each, then the other.

    Every edge is the line of two planes, clipped by all others. Points within rounding of the body belong to it, so
    that a body without thickness keeps its vertices.
    """
    first, second = np.array(list(itertools.combinations(range(len(planes)), 2))).T
    others = (np.arange(len(planes)) != first[:, None]) & (np.arange(len(planes)) != second[:, None])
    return edges_between(planes[first], planes[second], planes, others)


def edges_between(
    first: Float[Array, "E 4"],
    second: Float[Array, "E 4"],
    planes: Float[Array, "K 4"],
    others: Bool[np.ndarray, "E K"],
) -> tuple[Float[Array, "N 3"], Bool[Array, " N"], Bool[Array, ""]]:
    """(both ends, which there are, whether one is unbounded) of the lines in which planes meet, clipped by half-spaces.

    Args:
        first, second: the planes of each line.
        planes: the half-spaces.
        others: which of them clip each line.
    """
    p, q = first[:, :3], second[:, :3]
    normals, offsets = planes[:, :3], planes[:, 3]
    eps = jnp.finfo(planes.dtype).eps
    direction = jnp.cross(p, q)
    square = (direction * direction).sum(-1)
    crossing = square > 1e4 * eps  # parallel planes have no edge, or a negligible one
    square = jnp.where(crossing, square, 1)
    # The line's point nearest to the eye, and its unit direction.
    h, g = -first[:, 3:], -second[:, 3:]
    base = (h * jnp.cross(q, direction) + g * jnp.cross(direction, p)) / square[:, None]
    direction = direction / jnp.sqrt(square)[:, None]
    start, end, bounded, slanted, inside = clipped(base, direction, normals, offsets, others)
    reach = jnp.sqrt((base * base).sum(-1) + jnp.maximum(start * start, end * end))
    tolerance = 64 * eps * reach
    beside = (others & ~slanted & (inside < -tolerance[:, None])).any(1)
    valid = crossing & ~beside & (start <= end + tolerance)
    endless = (valid & ~bounded).any()
    valid = valid & bounded
    ends = base + start[:, None] * direction, base + end[:, None] * direction
    return jnp.concatenate(ends), jnp.concatenate([valid, valid]), endless


def clipped(base, direction, normals, offsets, others) -> tuple[Array, Array, Array, Array, Array]:
    """Lines base + t direction, each clipped by its half-spaces in `others`.

    Returns (first t, last t, whether both exist, which half-spaces cut the line, each one's value at the base);
    the first two are 0 where the line stays unbounded.
    """
    towards, inside = direction @ normals.T, base @ normals.T + offsets
    slanted = others & (jnp.abs(towards) > 64 * jnp.finfo(base.dtype).eps)
    at = -inside / jnp.where(slanted, towards, 1)
    start = largest_of(jnp.where(slanted & (towards > 0), at, -jnp.inf))
    end = least_of(jnp.where(slanted & (towards < 0), at, jnp.inf))
    bounded = jnp.isfinite(start) & jnp.isfinite(end)
    return jnp.where(bounded, start, 0), jnp.where(bounded, end, 0), bounded, slanted, inside


def thickened(
    planes: Float[Array, "K 4"], vertices: Float[Array, "N 3"], valid: Bool[Array, " N"]
) -> tuple[Array, Array, Array]:
    """(half-spaces, vertices, which are valid) of a body, thickened to at least sqrt(eps) of its size.

    A thinner body has negligible volume; thickening it moves the optimum by no more than rounding does elsewhere.
    """
    eps = jnp.finfo(planes.dtype).eps
    present = valid[:, None]
    extent = (jnp.where(present, vertices, -jnp.inf).max(0) - jnp.where(present, vertices, jnp.inf).min(0)).max()
    size = jnp.maximum(extent, eps**0.5 * jnp.abs(jnp.where(present, vertices, 0)).max())
    size = jax.lax.stop_gradient(jnp.where(jnp.isfinite(size) & (size > 0), size, 1))
    thickness = jnp.where(present, vertices @ planes[:, :3].T + planes[:, 3], -jnp.inf).max(0)
    short = jax.lax.stop_gradient(eps**0.5 * size - thickness)
    thick = planes.at[:, 3].add(jnp.where(valid.any() & (short > 0), short, 0))
    return thick, *vertices_of(thick)[:2]

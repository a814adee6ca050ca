"""Solid bodies by depth along Z_w for L_P norms of E_p: their density is integrated in slices.

At one depth, a convex body is a polygon in the plane of X_w and the light. Its corners lie on the body's edges, so they
are linear in depth between two vertices, and so is the width of each stretch between two corners along the light.
Hence W, the integral of z^-(P + m), is a sum of integrals of smooth functions there, analytic in depth between
vertices. All terms are positive. `warpopt.bound.frustum` explains the use of W.
"""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from ..._numerics import power, unit_nodes
from ...theory.camera import Camera
from ...theory.light_frame import LightFrame
from ..bins import ends
from ..footprint import range_of
from ..polytope import thickened, vertices_of
from .profile import NOTHING, Stretches

# (largest number of slabs, nodes along Z_w for each stretch, Gauss nodes for each part of a slice).
# Errors measured for P = 1 to 3 and five lights: one body 1e-12 for f/n up to 1e4, 2e-8 for 1e12; a histogram 1e-8
# where no bin spans a depth ratio above 100, 3e-6 above (tests/test_lower_bound.py).
_NODES = ((1, 96, 20), (16, 48, 12), (64, 24, 8), (math.inf, 16, 6))
_REACH = 3.5  # of the double exponential nodes: the first is 3e-23 of a stretch from its end


class Solid(eqx.Module):
    """A convex body in eye coordinates with a density z^-m, with a weight per slab of eye depth.

    Attributes:
        planes: (K, 4) half-spaces normal . c + offset >= 0.
        between: (N - 1,) eye depths of the boundaries between slabs.
        weights: (N,) of the slabs.
        exponent: m.
    """

    planes: Float[Array, "K 4"]
    between: Float[Array, " B"]
    weights: Float[Array, " N"]
    exponent: float = eqx.field(static=True)

    @classmethod
    def uniform(cls, planes: Float[Array, "K 4"], exponent: float) -> "Solid":
        """A solid of one slab."""
        return cls(planes, jnp.zeros(0, planes.dtype), jnp.ones(1, planes.dtype), exponent)


def sliced_stretches(camera: Camera, frame: LightFrame, solid: Solid, order: float, parts: int) -> Stretches:
    """The best map of E_p in L_order, each stretch between two vertices in `parts` linear pieces."""
    starts, lengths, shares, value = body_shares(camera, frame, solid, order)
    if not value > 0:
        return NOTHING
    at, s = _joined(starts, lengths, shares, parts)
    return Stretches(at, s, float(value))


@functools.partial(jax.jit, static_argnames=("order",))
def body_shares(
    camera: Camera, frame: LightFrame, solid: Solid, order: float
) -> tuple[Float[Array, " S"], Float[Array, " S"], Float[Array, "S N"], Float[Array, ""]]:
    """(where stretches of depth begin, their lengths, each node's part of the integral of W^(1/(P+1)), the bound).

    The nodes along a stretch, and the ends of their parts, are those of `depth_cells`. Stretches are unordered; some
    have length 0. The bound is in `lower_bound`'s units, 0 for no receivers or a single depth, in either dtype.
    Derivatives are finite, and correct except where two corners have the same depth (a kink).
    """
    planes, between, weights, exponent = solid.planes, solid.between, solid.weights, solid.exponent
    vertices, valid, _ = vertices_of(planes)
    depths = vertices @ frame.z_axis
    _, flat = range_of(*ends(valid, depths), jnp.abs(jnp.where(valid, depths, 0)).max())
    planes, vertices, valid = thickened(planes, vertices, valid)
    unit = jnp.where(valid, vertices[:, 2], jnp.inf).min()
    unit = jnp.where(valid.any(), unit, 1)
    axes = jnp.stack([frame.x_axis, frame.light, frame.z_axis])
    planes = jnp.c_[planes[:, :3] @ axes.T, planes[:, 3] / unit]
    body_edges = jnp.stack(jnp.split(vertices / unit @ axes[1:].T, 2), 1)  # of the edges: (edges, 2, (l . c, Z_w . c))
    depths = jnp.where(valid, vertices @ frame.z_axis / unit, -jnp.inf)
    # A slab's corners are on the frustum's edges.
    inner = jnp.outer(between, camera.corner_slopes() @ frame.z_axis).ravel() / unit
    depths = jnp.sort(jnp.concatenate([jnp.where(valid, depths, depths.max()), inner]))
    depths = jnp.where(valid.any(), depths, 0)
    count = 2 * len(planes) - 5 + len(inner)  # the longest are the true ones; the rest is rounding between equal depths
    lengths, where = jax.lax.top_k(jnp.diff(depths), min(count, len(depths) - 1))
    starts = depths[where]
    nodes, parts = next((n, p) for most, n, p in _NODES if len(weights) <= most)
    share, weight, _ = (v.astype(depths.dtype) for v in depth_cells(nodes))
    slabs = between / unit, weights
    slices = functools.partial(
        _slice,
        planes,
        body_edges,
        valid[: len(body_edges)],
        slabs,
        frame=frame,
        # Parallel rays: errors do not depend on z, and every measure that is left is the volume.
        powers=(0.0, 0.0) if frame.is_orthographic else (order + exponent, exponent),
        count=parts,
    )
    W, mass = jax.lax.map(lambda place: jax.vmap(slices)(place[0] + place[1] * share), (starts, lengths))
    steps = lengths[:, None] * weight
    there = W > 0
    shares = jnp.where(there, jnp.where(there, W, 1) ** (1 / (order + 1)) * steps, 0)
    total, mass = shares.sum(), (mass * steps).sum()
    there = (total > 0) & (mass > 0) & ~flat
    total, mass = (jnp.where(there, v, 1) for v in (total, mass))
    # E_p is mu/z, lengths over `unit` both; under parallel rays it is mu.
    size = unit if frame.is_orthographic else 1
    value = jnp.where(there, frame.density_p * size * total * power(total / mass, 1 / order), 0)
    return starts * unit, lengths * unit, shares, value


def _joined(starts: Array, lengths: Array, shares: Array, parts: int) -> tuple[NDArray, NDArray]:
    """(ends (N + 1,), shares (N,)) of a piecewise linear map: `parts` pieces for each stretch, denser where it bends.

    Evenly spaced in the sum of depth and map, each normalised to [0, 1].
    """
    order = np.argsort(starts, kind="stable")
    order = order[np.asarray(lengths)[order] > 0]
    edges = depth_cells(shares.shape[1])[2]
    at, s = [], []
    for start, length, share in zip(
        *(np.asarray(v, np.float64)[order] for v in (starts, lengths, shares)), strict=True
    ):
        reached = np.append(0, np.cumsum(share))
        even = np.linspace(0, 1, parts + 1)
        place = np.interp(even, (edges + reached / (reached[-1] or 1)) / (1 + (reached[-1] > 0)), edges)
        at.append(start + length * place)
        s.append(np.diff(np.interp(place, edges, reached)))
    return np.append(np.concatenate([ends[:-1] for ends in at]), at[-1][-1]), np.concatenate(s)


@functools.lru_cache(maxsize=8)
def depth_cells(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(nodes in [0, 1], weights, the ends of each node's cell): double exponential, for square-root ends."""
    edges = np.linspace(-_REACH, _REACH, count + 1)
    x = (edges[1:] + edges[:-1]) / 2
    share = 1 / (1 + np.exp(-np.pi * np.sinh(x)))
    weight = np.pi * np.cosh(x) * share * (1 - share) * (2 * _REACH / count)
    cells = 1 / (1 + np.exp(-np.pi * np.sinh(edges)))
    cells[0], cells[-1] = 0, 1
    return share, weight, cells


def _slice(
    planes: Float[Array, "K 4"], ends: Float[Array, "E 2 2"], valid: Bool[Array, " E"], slabs: tuple[Array, Array],
    depth: Array, *, frame: LightFrame, powers: tuple[float, ...], count: int,
) -> list[Array]:  # fmt: skip
    """The integrals of z^-power over the polygon at one depth; planes and edges along (X_w, l, Z_w)."""
    (h0, d0), (h1, d1) = (ends[:, k].T for k in (0, 1))
    crossing = valid & ((d0 < depth) != (d1 < depth))
    h = h0 + (h1 - h0) * (jnp.where(crossing, depth - d0, 0) / jnp.where(crossing, d1 - d0, 1))
    there = crossing.any()
    least, largest = (jnp.where(there, v, 0) for v in (
        jnp.where(crossing, h, jnp.inf).min(), jnp.where(crossing, h, -jnp.inf).max()
    ))  # fmt: skip
    (x_lean, h_lean, d_lean), (between, weights) = jnp.stack([frame.x_axis, frame.light, frame.z_axis])[:, 2], slabs
    # under a light overhead, a slice has one eye depth and lies in one bin
    leans = jnp.abs(h_lean) > jnp.finfo(h.dtype).tiny
    cuts = jnp.where(leans, (between - depth * d_lean) / jnp.where(leans, h_lean, 1), least)
    corners = jnp.sort(jnp.concatenate([jnp.where(crossing, h, largest), jnp.clip(cuts, least, largest)]))
    lengths, where = jax.lax.top_k(jnp.diff(corners), min(len(planes) - 1 + len(between), len(corners) - 1))
    first = corners[where][:, None]
    lengths = lengths[:, None]
    low, middle, high = (
        jnp.where(there, depth * d_lean + (first + part * lengths) * h_lean, 1) for part in (0, 0.5, 1)
    )
    t, weight = unit_nodes(count, corners.dtype)
    # even in log z, so that a part from the eye to the horizon is smooth too
    share, speed = _graded(jnp.log(high / low), t)
    h = first + lengths * share
    slope = planes[:, 0]
    upright = jnp.abs(slope) > 64 * jnp.finfo(h.dtype).eps
    x = -(planes[:, 1] * h[..., None] + planes[:, 2] * depth + planes[:, 3]) / jnp.where(upright, slope, 1)
    left = jnp.where(upright & (slope > 0), x, -jnp.inf).max(-1)
    right = jnp.where(upright & (slope < 0), x, jnp.inf).min(-1)
    inside = there & (right > left)
    left, right = jnp.where(inside, left, 0), jnp.where(inside, right, 0)
    # where light and view are parallel, X_w leans out of the screen by up to sqrt(eps): its middle is used for all
    z = jnp.where(inside, depth * d_lean + h * h_lean + (left + right) / 2 * x_lean, 1)
    area = weights[jnp.searchsorted(between, middle)] * (right - left) * lengths * speed * weight
    return [(area * z**-power).sum() for power in powers]


def _graded(L: Array, t: Array | np.ndarray) -> tuple[Array, Array]:
    """(share, its derivative): expm1(L t) / expm1(L), which grows as e^(L t); t itself for L = 0."""
    level = L == 0
    L = jnp.where(level, 1, L)
    whole = jnp.expm1(L)
    return jnp.where(level, t, jnp.expm1(L * t) / whole), jnp.where(level, 1, L * jnp.exp(L * t) / whole)

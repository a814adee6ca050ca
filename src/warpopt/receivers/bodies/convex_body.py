"""A convex body as receivers: the part of a scene's bounding box, or of any convex polytope, in the view frustum."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._checks import Numbers, checked, float_arrays, is_traced
from ..._numerics import compiled, unit_nodes
from ...objective import DENSITY_EXPONENT, Objective
from ...theory.camera import Camera, DirectionalLight
from ...theory.light_frame import LightFrame
from ..bins import extent_of, from_groups, singles
from ..footprint import Footprint
from ..moments import binomial_moments
from ..polytope import clipped, thickened, vertices_of
from ..profiles.hulls import BodyProfile
from ..profiles.nearness import over_body
from ..profiles.slices import Solid
from ..receivers import Receivers
from .depth_integrals import LARGEST_LOG_RATIO

_DEPTH_NODES = 24  # in log z on each piece: to 1e-14 for z ratios up to 1e4, 40 would serve 1e12


class ConvexBody(Receivers):
    """The intersection body B of SC sec. 4.1: the view frustum clipped by half-spaces, such as a scene's box.

    The camera may be inside, outside or partly inside; a body that is behind it, empty, or thinner than rounding is not
    an error. L-inf norms use B's vertices. L_P norms integrate over B in slices, in log z between the depths of its
    vertices; each slice is a polygon, integrated exactly. 24 Gauss nodes a piece leave an error of 1e-13 at f/n = 1e8
    and of 1e-9 at 7.9e13, beyond which there is no number (`Outcome.not_finite`).
    A body flatter than sqrt(eps) of its size is integrated as if it had that thickness, which moves eta by as much.

    Args:
        planes: (K, 4) world half-spaces normal . p + offset >= 0; normals of any nonzero length.

    Raises:
        ValueError: for a wrong shape, a zero normal or values that are not finite.

    Example:
        >>> import warpopt
        >>> body = ConvexBody.box((-10, 0, -60), (10, 5, -20))
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4)
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0.3, -1, -0.2)), body)
        >>> round(float(warpopt.optimal_warp(view).warp.mu), 3)
        41.184
    """

    measures = ("screen", "volume", "log_depth", "ground")
    weighted = False
    any_projection = True

    planes: Float[Array, "K 4"]

    def __init__(self, planes: Numbers):
        (planes,) = float_arrays(planes=planes)
        if planes.ndim != 2 or planes.shape[1] != 4:
            raise ValueError(f"planes: got shape {planes.shape}, expected (K, 4)")
        planes = checked("planes", planes, lambda p: abs(p) < np.inf, "finite numbers")
        largest = checked("planes", _largest(planes), lambda v: v > 0, "normals that are not zero")
        self.planes = _of_unit_normals(planes, largest)

    @classmethod
    def box(cls, lower: Numbers, upper: Numbers) -> "ConvexBody":
        """The axis-parallel box between two world points (3,), which may be infinite.

        For no objects, whose bounds are none, pass no points: `PointReceivers(np.zeros((0, 3)))`.

        Args:
            lower, upper: (3,), lower <= upper.

        Raises:
            ValueError: for a wrong shape, NaN, or lower > upper.
        """
        lower, upper = float_arrays(lower=lower, upper=upper)
        for name, value in (("lower", lower), ("upper", upper)):
            if value.shape != (3,):
                raise ValueError(f"{name}: got shape {value.shape}, expected (3,)")
            checked(name, value, lambda v: v == v, "numbers")
        upper = checked("upper", upper, lambda v, lower: v >= lower, "numbers >= those of lower", lower)
        return cls(_box_planes(lower, upper))

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`."""
        planes = self.with_frustum(camera)
        vertices, valid, endless = vertices_of(planes)
        footprint = from_groups(singles(valid, vertices, frame), camera.near, grouped=False)
        footprint = footprint.lost_where(endless | _beyond_reach(vertices, valid))
        if objective.supremum:
            return footprint
        made = footprint.with_moments(*moments_of_body(planes, vertices, valid, frame, footprint, objective))
        # Beyond, the nodes are too few: no number, as for the whole frustum.
        near, far = extent_of(frame.eye_depth(vertices), valid)
        return made.lost_where(valid.any() & (jnp.log(far / near) > LARGEST_LOG_RATIO))

    @compiled
    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        points, there = self.vertices(camera)
        return extent_of(points[:, 2], there)

    @compiled
    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: the vertices; one that occurs several times counts once."""
        points, there = self.vertices(camera)
        close = jnp.abs(points[:, None] - points).max(-1) <= 1e-6 * jnp.abs(points).max(1)
        earlier = jnp.tril(close & there, -1).any(1)
        return points, (there & ~earlier).astype(points.dtype)

    def mass_up_to(self, camera: Camera, objective: Objective) -> Callable[[Float[Array, "..."]], Float[Array, "..."]]:
        """See `Receivers`: the measure's integral over the part of the body up to a depth."""
        return MassOfBody(self.with_frustum(camera), objective, camera.is_orthographic)

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BodyProfile:
        """See `Receivers`."""
        vertices, valid, _ = map(np.asarray, _vertices(camera, self))
        planes = self.with_frustum(camera)
        solid = Solid.uniform(planes, DENSITY_EXPONENT[objective.measure])
        return BodyProfile([vertices[valid]], solid, camera, frame)

    def nearness(self, camera: Camera, frame: LightFrame, bins: int) -> float:
        """See `Receivers`: exact."""
        points, weights = (np.asarray(v, np.float64) for v in self.places(camera))
        return over_body(points[weights > 0], np.asarray(frame.light, np.float64), frame.is_orthographic)

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """See `Receivers`.

        Raises:
            ValueError: also for a body that is unbounded in the view of a camera without a far plane.
        """
        Receivers.check(self, camera, light, objective)
        if is_traced(camera.far, self.planes):
            return
        if np.isinf(camera.far).any() and _vertices(camera, self)[2]:
            raise ValueError(
                "receivers: got an unbounded body in the view of a camera with far = inf, expected one that "
                "ends, or a finite far"
            )

    @compiled
    def vertices(self, camera: Camera) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
        """(eye coordinates, which of them are vertices of B); each vertex may occur several times.

        Args:
            camera: whose frustum clips the body.
        """
        return vertices_of(self.with_frustum(camera))[:2]

    def with_frustum(self, camera: Camera) -> Float[Array, "N 4"]:
        """All half-spaces in eye coordinates, the frustum's first.

        Args:
            camera: of the frustum.
        """
        planes = self.planes.astype(camera.position.dtype)
        normals = planes[:, :3] @ camera.rotation.T
        offsets = planes[:, 3] + planes[:, :3] @ camera.position
        return jnp.concatenate([camera.planes(), jnp.c_[normals, offsets]])


def _reach(dtype) -> float:
    """Distance at which a box without a side is cut: beyond any frustum, but with squares that do not overflow."""
    return float(jnp.finfo(dtype).max) ** 0.25


@jax.jit
def _largest(planes: Array) -> Array:
    """Of each normal; it is divided by first, so that no square over- or underflows."""
    return jnp.abs(planes[:, :3]).max(1)


@jax.jit
def _of_unit_normals(planes: Array, largest: Array) -> Array:
    planes = planes / largest[:, None]
    return planes / jnp.sqrt((planes[:, :3] ** 2).sum(1))[:, None]


@jax.jit
def _box_planes(lower: Array, upper: Array) -> Array:
    reach = _reach(lower.dtype)
    lower, upper = (jnp.clip(value, -reach, reach) for value in (lower, upper))
    eye = jnp.eye(3, dtype=lower.dtype)
    return jnp.concatenate([jnp.c_[eye, -lower], jnp.c_[-eye, upper]])


def _beyond_reach(vertices: Array, valid: Array) -> Array:
    """Whether a body ends only at that cut."""
    return (valid & (jnp.abs(vertices).max(1) > 1e-3 * _reach(vertices.dtype))).any()


@jax.jit
def _vertices(camera: Camera, body: ConvexBody) -> tuple[Array, Array, Array]:
    """(eye coordinates, which of them are vertices of the body in view, whether the body is unbounded)."""
    vertices, valid, endless = vertices_of(body.with_frustum(camera))
    return vertices, valid, endless | _beyond_reach(vertices, valid)


def moments_of_body(planes, vertices, valid, frame, footprint: Footprint, objective: Objective):
    """(moments, unit) over the body; every term is positive."""
    # Parallel rays: errors do not depend on z, and every measure that is left is the volume.
    flat_view = frame.is_orthographic
    decay = 0 if flat_view else objective.metric.depth_power * objective.order
    slices = _Slices.of(planes, vertices, valid, flat_view)
    M = round(objective.blend_degree)
    points, area = slices.nodes(M)
    depth, mu = frame.depth(points), footprint.mu
    delta = jnp.clip((depth - footprint.start) / mu, 0, 1)
    rest = jnp.clip((footprint.start + mu - depth) / mu, 0, 1)
    area = area * slices.weights(objective, flat_view)[:, None]
    weighted = area * jnp.exp(-decay * slices.log_z)[:, None]
    sums = [(weighted * rest ** (M - j) * delta**j).sum() for j in range(M + 1)]
    return binomial_moments(sums, area.sum(), objective), jnp.ones_like(slices.unit) if flat_view else slices.unit


def _mass_of_body(planes: Array, objective: Objective, flat_view: bool) -> Array:
    """The integral of the measure over the body; 0 for none."""
    vertices, valid, _ = vertices_of(planes)
    slices = _Slices.of(planes, vertices, valid, flat_view)
    _, area = slices.nodes(0)
    growth = _growth(objective, flat_view)
    mass = (area * slices.weights(objective, flat_view)[:, None]).sum() * slices.unit**growth
    return jnp.where(valid.any(), mass, 0)


class MassOfBody(eqx.Module):
    """The measure's integral over the part of a body up to a depth."""

    planes: Float[Array, "K 4"]
    objective: Objective = eqx.field(static=True)
    flat_view: bool = eqx.field(static=True)

    def __call__(self, depth: Float[Array, "..."]) -> Float[Array, "..."]:
        def one(depth: Array) -> Array:
            zero, unit = jnp.zeros_like(depth), jnp.ones_like(depth)
            planes = jnp.concatenate([self.planes, jnp.stack([zero, zero, -unit, depth])[None]])
            return _mass_of_body(planes, self.objective, self.flat_view)

        # No farther than numbers go that can be squared.
        depth = jnp.minimum(depth, _reach(self.planes.dtype)).astype(self.planes.dtype)
        return jax.vmap(one)(depth.ravel()).reshape(depth.shape)


def _growth(objective: Objective, flat_view: bool) -> float:
    """The power of z in a slice's measure, of d log z."""
    return 3 if flat_view else 1 - objective.volume_exponent


class _Slices(NamedTuple):
    """Gauss nodes in depth between the vertices of a body, where a slice's moments are polynomials in z.

    Attributes:
        planes: of the body.
        unit: the least depth.
        log_z, weight_z: nodes and weights, of log z over the unit.
    """

    planes: Float[Array, "K 4"]
    unit: Float[Array, ""]
    log_z: Float[Array, " N"]
    weight_z: Float[Array, " N"]

    @classmethod
    def of(cls, planes: Array, vertices: Array, valid: Array, flat_view: bool) -> "_Slices":
        """`flat_view`: without a power of z, which the nodes of z itself integrate exactly."""
        thick, vertices, valid = thickened(planes, vertices, valid)
        z = jnp.where(valid, vertices[:, 2], jnp.nan)
        first = jnp.where(valid.any(), jnp.nanmin(jnp.where(valid, z, jnp.inf)), 1)
        last = jnp.where(valid.any(), jnp.nanmax(jnp.where(valid, z, -jnp.inf)), 2)
        # A polytope of F faces has at most 2 F - 4 vertices; the longest gaps are the true ones, the others are
        # rounding between equal depths.
        depths = jnp.sort(jnp.where(valid, vertices[:, 2], last)) / first
        along = depths if flat_view else jnp.log(depths)
        gaps, where = jax.lax.top_k(jnp.diff(along), min(2 * len(planes) - 5, len(along) - 1))
        t, w = unit_nodes(_DEPTH_NODES, along.dtype)
        log_z, weight_z = (along[where][:, None] + gaps[:, None] * t).ravel(), (gaps[:, None] * w).ravel()
        if flat_view:
            log_z, weight_z = jnp.log(log_z), weight_z / log_z
        return cls(thick, first, log_z, weight_z)

    def nodes(self, degree: int) -> tuple[Float[Array, "N M 3"], Float[Array, "N M"]]:
        """(points in eye coordinates, area weights) of each slice, exact for polynomials of that degree."""
        return jax.vmap(functools.partial(_slice, self.planes, self.unit, degree))(self.log_z)

    def weights(self, objective: Objective, flat_view: bool) -> Float[Array, " N"]:
        """Of each slice, in powers of the unit."""
        return self.weight_z * jnp.exp(_growth(objective, flat_view) * self.log_z)


def _slice(planes: Array, unit: Array, degree: int, log_z: Array) -> tuple[Array, Array]:
    """(points, area weights) at the nodes of one slice, a polygon in the plane of slopes (x/z, y/z).

    Each edge is a plane's line clipped by the others; with an inner point it forms a triangle, so no order is needed.
    """
    z = unit * jnp.exp(log_z)
    eps = jnp.finfo(z.dtype).eps
    normals, offsets = planes[:, :2], planes[:, 2] + planes[:, 3] / z
    square = (normals * normals).sum(1)
    edge = square > 64 * eps
    square = jnp.where(edge, square, 1)
    base = -normals * (offsets / square)[:, None]
    direction = jnp.stack([-normals[:, 1], normals[:, 0]], 1) / jnp.sqrt(square)[:, None]
    tolerance = 64 * eps * (1 + jnp.abs(offsets)[None, :] + jnp.abs(base).sum(1)[:, None])
    count = len(planes)
    others = ~np.eye(count, dtype=bool)
    start, end, _, slanted, inside = clipped(base, direction, normals, offsets, others)
    beside = (others & ~slanted & (inside < -tolerance)).any(1)
    # Of two planes with the same line, only the first counts.
    earlier = np.tril(np.ones((count, count), bool), -1)
    twice = (earlier & ~slanted & edge[None, :] & (jnp.abs(inside) <= tolerance)).any(1)
    usable = edge & ~beside & ~twice & (end > start)
    p, q = base + start[:, None] * direction, base + end[:, None] * direction
    share = jnp.where(usable, 1, 0)[:, None]
    centre = (share * (p + q)).sum(0) / jnp.maximum(2 * share.sum(), 1)
    area = jnp.where(usable, jnp.abs(jnp.cross(p - centre, q - centre)) / 2, 0)
    # Collapsed Gauss nodes on each triangle: r from the inner point (weight r), v along the edge.
    (r, a), (v, b) = (unit_nodes(count // 2 + 1, z.dtype) for count in (degree + 1, degree))
    along = p[:, None, :] * (1 - v)[:, None] + q[:, None, :] * v[:, None]
    points = centre + r[:, None, None] * (along[:, None] - centre)
    weights = (2 * area)[:, None, None] * (a * r)[:, None] * b
    points = jnp.concatenate([points, jnp.ones_like(points[..., :1])], -1) * z
    return points.reshape(-1, 3), weights.ravel()

"""A depth buffer as receivers."""

import functools
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, assembled, checked, float_arrays
from .._numerics import compiled, larger, largest_of, least_of, least_of_each
from .._parallel import sweep, wide
from .._words import one_of
from ..objective import Objective
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from .bins import BINS, SIGNS, Groups, bin_of, extent_of, from_groups, merged, with_moments
from .footprint import Footprint
from .one_by_one import OneByOne
from .points import PointReceivers
from .profiles.binned import BinnedProfile, PointSet
from .receivers import Receivers
from .samples import Counted, Normal
from .sketch import sketch_of_pixels
from .weighted.cells import EXACT, with_samples
from .weighted.weights import Weighting, Weights

Encoding = Literal["linear", "standard", "reversed"]
# Binning one value costs about as much as all other work for ten, so large buffers are first reduced to this many
# cells: runs of pixels in a row, along which depth varies least.
_CELLS = 131_072
_MIXED = 1.05  # far/near above which a cell is split in two


class DepthBuffer(OneByOne):
    """The pixels of a depth buffer rendered with the camera of the view; row 0 is the top of the screen.

    Each pixel's centre is one receiver. Background pixels are not receivers.

    Args:
        depth: (H, W) or (H, W, 1); half precision is read as single.
        encoding: "linear", eye depth, with background at or beyond the far plane, infinite, 0 or negative; "standard",
            in [0, 1] with 0 at the near plane and background at 1; "reversed", in [0, 1] with 1 at the near plane and
            background at 0. The last two also work without a far plane (`Camera.far` inf).
        weights: what each visible pixel counts for in an L_P norm: (H, W), >= 0, such as `warpopt.edge_weights` makes;
            "uniform" (the default); or "depth", the eye depth. Norms inf are over all visible pixels, and the map holds
            all, whatever their weight. If all are 0, weights are eye depths, and the solution's outcome says so.
        lit: (H, W), which pixels the light reaches; others have the weight 0.

    Raises:
        ValueError: for a wrong shape, NaN, values outside the encoding's range, or a negative weight.

    Example:
        >>> import numpy as np, warpopt
        >>> depth = np.full((4, 6), 20.0)
        >>> depth[:2] = 0.0  # sky
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.4, aspect=1.5)
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0)), DepthBuffer(depth))
        >>> warpopt.Outcome(int(warpopt.optimal_warp(view).result)).name   # for this light, a wall is at one depth
        'flat'
    """

    any_projection: ClassVar[bool] = True
    one_at_a_time: ClassVar[bool] = True  # one pass uses all cores, and its cells take tens of megabytes

    depth: Float[Array, "H W"]
    encoding: Encoding = eqx.field(static=True)
    weights: Weights

    def __init__(
        self,
        depth: Numbers,
        encoding: Encoding = "linear",
        weights: Weighting | None = None,
        lit: Numbers | None = None,
    ):
        one_of("encoding", encoding, get_args(Encoding))
        (values,) = float_arrays(depth=depth)
        given = np.dtype(depth.dtype if isinstance(depth, jax.Array) else np.asarray(depth).dtype)
        if given.kind in "iu":  # a file's are refused too: they are a code or a length in another unit
            raise ValueError(f"depth: got integers ({given}), expected them scaled to floats (0.001 for millimetres)")
        depth = values
        if depth.ndim == 3 and depth.shape[2] == 1:
            depth = depth[..., 0]
        if jnp.finfo(depth.dtype).bits < 32:
            depth = depth.astype(jnp.float32)
        if depth.ndim != 2 or 0 in depth.shape:
            raise ValueError(f"depth: got shape {depth.shape}, expected (height, width)")
        if encoding == "linear":
            self.depth = checked("depth", depth, lambda d: d == d, "eye depths, not NaN")
        else:
            self.depth = checked("depth", depth, lambda d: (d >= 0) & (d <= 1), "numbers in [0, 1]")
        self.encoding = encoding
        self.weights = Weights(weights, lit, depth.shape)

    @compiled
    def eye_depth(self, camera: Camera) -> Float[Array, "H W"]:
        """Eye depth of each pixel; inf for background.

        Args:
            camera: whose planes encoded depths are of.
        """
        seen, z = self._decoded(self.depth, camera)
        return jnp.where(seen, z, jnp.inf)

    def between(self, camera: Camera, near: Float[Array, ""], far: Float[Array, ""]) -> tuple[Camera, Receivers]:
        """See `Receivers`."""
        # Encoded depths need the camera's own planes: decoded first, with what lies outside as background.
        z = self.eye_depth(camera)
        z = jnp.where((z >= near) & (z <= far), z, jnp.inf)
        return camera, assembled(DepthBuffer, depth=z, encoding="linear", weights=self.weights)

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        z = self.eye_depth(camera)
        return extent_of(z, jnp.isfinite(z))

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """See `Receivers`: every pixel that sees something."""
        points, seen = eye_points(self, camera)
        return points.reshape(-1, 3), seen.ravel().astype(points.dtype)

    def counted(self, camera: Camera, objective: Objective) -> Counted:
        """See `Receivers`."""
        points, seen = eye_points(self, camera)
        return self.weights.counted(points.reshape(-1, 3), camera, seen.ravel(), objective.kernel)

    def sketch(self, camera: Camera, objective: Objective) -> Receivers:
        """See `Receivers`: the pixels as points if they are few, else tiles of them, each in two parts by depth."""
        if self.depth.size <= EXACT:
            return self._points(camera)
        seen, z = self._decoded(self.depth, camera)
        weights = None if self.weights.uniform or objective.supremum else self.weights.of(z, seen)[0]
        return sketch_of_pixels(camera, *_slopes(self.depth, camera), z, seen, weights, objective)

    def _points(self, camera: Camera) -> PointReceivers:
        points, seen = (v.reshape(self.depth.size, -1) for v in eye_points(self, camera))
        points = jnp.where(seen, points, jnp.array([0.0, 0.0, -1.0], points.dtype))  # what is not seen is behind
        world = points @ camera.rotation + camera.position
        return assembled(PointReceivers, points=world, weights=jax.tree.map(jnp.ravel, self.weights))

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> BinnedProfile:
        """See `Receivers`."""
        return BinnedProfile(_weighted(self, camera, objective.supremum), frame, bins)

    def _decoded(self, value: Array, camera: Camera) -> tuple[Array, Array]:
        """(which pixels are not background, eye depths, in [near, far] for all)."""
        n, f = camera.near, camera.far
        if self.encoding == "linear":
            seen = (value > 0) & (value < f)  # excludes background for f = inf: inf < inf is False
            return seen, jnp.where(seen, larger(value, n), n)
        if camera.is_orthographic:  # depth buffers of parallel rays are linear in z
            seen, share = (value < 1, value) if self.encoding == "standard" else (value > 0, 1 - value)
            return seen, jnp.where(seen, n + (f - n) * share, n)
        # n / f is 0 without a far plane. Sums of positive terms: f - value (f - n) may round to 0 in a deep frustum.
        shallow = n / f
        if self.encoding == "standard":
            seen = value < 1
            value = jnp.where(seen, value, 0)
            return seen, n / (shallow * value + (1 - value))
        seen = value > 0
        value = jnp.where(seen, value, 1)
        return seen, n / (shallow * (1 - value) + value)

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`. A pass over cells for extents, another if there are silhouettes, and one for moments."""
        if camera.is_orthographic:
            return self._points(camera).footprint(camera, frame, objective)
        across, up = _slopes(self.depth, camera)
        # Values shared by rows are computed here: inside a sweep they would be recomputed for every pixel.
        slope_across, slope_up = frame.z_axis[0] * across, frame.z_axis[1] * up + frame.z_axis[2]
        rows = self.depth, slope_up

        def depths(row: tuple[Array, Array]) -> tuple[Array, Array, Array]:
            value, slope = row
            seen, z = self._decoded(value, camera)
            return seen, z, z * (slope_across + slope)

        cells = self._cells(rows, depths)
        start, end, near, far = cells.start, cells.end, cells.near, cells.far
        bounds = functools.partial(self._bounds, start, end, (across, up), frame)
        if wide():
            nearer, beyond = self._parts(rows, depths, near, far)
            parts = zip((near, far), (jnp.inf, -jnp.inf), nearer, beyond, strict=True)
            halves = [
                jnp.where(cells.mixed, jnp.stack([a, b]), jnp.stack([v, jnp.full_like(v, no)])) for v, no, a, b in parts
            ]
            groups = bounds(*halves)
        else:

            def split(groups: Groups) -> Groups:
                nearer, beyond = self._parts(rows, depths, near, far)
                return _union(bounds(*nearer), bounds(*beyond))

            groups = jax.lax.cond(cells.mixed, split, lambda groups: groups, bounds(near, far))
        footprint = from_groups(groups, camera.near)
        if objective.supremum:
            return footprint
        unit = jnp.where(footprint.empty, 1, cells.nearest)
        weights = normals = known = None
        if not self.weights.uniform:
            seen, z = self._decoded(self.depth, camera)
            weights, by_depth = self.weights.of(z, seen, cells.farthest)
            footprint = footprint.weighted_by_depth(by_depth)
            normals, known = self.weights.normals_for(objective.kernel), jnp.where(by_depth, 0, 1)

        def weight_of(seen: Array, z: Array, weight: Array | None) -> Array:
            return seen.astype(z.dtype) if weight is None else weight

        if objective.kernel is not None:
            lean, rise = frame.x_axis[0] * across, frame.x_axis[1] * up + frame.x_axis[2]

            def samples_of(row: Any) -> tuple[Array, Array, Array, Array, Array, Normal | None]:
                pixels, weight, rise, normal = row
                seen, z, d = depths(pixels)
                normal = None if normal is None else frame.across_edges(*(n * known for n in normal))
                return d, z * (lean + rise), jnp.where(seen, z, unit), weight_of(seen, z, weight), seen, normal

            return with_samples(footprint, (rows, weights, rise, normals), samples_of, unit, objective)

        def receivers_of(row: tuple[Any, Array | None]) -> tuple[Array, Array, Array]:
            pixels, weight = row
            seen, z, d = depths(pixels)
            return jnp.where(seen, d, start), unit / jnp.where(seen, z, unit), weight_of(seen, z, weight)

        return with_moments(footprint, (rows, weights), receivers_of, unit, objective)

    def _cells(self, rows, depths) -> "_Cells":
        """The cells, in one pass.

        On a CPU only z is reduced by cells, as that costs several times as much as reducing whole rows.
        """

        def of_cells(values: Array, seen: Array) -> tuple[Array, Array]:
            """(least, largest) of each cell of a row."""
            least, largest = (self._in_cells(jnp.where(seen, values, edge), edge) for edge in (jnp.inf, -jnp.inf))
            return least_of(least), largest_of(largest)

        def row_bounds(found: tuple[Array, Array], row: tuple[Array, Array]):
            seen, z, d = depths(row)
            least = jnp.where(seen & (d < found[0]), d, found[0])
            largest = jnp.where(seen & (d > found[1]), d, found[1])
            return (least, largest), of_cells(z, seen)

        def row_by_cells(row: tuple[Array, Array]):
            seen, z, d = depths(row)
            return of_cells(d, seen), of_cells(z, seen)

        if wide():  # all cells' extents are one kernel, the columns' would be three
            (least, largest), (near, far) = jax.vmap(row_by_cells)(rows)
        else:
            none = jnp.full(self.depth.shape[1], jnp.inf, self.depth.dtype)
            (least, largest), (near, far) = jax.lax.scan(row_bounds, (none, -none), rows)
        filled = jnp.isfinite(near)
        # A cell across a silhouette would combine near and far depths into a receiver that does not exist.
        across = jnp.where(filled, far - _MIXED * near, -jnp.inf)
        start, end, nearest, farthest, widest = least_of_each(least, -largest, near, -far, -across)
        start, end = jnp.where(jnp.isfinite(nearest), jnp.stack([start, -end]), 0)
        return _Cells(start, end, near, far, nearest, -farthest, widest < 0)

    def _parts(self, rows, depths, near: Array, far: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """(near, far) of each cell's pixels before and beyond the geometric mean of its depths."""
        there = jnp.isfinite(near)
        middle = jnp.sqrt(jnp.where(there, near, 1)) * jnp.sqrt(jnp.where(there, far, 1))

        def row_parts(_, row):
            row, middle = row
            seen, z, _ = depths(row)
            z, seen = self._in_cells(z, 1.0), self._in_cells(seen, False)
            before = z <= middle[:, None]
            nearer = jnp.where(seen & before, z, -jnp.inf).max(1)
            return None, (nearer, jnp.where(seen & ~before, z, jnp.inf).min(1))

        _, (nearer, beyond) = sweep(row_parts, None, (rows, jax.lax.stop_gradient(middle)))
        # `middle` may round to `near` or `far` where these are almost equal: both parts are non-empty.
        nearer = jnp.where(jnp.isfinite(nearer), nearer, near)
        return (near, jnp.where(there, nearer, -jnp.inf)), (beyond, jnp.where(jnp.isfinite(beyond), far, -jnp.inf))

    @property
    def _cell_size(self) -> int:
        return max(1, round(self.depth.size / _CELLS))

    def _in_cells(self, row: Array, fill) -> Array:
        """(cells, pixels of each) of a row."""
        return jnp.pad(row, (0, -len(row) % self._cell_size), constant_values=fill).reshape(-1, self._cell_size)

    def _bounds(self, start, end, slopes: tuple[Array, Array], frame: LightFrame, near: Array, far: Array) -> Groups:
        """The bounds of cells with these depths, from the slopes at their ends, in bins."""
        across, up = slopes
        there = jnp.isfinite(near)
        first = np.arange(0, len(across), self._cell_size)
        ends = across[first], across[np.minimum(first + self._cell_size, len(across)) - 1]
        # Empty cells bound nothing: least inf, largest -inf.
        nearest, farthest = jnp.where(there, near, 1), jnp.where(there, far, 1)

        def extents(axis: Array) -> tuple[Array, Array, Array, Array]:
            """(least, an attained least, an attained largest, largest) of axis . c."""
            one, other = (axis[0] * end + (axis[1] * up + axis[2])[:, None] for end in ends)
            low, high = jnp.where(one < other, one, other), jnp.where(one < other, other, one)
            return (
                low * jnp.where(low > 0, nearest, farthest), high * jnp.where(high > 0, nearest, farthest),
                low * jnp.where(low > 0, farthest, nearest), high * jnp.where(high > 0, farthest, nearest),
            )  # fmt: skip

        (d_least, _, _, d_largest), (x_least, x_low, x_high, x_largest), (h_least, _, _, h_largest) = (
            extents(axis) for axis in (frame.z_axis, frame.x_axis, frame.light)
        )
        d_least, d_largest = jnp.where(d_least > start, d_least, start), jnp.where(d_largest < end, d_largest, end)
        cells = Groups(d_least, d_largest, x_least, x_largest, h_least, h_largest, nearest, (x_low, x_high))
        share = (d_least - start) / jnp.where(end > start, end - start, 1)
        return merged(there, cells, bin_of(jnp.where(there, share, 0)), BINS)


class _Cells(NamedTuple):
    """Least and largest Z_w . c of all pixels, 0 if there are none; least and largest eye depth of each cell and of
    all, inf and -inf where empty; whether there is a silhouette."""

    start: Float[Array, ""]
    end: Float[Array, ""]
    near: Float[Array, "H C"]
    far: Float[Array, "H C"]
    nearest: Float[Array, ""]
    farthest: Float[Array, ""]
    mixed: Bool[Array, ""]


def _union(one: Groups, other: Groups) -> Groups:
    """Groups that contain both groups, index by index."""
    return jax.tree.map(lambda a, b, sign: jnp.where(sign * a < sign * b, a, b), one, other, SIGNS)


@compiled
def eye_points(buffer: DepthBuffer, camera: Camera) -> tuple[Float[Array, "H W 3"], Bool[Array, "H W"]]:
    """(the pixels' receivers in eye coordinates, which pixels have one)."""
    z = buffer.eye_depth(camera)
    seen = jnp.isfinite(z)
    z = jnp.where(seen, z, 1)
    across, up = _slopes(z, camera)
    size = camera.screen_depth(z)
    return jnp.stack([size * across, size * up[:, None], z], -1), seen


@functools.partial(jax.jit, static_argnames=("supremum",))
def _weighted(buffer: DepthBuffer, camera: Camera, supremum: bool) -> PointSet:
    points, seen = eye_points(buffer, camera)
    weights = seen.astype(points.dtype) if supremum else buffer.weights.of(camera.screen_depth(points[..., 2]), seen)[0]
    return PointSet(points.reshape(-1, 3), weights.ravel())


def _slopes(depth: Array, camera: Camera) -> tuple[Array, Array]:
    """(x/z of each column, y/z of each row) at the pixels' centres."""
    left, right, bottom, top = camera.window
    height, width = depth.shape
    columns, rows = ((np.arange(size) + 0.5) / size for size in (width, height))
    return left + (right - left) * columns.astype(depth.dtype), top - (top - bottom) * rows.astype(depth.dtype)

"""The best map of the depth itself, as a table: what the limit is attained by."""

import csv
import importlib.metadata
import io
import math
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._checks import instance
from ..receivers.footprint import Receivers
from ..receivers.groups import BINS
from ..receivers.view_frustum import WholeFrustum
from ..receivers.whole_frustum import unit_nodes
from ..solve.limit import limit, refuse_unknown
from ..solve.scene_limit import checked_frame, pieces_of
from ..theory.camera import Camera, DirectionalLight
from ..theory.error_norm import ErrorNorm, Metric
from ..theory.frustum import ViewFrustum
from ..theory.light_space import LightSpace, checked_theta
from .files import READERS, TableFileError, digest_of, encoded_fields, write_table

FORMAT = "warpopt.LimitMap 2"
_TEXT = ("norm", "measure", "version")
_NUMBERS = ("value", "start", "mu", "density", "near", "far", "theta")
_COLUMNS = ("delta", "s")


class LimitMap(eqx.Module):
    """s(delta): where the best monotone map puts each depth along Z_w; both run from 0 to 1. See `warpopt.limit`.

    E_p at eye depth z and delta = (Z_w . c - start) / mu is density mu / z over the slope ds/d delta there.

    Attributes:
        delta, s: (N,) knots; delta increases from 0 to 1, s does not decrease.
        value: the norm of the exact map, the limit. The straight pieces between the knots are within a few per cent of
            it in L-inf, and much less in L_P; of points and depth buffers, whose bins they are, they are exact.
        start, mu: of the receivers along Z_w, in world units from the eye.
        density: screen units per unit slope along the warp over texels along it; 1 / tan(half_fov) of a view frustum.
        near, far, theta: of the view and the light, as given; theta in radians.
        order: of the norm of E_p; inf for L-inf.
        measure: of the norm; "receivers" where each counts by its own weight.

    Example:
        >>> import warpopt
        >>> best = warpopt.limit_map(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 1.5707963)
        >>> round(best.value, 3), bool((np.diff(best.s) >= 0).all())   # log(f/n) / tan(phi)
        (7.976, True)
    """

    delta: Float[np.ndarray, " N"]
    s: Float[np.ndarray, " N"]
    value: float = eqx.field(static=True)
    start: float = eqx.field(static=True)
    mu: float = eqx.field(static=True)
    density: float = eqx.field(static=True)
    near: float = eqx.field(static=True)
    far: float = eqx.field(static=True)
    theta: float = eqx.field(static=True)
    order: float = eqx.field(static=True)
    measure: str = eqx.field(static=True)

    def __call__(self, delta: np.ndarray) -> np.ndarray:
        """s at any delta in [0, 1], by straight pieces."""
        return np.interp(delta, self.delta, self.s)

    def save(self, path: str | Path) -> None:
        """Write it as .npz, .csv or .json, by the path's ending: whole or not at all, equal files for equal maps.

        Raises:
            ValueError: another ending.
            OSError: the file cannot be written; an earlier one is then as it was.
        """
        write_table(path, _fields(self), _columns(self))

    def encoded(self, path: str | Path) -> bytes:
        """What `save` writes to the path; raises as it does for the ending."""
        return encoded_fields(_fields(self), _columns(self), Path(path))

    @staticmethod
    def load(path: str | Path) -> "LimitMap":
        """Read it back.

        Raises:
            TableFileError (a ValueError): a file that is missing, truncated, edited or foreign.
        """
        path = Path(path)
        read = {**READERS, ".csv": _from_csv}.get(path.suffix)
        if read is None:
            raise TableFileError(f"{path}: got the ending {path.suffix!r}, expected .npz, .csv or .json")
        try:
            fields = read(path.read_bytes())
        except OSError as error:
            raise TableFileError(f"{path}: cannot be read: {error.strerror}") from None
        except Exception as error:  # whatever a damaged archive, number or nesting makes its reader raise
            raise TableFileError(f"{path}: not a whole {path.suffix[1:]} map: {error}") from None
        return _checked(path, fields)


def _fields(best: LimitMap) -> dict:
    norm = {math.inf: "inf", 1.0: "l1", 2.0: "l2"}.get(best.order, repr(best.order))
    text = {"norm": norm, "measure": best.measure, "version": importlib.metadata.version("warpopt")}
    fields = {"format": FORMAT, **text, **{name: getattr(best, name) for name in _NUMBERS}}
    return {**fields, "digest": digest_of(fields, _columns(best))}


def _columns(best: LimitMap) -> dict[str, np.ndarray]:
    return {name: getattr(best, name) for name in _COLUMNS}


def _from_csv(content: bytes) -> dict:
    rows = list(csv.reader(io.StringIO(content.decode(), newline="")))
    fields: dict = {row[0][2:]: row[1] for row in rows if row and row[0].startswith("# ")}
    knots = np.array([[float(v) for v in row] for row in rows[rows.index(list(_COLUMNS)) + 1 :]])
    if knots.shape != (int(fields.pop("knots")), len(_COLUMNS)):
        raise ValueError(f"got {len(knots)} knots, expected as many as the file says")
    return fields | dict(zip(_COLUMNS, knots.T, strict=True))


def _checked(path: Path, fields: dict) -> LimitMap:
    if fields.get("format") != FORMAT:
        raise TableFileError(f"{path}: got format {fields.get('format')!r}, expected {FORMAT!r}")
    expected = {"format", "digest", *_TEXT, *_NUMBERS, *_COLUMNS}
    if fields.keys() != expected:
        raise TableFileError(f"{path}: got fields {sorted(fields)}, expected {sorted(expected)}")
    try:
        columns = {name: np.asarray(fields[name], np.float64) for name in _COLUMNS}
        numbers = {name: float(fields[name]) for name in _NUMBERS}
        norm, measure = str(fields["norm"]), str(fields["measure"])
        order = {"inf": math.inf, "l1": 1.0, "l2": 2.0}.get(norm) or float(norm)
    except (TypeError, ValueError, OverflowError):
        raise TableFileError(f"{path}: got a field that is no number, expected numbers") from None
    shapes = {column.shape for column in columns.values()}
    rising = len(shapes) == 1 and all(c.ndim == 1 and len(c) > 1 and (np.diff(c) >= 0).all() for c in columns.values())
    rising = rising and (np.diff(columns["delta"]) > 0).all()
    if not rising or any((c[0], c[-1]) != (0, 1) for c in columns.values()):
        raise TableFileError(f"{path}: got knots that do not run from 0 to 1, expected delta and s that both do")
    own = {"format": FORMAT} | {name: str(fields[name]) for name in _TEXT} | numbers
    if fields["digest"] != digest_of(own, columns):
        raise TableFileError(f"{path}: got contents that its digest does not fit, expected a map as it was written")
    return LimitMap(**columns, **numbers, order=order, measure=measure)


def limit_map(
    frustum: ViewFrustum, theta: float, norm: str | float = "inf", measure: str = "screen", knots: int = 96
) -> LimitMap:
    """The map that attains `warpopt.limit` of E_p, for one frustum and one light; in float64 whatever JAX's dtype is.

    Args:
        frustum, theta: one of each, theta in radians in [0, pi].
        norm, measure: as in `optimal_warp`.
        knots: at least so many on each of the three parts (rows growing, longest, shrinking).

    Raises:
        ValueError: bad arguments; the axis under a light along the view, which is at one depth.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> best = limit_map(frustum, 1.5707963267948966)   # the logarithm of z
        >>> round(float(best(9 / 99)), 4)   # z = 10
        0.5
    """
    instance("frustum", frustum, ViewFrustum)
    _check_knots(knots)
    error_norm = ErrorNorm.of(Metric(1.0, 0.0), norm, measure)
    refuse_unknown(error_norm)
    value, theta_in = limit(frustum, theta, "p", norm, measure), checked_theta(theta, frustum)
    if value.shape:
        raise ValueError(f"frustum, theta: got shape {value.shape}, expected one of each")
    if not value > 0:
        raise ValueError(f"theta: got {theta} with measure 'axis', expected receivers at more than one depth")
    space = LightSpace(frustum, theta_in)
    length, share = _knots(space, error_norm, knots)
    frustum_numbers = (float(v) for v in (frustum.near, frustum.far, theta_in))
    extent = (float(v) for v in (space.minimum_depth, space.mu, 1 / space.tan_phi))
    return LimitMap(*_running(length, share), float(value), *extent, *frustum_numbers, error_norm.order, measure)


def scene_limit_map(
    camera: Camera,
    light: DirectionalLight,
    receivers: Receivers | None = None,
    norm: str | float = "inf",
    *,
    bins: int = BINS,
    knots: int = 16,
    screen: tuple[int, int] | None = None,
    shadow_map: tuple[int, int] | None = None,
) -> LimitMap:
    """The map that attains `warpopt.scene_limit` of E_p over the receivers.

    Args:
        camera, light, receivers, norm, screen, shadow_map: as in `scene_warp`.
        bins: of points and depth buffers: the map is linear within each.
        knots: of bodies: for each stretch between the depths of two vertices.

    Raises:
        ValueError: as `scene_limit`; no receivers, or all at one depth.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5235987755982988)
        >>> best = scene_limit_map(camera, warpopt.DirectionalLight((0, -1, 0)))   # the logarithm of z
        >>> round(float(best(9 / 99)), 2)   # z = 10
        0.5
    """
    _check_knots(knots)
    receivers = WholeFrustum() if receivers is None else receivers
    measure = getattr(receivers, "measure", "receivers")
    error_norm = ErrorNorm.of(Metric(1.0, 0.0), norm, "screen")
    frame = checked_frame(camera, light, bins, screen, shadow_map)
    pieces = pieces_of(camera, frame, receivers, error_norm.order, bins, knots)
    if not pieces.value > 0:
        raise ValueError("receivers: got none, or all at one depth, expected receivers at more than one")
    numbers = (float(v) for v in (frame.density_p, camera.near, camera.far, frame.theta))
    start, mu = float(pieces.at[0]), float(pieces.at[-1] - pieces.at[0])
    knots_of = _running(np.diff(pieces.at), pieces.shares)
    return LimitMap(*knots_of, pieces.value, start, mu, *numbers, error_norm.order, measure)


def _check_knots(knots: int) -> None:
    if isinstance(knots, bool) or not isinstance(knots, int) or knots < 2:
        raise ValueError(f"knots: got {knots!r}, expected an integer >= 2")


def _running(length: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(delta, s) at the ends of pieces, delta rising: a piece within rounding of no length is its neighbour's."""
    delta, s = (np.concatenate([[0.0], np.minimum(np.cumsum(v) / v.sum(), 1.0)]) for v in (length, share))
    delta[-1] = s[-1] = 1.0
    tiny = 4 * np.finfo(float).eps
    kept = np.append((np.diff(delta) > tiny) & (delta[:-1] > tiny) & (delta[:-1] < 1 - tiny), True)
    kept[0] = True
    return delta[kept], s[kept]


def _knots(space: LightSpace, norm: ErrorNorm, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(extents in mu delta, shares of the map) of the pieces between knots, from delta = 0 on; lengths over near."""
    # notation: as in solve.limit; q such that rho = rho_max t^q leaves no root
    x, T2, a, a_minus, b = (
        float(v) for v in (space.depth_range, 2 * space.slope, space.a_plus, space.a_minus, space.b)
    )
    L, sup = math.log1p(x), norm.supremum
    order = norm.order * norm.metric.alpha
    t = np.linspace(0, 1, count + 1)
    if norm.measure == "axis":
        z = np.exp(L * t)
        s, T = float(space.sin_theta), T2 / 2
        ends = x * a_minus + T, s * x, T + x * T if a > 0 else T2 * (1 + x) - T - s * x - x * a_minus
        part = 0.0 if sup else 1 / (order + 1)
        inner = np.diff(np.log(z)) if sup else np.diff(z**part)
        pieces = [ends[0]], s * np.diff(z), [max(ends[2], 0.0)]
        return np.concatenate(pieces), np.concatenate([[0.0], inner, [0.0]])
    cut = T2 > x * a
    longest = L if cut else math.log1p(T2 / a)
    q, Q = (1.0, 0.0) if sup else (order + 1, norm.depth_exponent)
    root = 0.0 if sup else 1 / q

    def weight(rho, shortest):  # W^root, up to a factor, of the row from log depth `shortest` on
        if sup:
            return np.exp(-shortest)
        y = Q * rho
        small = np.abs(y) < 1e-8
        mean = np.where(small, 1 - y / 2, -np.expm1(-y) / np.where(small, 1, y))
        return (rho * np.exp(-Q * shortest) * mean) ** root

    def pieces(slope, log_z, shortest, ends, exponent):  # depths slope e^log_z, by a parameter v = ends t^exponent
        edges = ends * t**exponent
        nodes, weights = unit_nodes(12, np.float64)
        at = t[:-1, None] + np.diff(t)[:, None] * nodes
        v = ends * at**exponent
        speed = ends * exponent * at ** (exponent - 1)  # dv/dt
        density = slope * np.exp(log_z(v)) * weight(*shortest(v)) * speed
        return slope * np.abs(np.diff(np.exp(log_z(edges)))), (density * weights).sum(1) * np.diff(t)

    at_far = pieces(1.0, lambda v: L - v, lambda v: (v, L - v), longest, q)
    if a > 0:
        first = pieces(a, lambda v: v, lambda v: (v, 0 * v), longest, q)
    else:
        first = tuple(a_minus * v for v in at_far)
    last = tuple(b * v[::-1] for v in at_far)
    if cut:
        even = np.full(count, (T2 - x * a) / count)
        middle = even, even * weight(np.full(count, longest), 0.0)
    else:
        ell = math.log1p((x * a - T2) / b)
        middle = pieces(b, lambda v: v, lambda v: (np.full_like(v, longest), v), ell, 1.0)
    return tuple(np.concatenate(parts) for parts in zip(first, middle, last, strict=True))

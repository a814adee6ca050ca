"""The best map of the depth as a table: the map that attains the lower bound."""

import importlib.metadata
from pathlib import Path

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float
from numpy.typing import NDArray

from .._checks import float_arrays
from .._data_files import DataFileError, digest_of, encoded, path_of, read_fields, write_whole
from ..objective import norm_name, order_of

FORMAT = "warpopt.LimitMap 2"
_TEXT = ("norm", "measure", "version")
_NUMBERS = ("value", "start", "mu", "density", "near", "far", "theta")
_COLUMNS = ("delta", "s")


class BoundMap(eqx.Module):
    """s(delta): the best monotone map of the depth along Z_w; both run from 0 to 1. See `warpopt.lower_bound`.

    E_p at eye depth z and delta = (Z_w . c - start) / mu is density mu / z over the slope ds/d delta there.

    Attributes:
        delta, s: (N,) knots; delta increases from 0 to 1, s does not decrease.
        value: the norm of the exact map, the lower bound. Linear interpolation between the knots is within a few per
            cent of it in L-inf, much closer in L_P, and exact for points and depth buffers, as the knots are the bins.
        start, mu: of the receivers along Z_w, in world units from the eye.
        density: screen units per unit slope along the warp over texels along it; 1 / tan(half_fov) of a view frustum.
        near, far, theta: of the view and the light, as given; theta in radians.
        order: of the norm of E_p; inf for L-inf.
        measure: of the norm; "receivers" if weighted by the receivers' weights.

    Example:
        >>> import warpopt
        >>> view = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 1.5707963)
        >>> best = warpopt.lower_bound_map(view)
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

    def __call__(self, delta: ArrayLike) -> NDArray | np.floating:
        """s at any delta in [0, 1], by linear interpolation.

        Args:
            delta: of any shape; clamped to [0, 1].

        Returns:
            s, of the same shape.
        """
        (delta,) = float_arrays(delta=delta)
        return np.interp(np.asarray(delta, float), self.delta, self.s)

    def save(self, path: str | Path) -> None:
        """Write it as .npz, .csv or .json, by the file extension; atomic, and equal maps give equal files.

        Args:
            path: of the file.

        Raises:
            ValueError: another ending.
            OSError: the file cannot be written; an existing one is left unchanged.
        """
        write_whole(path, _fields(self), _columns(self))

    def encoded(self, path: str | Path) -> bytes:
        """The bytes that `save` writes to the path; raises the same for the extension.

        Args:
            path: of which the extension counts.
        """
        return encoded(path, _fields(self), _columns(self))

    @staticmethod
    def load(path: str | Path) -> "BoundMap":
        """Read a map from a file.

        Args:
            path: of a file that `save` wrote.

        Raises:
            DataFileError (a ValueError): a file that is missing, truncated, edited or of another format.
        """
        path = path_of(path)
        fields = read_fields(path, "map", _COLUMNS)
        try:
            return _checked(fields)
        except ValueError as error:
            raise DataFileError(f"{path}: {error}") from None


def _fields(best: BoundMap) -> dict:
    text = {"norm": norm_name(best.order), "measure": best.measure, "version": importlib.metadata.version("warpopt")}
    fields = {"format": FORMAT, **text, **{name: getattr(best, name) for name in _NUMBERS}}
    return {**fields, "digest": digest_of(fields, _columns(best))}


def _columns(best: BoundMap) -> dict[str, np.ndarray]:
    return {name: getattr(best, name) for name in _COLUMNS}


def _checked(fields: dict) -> BoundMap:
    """The map of a file's fields; a ValueError names the defect."""
    if fields.get("format") != FORMAT:
        raise ValueError(f"got format {fields.get('format')!r}, expected {FORMAT!r}")
    expected = {"format", "digest", *_TEXT, *_NUMBERS, *_COLUMNS}
    if fields.keys() != expected:
        raise ValueError(f"got fields {sorted(fields)}, expected {sorted(expected)}")
    try:
        columns = {name: np.asarray(fields[name], np.float64) for name in _COLUMNS}
        numbers = {name: float(fields[name]) for name in _NUMBERS}
        order, measure = order_of(str(fields["norm"])), str(fields["measure"])
    except (TypeError, ValueError, OverflowError):
        raise ValueError("got a field that is not a number, expected numbers") from None
    shapes = {column.shape for column in columns.values()}
    rising = len(shapes) == 1 and all(c.ndim == 1 and len(c) > 1 and (np.diff(c) >= 0).all() for c in columns.values())
    rising = rising and (np.diff(columns["delta"]) > 0).all()
    if not rising or any((c[0], c[-1]) != (0, 1) for c in columns.values()):
        raise ValueError("got knots that do not run from 0 to 1, expected delta and s that both do")
    own = {"format": FORMAT} | {name: str(fields[name]) for name in _TEXT} | numbers
    if fields["digest"] != digest_of(own, columns):
        raise ValueError("got contents that do not match the digest, expected an unedited map")
    return BoundMap(columns["delta"], columns["s"], **numbers, order=order, measure=measure)


def running(lengths: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(delta, s) at the ends of stretches, delta increasing; stretches of length 0 up to rounding join a neighbour."""
    delta, s = (np.concatenate([[0.0], np.minimum(np.cumsum(v) / v.sum(), 1.0)]) for v in (lengths, shares))
    delta[-1] = s[-1] = 1.0
    tiny = 4 * np.finfo(float).eps
    kept = np.append((np.diff(delta) > tiny) & (delta[:-1] > tiny) & (delta[:-1] < 1 - tiny), True)
    kept[0] = True
    return delta[kept], s[kept]

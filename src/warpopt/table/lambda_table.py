"""lambda(theta) as a small table with a promised accuracy."""

import functools
import math
from pathlib import Path
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import Numbers, checked, float_arrays, instance
from .._words import one_of
from ..objective import Objective
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from ..views import FrustumView
from . import files
from .lookup import Rows, lookup

Outside = Literal["clamp", "error"]


class LambdaTable(eqx.Module):
    """The optimal warp for every light direction, optionally over ranges of far/near and of the field of view.

    Polylines of eta in theta, whose knots move with far/near; see `lookup.lookup`. Knots may lie above eta = 1: a
    lookup clamps at eta = 1 (no warp), so the onset of no warp needs no knot. Directions beyond pi/2 are mirrored, as
    the frustum is symmetric. Built by `warpopt.build_table`; the numbers are float32.

    Attributes:
        depth_ratio: (R,) far/near of the rows, increasing; one entry if far/near is fixed.
        half_fov: (H,) half fields of view, radians, increasing; one entry likewise.
        theta: (R, H, N) knots, radians, not decreasing along N.
        knot_eta: (R, H, N) eta at the knots.
        objective: what is minimised.
        max_slope: requested bound on |d log(eta) / d theta|; inf for none.
        promised: bound on the regret, value/minimum - 1, over the table's ranges.
        achieved: the largest regret found.
        worst: the (theta, far/near, half_fov) at which it was found.
        version: of warpopt.

    Example:
        >>> import warpopt
        >>> table = warpopt.build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> table.theta.shape[-1] <= 6 and abs(float(table.eta(1.5707963)) / 0.1 - 1) < 0.01
        True
    """

    depth_ratio: Float[np.ndarray, " R"]
    half_fov: Float[np.ndarray, " H"]
    theta: Float[np.ndarray, "R H N"]
    knot_eta: Float[np.ndarray, "R H N"]
    objective: Objective = eqx.field(static=True)
    max_slope: float = eqx.field(static=True)
    promised: float = eqx.field(static=True)
    achieved: float = eqx.field(static=True)
    worst: tuple[float, float, float] = eqx.field(static=True)
    version: str = eqx.field(static=True)

    @property
    def rows(self) -> Rows:
        """The rows that a lookup reads."""
        return Rows(self.depth_ratio, self.half_fov, self.theta, self.knot_eta)

    @property
    def size(self) -> int:
        """Size in bytes of the numbers in exported code, four bytes each."""
        return 4 * self.rows.size

    def eta(
        self,
        theta: Numbers,
        depth_ratio: Numbers | None = None,
        half_fov: Numbers | None = None,
        *,
        outside: Outside = "clamp",
    ) -> Float[Array, "..."]:
        """eta at any theta, in JAX: works under jit, vmap and grad (at a knot: the slope of the piece that ends there).

        Args:
            theta: radians, any shape.
            depth_ratio, half_fov: far/near and half the field of view, of shapes that broadcast; required for an axis
                with several rows. With one row they have no effect, except that "error" refuses values other than the
                row's.
            outside: "clamp": inputs beyond the first or last knot (after mirroring) or row are clamped, and NaN gives
                eta = 1, as in the exported code; "error": both, and theta outside [0, pi], are refused (under jit at
                run time).

        Returns:
            eta, of the joint shape.

        Raises:
            ValueError: see `outside`; a missing argument.
        """
        given = self._given(outside, depth_ratio=depth_ratio, half_fov=half_fov)
        return self._looked_up(float_arrays(theta=theta, **given), outside, jnp)

    def eta_numpy(
        self,
        theta: Numbers,
        depth_ratio: Numbers | None = None,
        half_fov: Numbers | None = None,
        *,
        outside: Outside = "clamp",
    ) -> np.ndarray:
        """`eta` in plain NumPy, in theta's precision, with the same operations as the exported code.

        Args:
            theta, depth_ratio, half_fov, outside: as for `eta`.

        Returns:
            eta, of the joint shape.

        Raises:
            ValueError: as `eta`.
        """
        float_arrays(theta=theta)  # for its words
        theta = np.asarray(theta)
        dtype = theta.dtype if theta.dtype == np.float32 else np.dtype(np.float64)
        given = self._given(outside, depth_ratio=depth_ratio, half_fov=half_fov)
        return self._looked_up([np.asarray(v, dtype) for v in (theta, *given.values())], outside, np)

    def warp(self, frustum: ViewFrustum, theta: Numbers, *, outside: Outside = "clamp") -> Warp:
        """The table's warp for a frustum (`lam` in its units).

        Its `promised` says where the table keeps its promise: not where theta, far/near or the field of view was
        clamped.

        Args:
            frustum: of any shape.
            theta: radians in [0, pi], of a shape that broadcasts.
            outside: as for `eta`.

        Returns:
            A `Warp` of the joint shape.

        Raises:
            ValueError: theta outside [0, pi]; as `eta`; a frustum whose far/near or field of view differs from the
                fixed one of the table.
        """
        instance("frustum", frustum, ViewFrustum)
        ratio, half_fov = frustum.depth_ratio, frustum.half_fov
        self._check_single(depth_ratio=ratio, half_fov=half_fov)
        view = FrustumView(frustum, theta)
        eta = self.eta(theta, ratio, half_fov, outside=outside)
        promised = jnp.ones((), bool)
        for name, value in (("theta", view.theta), ("depth_ratio", ratio), ("half_fov", half_fov)):
            promised = promised & self._within(name, value)
        return Warp(eta, 1 - eta, view.start, view.mu, jnp.ones((), bool), promised)

    def save(self, path: str | Path) -> None:
        """Write it as .npz, .csv or .json, by the file extension; atomic, and equal tables give equal files.

        Args:
            path: of the file.

        Raises:
            ValueError: another ending.
            OSError: the file cannot be written; an existing one is left unchanged.
        """
        files.save(self, path)

    def encoded(self, path: str | Path) -> bytes:
        """The bytes that `save` writes to the path; raises the same for the extension.

        Args:
            path: of which the extension counts.
        """
        return files.encoded_table(self, path)

    @classmethod
    def load(cls, path: str | Path) -> "LambdaTable":
        """Read a table from a file.

        Args:
            path: of a file that `save` wrote.

        Raises:
            DataFileError (a ValueError): a file that is missing, truncated, edited or of another format.
        """
        return files.load(path, cls)

    def _check_single(self, **values: Numbers | None) -> None:
        """Refuse values that differ from the single row's."""
        for name, value in values.items():
            axis = getattr(self, name)
            if len(axis) > 1 or value is None:
                continue
            (value,) = float_arrays(**{name: value})
            own, tolerance = float(axis[0]), 16 * float(jnp.finfo(value.dtype).eps)
            checked(name, value, lambda v, o=own, t=tolerance: abs(v / o - 1) <= t, f"the table's {own:.9g}")

    def _ends(self, name: str) -> tuple[float, float]:
        """The least and the largest value of an axis; of theta, of the knots, which all rows share."""
        axis = self.theta[0, 0] if name == "theta" else getattr(self, name)
        return float(axis[0]), float(axis[-1])

    def _within(self, name: str, value):
        """Where a value lies within the axis, up to rounding of the mirroring and of the axis; a single row's is so."""
        low, high = self._ends(name)
        slack = 4 * float(np.finfo(np.float32).eps)  # a table's axes are kept in single precision, like its rows
        if name == "theta":
            folded = math.pi / 2 - abs(value - math.pi / 2)
            return (folded >= low - slack) & (folded <= high + slack)
        return (value >= low * (1 - slack)) & (value <= high * (1 + slack)) if low < high else value == value

    def _given(self, outside: Outside, **values: Numbers | None) -> dict[str, Numbers]:
        """The axes' values, without those of axes that the table does not have."""
        one_of("outside", outside, get_args(Outside))
        if outside == "error":
            self._check_single(**values)
        asked = {}
        for name, value in values.items():
            rows = len(getattr(self, name))
            if rows > 1 and value is None:
                raise ValueError(f"{name}: got none, expected values: the table has {rows} rows")
            if rows > 1:
                asked[name] = value
        return asked

    def _looked_up(self, values: list, outside: Outside, xp):
        theta, *others = values
        names = [name for name in ("depth_ratio", "half_fov") if len(getattr(self, name)) > 1]
        if outside == "error":
            low, high = self._ends("theta")
            words = f"radians in [{low:.6g}, {high:.6g}], or as far from pi"
            theta = checked("theta", theta, functools.partial(self._within, "theta"), words)
            for i, name in enumerate(names):
                low, high = self._ends(name)
                words = f"a number in [{low:.6g}, {high:.6g}]"
                others[i] = checked(name, others[i], functools.partial(self._within, name), words)
        by_name = dict(zip(names, others, strict=True))
        read = _compiled_lookup if xp is jnp else functools.partial(lookup, xp=np)
        return read(theta, by_name.get("depth_ratio"), by_name.get("half_fov"), self.rows)


# Compiled as a whole: op by op, each of its fifty operations is a compilation for each new shape.
@jax.jit
def _compiled_lookup(theta: Array, depth_ratio: Array | None, half_fov: Array | None, rows: Rows) -> Array:
    return lookup(theta, depth_ratio, half_fov, rows, jnp)

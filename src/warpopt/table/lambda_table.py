"""lambda(theta) as a small table with a promise."""

from pathlib import Path
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._checks import checked, float_arrays
from ..theory.frustum import ViewFrustum
from ..theory.light_space import LightSpace
from ..theory.warp import Warp

Outside = Literal["clamp", "error"]


class LambdaTable(eqx.Module):
    """The optimal warp of one view frustum's shape for every light direction, as a polyline of log(eta) in theta.

    Knots may stand above log(eta) = 0: a look-up ends at eta = 1, no warp, so that the onset of no warp needs no knot.
    Directions beyond pi/2 are folded, as the frustum is symmetric. Made by `warpopt.build_table`.

    Attributes:
        theta: (N,) knots, radians, increasing.
        log_eta: (N,) heights.
        depth_ratio, half_fov: the frustum's far/near and half field of view.
        metric, norm, measure: what is minimised.
        promised: the regret, value/minimum - 1, that no direction was to exceed, and
        achieved: the largest found between all knots, at
        worst_theta: this direction.
        version: of warpopt.
    """

    theta: Float[np.ndarray, " N"]
    log_eta: Float[np.ndarray, " N"]
    depth_ratio: float = eqx.field(static=True)
    half_fov: float = eqx.field(static=True)
    metric: str = eqx.field(static=True)
    norm: str = eqx.field(static=True)
    measure: str = eqx.field(static=True)
    promised: float = eqx.field(static=True)
    achieved: float = eqx.field(static=True)
    worst_theta: float = eqx.field(static=True)
    version: str = eqx.field(static=True)

    def eta(self, theta: ArrayLike, outside: Outside = "clamp") -> Float[Array, "..."]:
        """eta at any theta, by JAX: under jit, vmap and grad (the slope of the piece that ends at a knot).

        Args:
            theta: radians, any shape.
            outside: "clamp": beyond the first or last knot (folded) its value, and eta = 1 for NaN, as the exported
                code does; "error": both, and theta outside [0, pi], are refused.

        Raises:
            ValueError: see `outside`.
        """
        (theta,) = float_arrays(theta=theta)
        return look_up(self._checked(theta, outside), self.theta, self.log_eta, jnp)

    def eta_numpy(self, theta: ArrayLike, outside: Outside = "clamp") -> np.ndarray:
        """`eta` in plain NumPy, in theta's precision, operation by operation what the exported code does."""
        theta = np.asarray(theta)
        theta = theta if theta.dtype == np.float32 else theta.astype(np.float64)
        return look_up(self._checked(theta, outside), self.theta, self.log_eta, np)

    def warp(self, frustum: ViewFrustum, theta: ArrayLike, outside: Outside = "clamp") -> Warp:
        """The table's warp for a frustum of this table's shape (`lam` in its units).

        Raises:
            ValueError: as `eta`, or for a frustum of another far/near or field of view.
        """
        for name, value, expected in (
            ("far/near", frustum.depth_ratio, self.depth_ratio), ("half_fov", frustum.half_fov, self.half_fov)
        ):  # fmt: skip
            tolerance = 16 * float(jnp.finfo(frustum.near.dtype).eps)
            checked(name, value, lambda v, e=expected, t=tolerance: abs(v / e - 1) <= t, f"the table's {expected}")
        eta = self.eta(theta, outside)
        mu = LightSpace(frustum, jnp.asarray(theta, frustum.near.dtype)).mu
        return Warp(eta, 1 - eta, mu, jnp.ones((), bool))

    def save(self, path: str | Path) -> None:
        """Write it as .npz, .csv or .json; see `warpopt.table.files.save`."""
        from .files import save

        save(self, path)

    @staticmethod
    def load(path: str | Path) -> "LambdaTable":
        """Read it back; see `warpopt.table.files.load`.

        Raises:
            TableFileError (a ValueError): a file that is missing, truncated, edited or foreign.
        """
        from .files import load

        return load(path)

    def _checked(self, theta, outside: Outside):
        if outside not in ("clamp", "error"):
            raise ValueError(f"outside: got {outside!r}, expected 'clamp' or 'error'")
        if outside == "error":
            first, last = float(self.theta[0]), float(self.theta[-1])
            slack = 4 * float(np.finfo(theta.dtype).eps)  # of the fold

            def within(v):
                folded = np.pi / 2 - abs(v - np.pi / 2)
                return (folded >= first - slack) & (folded <= last + slack)

            expected = f"radians in [{first:.6g}, {last:.6g}], or as far from pi"
            theta = checked("theta", theta, within, expected)
        return theta


def look_up(theta, knots: np.ndarray, heights: np.ndarray, xp):
    """exp(min(y, 0)) of the polyline's height y; the one definition that NumPy, JAX and the exports share."""
    dtype = theta.dtype
    knots, heights = knots.astype(dtype), heights.astype(dtype)
    pi, half = np.asarray(np.pi, dtype), np.asarray(np.pi / 2, dtype)
    folded = xp.where(theta > half, pi - theta, theta)
    # The piece whose end is the first knot not before theta: a sum of comparisons, as short tables are searched.
    piece = sum((folded > knot).astype(np.int32) for knot in knots[1:-1])
    start, end = xp.asarray(knots)[piece], xp.asarray(knots)[piece + 1]
    low, high = xp.asarray(heights)[piece], xp.asarray(heights)[piece + 1]
    share = (folded - start) / (end - start)
    share = xp.where(share > 0, xp.where(share < 1, share, 1), 0).astype(dtype)
    height = low + share * (high - low)
    eta = xp.exp(xp.where(height < 0, height, 0))
    return xp.where(xp.isnan(theta), 1, eta).astype(dtype)

"""What each receiver of a set counts for in a mean. Everything seen must fit into the map, whatever its weight."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._checks import Numbers, checked, float_arrays, shown
from ...theory.camera import Camera
from ..samples import Counted

NAMED = ("uniform", "depth")


class EdgeWeights(eqx.Module):
    """Weights of receivers beside shadow edges, with the edges' directions; `warpopt.edge_weights` makes them.

    As `weights=` of a `DepthBuffer` or `PointReceivers`, the mean of "band" is over edges of these directions; with the
    array `weights` alone, over all directions.

    Args:
        weights: (H, W) or (N,), one for each receiver, >= 0.
        normals: (H, W, 2) or (N, 2), perpendicular to the edge beside each on the screen: (right, up) in pixels, of any
            length (kept as unit vectors); n and -n are one. 0 where the direction is unknown: all are averaged there.

    Attributes:
        share: the mean of the weights: the fraction of the screen that edges cover. 0: no edge is known, and receivers
            fall back on weights by depth, which their solutions report as `Outcome.depth_weighted`.

    Raises:
        ValueError: other shapes, a negative weight, NaN or infinity.

    Example:
        >>> EdgeWeights([1.0, 0.0], [[0.0, 1.0], [0.0, 0.0]]).share   # the first of two points, beside a level edge
        Array(0.5, dtype=float64)
    """

    weights: Float[Array, "..."]
    normals: Float[Array, "... 2"]

    def __init__(self, weights: Numbers, normals: Numbers):
        weights, normals = float_arrays(weights=weights, normals=normals)
        if normals.shape != (*weights.shape, 2):
            raise ValueError(
                f"normals: got shape {normals.shape}, expected {(*weights.shape, 2)}, two numbers for each weight"
            )
        self.weights = checked("weights", weights, *_POSITIVE)
        normals = checked("normals", normals, lambda n: abs(n) < np.inf, "finite numbers")
        # Divided by the larger first: squares stay in range for normals of any size.
        largest = jnp.abs(normals).max(-1, keepdims=True)
        normals = normals / jnp.where(largest > 0, largest, 1)
        self.normals = normals / jnp.sqrt(jnp.where(largest > 0, (normals * normals).sum(-1, keepdims=True), 1))

    @property
    def share(self) -> Float[Array, ""]:
        return self.weights.mean()


Weighting = Numbers | str | EdgeWeights
"""What says how much a receiver counts: one number for each, or "uniform" or "depth", or a shadow edge."""

_POSITIVE = (lambda w: (w >= 0) & (w < np.inf), "finite numbers >= 0")


class Weights(eqx.Module):
    """Weights of receivers in a mean.

    Args:
        weights: an array of the given shape, >= 0; `EdgeWeights`; "uniform"; or "depth", the eye depth z, which stands
            for shadow edges where none are known: they crowd in the distance, though not under parallel rays, where all
            count alike. None means "uniform".
        lit: which receivers the light reaches, of the same shape; others have the weight 0. None means all.
        shape: of the set of receivers.

    Raises:
        ValueError: another word or shape, a negative weight, NaN or infinity; a mask of anything but booleans, 0 and 1.
    """

    values: Float[Array, "..."] | None
    lit: Bool[Array, "..."] | None
    normals: tuple[Float[Array, "..."], Float[Array, "..."]] | None
    by_depth: bool = eqx.field(static=True)
    shape: tuple[int, ...] = eqx.field(static=True)

    def __init__(self, weights: Weighting | None, lit: Numbers | None, shape: tuple[int, ...]):
        if isinstance(weights, str) and weights not in NAMED:
            expected = ", ".join(map(repr, NAMED))
            raise ValueError(f"weights: got {shown(weights)}, expected {expected} or an array of shape {shape}")
        named = weights is None or isinstance(weights, str)
        self.normals = None
        if isinstance(weights, EdgeWeights):
            # Apart, each without gaps in memory: a sweep over both at once takes half as long again.
            self.normals = weights.normals[..., 0], weights.normals[..., 1]
            weights = weights.weights
        self.shape = shape
        self.values = None if named else _weights(weights, shape)
        self.by_depth = named and weights == "depth"
        self.lit = None if lit is None else mask_of("lit", lit, shape)

    def instead(self, weights: Weighting) -> "Weights":
        """Others for the same receivers, of which the same are lit. Raises as the class."""
        made = Weights(weights, None, self.shape)
        return eqx.tree_at(lambda w: w.lit, made, self.lit, is_leaf=lambda leaf: leaf is None)

    @property
    def uniform(self) -> bool:
        return self.values is None and self.lit is None and not self.by_depth

    def of(
        self, z: Float[Array, "..."], seen: Bool[Array, "..."], farthest: Float[Array, ""] | None = None
    ) -> tuple[Float[Array, "..."], Bool[Array, ""]]:
        """(weights, 0 for what is not seen; whether all would be 0, also because nothing is seen: then they are z).

        Args:
            z: eye depths; anything finite for what is not seen.
            seen: which receivers are visible.
            farthest: the largest depth of these, if it is known; -inf if there are none.
        """
        counted = seen if self.lit is None else seen & self.lit
        base = z if self.by_depth else jnp.ones_like(z) if self.values is None else self.values.astype(z.dtype)
        # Only their ratios matter: products and powers stay in range for weights of any size.
        if farthest is not None and self.by_depth and self.lit is None:
            largest = jax.lax.stop_gradient(jnp.where(farthest > 0, farthest, 0))
        else:
            largest = jax.lax.stop_gradient(jnp.where(counted, base, 0).max())
        # Near the end of the range the reciprocal that XLA multiplies by would be below the normal numbers, hence 0.
        fit = jnp.where(largest > 1, 1 / 16, 1).astype(z.dtype)
        weights = jnp.where(counted, base * fit, 0) / jnp.where(largest > 0, largest * fit, 1)
        none = largest <= 0
        instead = seen if self.lit is None else jnp.where(counted.any(), counted, seen)
        return jnp.where(none, jnp.where(instead, z, 0), weights), none

    def normals_for(self, kernel: str | None) -> tuple[Float[Array, "..."], Float[Array, "..."]] | None:
        """The normals' components for a kernel that depends on them; None for all but "band", and if there are none."""
        return self.normals if kernel == "band" else None

    def counted(
        self, points: Float[Array, "N 3"], camera: Camera, seen: Bool[Array, " N"], kernel: str | None
    ) -> Counted:
        """Points in eye coordinates, one for each weight, with the normals that the kernel depends on."""
        flat = jax.tree.map(jnp.ravel, self)
        weights, by_depth = flat.of(camera.screen_depth(jnp.where(seen, points[:, 2], 1)), seen)
        normals = flat.normals_for(kernel)
        if normals is not None:  # weights by depth stand for edges of all directions
            normals = jnp.where(by_depth, 0, normals[0]), jnp.where(by_depth, 0, normals[1])
        return Counted(points, weights, normals)

    def of_groups(self, z: Float[Array, "K N"], seen: Bool[Array, " K"]) -> tuple[Float[Array, "K N"], Bool[Array, ""]]:
        """`of`, where each weight is that of a group of receivers with the eye depths of a row of z."""
        each = self if self.values is None else eqx.tree_at(lambda w: w.values, self, self.values[:, None])
        return each.of(z, seen[:, None])


def _weights(weights: Any, shape: tuple[int, ...]) -> Array:
    kind = jnp.result_type(weights if hasattr(weights, "dtype") else np.asarray(weights))
    (weights,) = float_arrays(weights=jnp.asarray(weights, float) if kind == np.dtype(bool) else weights)
    if weights.shape != shape:
        raise ValueError(f"weights: got shape {weights.shape}, expected {shape}, one for each receiver")
    return checked("weights", weights, *_POSITIVE)


def mask_of(name: str, mask: Any, shape: tuple[int, ...] | None) -> Bool[Array, "..."]:
    """A mask as booleans.

    Raises:
        ValueError: another shape, or values that are neither booleans nor 0 and 1.
    """
    boolean = jnp.result_type(mask if hasattr(mask, "dtype") else np.asarray(mask)) == np.dtype(bool)
    (values,) = float_arrays(**{name: jnp.asarray(mask, float) if boolean else mask})
    if shape is not None and values.shape != shape:
        raise ValueError(f"{name}: got shape {values.shape}, expected {shape}")
    return checked(name, values, lambda v: (v == 0) | (v == 1), "true or false, or 0 and 1") == 1

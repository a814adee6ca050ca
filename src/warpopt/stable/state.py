"""What a stable window remembers from frame to frame."""

import json
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from .._words import shown
from .pencil import Pencil

_VERSION = 1


class WindowState(eqx.Module):
    """A stable window between two frames; `StableWindow.start` makes the first. A pytree of less than 1 KB.

    Attributes:
        pencil: the warp, frozen when the window was last fitted, or moved on since by a whole map.
        plane: (4,) the anchor plane, on which texels stay where they are under a light that turns: plane . (p - origin,
            1) = 0, of a unit normal.
        fitted_light, light: (3,) world unit vectors, when the window was fitted, and in the last frame.
        reach: the largest A that the map may have at its far end, where the horizon is near.
        offset: whole texels along (t, s) by which the map lies off the pencil's.
        scrolled: the same since the window was fitted.
        texels: along (t, s).
        depth: level, least and largest of the map's depth: (light . (p - origin) - level)/A spans the last two.
        eye: (3,) the last frame's, from the pencil's origin.
        loss: as last computed.
        fitted: whether there is a map.
        missed: frames in a row without receivers.
        unchecked: frames since the loss was computed.
        margin: that the map was fitted with.
        age: frames since then.
        frames, refits: so far; a first fit is no refit.
        settings: a checksum of the window's.

    Example:
        >>> import warpopt
        >>> state = warpopt.StableWindow().start()
        >>> bool(state.fitted), len(state.to_json()) < 1024
        (False, True)
    """

    pencil: Pencil
    plane: Float[Array, "4"]
    fitted_light: Float[Array, "3"]
    light: Float[Array, "3"]
    reach: Float[Array, ""]
    offset: Int[Array, "2"]
    scrolled: Int[Array, "2"]
    texels: Int[Array, "2"]
    depth: Float[Array, "3"]
    eye: Float[Array, "3"]
    loss: Float[Array, ""]
    fitted: Bool[Array, ""]
    missed: Int[Array, ""]
    unchecked: Int[Array, ""]
    margin: Float[Array, ""]
    age: Int[Array, ""]
    frames: Int[Array, ""]
    refits: Int[Array, ""]
    settings: UInt32[Array, ""]

    @classmethod
    def empty(cls, texels: tuple[int, int], settings: int, dtype: Any = float) -> "WindowState":
        """A window that has seen nothing.

        Args:
            texels: of the map along (t, s).
            settings: `StableWindow.checksum`.
            dtype: of its numbers.
        """
        dtype = jnp.zeros(0, dtype).dtype
        none, number = jnp.zeros(3, dtype), jnp.zeros((), jnp.int32)
        row, one = jnp.zeros(4, dtype), jnp.ones((), dtype)
        pencil = Pencil(none, row.at[2].set(1), row.at[0].set(1), one, 0 * one)
        up = none.at[1].set(1)
        places = jnp.zeros(2, jnp.int32)
        return cls(
            pencil=pencil, plane=jnp.append(up, 0).astype(dtype), fitted_light=-up, light=-up, reach=one, offset=places,
            scrolled=places, texels=jnp.asarray(texels, jnp.int32), depth=none, eye=none, loss=one,
            fitted=jnp.zeros((), bool), missed=number, unchecked=number, margin=one, age=number, frames=number,
            refits=number, settings=jnp.asarray(settings, jnp.uint32),
        )  # fmt: skip

    def to_json(self) -> str:
        """The state as strict JSON on one line, of at most a kilobyte; `from_json` reads it back to the last bit.

        Raises:
            ValueError: several states (use `jax.tree.map(lambda v: v[k], state)` for one), or a number that is not
                finite.
        """
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(self)]
        one = jax.tree.leaves(self.empty((1, 1), 0, self.loss.dtype))
        if any(a.shape != b.shape for a, b in zip(leaves, one, strict=True)):
            raise ValueError(f"state: got {leaves[-1].shape} of them, expected one")
        values = [leaf.tolist() for leaf in leaves]
        if not all(np.isfinite(leaf.astype(float)).all() for leaf in leaves):
            raise ValueError("state: got a number that is not finite, expected finite numbers")
        # A single's shortest digits are those of its own precision.
        single = self.loss.dtype == jnp.float32
        told = [_short(value) for value in values] if single else values
        record = {"warpopt.WindowState": _VERSION, "dtype": self.loss.dtype.name, "values": told}
        return json.dumps(record, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> "WindowState":
        """The state that `to_json` wrote.

        Args:
            text: one line of JSON.

        Raises:
            ValueError: anything else: another text, version, dtype, shape or number, and double precision without
                `jax_enable_x64`.
        """
        try:
            record = json.loads(text, parse_constant=lambda word: (_ for _ in ()).throw(ValueError(word)))
        except (TypeError, ValueError, RecursionError):
            raise ValueError(f"state: got {shown(text)}, expected the JSON of WindowState.to_json") from None
        if not isinstance(record, dict) or set(record) != {"warpopt.WindowState", "dtype", "values"}:
            raise ValueError(f"state: got {shown(record)}, expected the JSON of WindowState.to_json")
        if record["warpopt.WindowState"] != _VERSION or record["warpopt.WindowState"] is True:
            raise ValueError(f"state: got version {shown(record['warpopt.WindowState'])}, expected {_VERSION}")
        dtype, values = record["dtype"], record["values"]
        if dtype not in ("float32", "float64"):
            raise ValueError(f"state: got dtype {shown(dtype)}, expected float32 or float64")
        if dtype == "float64" and jnp.zeros(0).dtype != jnp.float64:
            raise ValueError("state: got float64 without jax_enable_x64, expected float32")
        like = cls.empty((1, 1), 0, dtype)
        leaves, shape = jax.tree.flatten(like)
        if not isinstance(values, list) or len(values) != len(leaves):
            raise ValueError(f"state: got {shown(values)}, expected {len(leaves)} values")
        made = [_leaf(value, leaf, k) for k, (value, leaf) in enumerate(zip(values, leaves, strict=True))]
        state = jax.tree.unflatten(shape, made)
        if not (0 < float(state.pencil.eta) <= 1 and (np.asarray(state.texels) > 0).all()):
            raise ValueError(f"state: got eta {float(state.pencil.eta)}, expected one in (0, 1], and a map with texels")
        return state


def _short(value: Any) -> Any:
    if isinstance(value, list):
        return [_short(each) for each in value]
    return float(str(np.float32(value))) if isinstance(value, float) else value


def _leaf(value: Any, like: Array, place: int) -> Array:
    flat = value if isinstance(value, list) else [value]
    kinds = {"f": (int, float), "b": (bool,), "i": (int,), "u": (int,)}[like.dtype.kind]
    good = all(isinstance(v, kinds) and (like.dtype.kind == "b" or not isinstance(v, bool)) for v in flat)
    if like.dtype.kind in "iu":
        ends = np.iinfo(like.dtype)
        good = good and all(ends.min <= v <= ends.max for v in flat)
    if good and like.dtype.kind == "f":  # in the state's own precision
        top = float(np.finfo(like.dtype).max)
        good = all(abs(v) <= top for v in flat)
    if not good or np.shape(value) != like.shape:
        raise ValueError(f"state: got {shown(value)} as value {place}, expected {like.dtype.name}{list(like.shape)}")
    return jnp.asarray(value, like.dtype)

"""Large batches: split into chunks that fit the cache inside a compiled call, and into calls of one fixed shape."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .._checks import is_traced
from .._parallel import wide

# A solve keeps about a hundred numbers per problem: a million problems at once exceed every cache, but XLA's CPU
# backend runs loops over much less than 100,000 elements on one core. Measured on two cores, ns per E_p L2 solve: 243
# for chunks of 32,768, 147 for 131,072, 220 for a million. A GPU gets them all at once, within its memory.
_CHUNK = 131_072
_CHUNK_ELSEWHERE = 4_194_304
# Where a solve keeps almost nothing beside its inputs and outputs, pieces would only be copied in and out.
_CHUNK_OF_FEW_NUMBERS = 67_108_864
# Above this many problems, repeated calls of one compiled program with this fixed shape: memory stays bounded, and a
# new size needs no new compilation.
_BLOCK = 1_048_576


def in_chunks(function: Callable[..., PyTree], args: PyTree, *static: Any, few_numbers: bool = False) -> PyTree:
    """function(*args, *static) for an elementwise function of arrays that broadcast, under `jax.jit`.

    Results have the arrays' joint shape.

    Arguments of one element stay single, so that values that depend only on them are computed once (a sweep of
    directions under one frustum shares its depth integrals). `few_numbers` says that the function keeps few at a time.
    """
    leaves, structure = jax.tree.flatten(args)
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in leaves))
    size = math.prod(shape)
    chunk = _CHUNK
    if wide():
        chunk = _CHUNK_OF_FEW_NUMBERS if few_numbers else _CHUNK_ELSEWHERE
    if size <= chunk:
        return jax.tree.map(lambda out: jnp.broadcast_to(out, shape), function(*args, *static))
    count = -(-size // chunk)
    chunk = -(-size // count)  # equal chunks need almost no padding
    single = [leaf.size == 1 for leaf in leaves]

    def pieces(leaf: Array) -> Array:
        flat = jnp.broadcast_to(leaf, shape).ravel()
        return jnp.pad(flat, (0, count * chunk - size), mode="edge").reshape(count, chunk)

    many = [pieces(leaf) for leaf, one in zip(leaves, single, strict=True) if not one]

    def one_chunk(parts: list[Array]) -> PyTree:
        rest = iter(parts)
        whole = [leaf.reshape(()) if one else next(rest) for leaf, one in zip(leaves, single, strict=True)]
        return jax.tree.map(
            lambda out: jnp.broadcast_to(out, (chunk,)), function(*jax.tree.unflatten(structure, whole), *static)
        )

    return jax.tree.map(lambda out: out.ravel()[:size].reshape(shape), jax.lax.map(one_chunk, many))


def in_blocks(compiled: Callable[..., PyTree], args: PyTree, *static: Any) -> PyTree:
    """compiled(*args, *static) like `in_chunks`, for concrete arrays of any size; one call if traced, or small.

    On other devices than a CPU one call whatever the size: nothing passes through the host.
    """
    leaves, structure = jax.tree.flatten(args)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in leaves))
    size = math.prod(shape)
    if size <= _BLOCK or wide() or is_traced(leaves):
        return compiled(*args, *static)
    flat = [leaf if leaf.size == 1 else np.broadcast_to(leaf, shape).reshape(-1) for leaf in map(np.asarray, leaves)]
    results: list[np.ndarray] = []

    def keep(start: int, parts: list[Array]) -> None:
        stop = min(start + _BLOCK, size)
        results.extend(_aligned(size, part.dtype) for part in parts[len(results) :])
        for whole, part in zip(results, parts, strict=True):
            whole[start:stop] = np.asarray(part)[: stop - start]

    def begun(start: int) -> tuple[list[Array], Any]:
        block = [leaf if leaf.size == 1 else _padded(leaf[start : start + _BLOCK]) for leaf in flat]
        return jax.tree.flatten(compiled(*jax.tree.unflatten(structure, block), *static))

    before, (parts, parts_structure) = 0, begun(0)
    for start in range(_BLOCK, size, _BLOCK):
        following, _ = begun(start)
        keep(before, parts)  # copies one block while the next is computed
        before, parts = start, following
    keep(before, parts)
    return jax.tree.unflatten(
        parts_structure, [jax.device_put(whole.reshape(shape), may_alias=True) for whole in results]
    )


def _aligned(size: int, dtype: np.dtype) -> np.ndarray:
    """An empty array that JAX on a CPU can use without a copy: it requires 64-byte alignment."""
    space = np.empty(size * dtype.itemsize + 64, np.uint8)
    start = -space.ctypes.data % 64
    return space[start : start + size * dtype.itemsize].view(dtype)


def _padded(piece: np.ndarray) -> np.ndarray:
    return piece if piece.size == _BLOCK else np.pad(piece, (0, _BLOCK - piece.size), mode="edge")

"""Large batches in pieces that stay in cache, inside one compiled call."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

# A solve keeps about a hundred numbers a problem in flight. 32,768 problems are 26 MB of them in double precision, about
# the last-level cache of a desktop processor; a GPU wants them all at once, within its memory.
_CHUNK = {"cpu": 32_768}
_CHUNK_ELSEWHERE = 4_194_304


def in_chunks(function: Callable[..., PyTree], *args: PyTree) -> PyTree:
    """function(*args) for an elementwise function of arrays that broadcast; results have their joint shape.

    Arguments of one element stay single, so that what depends on them alone is computed once (a sweep of directions
    under one frustum shares its depth integrals).
    """
    leaves, structure = jax.tree.flatten(args)
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in leaves))
    size = math.prod(shape)
    chunk = _CHUNK.get(jax.default_backend(), _CHUNK_ELSEWHERE)
    if size <= chunk:
        return jax.tree.map(lambda out: jnp.broadcast_to(out, shape), function(*args))
    count = -(-size // chunk)
    single = [leaf.size == 1 for leaf in leaves]

    def pieces(leaf: Array) -> Array:
        flat = jnp.broadcast_to(leaf, shape).ravel()
        return jnp.pad(flat, (0, count * chunk - size), mode="edge").reshape(count, chunk)

    many = [pieces(leaf) for leaf, one in zip(leaves, single, strict=True) if not one]

    def one_chunk(parts: list[Array]) -> PyTree:
        rest = iter(parts)
        whole = [leaf.reshape(()) if one else next(rest) for leaf, one in zip(leaves, single, strict=True)]
        return jax.tree.map(lambda out: jnp.broadcast_to(out, (chunk,)), function(*jax.tree.unflatten(structure, whole)))

    return jax.tree.map(lambda out: out.ravel()[:size].reshape(shape), jax.lax.map(one_chunk, many))

"""Small numerical tools that JAX lacks."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def power(base: Float[Array, "..."], exponent: float) -> Float[Array, "..."]:
    """base ** exponent for a static exponent: multiplications or a square root where they do, which round better."""
    if exponent == int(exponent):
        return base ** int(exponent)
    if 2 * exponent == int(2 * exponent):
        return base ** int(exponent) * jnp.sqrt(base) if exponent > 0 else 1 / power(base, -exponent)
    return base**exponent


def horner(coefficients: "list[Array] | tuple[Array, ...]", at: Float[Array, "..."]) -> Float[Array, "..."]:
    """The polynomial of the given coefficients, highest power first."""
    total = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * at + coefficient
    return total

"""The moments of the receivers' depth along Z_w that define an L_P norm."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._numerics import horner, power
from ..objective import Objective


class Moments(eqx.Module):
    """The M + 1 non-negative numbers that define an L_P norm, for integer M = kP and receivers of any size.

    integral of A^M z^-Q over the measure, over the measure's mass and in units of near
        = amplitude (scale eta')^M ... with eta = scale eta':  amplitude * sum_j coefficients[j] eta'^(M - j)

    The scale balances the two ends (coefficients[0] = coefficients[M] = 1). Moment sequences are log-convex, so the
    others stay below binomials, and they and their powers stay in the range of float32.
    """

    coefficients: tuple[Float[Array, "..."], ...]
    scale: Float[Array, "..."]
    root_amplitude: Float[Array, "..."]  # amplitude^(1/P) = (norm of A z^-r over mass / eta'-polynomial)^(1/P)

    def power_mean(self, eta: Float[Array, "..."], objective: Objective) -> Float[Array, "..."]:
        """(integral of A^M (z/n)^-rP dm / integral of dm)^(1/P)."""
        ratio = eta / self.scale
        # Horner in eta' or 1/eta', whichever is below 1, so that powers cannot overflow.
        flip = ratio > 1
        at = jnp.where(flip, 1 / jnp.where(flip, ratio, 1), ratio)
        up = horner(self.coefficients, jnp.where(flip, 1, at))
        down = horner(self.coefficients[::-1], jnp.where(flip, at, 1))
        largest = jnp.where(flip, eta, self.scale)
        return (
            self.root_amplitude
            * power(largest, objective.metric.blend_power)
            * power(jnp.where(flip, down, up), 1 / objective.order)
        )


def binomial_moments(sums: list[Array], mass: Array, objective: Objective) -> Moments:
    """Moments from the sums of (1 - delta)^(M-j) delta^j z^-rP, j = 0..M, and of the measure; ones where it is 0."""
    M = len(sums) - 1
    raw = [math.comb(M, j) * value for j, value in enumerate(sums)]
    largest = jax.lax.stop_gradient(functools.reduce(jnp.maximum, raw))
    there = (largest > 0) & jnp.isfinite(largest) & (mass > 0)
    largest, mass = jnp.where(there, largest, 1), jnp.where(there, mass, 1)
    coefficients = tuple(jnp.where(there, b / largest, 1) for b in raw)
    return Moments(coefficients, jnp.ones_like(mass), (largest / mass) ** (1 / objective.order))

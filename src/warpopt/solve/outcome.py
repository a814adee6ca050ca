"""How a solve ended."""

import enum

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


class Outcome(enum.IntEnum):
    """The mechanism that fixed the optimum, or why there is none. Solutions hold arrays of these integers.

    Example:
        >>> Outcome(3).name, Outcome(3).succeeded, Outcome(3).sentence
        ('no_warp', True, 'No warp (eta = 1) is optimal.')
    """

    stationary = 0
    tie = 1
    kink = 2
    no_warp = 3
    flat = 4
    unbounded = 5
    empty = 6
    not_converged = 7
    inaccurate = 8
    not_finite = 9

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]

    @property
    def succeeded(self) -> bool:
        return self <= Outcome.empty


_SENTENCES = {
    Outcome.stationary: "The norm is stationary at the optimum.",
    Outcome.tie: "At the optimum two errors are equal: a near and a far receiver's, or E_p and E_q in their maximum.",
    Outcome.kink: "At the optimum near and far receivers span the width of the shadow map together.",
    Outcome.no_warp: "No warp (eta = 1) is optimal.",
    Outcome.flat: "All receivers lie at one depth along the warp's axis: there is nothing to warp.",
    Outcome.unbounded: "The norm falls as eta goes to 0: eta is the floor that was asked for (min_eta).",
    Outcome.empty: "There are no receivers: nothing needs a shadow map.",
    Outcome.not_converged: "The root finder ran out of steps before its bracket closed.",
    Outcome.inaccurate: "The quadrature's own error estimate exceeds its tolerance; the optimum is not certified.",
    Outcome.not_finite: "The norm is not a finite number: far/near beyond 7.9e13, or NaN input.",
}


def failed(result: Int[Array, "..."]) -> Bool[Array, "..."]:
    return jnp.asarray(result) > Outcome.empty

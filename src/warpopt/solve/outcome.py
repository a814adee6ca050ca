"""How a solve ended."""

import enum
import functools

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool
from numpy.typing import NDArray


class Outcome(enum.IntEnum):
    """The condition that fixed the optimum, or the reason for none. Solutions hold arrays of these integers.

    Example:
        >>> Outcome(3).name, Outcome(3).succeeded, Outcome(3).sentence
        ('no_warp', True, 'eta = 1 (no warp) minimises the norm.')
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
    depth_weighted = 10
    out_of_range = 11

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]

    @property
    def succeeded(self) -> bool:
        """Whether the warp is the optimum, or no warp is needed; not whether there is something to warp."""
        return self not in (
            Outcome.not_converged, Outcome.inaccurate, Outcome.not_finite, Outcome.out_of_range,
        )  # fmt: skip


_SENTENCES = {
    Outcome.stationary: "The norm is stationary at the optimum.",
    Outcome.tie: "At the optimum two errors are equal: a near and a far receiver's, or E_p and E_q in metric 'max'.",
    Outcome.kink: "At the optimum near and far receivers span the width of the shadow map together.",
    Outcome.no_warp: "eta = 1 (no warp) minimises the norm.",
    Outcome.flat: "All receivers lie at one depth along the warp's axis: there is nothing to warp.",
    Outcome.unbounded: "The norm falls as eta goes to 0: eta is the requested minimum (min_eta).",
    Outcome.empty: "There are no receivers: nothing needs a shadow map.",
    Outcome.not_converged: "The root finder ran out of steps before its bracket closed.",
    Outcome.inaccurate: (
        "The optimum is not certified: the quadrature's error estimate exceeds its tolerance, or the lower bound of a "
        "mean is no number, as with min_eta below 1e-100 (1e-12 in single precision) or a large order."
    ),
    Outcome.depth_weighted: "All weights are 0 (no shadow edge is known): receivers were weighted by depth instead.",
    Outcome.not_finite: (
        "The norm is not a finite number: far/near beyond 7.9e13, unbounded receivers, exponents or an order so large "
        "that it overflows, or NaN input."
    ),
    Outcome.out_of_range: "Out of range: eta, the norm or a length is beyond the normal numbers of the dtype.",
}


_FAILURES = tuple(outcome for outcome in Outcome if not outcome.succeeded)


def failed(result: ArrayLike) -> Bool[Array, "..."]:
    """Which of an array of outcomes are failures: the only test for them, on the host and when traced."""
    result = jnp.asarray(result)
    return functools.reduce(jnp.logical_or, [result == outcome for outcome in _FAILURES])


def failed_on_host(result: ArrayLike) -> NDArray[np.bool_]:
    """`failed` in NumPy."""
    return np.isin(np.asarray(result), _FAILURES)

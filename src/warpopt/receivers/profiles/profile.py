"""The interface that lower bounds use to read receivers."""

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, eq=False)
class Stretches:
    """The best map of E_p, stretch by stretch of the depth along Z_w.

    Attributes:
        at: (N + 1,) Z_w . c of the stretches' ends, increasing; empty for no receivers, or one depth.
        shares: (N,) each stretch's share of the map, up to a factor.
        value: the least norm of E_p that any monotone map reaches.
    """

    at: NDArray
    shares: NDArray
    value: float


NOTHING = Stretches(np.zeros(0), np.zeros(0), 0.0)


@runtime_checkable
class DepthProfile(Protocol):
    """Receivers by depth along Z_w."""

    def stretches(self, order: float, parts: int) -> Stretches:
        """The best map of E_p in L_order; curved stretches are split into at least `parts` linear ones."""
        ...

    def widest(self) -> float:
        """The largest (x_max - x_min) / z_min at one depth."""
        ...

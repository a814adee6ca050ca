"""Sets of receivers that are given one by one, each with a weight."""

from typing import TypeVar

import equinox as eqx

from .receivers import Receivers
from .weighted.weights import Weighting, Weights

Kind = TypeVar("Kind", bound="OneByOne")  # `Self` has no meaning to a checker of single functions


class OneByOne(Receivers):
    """Points, or pixels: others' weights can take the place of their own.

    Attributes:
        weights: what each counts for in a mean.
    """

    weights: eqx.AbstractVar[Weights]

    def reweighed(self: Kind, weights: Weighting) -> Kind:
        """The same receivers with other weights, of which the same are lit.

        Only the weights are checked: a check of the receivers is a pass over them, and a copy to the host.

        Raises:
            ValueError: as `Weights`.
        """
        return eqx.tree_at(lambda r: r.weights, self, self.weights.instead(weights))

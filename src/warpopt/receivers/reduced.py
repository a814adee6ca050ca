"""Receivers reduced to their footprint: several calls share one pass over them."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._checks import is_traced
from ..objective import Objective
from ..theory.camera import Camera, DirectionalLight
from ..theory.light_frame import LightFrame
from .footprint import Footprint
from .profiles.profile import DepthProfile
from .receivers import EVERY_MEASURE, Receivers


class Reduced(Receivers):
    """A footprint instead of the receivers it was made from; see `warpopt.SceneView.reduced`.

    Attributes:
        made: the footprint.
        camera, light: the ones it was made for.
        objective: the one of its moments.
        kind: the receivers' class, for messages.
        extent: (least, largest) eye depth of the receivers; None if their kind has none.
    """

    made: Footprint
    camera: Camera
    light: DirectionalLight
    objective: Objective = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    extent: tuple[Float[Array, ""], Float[Array, ""]] | None

    any_projection = True
    measures = EVERY_MEASURE  # the objective is compared as a whole

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`; `check` has compared all three arguments."""
        return self.made

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        if self.extent is None:
            raise ValueError(f"receivers: got {self.kind}, which has no depth_extent, as rules over it need")
        return self.extent

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> DepthProfile:
        """See `Receivers`.

        Raises:
            ValueError: always: a footprint has no profile.
        """
        raise ValueError(
            f"receivers: got {self.kind} reduced to a footprint, which has no depth_profile, as lower bounds need; "
            "expected the receivers themselves"
        )

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """See `Receivers`.

        Raises:
            ValueError: a camera or light that the footprint was not made for (traced values are not checked); another
                L_P norm, or the axis instead of the whole frustum.
        """
        for name, one, own in (("camera", camera, self.camera), ("light", light, self.light)):
            if not all(map(_same, jax.tree.leaves(one), jax.tree.leaves(own))):
                raise ValueError(
                    f"{name}: got another than the receivers were reduced for, expected the same: reduce the view again"
                )
        if objective is None:
            return
        alike = (objective.measure == "axis") == (self.objective.measure == "axis")
        if objective != self.objective and not (objective.supremum and alike):
            raise ValueError(
                f"objective: got {objective.title} with receivers reduced for {self.objective.title}, expected that or "
                "a norm inf"
            )


def _same(one: Array, other: Array) -> bool:
    if one is other or is_traced(one) or is_traced(other):
        return True
    return np.array_equal(one, other)

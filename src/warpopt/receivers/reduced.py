"""Receivers that have been reduced to their footprint: one pass over them for several verbs."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..objective import Objective
from ..theory.camera import Camera, DirectionalLight
from ..theory.light_frame import LightFrame
from .footprint import Footprint
from .receivers import EVERY_MEASURE, Receivers


class Reduced(Receivers):
    """A footprint in the place of the receivers that it was made of; see `warpopt.SceneView.reduced`.

    Attributes:
        made: the footprint.
        camera, light: what it was made for.
        objective: of its moments.
        kind: the receivers' class, for messages.
        extent: (least, largest) eye depth of the receivers; None where their kind does not know it.
    """

    made: Footprint
    camera: Camera
    light: DirectionalLight
    objective: Objective = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    extent: tuple[Float[Array, ""], Float[Array, ""]] | None

    measures = EVERY_MEASURE  # the objective is compared as a whole

    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """See `Receivers`; `check` has compared all three."""
        return self.made

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """See `Receivers`."""
        if self.extent is None:
            raise ValueError(f"receivers: got {self.kind}, which has no depth_extent, as rules over it need")
        return self.extent

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """See `Receivers`.

        Raises:
            ValueError: another camera or light than the footprint was made for, unless traced, of which nothing is
                known; another L_P norm, or the axis in the place of the whole.
        """
        for name, one, own in (("camera", camera, self.camera), ("light", light, self.light)):
            if not all(map(_same, jax.tree.leaves(one), jax.tree.leaves(own))):
                raise ValueError(
                    f"{name}: got another than the receivers were reduced for, expected the same: reduce the view anew"
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
    if one is other or isinstance(one, jax.core.Tracer) or isinstance(other, jax.core.Tracer):
        return True
    return np.array_equal(one, other)

"""What must be resolved: the interface of every kind of receivers, yours too."""

import abc
from typing import ClassVar, get_args

import equinox as eqx
from jaxtyping import Array, Float

from ..objective import Measure, Objective
from ..theory.camera import Camera, DirectionalLight
from ..theory.light_frame import LightFrame
from .footprint import Footprint
from .profiles.profile import DepthProfile

EVERY_MEASURE: tuple[str, ...] = get_args(Measure)


class Receivers(eqx.Module):
    """Receivers of any kind. Nothing outside this package asks which kind they are.

    A kind of your own is an `equinox.Module` that derives from this class. `footprint` is all that `optimal_warp`,
    `error_norm` and `shadow_matrix` need; without the other two, rules over it and lower bounds are refused in words.

    Attributes:
        measures: the measures that L_P norms over this kind may be taken over; a set has weights of its own.
        one_at_a_time: whether one view's pass fills the machine, so that views are solved one after the other.

    Example:
        >>> import jax, jax.numpy as jnp, warpopt
        >>> class Posts(Receivers):   # a kind that is put together from another
        ...     feet: jax.Array
        ...
        ...     def footprint(self, camera, frame, objective):
        ...         ends = jnp.concatenate([self.feet, self.feet + jnp.array([0.0, 2.0, 0.0])])
        ...         return warpopt.receivers.PointReceivers(ends).footprint(camera, frame, objective)
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4)
        >>> posts = Posts(jnp.array([[0.0, 0.0, -8.0], [3.0, 0.0, -80.0]]))
        >>> view = warpopt.SceneView(camera, warpopt.DirectionalLight((0, -1, 0)), posts)
        >>> round(float(warpopt.optimal_warp(view).warp.mu), 3)   # they stand from z = 8 to 80
        72.0
    """

    measures: ClassVar[tuple[str, ...]] = ("screen",)
    one_at_a_time: ClassVar[bool] = False

    @abc.abstractmethod
    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """The receivers as far as a warp needs to know them, with moments if the objective is an L_P norm.

        Called under `jax.jit`.
        """

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(least, largest) eye depth of what is seen, which rules take for n and f; (inf, -inf) for nothing.

        Called under `jax.jit`.

        Raises:
            ValueError: this kind does not know it.
        """
        raise ValueError(f"receivers: got {type(self).__name__}, which has no depth_extent, as rules over it need")

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> DepthProfile:
        """The receivers by their depth along Z_w, which lower bounds are made of.

        Args:
            camera, frame, objective: as for `footprint`, but concrete.
            bins: of depth, for kinds that are sets of points.

        Raises:
            ValueError: this kind does not know it.
        """
        raise ValueError(f"receivers: got {type(self).__name__}, which has no depth_profile, as lower bounds need")

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """Refuse what these receivers are not for; every verb asks before anything is compiled.

        Args:
            camera, light: of the view.
            objective: None where the receivers' extents alone are needed.

        Raises:
            ValueError: a measure that is not this kind's.
        """
        if objective is not None and objective.measure not in self.measures:
            expected = ", ".join(map(repr, self.measures))
            raise ValueError(
                f"measure: got {objective.measure!r} with {type(self).__name__}, expected "
                + (f"one of {expected}" if len(self.measures) > 1 else f"{expected}: its weights are its own")
            )

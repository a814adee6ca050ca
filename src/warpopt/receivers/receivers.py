"""The interface of every kind of receivers, including your own."""

import abc
from collections.abc import Callable
from typing import ClassVar, get_args

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..objective import Measure, Objective
from ..theory.camera import Camera, DirectionalLight
from ..theory.light_frame import LightFrame
from .footprint import Footprint
from .profiles.nearness import over_points
from .profiles.profile import DepthProfile
from .samples import Counted

EVERY_MEASURE: tuple[str, ...] = get_args(Measure)


class Receivers(eqx.Module):
    """Receivers of any kind. Code outside this package does not depend on the kind.

    Your own kind is an `equinox.Module` derived from this class. `optimal_warp`, `error_norm` and `shadow_matrix` need
    only `footprint` (`warpopt.receivers.bins` builds it from extents of groups, and moments for L_P norms). Rules over
    it also need `depth_extent`, lower bounds `depth_profile`; the other methods say what they are for. What your
    methods return is checked: a wrong type, shape or value is a `ValueError` that names it (wrong values in your own
    compiled program are `Outcome.not_finite`). Outside such a program they are called once for each solve, or once by
    `SceneView.reduced`.

    Attributes:
        measures: the measures that L_P norms over this kind accept; a set is weighted by its weights instead.
        weighted: whether the kind is a set with weights, over which means of "edge", "band" and "max" can be taken.
        one_at_a_time: whether one pass uses all cores, so that views are solved one after the other.
        of_cells: whether its maxima are those of cells, and its means those of their centroids.
        any_projection: whether the kind serves orthographic cameras: it takes z for errors from `LightFrame.eye_depth`.

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
    weighted: ClassVar[bool] = True
    one_at_a_time: ClassVar[bool] = False
    of_cells: ClassVar[bool] = False
    any_projection: ClassVar[bool] = False

    @abc.abstractmethod
    def footprint(self, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
        """The data that a warp needs, with moments if the objective is an L_P norm.

        Called under `jax.jit`.

        Args:
            camera: of the view.
            frame: W's axes, in eye coordinates.
            objective: whose moments or samples are needed.

        Returns:
            A `Footprint`, in the world's units.
        """

    def depth_extent(self, camera: Camera) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(least, largest) eye depth of the visible receivers, used by rules as n and f; (inf, -inf) if none.

        Called under `jax.jit`.

        Args:
            camera: of the view.

        Returns:
            Two numbers, in the world's units.

        Raises:
            ValueError: this kind has none.
        """
        raise ValueError(f"receivers: got {type(self).__name__}, which has no depth_extent, as rules over it need")

    def places(self, camera: Camera) -> tuple[Float[Array, "N 3"], Float[Array, " N"]]:
        """(points in eye coordinates that stand for the receivers, how much each counts), for directions from them.

        Called under `jax.jit`.

        Args:
            camera: of the view.

        Returns:
            (N, 3), in the world's units, and (N,), >= 0; 0 for entries that stand for nothing.

        Raises:
            ValueError: this kind has none.
        """
        raise ValueError(
            f"receivers: got {type(self).__name__}, which has no places, as the directions 'gradient' and 'middle' need"
        )

    def counted(self, camera: Camera, objective: Objective) -> Counted:
        """The receivers one by one, for means over maps that were not fitted to them.

        Called under `jax.jit`.

        Args:
            camera: of the view.
            objective: the mean.

        Returns:
            A `Counted` of N receivers.

        Raises:
            ValueError: this kind has none.
        """
        raise ValueError(
            f"receivers: got {type(self).__name__}, which cannot count its receivers one by one, as the mean "
            f"{objective.name!r} in a stable window or over cascades needs"
        )

    def mass_up_to(self, camera: Camera, objective: Objective) -> Callable[[Float[Array, "..."]], Float[Array, "..."]]:
        """The function from eye depths to the sum of the weights of what is not farther, for means over cascades.

        Called under `jax.jit`, and returned from there: a pytree.

        Args:
            camera: of the view.
            objective: the mean.

        Returns:
            A function of depths of any shape.

        Raises:
            ValueError: as `counted`.
        """
        points, weights, _ = self.counted(camera, objective)
        order = jnp.argsort(points[:, 2])
        z, summed = points[order, 2], jnp.concatenate([jnp.zeros(1, weights.dtype), jnp.cumsum(weights[order])])
        return MassOfPoints(z, summed)

    def sketch(self, camera: Camera, objective: Objective) -> "Receivers":
        """The same receivers, or fewer that stand for them, whose footprint is cheap enough for many directions.

        What fits a map of the sketch fits every receiver. Called under `jax.jit`.

        Args:
            camera: of the view.
            objective: whose norm is searched.

        Returns:
            Receivers, of any kind.
        """
        return self

    def between(self, camera: Camera, near: Float[Array, ""], far: Float[Array, ""]) -> "tuple[Camera, Receivers]":
        """(a camera, receivers) of what lies between two eye depths, for cascades: here a camera with other planes.

        Called under `jax.jit`.

        Args:
            camera: of the view.
            near, far: 0 < near <= far; far may be inf.

        Returns:
            Both, for the view of one cascade.
        """
        planes = (jnp.asarray(v, camera.near.dtype) for v in (near, far))
        return eqx.tree_at(lambda c: (c.near, c.far), camera, tuple(planes)), self

    def depth_profile(self, camera: Camera, frame: LightFrame, objective: Objective, bins: int) -> DepthProfile:
        """The receivers by depth along Z_w, used by lower bounds.

        Args:
            camera, frame, objective: as for `footprint`, but not traced.
            bins: number of depth bins, for kinds that are sets of points.

        Raises:
            ValueError: this kind has none.
        """
        raise ValueError(f"receivers: got {type(self).__name__}, which has no depth_profile, as lower bounds need")

    def nearness(self, camera: Camera, frame: LightFrame, bins: int) -> float:
        """The integral over the light plane of max 1/z^2 of the receivers on each ray, used by the bound of "storage".

        Under parallel rays it is the area that they cover there.

        Args:
            camera, frame: not traced.
            bins: for sets of points: cells are 8 / bins of their depths wide; of the window's height under parallel
                rays.

        Raises:
            ValueError: this kind has none.
        """
        points, weights = (np.asarray(v, np.float64) for v in self.places(camera))
        points = points[weights > 0]
        side = 8 / bins * (float(camera.window[3] - camera.window[2]) if camera.is_orthographic else 1)
        z = np.asarray(frame.eye_depth(points), np.float64)
        return over_points(points, z, np.asarray(frame.light, np.float64), side)

    def check(self, camera: Camera, light: DirectionalLight, objective: Objective | None) -> None:
        """Refuse inputs that these receivers do not support; public functions call it before compiling anything.

        Args:
            camera, light: of the view.
            objective: None if only the receivers' extents are needed.

        Raises:
            ValueError: a measure or a mean that this kind does not support.
        """
        if objective is not None and objective.kernel is not None and not self.weighted:
            raise ValueError(
                f"metric: got {objective.name!r} in norm {objective.norm} with {type(self).__name__}, expected points, "
                "a depth buffer or a histogram: it is a mean over receivers with weights"
            )
        if objective is not None and camera.is_orthographic and objective.measure not in ("screen", "volume"):
            raise ValueError(
                f"measure: got {objective.measure!r} with an orthographic camera, expected 'screen' or 'volume', which "
                "are the same"
            )
        if objective is not None and objective.measure not in self.measures:
            expected = ", ".join(map(repr, self.measures))
            raise ValueError(
                f"measure: got {objective.measure!r} with {type(self).__name__}, expected "
                + (f"one of {expected}" if len(self.measures) > 1 else f"{expected}: it has weights")
            )


class MassOfPoints(eqx.Module):
    """The sum of the weights of points up to a depth.

    Attributes:
        z: increasing depths.
        summed: of the weights before each, and of all.
    """

    z: Float[Array, " N"]
    summed: Float[Array, " N+1"]

    def __call__(self, depth: Float[Array, "..."]) -> Float[Array, "..."]:
        return self.summed[jnp.searchsorted(self.z, depth, side="right")]

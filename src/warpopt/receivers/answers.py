"""What receivers answer, checked: a kind of a user's own may return anything.

What the package's own kinds return is trusted. Of others, types and shapes are checked when a program is compiled, and
values where they are concrete; in a user's compiled program, wrong values make the footprint NaN, which is an outcome.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import gathered, is_traced
from .._words import shown
from ..objective import Objective
from ..theory.camera import Camera
from ..theory.light_frame import LightFrame
from ..theory.light_space import LightDepth
from .footprint import Footprint, Nearest, Sides
from .moments import Moments
from .profiles.profile import DepthProfile, Stretches
from .receivers import Receivers
from .samples import Samples

Extent = tuple[Float[Array, ""], Float[Array, ""]]
_SLACK = 1e-3  # of a depth in [0, 1], and of an eye depth: nonsense is larger, rounding in single precision smaller


class WrongAnswer(ValueError):
    """What no receivers can answer."""


def to_be_checked(receivers: Receivers) -> bool:
    """Whether the kind is not one of this package's, so that what it answers is to be checked."""
    return not type(receivers).__module__.startswith(f"{__package__}.")


def footprint_of(receivers: Receivers, camera: Camera, frame: LightFrame, objective: Objective) -> Footprint:
    """The receivers' footprint; NaN where it has values that no footprint has, or a check in it failed.

    Raises:
        ValueError: no footprint, or one with missing parts or other shapes.
    """
    if not to_be_checked(receivers):
        return receivers.footprint(camera, frame, objective)

    def answer() -> Footprint:
        return _of_arrays(receivers, receivers.footprint(camera, frame, objective), objective, frame.z_axis.dtype)

    wrong, made = gathered(answer)
    right = [jnp.all(valid) for _, _, valid, _ in _values(made)]
    return made.lost_where(wrong | ~functools.reduce(jnp.logical_and, right))


def extent_of(receivers: Receivers, camera: Camera) -> Extent:
    """The receivers' depth extent.

    Raises:
        ValueError: the kind has none, or answers anything but two numbers.
    """
    if not to_be_checked(receivers):
        return receivers.depth_extent(camera)
    wrong, extent = gathered(lambda: _two_numbers(receivers, receivers.depth_extent(camera), camera.near.dtype))
    least, largest = (jnp.where(wrong, jnp.nan, v) for v in extent)
    return least, largest


def extent_if_any(receivers: Receivers, camera: Camera) -> Extent | None:
    """The receivers' depth extent; None if the kind has none.

    Raises:
        WrongAnswer: an answer that is not two numbers.
    """
    try:
        return extent_of(receivers, camera)
    except WrongAnswer:
        raise
    except ValueError:  # callers that need it raise
        return None


def profile_of(
    receivers: Receivers, camera: Camera, frame: LightFrame, objective: Objective, bins: int
) -> DepthProfile:
    """The receivers' depth profile, whose answers are checked.

    Raises:
        ValueError: the kind has none, or answers something else.
    """
    profile = receivers.depth_profile(camera, frame, objective, bins)
    if not to_be_checked(receivers):
        return profile
    if not isinstance(profile, DepthProfile):
        raise _refused(receivers, "depth_profile", shown(profile), "a profile with stretches and widest")
    return _Checked(profile, receivers)


def refuse_answers(
    receivers: Receivers,
    camera: Camera,
    frame: LightFrame,
    objective: Objective,
    made: Footprint,
    extent: Extent | None,
) -> None:
    """Refuse values that no receivers have. Traced values are not checked.

    Args:
        made, extent: what compiled programs found; the receivers are asked again for what is wrong, uncompiled.

    Raises:
        ValueError: naming the value, what was got and what was expected.
    """
    if not to_be_checked(receivers) or is_traced(receivers, camera, frame, made, extent):
        return
    made = jax.tree.map(np.asarray, made)  # in NumPy nothing is compiled for a comparison
    if not all(np.all(valid) for _, _, valid, _ in _values(made)):
        asked = receivers.footprint(camera, frame, objective)  # its own checks now have words
        for each in (_of_arrays(receivers, asked, objective, frame.z_axis.dtype), made):
            for name, value, valid, expected in _values(each):
                if not np.all(valid):
                    got = f"{name} = {np.asarray(value)[~np.asarray(valid)].flat[0]:g}"
                    raise _refused(receivers, "footprint", got, expected)
    if extent is None:
        return
    least, largest = map(float, extent)
    got = f"({least:g}, {largest:g})"
    if not (0 < least <= largest < np.inf or (least, largest) == (np.inf, -np.inf)):
        raise _refused(receivers, "depth_extent", got, "0 < least <= largest, or (inf, -inf)")
    if bool(made.empty) != (least > largest):
        found = "no receivers" if bool(made.empty) else "receivers"
        raise _refused(receivers, "depth_extent", got, f"the extent of its footprint, which has {found}")
    nearest = float(made.nearest.z.min())
    if not (made.empty or least * (1 - _SLACK) <= nearest <= largest * (1 + _SLACK)):
        expected = f"one with the least eye depth of its footprint, {nearest:g}"
        raise _refused(receivers, "depth_extent", got, expected)


def _refused(receivers: Receivers, method: str, got: str, expected: str) -> WrongAnswer:
    return WrongAnswer(f"receivers: got {got} from {type(receivers).__name__}.{method}, expected {expected}")


def _two_numbers(receivers: Receivers, answer: Any, dtype: Any) -> Extent:
    try:
        least, largest = (jnp.asarray(v, dtype) for v in answer)
    except (TypeError, ValueError):
        raise _refused(receivers, "depth_extent", shown(answer), "(least, largest) eye depth") from None
    if least.shape or largest.shape:
        raise _refused(receivers, "depth_extent", f"shapes {least.shape}, {largest.shape}", "two numbers")
    return least, largest


def _of_arrays(receivers: Receivers, made: Any, objective: Objective, dtype: Any) -> Footprint:
    """The footprint with all numbers as arrays.

    Raises:
        ValueError: missing parts or other shapes.
    """

    def part(name: str, value: Any, kind: type) -> None:
        if not isinstance(value, kind):
            raise _refused(receivers, "footprint", f"{name}{shown(value)}", f"a {kind.__name__}")

    part("", made, Footprint)
    part("nearest = ", made.nearest, Nearest)
    part("sides = ", made.sides, Sides)
    part("nearest.depth = ", made.nearest.depth, LightDepth)
    part("sides.depth = ", made.sides.depth, LightDepth)
    part("sides.farthest = ", made.sides.farthest, LightDepth)
    if objective.kernel is not None:
        part("samples = ", made.samples, Samples)
        part("samples.depth = ", made.samples.depth, LightDepth)
    elif not objective.supremum:
        part("moments = ", made.moments, Moments)
        count = round(objective.blend_degree) + 1
        if len(made.moments.coefficients) != count:
            got = f"moments of {len(made.moments.coefficients)} coefficients"
            raise _refused(receivers, "footprint", got, f"{count} with {objective.title}")
    try:
        made = jax.tree.map(jnp.asarray, made)
    except (TypeError, ValueError):
        raise _refused(receivers, "footprint", "values that are no arrays", "arrays of real numbers") from None
    made = jax.tree.map(lambda v: v.astype(dtype) if jnp.issubdtype(v.dtype, jnp.number) else v, made)
    scalars = [(name, getattr(made, name)) for name in ("start", "mu", "axis", "unit", "empty", "flat")]
    scalars += [("moments", leaf) for leaf in jax.tree.leaves(made.moments)]
    for name, value in scalars:
        if value.shape:
            raise _refused(receivers, "footprint", f"{name} of shape {value.shape}", "a number")
    for name, group in (("nearest", made.nearest), ("sides", made.sides), ("samples", made.samples)):
        if group is None:
            continue
        parts = (group.depth, group.lateral, group.weight) if isinstance(group, Samples) else group  # without its cells
        shapes = {leaf.shape for leaf in jax.tree.leaves(parts)}
        if len(shapes) > 1 or not all(len(shape) == 1 and shape[0] for shape in shapes):
            raise _refused(receivers, "footprint", f"{name} of shapes {sorted(shapes)}", "(N,) for all, N >= 1")
    return made


def _values(made: Footprint) -> Iterator[tuple[str, Array, Array, str]]:
    """(name, value, where it can be of a footprint, that in words)."""
    finite = "a finite number"
    for name in ("start", "axis"):
        value = getattr(made, name)
        yield name, value, (value > -jnp.inf) & (value < jnp.inf), finite
    z = made.nearest.z
    yield "nearest.z", z, z > 0, "eye depths > 0, inf for no receiver"
    for name, depth in (("nearest", made.nearest.depth), ("sides", made.sides.depth), ("sides", made.sides.farthest)):
        for field, value in zip(depth._fields, depth, strict=True):
            yield f"{name} {field}", value, (value >= -_SLACK) & (value <= 1 + _SLACK), "numbers in [0, 1]"
    for name in ("right", "left"):
        value = getattr(made.sides, name)
        yield f"sides.{name}", value, (value >= 0) & (value < jnp.inf), "finite numbers >= 0"
    for name in ("light_least", "light_largest"):
        value = getattr(made.sides, name)
        yield f"sides.{name}", value, value == value, "numbers"
    if made.samples is not None:
        for field, value in zip(made.samples.depth._fields, made.samples.depth, strict=True):
            yield f"samples {field}", value, (value >= -_SLACK) & (value <= 1 + _SLACK), "numbers in [0, 1]"
        for name in ("lateral", "weight"):
            value = getattr(made.samples, name)
            yield f"samples.{name}", value, (value >= 0) & (value < jnp.inf), "finite numbers >= 0"
    for value in jax.tree.leaves(made.moments):
        yield "moments", value, (value >= 0) & (value < jnp.inf), "finite numbers >= 0"
    for name in ("unit", "mu"):  # mu last: it is NaN for what was found wrong in a compiled program
        value = getattr(made, name)
        yield name, value, (value > 0) & (value < jnp.inf), "a finite number > 0"


@dataclasses.dataclass(frozen=True, eq=False)
class _Checked:
    """A user's profile; see `DepthProfile`."""

    profile: DepthProfile
    receivers: Receivers

    def stretches(self, order: float, parts: int) -> Stretches:
        """See `DepthProfile`."""
        found = self.profile.stretches(order, parts)
        name = "depth_profile().stretches"
        if not isinstance(found, Stretches):
            raise _refused(self.receivers, name, shown(found), "Stretches")
        expected = "depths that increase, shares >= 0, one less, and a value >= 0, all finite"
        try:
            at, shares, value = np.asarray(found.at, float), np.asarray(found.shares, float), float(found.value)
        except (TypeError, ValueError):
            raise _refused(self.receivers, name, "Stretches that are no numbers", expected) from None
        right = at.ndim == shares.ndim == 1 and len(shares) == max(len(at) - 1, 0) and 0 <= value < np.inf
        if not (right and (np.diff(at) >= 0).all() and ((shares >= 0) & (shares < np.inf)).all()):
            raise _refused(self.receivers, name, f"Stretches of value {value:g}", expected)
        return Stretches(at, shares, value)

    def widest(self) -> float:
        """See `DepthProfile`."""
        found = self.profile.widest()
        try:
            width = float(found)
        except (TypeError, ValueError):
            width = np.nan
        if not 0 <= width < np.inf:
            raise _refused(self.receivers, "depth_profile().widest", shown(found), "a finite number >= 0")
        return width

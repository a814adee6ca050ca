"""What methods of a user's own receivers return: nonsense is refused in words by every verb, or is an outcome."""

import dataclasses
import functools
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Objective, SceneView
from warpopt.receivers import ConvexBody, PointReceivers, Receivers
from warpopt.receivers.profiles.profile import Stretches

CAMERA = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
LIGHT = warpopt.DirectionalLight((0.3, -1.0, -0.2))
BOX = ConvexBody.box((-20, 0, -80), (20, 8, -5))
WARP = warpopt.Warp.from_eta(0.5, warpopt.theory.Extent(1.0, 90.0))
L2 = Objective("p", "l2")


@functools.partial(jax.jit, static_argnames="objective")
def box_footprint(camera, frame, objective):
    """Compiled, as methods of a user's own kind need not be."""
    return BOX.footprint(camera, frame, objective)


class Mine(Receivers):
    """A box, and what its methods make of the box's answers."""

    footprint_made: Any = eqx.field(static=True, default=lambda made: made)
    extent_made: Any = eqx.field(static=True, default=lambda extent: extent)
    profile_made: Any = eqx.field(static=True, default=lambda profile: profile)

    def footprint(self, camera, frame, objective):
        return self.footprint_made(box_footprint(camera, frame, objective))

    def depth_extent(self, camera):
        return self.extent_made(BOX.depth_extent(camera))

    def depth_profile(self, camera, frame, objective, bins):
        return self.profile_made(BOX.depth_profile(camera, frame, objective, bins))


def verbs(receivers, objective=None):
    """Every verb that asks for a footprint, by name."""
    view = SceneView(CAMERA, LIGHT, receivers)
    return {
        "optimal_warp": lambda: warpopt.optimal_warp(view, objective),
        "without throw": lambda: warpopt.optimal_warp(view, objective, throw=False),
        "error_norm": lambda: warpopt.error_norm(view, WARP, objective),
        "shadow_matrix": lambda: warpopt.shadow_matrix(view, WARP),
        "footprint": lambda: view.footprint(objective),
        "reduced": lambda: view.reduced(objective),
        "compare_rules": lambda: warpopt.compare_rules(view, "psm", objective),
    }


def put(where, value):
    return lambda made: eqx.tree_at(where, made, value, is_leaf=lambda v: v is None)


TYPES = {
    "nothing": (lambda made: None, "got None from Mine.footprint, expected a Footprint"),
    "a number": (lambda made: 5.0, "got 5.0 from Mine.footprint, expected a Footprint"),
    "text": (lambda made: "wide", "got 'wide' from Mine.footprint, expected a Footprint"),
    "no nearest": (put(lambda f: f.nearest, None), "got nearest = None from Mine.footprint, expected a Nearest"),
    "no sides": (put(lambda f: f.sides, ()), "got sides = () from Mine.footprint, expected a Sides"),
    "no depth": (put(lambda f: f.sides.farthest, 1.0), "got sides.farthest = 1.0 from Mine.footprint, expected a L"),
    "text as start": (put(lambda f: f.start, "x"), "got values that are no arrays from Mine.footprint, expected a"),
    "two starts": (put(lambda f: f.start, jnp.ones(2)), "got start of shape (2,) from Mine.footprint, expected a"),
    "no groups": (
        lambda made: dataclasses.replace(made, nearest=jax.tree.map(lambda v: v[:0], made.nearest)),
        "got nearest of shapes [(0,)] from Mine.footprint, expected (N,) for all, N >= 1",
    ),
    "other lengths": (put(lambda f: f.sides.left, jnp.ones(2)), "got sides of shapes [(2,), ("),
}  # fmt: skip
VALUES = {
    "NaN start": (put(lambda f: f.start, np.nan), "got start = nan from Mine.footprint, expected a finite number"),
    "negative mu": (put(lambda f: f.mu, -5.0), "got mu = -5 from Mine.footprint, expected a finite number > 0"),
    "no axis": (put(lambda f: f.axis, np.inf), "got axis = inf from Mine.footprint, expected a finite number"),
    "behind the eye": (lambda made: eqx.tree_at(lambda f: f.nearest.z, made, -made.nearest.z), "got nearest.z = -"),
    "beyond the end": (
        lambda made: eqx.tree_at(lambda f: f.nearest.depth.delta, made, made.nearest.depth.delta + 3),
        "got nearest delta = 3 from Mine.footprint, expected numbers in [0, 1]",
    ),
    "NaN width": (
        lambda made: eqx.tree_at(lambda f: f.sides.left, made, made.sides.left * np.nan), "got sides.left = nan from",
    ),
    "negative width": (
        lambda made: eqx.tree_at(lambda f: f.sides.right, made, made.sides.right - 99),
        "got sides.right = -",
    ),
    "NaN heights": (
        lambda made: eqx.tree_at(lambda f: f.sides.light_least, made, made.sides.light_least * np.nan),
        "got sides.light_least = nan from",
    ),
    "NaN points": (
        lambda made: dataclasses.replace(
            made, unit=made.unit + 0 * PointReceivers(made.unit * jnp.array([[0.0, np.nan, 1.0]])).points.sum()
        ),
        "points: got nan, expected finite numbers",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TYPES | VALUES)
def test_a_footprint_of_nonsense_is_refused_by_every_verb(name):
    """Killed: an AttributeError or JAX's own error from within, a number made from nonsense."""
    made, words = (TYPES | VALUES)[name]
    for verb, call in verbs(Mine(made)).items():
        with pytest.raises(ValueError) as error:  # noqa: PT011, the words are checked below
            call()
        told = str(error.value)
        assert words in told, (verb, told)
        assert told.startswith(("receivers: got", "points: got"))


def test_moments_are_those_of_the_norm():
    for made, words in (
        (put(lambda f: f.moments, None), "got moments = None from Mine.footprint, expected a Moments"),
        (
            lambda f: eqx.tree_at(lambda f: f.moments.coefficients, f, f.moments.coefficients[:3]),
            "got moments of 3 coefficients from Mine.footprint, expected 5 with E_p, norm l2",
        ),
        (
            lambda f: eqx.tree_at(lambda f: f.moments.scale, f, f.moments.scale * np.nan),
            "got moments = nan from Mine.footprint, expected finite numbers >= 0",
        ),
    ):
        for verb, call in verbs(Mine(made), L2).items():
            if verb == "shadow_matrix":  # which needs no moments
                continue
            with pytest.raises(ValueError) as error:  # noqa: PT011
                call()
            assert words in str(error.value), verb


@pytest.mark.parametrize("name", TYPES)
def test_types_and_shapes_are_refused_when_traced_too(name):
    made, words = TYPES[name]
    for verb in (
        lambda view: warpopt.optimal_warp(view, throw=False),
        lambda view: warpopt.error_norm(view, WARP),
        lambda view: warpopt.shadow_matrix(view, WARP),
    ):
        with pytest.raises(ValueError) as error:  # noqa: PT011
            jax.jit(lambda light, verb=verb: verb(SceneView(CAMERA, light, Mine(made))))(LIGHT)
        assert words in str(error.value)


class OneOf(Receivers):
    """A box with the answer of this number: one program for all."""

    number: jax.Array
    made: ClassVar = [made for name, (made, _) in VALUES.items() if name != "NaN points"] + [lambda own: own]

    def footprint(self, camera, frame, objective):
        every = [made(box_footprint(camera, frame, objective)) for made in self.made]
        return jax.tree.map(lambda *v: jnp.stack(v)[self.number], *every)


def test_traced_values_of_nonsense_are_an_outcome():
    """Killed: a callback that ends the program, an optimum over nonsense that looks like one."""

    def solve(number):
        return warpopt.optimal_warp(SceneView(CAMERA, LIGHT, OneOf(number)), throw=False)

    *wrong, own = jax.jit(jax.vmap(solve))(jnp.arange(len(OneOf.made))).result.tolist()
    assert wrong == [warpopt.Outcome.not_finite] * 8
    assert own == warpopt.optimal_warp(SceneView(CAMERA, LIGHT, BOX)).result
    assert own != warpopt.Outcome.not_finite
    # Batched or not, one program is made of the same checks.
    assert warpopt.Outcome(int(jax.jit(solve)(0).result)) is warpopt.Outcome.not_finite


def test_traced_points_of_nonsense_are_an_outcome():
    """Points that a method makes are checked where they are made."""
    receivers = Mine(VALUES["NaN points"][0])

    def solve(light):
        return warpopt.optimal_warp(SceneView(CAMERA, light, receivers), throw=False)

    several = jax.jit(jax.vmap(solve))(jax.tree.map(lambda v: np.stack([v, v]), LIGHT))
    assert several.result.tolist() == [warpopt.Outcome.not_finite] * 2


EXTENTS = {
    "none": (lambda extent: None, "got None from Mine.depth_extent, expected (least, largest) eye depth"),
    "a number": (lambda extent: 5, "got 5 from Mine.depth_extent, expected (least, largest) eye depth"),
    "three": (lambda extent: (1, 2, 3), "got (1, 2, 3) from Mine.depth_extent, expected (least, largest) eye depth"),
    "text": (lambda extent: ("a", "b"), "got ('a', 'b') from Mine.depth_extent, expected (least, largest)"),
    "arrays": (lambda extent: (jnp.ones(2), 3.0), "got shapes (2,), () from Mine.depth_extent, expected two numbers"),
    "nonsense": (lambda extent: (-5, np.nan), "got (-5, nan) from Mine.depth_extent, expected 0 < least <= largest"),
    "reversed": (lambda extent: extent[::-1], "from Mine.depth_extent, expected 0 < least <= largest, or (inf, -inf)"),
    "empty": (lambda extent: (np.inf, -np.inf), "got (inf, -inf) from Mine.depth_extent, expected the extent of its"),
    "farther": (lambda extent: (90.0, 95.0), "got (90, 95) from Mine.depth_extent, expected one with the least"),
    "nearer": (lambda extent: (1.0, 2.0), "got (1, 2) from Mine.depth_extent, expected one with the least eye depth"),
    "NaN points": (
        lambda extent: PointReceivers(extent[0] * jnp.array([[0.0, np.nan, 1.0]])).depth_extent(CAMERA),
        "got (nan, nan) from Mine.depth_extent, expected 0 < least",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", EXTENTS)
def test_an_extent_of_nonsense_is_refused(name):
    made, words = EXTENTS[name]
    for verb, call in verbs(Mine(extent_made=made)).items():
        with pytest.raises(ValueError) as error:  # noqa: PT011
            call()
        assert words in str(error.value), verb


class Stub:
    """A profile of given answers."""

    def __init__(self, stretches: Any = None, widest: Any = 1.0):
        self.answers = stretches, widest

    def stretches(self, order, parts):
        return self.answers[0]

    def widest(self):
        return self.answers[1]


PROFILES = {
    "none": (None, "got None from Mine.depth_profile, expected a profile with stretches and widest"),
    "no stretches": (Stub(), "got None from Mine.depth_profile().stretches, expected Stretches"),
    "NaN": (Stub(Stretches(np.array([0.0, 1.0]), np.array([np.nan]), 1.0)), "got Stretches of value 1 from Mine"),
    "text": (Stub(Stretches("a", "b", 1.0)), "got Stretches that are no numbers from Mine"),
    "negative": (Stub(Stretches(np.array([0.0, 1.0]), np.ones(1), -1.0)), "got Stretches of value -1 from Mine"),
    "other lengths": (Stub(Stretches(np.array([0.0, 1.0]), np.ones(2), 1.0)), "got Stretches of value 1 from Mine"),
    "falling": (Stub(Stretches(np.array([1.0, 0.0]), np.ones(1), 1.0)), "got Stretches of value 1 from Mine"),
}  # fmt: skip


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_of_nonsense_is_refused(name):
    profile, words = PROFILES[name]
    view = SceneView(CAMERA, LIGHT, Mine(profile_made=lambda _: profile))
    for verb in (warpopt.lower_bound, warpopt.lower_bound_map):
        with pytest.raises(ValueError) as error:  # noqa: PT011
            verb(view)
        assert words in str(error.value)


@pytest.mark.parametrize("width", [np.nan, -1.0, None, "wide"])
def test_a_width_of_nonsense_is_refused(width):
    view = SceneView(CAMERA, LIGHT, Mine(profile_made=lambda _: Stub(widest=width)))
    with pytest.raises(ValueError, match=r"^receivers: got .* from Mine\.depth_profile\(\)\.widest, expected a finite"):
        warpopt.lower_bound(view, Objective("q"))


def test_numbers_that_are_no_arrays_are_taken():
    """Killed: a check that refuses what is right, or a dtype that is asked of a Python number."""
    own = Mine(lambda made: dataclasses.replace(made, axis=0.0, flat=False, empty=False), lambda extent: list(extent))
    got, expected = ({name: call() for name, call in verbs(r).items()} for r in (own, Mine()))
    np.testing.assert_array_equal(got["optimal_warp"].value, expected["optimal_warp"].value)
    np.testing.assert_array_equal(got["compare_rules"].values, expected["compare_rules"].values)
    gradient = jax.grad(lambda z: warpopt.optimal_warp(
        SceneView(eqx.tree_at(lambda c: c.near, CAMERA, z), LIGHT, own), throw=False).value)  # fmt: skip
    assert np.isfinite(gradient(1.0))

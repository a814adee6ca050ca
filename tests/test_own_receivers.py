"""Receivers of a user's own kind, and receivers reduced to their footprint, in every verb."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Objective, SceneView
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers, Receivers, WholeFrustum

EPS = np.finfo(float).eps
CAMERA = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
LIGHT = warpopt.DirectionalLight((0.3, -1.0, -0.2))
LIGHTS = jax.vmap(warpopt.DirectionalLight)(jnp.array([[0.3, -1.0, -0.2], [0.5, -1.0, 0.8]]))
L2 = Objective("pxq", "l2")
RULES = ["lispsm_paper", "psm"]
GROUND = np.where(np.arange(12)[:, None] < 5, 0, np.geomspace(90, 3, 12)[:, None] + np.arange(16))
POINTS = np.random.default_rng(4).uniform((-9, -1, -60), (9, 4, -5), (40, 3))
KINDS = {
    "frustum": WholeFrustum(),
    "box": ConvexBody.box((-20, 0, -80), (20, 8, -5)),
    "points": PointReceivers(POINTS, np.linspace(1, 3, 40)),
    "buffer": DepthBuffer(GROUND),
    "histogram": DepthHistogram((2.0, 9.0, 40.0), (3.0, 1.0)),
}


class OnlyFootprint(Receivers):
    """The least that a kind must know; it counts how often it is asked, which is once for each program compiled."""

    inner: Receivers
    asked: ClassVar[list[str]] = []

    def footprint(self, camera, frame, objective):
        self.asked.append(objective.title)
        return self.inner.footprint(camera, frame, objective)


class Whole(OnlyFootprint):
    """All that a kind may know."""

    measures = ("screen", "ground")

    def depth_extent(self, camera):
        return self.inner.depth_extent(camera)

    def depth_profile(self, camera, frame, objective, bins):
        return self.inner.depth_profile(camera, frame, objective, bins)


def verbs(view, objective):
    """Numbers of the verbs that need a footprint alone."""
    solution = warpopt.optimal_warp(view, objective)
    warp = warpopt.Warp.from_eta(jnp.array([0.05, 0.4, 1.0]), solution.footprint)
    numbers = [solution.warp.eta, solution.value, solution.residual, solution.margin, solution.excess]
    return [*numbers, warpopt.error_norm(view, warp, objective), warpopt.shadow_matrix(view, solution)]


@pytest.mark.thorough
def test_a_kind_that_only_knows_its_footprint_has_the_numbers_of_the_kind_it_wraps():
    """Killed: a verb that asks which kind receivers are, and takes another path for one that it does not know."""
    box = KINDS["box"]
    own, inner = (SceneView(CAMERA, LIGHT, receivers) for receivers in (OnlyFootprint(box), box))
    for got, expected in zip(verbs(own, L2), verbs(inner, L2), strict=True):
        np.testing.assert_allclose(got, expected, rtol=64 * EPS, atol=64 * EPS)


def test_a_kind_without_extent_and_profile_is_refused_in_words():
    """Killed: depths of the whole frustum in the place of an extent that is not known."""
    view = SceneView(CAMERA, LIGHT, OnlyFootprint(KINDS["box"]))
    with pytest.raises(ValueError, match=r"^receivers: got OnlyFootprint, which has no depth_profile, as lower bounds"):
        warpopt.lower_bound(view)
    with pytest.raises(ValueError, match=r"^receivers: got OnlyFootprint, which has no depth_profile, as lower bounds"):
        warpopt.lower_bound_map(view)
    for several in (view.receivers, view.reduced().receivers):
        one = jax.tree.map(lambda v: v[:1], LIGHTS)
        with pytest.raises(
            ValueError, match=r"^receivers: got OnlyFootprint, which has no depth_extent, as rules over"
        ):
            warpopt.compare_rules(SceneView(CAMERA, one, several), RULES)


@pytest.mark.thorough
def test_a_kind_that_knows_all_is_as_good_as_a_built_in_one():
    """Killed: rules that are told other depths than the kind's own; a bound that is looked up by class."""
    box = KINDS["box"]
    own, inner = (SceneView(CAMERA, LIGHTS, receivers) for receivers in (Whole(box), box))
    got, expected = (warpopt.compare_rules(view, RULES) for view in (own, inner))
    assert got.no_bound_because is None
    assert (got.ratio > 1.01).any()
    for name in ("eta", "values", "unwarped", "bound", "ratio", "over_bound"):
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=64 * EPS)
    own, inner = (SceneView(CAMERA, LIGHT, receivers) for receivers in (Whole(box), box))
    best, same = (warpopt.lower_bound_map(view) for view in (own, inner))
    assert best.value == same.value
    assert best.value == pytest.approx(warpopt.lower_bound(own), rel=8 * EPS)
    np.testing.assert_array_equal(best.s, same.s)


def test_an_extent_without_a_profile_has_rules_and_no_bound():
    """Killed: a bound of 0 or NaN without a word where the kind has no profile."""

    class NoProfile(OnlyFootprint):
        def depth_extent(self, camera):
            return self.inner.depth_extent(camera)

    got = warpopt.compare_rules(SceneView(CAMERA, LIGHTS, NoProfile(KINDS["box"])), RULES)
    expected = warpopt.compare_rules(SceneView(CAMERA, LIGHTS, KINDS["box"]), RULES)
    np.testing.assert_allclose(got.ratio, expected.ratio, rtol=64 * EPS)
    assert got.bound is None
    assert got.over_bound is None
    assert "got NoProfile, which has no depth_profile" in got.no_bound_because


def test_a_kind_takes_the_measures_that_it_names():
    """Killed: measures checked against a list of the built-in kinds."""
    ground = Objective("p", "l2", "ground")
    box = KINDS["box"]
    got, expected = (warpopt.optimal_warp(SceneView(CAMERA, LIGHT, r), ground) for r in (Whole(box), box))
    np.testing.assert_allclose(got.warp.eta, expected.warp.eta, rtol=64 * EPS)
    for receivers, words in (
        (OnlyFootprint(box), "'screen': it has weights"),
        (KINDS["points"], "'screen': it has weights"),
    ):
        view = SceneView(CAMERA, LIGHT, receivers)
        name = type(receivers).__name__
        for verb in (
            lambda v: warpopt.optimal_warp(v, ground),
            lambda v: warpopt.error_norm(v, expected, ground),
            lambda v: warpopt.lower_bound(v, ground),
            lambda v: v.footprint(ground),
            lambda v: v.reduced(ground),
        ):
            with pytest.raises(ValueError, match=rf"^measure: got 'ground' with {name}, expected {words}"):
                verb(view)
    with pytest.raises(ValueError, match=r"^measure: got 'axis' with Whole, expected one of 'screen', 'ground'"):
        warpopt.optimal_warp(SceneView(CAMERA, LIGHT, Whole(box)), Objective(measure="axis"))


def test_what_only_looks_like_receivers_is_none():
    class Alike:
        def footprint(self, camera, frame, objective):
            return None

    with pytest.raises(ValueError, match=r"^receivers: got .*, expected one of"):
        SceneView(CAMERA, LIGHT, Alike())
    with pytest.raises(TypeError, match="abstract"):
        Receivers()


@pytest.mark.thorough
def test_a_reduced_view_has_the_views_numbers_and_costs_one_pass():
    """Killed: `reduced` that hands the receivers on, moments of another objective, an extent that is lost.

    The kind is asked for its footprint when a program is compiled: `reduced` alone compiles one that asks.
    """
    Whole.asked.clear()
    view = SceneView(CAMERA, LIGHT, Whole(KINDS["box"]))
    reduced = view.reduced(L2)
    assert Whole.asked == [L2.title]
    numbers = verbs(reduced, L2)
    others = warpopt.optimal_warp(reduced).value, reduced.footprint(L2).start, reduced.reduced(L2).footprint(L2).mu
    one = SceneView(CAMERA, jax.tree.map(lambda v: v[:1], LIGHTS), reduced.receivers)
    compared = warpopt.compare_rules(one, RULES, L2)
    assert Whole.asked == [L2.title]
    for got, expected in zip(numbers, verbs(SceneView(CAMERA, LIGHT, KINDS["box"]), L2), strict=True):
        np.testing.assert_allclose(got, expected, rtol=64 * EPS, atol=64 * EPS)
    best = warpopt.optimal_warp(SceneView(CAMERA, LIGHT, KINDS["box"]))  # extents serve any norm inf
    expected = best.value, best.footprint.start, best.footprint.mu
    np.testing.assert_allclose(others, expected, rtol=64 * EPS)
    expected = warpopt.compare_rules(SceneView(CAMERA, one.light, KINDS["box"]), RULES, L2)
    np.testing.assert_allclose(compared.values, expected.values, rtol=64 * EPS)


def test_a_footprint_is_refused_where_it_does_not_hold():
    """Another camera, light or norm than it was made for, in every verb."""
    reduced = SceneView(CAMERA, LIGHT, KINDS["box"]).reduced(L2)
    moved = warpopt.Camera((0, 2.5, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
    turned = warpopt.DirectionalLight((0.3, -1.0, -0.21))
    warp = warpopt.optimal_warp(reduced, L2)
    verbs_of = (
        lambda v: warpopt.optimal_warp(v, L2),
        lambda v: warpopt.error_norm(v, warp, L2),
        lambda v: warpopt.shadow_matrix(v, warp),
        lambda v: v.footprint(L2),
        lambda v: v.reduced(L2),
    )
    for verb in verbs_of:
        with pytest.raises(ValueError, match=r"^camera: got another than the receivers were reduced for"):
            verb(SceneView(moved, LIGHT, reduced.receivers))
        with pytest.raises(ValueError, match=r"^light: got another than the receivers were reduced for"):
            verb(SceneView(CAMERA, turned, reduced.receivers))
    for objective in (Objective("p", "l2"), Objective("pxq", "l1"), Objective("pxq", "l2", "ground")):
        for verb in (warpopt.optimal_warp, lambda v, o: warpopt.error_norm(v, warp, o)):
            with pytest.raises(ValueError, match=r"^objective: got .* with receivers reduced for E_pxq, norm l2"):
                verb(reduced, objective)
    with pytest.raises(ValueError, match=r"^objective: got E_p, norm inf with receivers reduced for E_pxq, norm l2"):
        warpopt.optimal_warp(reduced, Objective(measure="axis"))
    with pytest.raises(ValueError, match=r"^light: got another than the receivers were reduced for"):
        warpopt.compare_rules(SceneView(CAMERA, LIGHTS, reduced.receivers), RULES, L2)  # the second of the two

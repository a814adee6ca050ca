"""Cascades where ranges are empty, bands and shares meet, receivers are at one depth, and receivers are many."""

import itertools

import jax
import numpy as np
import pytest

import warpopt
from warpopt import FrustumView, Objective, SceneView, ViewFrustum, cascades
from warpopt.receivers import ConvexBody, DepthBuffer, PointReceivers

CAMERA = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=0.5, far=100.0, half_fov=0.6)
LIGHT = warpopt.DirectionalLight((0.3, -1, -0.4))


def view_of(points, **how) -> SceneView:
    return SceneView(CAMERA, LIGHT, PointReceivers(points), **how)


def test_bands_and_unequal_shares_are_the_best_of_random_splits():
    """Also with maps that are not used, which take no band; the plan's splits are a split like any other."""
    rng = np.random.default_rng(2)
    view = FrustumView(ViewFrustum(1.0, 100.0, 0.52), 1.05)
    for overlap, shares in (
        (0.2, (1, 0.01, 1)), (0.2, (1, 0.01, 0.5)), (0.5, (1, 0.4, 0.01)), (0.5, (0.1, 1, 1)), (0.2, (0.01, 1, 0.3)),
    ):  # fmt: skip
        plan = cascades.plan(view, 3, overlap=overlap, shares=shares)
        again = cascades.errors(view, plan.splits, overlap=overlap, shares=shares)
        np.testing.assert_allclose(again.errors, plan.errors, rtol=1e-12)
        assert float(plan.lower) == pytest.approx(float(plan.value), rel=1e-9)
        assert (np.diff(plan.splits) >= 0).all()
        cuts = np.sort(100.0 ** rng.uniform(0, 1, (2000, 2)), -1)
        cuts[::4, 1], cuts[1::4, 0], cuts[2::4, 1] = cuts[::4, 0], 1, 100
        many = FrustumView(ViewFrustum(np.ones(2000), np.full(2000, 100.0), 0.52), 1.05)
        others = np.concatenate([np.ones((2000, 1)), cuts, np.full((2000, 1), 100.0)], -1)
        values = np.asarray(cascades.errors(many, others, overlap=overlap, shares=shares).value)
        assert values.min() >= float(plan.value) * (1 - 1e-9)
        assert values.min() < float(plan.value) * 1.2


def test_a_map_of_no_length_costs_nothing():
    """Over a frustum and over receivers, with a band too."""
    view = FrustumView(ViewFrustum(1.0, 100.0, 0.52), 1.05)
    two, three = (cascades.errors(view, at, overlap=0.2) for at in ([1, 10, 100], [1, 10, 100, 100]))
    np.testing.assert_allclose(three.errors, [*two.errors, 0], rtol=1e-12)
    seen = view_of([(s * z / 3, -z / 5, -z) for z in (2.0, 4.0, 7.0, 18.0) for s in (-1, 1)])
    two, three = (cascades.errors(seen, at, overlap=0.2) for at in ([2, 5, 18], [2, 5, 18, 18]))
    np.testing.assert_allclose(three.errors, [*two.errors, 0], rtol=1e-12)
    assert np.isnan(three.matrices()[0][2]).all()


@pytest.mark.thorough("storage")
@pytest.mark.parametrize("goal", [Objective("p"), Objective("storage"), Objective("p", "l2")], ids=lambda g: g.title)
def test_bands_over_few_receivers_are_those_of_exhaustive_search(goal):
    """Each map solved as a set of its own: up to its end, from the first that a band before its split lets in."""
    rng, size, overlap = np.random.default_rng(5), 6, 0.25
    mean, power = not goal.supremum, goal.order if not goal.supremum else 1

    @jax.jit
    @jax.vmap
    def alone(points, inside):
        receivers = PointReceivers(points, weights=inside.astype(float) if mean else None)
        return warpopt.optimal_warp(SceneView(CAMERA, LIGHT, receivers), goal, throw=False).value

    gained = 0
    for _ in range(12):
        z = np.sort(np.exp(rng.uniform(np.log(2), np.log(30), size)))
        points = np.stack([rng.uniform(-0.5, 0.5, size) * z, rng.uniform(-0.5, 0.5, size) * z, -z], 1)
        spans = [(i, j) for i in range(size) for j in range(i + 1, size + 1)]
        # A split lies before the next receiver, by as little as can be.
        first = {i: int(np.searchsorted(z, z[i] * (1 - overlap) * (1 - 1e-7))) if i else 0 for i in range(size)}
        inside = np.array([[first[i] <= k < j for k in range(size)] for i, j in spans])
        index = np.where(inside, np.arange(size), np.array([first[i] for i, _ in spans])[:, None])
        own = np.array([j - i for i, j in spans]) / size
        values = np.asarray(alone(points[index], inside)) ** power * (own if mean else 1)
        table = dict(zip(spans, values, strict=True))
        together = sum if mean else max
        least = min(
            together((table[0, i], table[i, j], table[j, size])) for i, j in itertools.combinations(range(1, size), 2)
        )
        receivers = PointReceivers(points, weights=np.ones(size) if mean else None)
        plan = cascades.plan(SceneView(CAMERA, LIGHT, receivers), 3, goal, overlap=overlap)
        assert float(plan.value) == pytest.approx(least ** (1 / power), rel=1e-6, abs=1e-12)
        gained += any(first[i] < i for i in range(1, size))
    assert gained > 6


def test_receivers_at_one_depth_are_the_finest_map_s():
    wall = view_of([(-1, 0, -10), (1, 0, -10), (0, 3, -10), (0, 1, -10)])
    alone = float(warpopt.optimal_warp(wall).value)
    for shares, used in ((None, 0), ((1, 0.1), 0), ((0.1, 1), 1)):
        for goal in (Objective(), Objective("p", "l2")):
            plan = cascades.plan(wall, 2, goal, shares=shares)
            one = alone if goal.supremum else float(warpopt.optimal_warp(wall, goal).value)
            assert float(plan.value) == pytest.approx(one, rel=1e-12)
            assert float(plan.errors[1 - used]) == 0
            assert np.isnan(plan.matrices()[0][1 - used]).all()
    number, texels = cascades.count(wall, 0.5)
    own = float(warpopt.optimal_warp(wall, Objective("storage")).value)
    np.testing.assert_allclose(texels, own + 0.5 * np.arange(1, 17), rtol=1e-9)
    assert number == 1


def test_one_map_is_the_optimal_warp_for_means_too():
    """Of receivers that cannot be counted one by one: only their parts could not be weighed."""
    for receivers in (None, ConvexBody.box((-5, -3, -40), (5, 1, -4))):
        view, goal = SceneView(CAMERA, LIGHT, receivers), Objective("p", "l2")
        found = cascades.plan(view, 1, goal)
        assert float(found.value) == pytest.approx(float(warpopt.optimal_warp(view, goal).value), rel=1e-12)


def test_means_give_a_coarser_map_less():
    """Over a frustum and over few receivers: no split of a scan is better, and the split moves."""
    frustum, goal = FrustumView(ViewFrustum(1.0, 100.0, 0.52), 1.05), Objective("p", "l2")
    points = view_of([(s * z / 3, -z / 5, -z) for z in np.geomspace(1, 100, 12) for s in (-1, 1)])
    for view in (frustum, points):
        even, coarse = (cascades.plan(view, 2, goal, shares=shares) for shares in (None, (1, 0.2)))
        scan = np.geomspace(1.05, 99, 25)
        values = [float(cascades.errors(view, [1, at, 100], goal, shares=(1, 0.2)).value) for at in scan]
        assert float(coarse.value) <= min(values) * (1 + 1e-9)
        assert float(coarse.splits[1]) > 1.2 * float(even.splits[1])


def test_means_over_frusta_beyond_their_numbers():
    """Pieces that have numbers make the plan; a piece that has none is an error."""
    deep, goal = FrustumView(ViewFrustum(1.0, 1e15, 0.52), 1.05), Objective("p", "l2")
    plan = cascades.plan(deep, 4, goal)
    assert (np.diff(plan.splits) > 0).all()
    assert np.isfinite(plan.errors).all()
    with pytest.raises(RuntimeError, match=r"cascades: 1 of 1 have no error: .*far/near beyond 7.9e13"):
        cascades.plan(deep, 1, goal)


@pytest.mark.parametrize("goal", [Objective("p", "l2"), pytest.param(Objective("edge"), marks=pytest.mark.thorough)],
                         ids=lambda goal: goal.title)  # fmt: skip
def test_means_over_many_pixels_are_split_well(goal):
    """More than are taken one by one: a floor and a pillar, against 12 other splits; cells lose a few per cent."""
    rows = np.linspace(0.1, 0.6, 72)[:, None] * np.ones((72, 96))
    depth = 2.0 / rows
    depth[20:60, 40:46] = 6.0
    view = SceneView(CAMERA, LIGHT, DepthBuffer(depth), screen=(96, 72), shadow_map=(64, 64))
    plan = cascades.plan(view, 2, goal)
    near, far = float(plan.splits[0]), float(plan.splits[-1])
    values = [
        float(cascades.errors(view, [near, at, far], goal).value)
        for at in near * (far / near) ** np.linspace(0.04, 0.96, 12)
    ]
    assert float(plan.value) <= min(values) * 1.05
    assert max(values) > 1.2 * float(plan.value)


def test_means_over_bodies_weigh_their_parts():
    """The whole frustum's plan is that of the frustum by itself; a box's measure up to a depth, by hand."""
    theta, goal = 1.05, Objective("p", "l2")
    alone = FrustumView(ViewFrustum(1.0, 100.0, 0.52), theta)
    scene = cascades.counts.in_world(alone)
    one, other = (cascades.plan(view, 3, goal) for view in (alone, scene))
    np.testing.assert_allclose(other.value, one.value, rtol=1e-6)
    np.testing.assert_allclose(other.splits, one.splits, rtol=1e-2)
    box, depths = ConvexBody.box((-1, -0.5, -9), (1, 1, -4)), np.array([3.0, 4.0, 5.0, 9.0, np.inf])
    z = np.clip(depths, 4, 9)
    for measure, exact in (
        ("volume", 3 * (z - 4)),
        ("screen", 3 * (1 / 4 - 1 / z)),
        ("log_depth", (4**-2 - z**-2) * 1.5),
    ):
        made = jax.jit(lambda measure=measure: box.mass_up_to(CAMERA, Objective("p", "l2", measure))(depths))()
        np.testing.assert_allclose(made, exact, rtol=1e-9, atol=1e-6)  # a flat body is thickened by sqrt(eps)


@pytest.mark.thorough
def test_a_box_is_split_for_a_mean():
    """No split of a scan is better."""
    view, goal = SceneView(CAMERA, LIGHT, ConvexBody.box((-1, -0.5, -9), (1, 1, -4))), Objective("p", "l2")
    plan = cascades.plan(view, 2, goal)
    others = [cascades.errors(view, [4, at, 9], goal) for at in np.linspace(4.2, 8.8, 9)]
    assert float(plan.value) <= min(float(each.value) for each in others) * (1 + 1e-6)

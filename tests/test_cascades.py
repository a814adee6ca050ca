"""Cascades: what docs/cascades.md states, on raw geometry, its tables, exhaustive search, and what is refused."""

import itertools

import equinox as eqx
import jax
import numpy as np
import pytest

import warpopt
from warpopt import FrustumView, Objective, SceneView, ViewFrustum, cascades
from warpopt.cascades import splits
from warpopt.cascades.chain import pairs_of
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers

PHI = float(np.deg2rad(30))
ANGLES = np.deg2rad([90.0, 60.0, 30.0])
CAMERA = warpopt.Camera((0, 2, 0), (0, -0.05, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.6, aspect=1.6)
LIGHT = warpopt.DirectionalLight((0.3, -1, -0.4))


def view_of(theta, ratio=1000.0, near=1.0) -> FrustumView:
    return FrustumView(ViewFrustum(near, near * ratio, PHI), theta)


@pytest.mark.parametrize(
    ("metric", "log", "practical", "plain", "uniform", "flat"),
    [
        ("p", (2.4, 2.0, 1.7), (5.8, 4.6, 3.7), (65, 50, 38), (8.1, 6.4, 5.0), (128, 99, 74)),
        ("pxq", (10, 4.5, 1.2), (9.7, 8.4, 39), (6270, 2540, 640), (15, 13, 86), (24100, 9750, 2450)),
    ],
)
def test_what_published_splits_lose(metric, log, practical, plain, uniform, flat):
    """At K = 4 and R = 1000, to two digits."""
    view, objective = view_of(ANGLES), Objective(metric)
    best = cascades.plan(view, 4, objective).value

    def over(scheme, warp):
        return np.asarray(cascades.errors(view, scheme(1.0, 1000.0, 4), objective, warp=warp).value / best)

    for told, scheme, warp in (
        (log, splits.logarithmic, False), (practical, splits.practical, True), (plain, splits.practical, False),
        (uniform, splits.uniform, True), (flat, splits.uniform, False),
    ):  # fmt: skip
        np.testing.assert_allclose(over(scheme, warp), told, rtol=0.03)


@pytest.mark.parametrize(
    ("name", "near", "far", "ratios", "lost"),
    [
        ("godot", 0.05, 100.0, (200, 2, 2.5, 2), (72, 5.3, 5450, 9.9)),
        ("unity", 0.3, 50.0, (11.2, 3.0, 2.3, 2.1), (5.4, 1.8, 26, 2.3)),
        ("unreal", 0.1, 200.0, (155, 4.0, 3.3), (40, 3.4, 2070, 5.3)),
        ("three", 0.1, 1000.0, (1680, 2.1, 2.8), (337, 8.3, 1.7e5, 18)),
    ],
)
def test_what_engines_splits_lose(name, near, far, ratios, lost):
    """At theta = 60 degrees (docs/cascades.md): E_p and E_pxq, without and with warps, over the best of as many."""
    made = splits.ENGINES[name](near, far)
    np.testing.assert_allclose(made[1:] / made[:-1], ratios, rtol=0.03)
    view = FrustumView(ViewFrustum(near, far, PHI), float(np.deg2rad(60)))
    found = []
    for metric, warp in itertools.product(("p", "pxq"), (False, True)):
        best = cascades.plan(view, len(ratios), Objective(metric)).value
        found.append(float(cascades.errors(view, made, Objective(metric), warp=warp).value / best))
    np.testing.assert_allclose(found, lost, rtol=0.03)


@pytest.mark.parametrize(
    ("name", "near", "far", "count", "depths"),
    [
        ("godot", 1, 101, 4, (1, 11, 21, 51, 101)), ("godot", 1, 101, 2, (1, 11, 101)),
        ("unity", 1, 100, 4, (1, 6.7, 20, 46.7, 100)), ("unity", 1, 100, 3, (1, 10, 30, 100)),
        ("unity", 1, 100, 2, (1, 25, 100)), ("unreal", 1, 14, 3, (1, 2, 5, 14)),
        ("bevy", 0.1, 160, 3, (0.1, 10, 40, 160)), ("three", 1, 100, 2, (1, 30.25 + 0.6975, 100)),
        ("filament", 1, 9, 4, (1, 2, 3, 5, 9)), ("filament", 1, 9, 2, (1, 2, 9)),
    ],
)  # fmt: skip
def test_engines_split_where_their_sources_say(name, near, far, count, depths):
    """Worked by hand from the sources named in each docstring: from the eye or from near, in all of its numbers."""
    np.testing.assert_allclose(splits.ENGINES[name](near, far, count), depths, rtol=1e-12)
    np.testing.assert_array_equal(splits.ENGINES[name](near, far, 1), (near, far))


@pytest.mark.parametrize("count", [1_000, pytest.param(100_000, marks=pytest.mark.thorough)])
def test_no_certificate_is_violated(count):
    """On random frusta with random splits, shares and bands: min e <= optimum <= max e, the optimum by equal ratios."""
    rng = np.random.default_rng(4)
    ratio = np.exp(rng.uniform(np.log(3), np.log(1e5), count))
    frustum = ViewFrustum(np.ones(count), ratio, rng.uniform(0.05, 1.4, count))
    view = FrustumView(frustum, rng.uniform(0, np.pi, count))
    cuts = np.sort(ratio[:, None] ** rng.uniform(0.02, 0.98, (count, 2)), -1)
    chosen = np.concatenate([np.ones((count, 1)), cuts, ratio[:, None]], -1)
    for overlap, shares in ((0.0, None), (0.2, None), (0.0, (1.0, 0.6, 0.3))):
        best = cascades.plan(view, 3, overlap=overlap, shares=shares)
        any_split = cascades.errors(view, chosen, overlap=overlap, shares=shares)
        low, high = np.asarray(any_split.lower), np.asarray(any_split.value)
        optimum = np.asarray(best.value)
        assert (low <= optimum * (1 + 1e-9)).all()
        assert (optimum <= high * (1 + 1e-9)).all()
        if shares is None:
            np.testing.assert_allclose(best.lower, optimum, rtol=1e-8)  # equal errors: the optimum
    assert (high / low).max() > 2  # or nothing would be tested


def test_bands_and_shares_balance():
    view = view_of(ANGLES)
    bands = cascades.plan(view, 4, overlap=0.2)
    np.testing.assert_allclose(bands.starts[..., 1:], 0.8 * bands.splits[..., 1:-1])
    ratios = bands.splits[..., 1:] / bands.starts
    np.testing.assert_allclose(ratios, np.broadcast_to(ratios[..., :1], ratios.shape), rtol=1e-12)
    shared = cascades.plan(view_of(float(np.deg2rad(60))), 4, shares=(1, 1, 0.5, 0.5))
    np.testing.assert_allclose(shared.splits[1:] / shared.splits[:-1], (10.6, 10.6, 2.98, 2.98), rtol=3e-3)
    np.testing.assert_allclose(shared.errors, np.full(4, shared.value), rtol=1e-9)
    # A share too small for any piece of its own is not used.
    alone = warpopt.optimal_warp(view_of(float(np.deg2rad(60)), 50.0)).value
    for shares, at in (((1.0, 1e-3), 50.0), ((1e-3, 1.0), 1.0)):
        tiny = cascades.plan(view_of(float(np.deg2rad(60)), 50.0), 2, shares=shares)
        assert float(tiny.splits[1]) == at
        np.testing.assert_allclose((tiny.value, tiny.lower), alone, rtol=1e-12)
        assert tiny.lower_because.endswith("for 1 cascades, as many as hold more than one depth")


@pytest.mark.parametrize(
    ("metric", "measure", "degrees", "lost", "at"),
    [
        ("p", "volume", 90, 3.0, (250.75, 500.5, 750.25)), ("p", "screen", 90, 1.48, (30.8, 159, 458)),
        ("pxq", "screen", 60, 1.41, (22.9, 136, 432)),
    ],
)  # fmt: skip
def test_means_have_other_splits(metric, measure, degrees, lost, at):
    """docs/cascades.md: what the logarithmic split loses, and where the best one is."""
    view, objective = view_of(float(np.deg2rad(degrees))), Objective(metric, "l2", measure)
    best = cascades.plan(view, 4, objective)
    log = cascades.errors(view, splits.logarithmic(1.0, 1000.0, 4), objective)
    assert float(log.value / best.value) == pytest.approx(lost, rel=6e-3)
    np.testing.assert_allclose(best.splits[1:-1], at, rtol=6e-3)
    assert np.isnan(best.lower)
    assert "not proved" in best.lower_because
    if (metric, measure) == ("p", "screen"):  # once: one cascade looks at no split
        one = cascades.plan(view, 1, objective).value
        np.testing.assert_allclose(one, warpopt.optimal_warp(view, objective).value, rtol=1e-12)


def test_equal_ratios_need_the_fewest_texels():
    """docs/cascades.md: without warps always; with them within 2.6 %, here of 24 other chains of two maps."""
    rng = np.random.default_rng(6)
    theta = float(np.deg2rad(60))
    ratio = 100.0

    def plain(cuts):  # (max E_p)(max E_q) is proportional to mu times the far width over near squared
        depths = np.concatenate([np.ones((len(cuts), 1)), ratio ** np.sort(cuts), np.full((len(cuts), 1), ratio)], 1)
        near, far = depths[:, :-1], depths[:, 1:]
        mu = np.asarray(FrustumView(ViewFrustum(near, far, PHI), theta).mu)
        return (mu * far / near**2).sum(1)

    assert plain(rng.uniform(0.01, 0.99, (10_000, 2))).min() >= plain(np.array([[1 / 3, 2 / 3]]))[0]
    scene, storage = cascades.counts.in_world(view_of(theta, ratio)), Objective("storage")
    needs = [
        float(cascades.errors(scene, [1.0, ratio**u, ratio], storage).errors.sum())
        for u in (0.5, *np.linspace(0.05, 0.95, 24))
    ]
    assert min(needs) >= needs[0] / 1.026


def test_the_best_chain_of_a_mean_is_stationary():
    """docs/cascades.md: G'(u_k) e^(-u_k) = G'(u_k+1) - G(u_k+1), G the mean times the measure of a piece of ratio e^u,
    from `optimal_warp` of frusta; its derivative by differences."""
    objective = Objective("p", "l2", "screen")
    plan = cascades.plan(view_of(float(np.deg2rad(90))), 4, objective)
    u = np.diff(np.log(np.asarray(plan.splits)))
    step = 1e-4

    def g(u):
        frustum = ViewFrustum(np.ones_like(u), np.exp(u), PHI)
        value = np.asarray(warpopt.optimal_warp(FrustumView(frustum, float(np.deg2rad(90))), objective).value)
        return value**2 * np.expm1(u)  # dm = dz

    slope = (g(u + step) - g(u - step)) / (2 * step)
    left, right = slope[:-1] * np.exp(-u[:-1]), slope[1:] - g(u)[1:]
    np.testing.assert_allclose(left, right, rtol=2e-3)  # splits are found to 1e-4 of their interval


def test_only_pairs_that_a_chain_may_have_are_solved():
    """By enumeration of all chains: of three cascades and more any pair, of two those that have an end of the range."""
    for inner in (1, 2, 3):
        chains = ([0, *chosen, 4] for chosen in itertools.combinations_with_replacement(range(5), inner))
        expected = {pair for chain in chains for pair in itertools.pairwise(chain)}
        assert set(map(tuple, pairs_of(5, inner).tolist())) == expected


def sets_of_points(count: int, size: int):
    rng = np.random.default_rng(9)
    for _ in range(count):
        z = np.sort(np.exp(rng.uniform(np.log(2), np.log(200), size)))
        eye = np.stack([rng.uniform(-0.8, 0.8, size) * z, rng.uniform(-0.5, 0.5, size) * z, z], 1)
        yield eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)


GOALS = [Objective("p"), Objective("pxq"), Objective("storage"), Objective("p", "l2"), Objective("edge")]


@pytest.mark.parametrize(
    ("count", "goal"),
    [(40, GOALS[0]), *(pytest.param(200, goal, marks=pytest.mark.thorough) for goal in GOALS)],
    ids=lambda value: value if isinstance(value, int) else value.title,
)
def test_plans_over_receivers_are_those_of_exhaustive_search(count, goal):
    """Sets of eight points, every split between them, each interval solved as receivers of its own."""
    size = 8
    spans = [(i, j) for i in range(size) for j in range(i + 1, size + 1)]
    inside = np.array([[i <= k < j for k in range(size)] for i, j in spans])
    # Points outside of an interval are put onto its first one, and weigh nothing.
    index = np.where(inside, np.arange(size), np.array([i for i, _ in spans])[:, None])
    mean = not goal.supremum
    power = goal.order if mean else 1

    @jax.jit
    @jax.vmap
    def alone(points, inside):
        receivers = PointReceivers(points, weights=inside.astype(float) if mean else None)
        solution = warpopt.optimal_warp(SceneView(CAMERA, LIGHT, receivers), goal, throw=False)
        return solution.value

    proved = 0
    for points in sets_of_points(count, size):
        values = np.asarray(alone(points[index], inside)) ** power * (inside.mean(1) if mean else 1)
        table = dict(zip(spans, values, strict=True))
        together = sum if mean else max
        chains = ((table[0, i], table[i, j], table[j, size]) for i in range(1, size) for j in range(i + 1, size))
        least = min(map(together, chains)) ** (1 / power)
        receivers = PointReceivers(points, weights=np.ones(size) if mean else None)
        made = cascades.plan(SceneView(CAMERA, LIGHT, receivers), 3, goal)
        assert float(made.value) == pytest.approx(least, rel=1e-9, abs=1e-12)
        if np.isfinite(made.lower):
            proved += 1
            assert float(made.lower) <= least * (1 + 1e-9)
    assert proved > count / 10 or mean


def test_inclusion():
    """What holds less has no larger error, with and without warps."""
    for points in sets_of_points(5, 12):
        view = SceneView(CAMERA, LIGHT, PointReceivers(points), lateral="free")
        z = np.sort(np.asarray(CAMERA.to_eye(points))[:, 2])
        first, last = z[[0, 0, 2, 3]], z[[-1, 7, 7, 6]]
        for name in ("pxq", "storage"):
            _, found = cascades.over_scene.solved_between(view, first, last, Objective(name))
            for errors in (np.asarray(found.value), np.asarray(found.unwarped)):
                assert (np.diff(errors) <= 1e-9 * errors[0]).all()
                assert errors[-1] < 0.9 * errors[0]


def test_each_cascade_has_its_map():
    points = next(sets_of_points(1, 60))
    view = SceneView(CAMERA, LIGHT, PointReceivers(points), screen=(640, 400), shadow_map=(512, 512),
                     warp_direction="gradient")  # fmt: skip
    made = cascades.plan(view, 3, Objective("pxq"))
    assert np.isnan(made.lower)
    assert "direction of its own" in made.lower_because
    matrices, ends = made.matrices(casters=points)
    z = np.asarray(CAMERA.to_eye(points))[:, 2]
    for k in range(3):
        mine = points[(z >= float(made.starts[k])) & (z <= float(ends[k]))]
        clip = np.c_[mine, np.ones(len(mine))] @ np.asarray(matrices[k]).T
        assert (clip[:, 3] > 0).all()
        assert np.abs(clip[:, :3] / clip[:, 3:]).max() <= 1 + 1e-9
    assert float(ends[-1]) >= z.max() * (1 - 1e-12)
    straight = SceneView(CAMERA, LIGHT, PointReceivers(points), screen=(640, 400), shadow_map=(512, 512))
    empty = cascades.errors(straight, [float(z.min()), 1.01 * float(z.max()), 400.0], Objective("pxq"))
    assert np.isnan(empty.matrices()[0][1]).all()
    assert float(empty.errors[1]) == 0
    assert float(empty.lower) == float(empty.value)  # one cascade holds something: of one, no split is better
    assert empty.lower_because.endswith("for 1 cascades, as many as hold more than one depth")


@pytest.mark.thorough
def test_pixels_and_bodies_are_split_too():
    # More pixels than are taken one by one: cells are split, and the plan holds for the pixels themselves.
    many = np.geomspace(3, 60, 80)[::-1, None] * np.ones((80, 64))
    wide = SceneView(CAMERA, LIGHT, DepthBuffer(many), screen=(640, 400), shadow_map=(512, 512))
    plan = cascades.plan(wide, 3, Objective("pxq"))
    assert (np.diff(plan.splits) > 0).all()
    assert float(plan.value) <= 1.1 * float(plan.lower)
    for other in ("uniform", "logarithmic"):
        given = splits.SCHEMES[other](float(plan.splits[0]), float(plan.splits[-1]), 3)
        assert float(plan.value) <= float(cascades.errors(wide, given, Objective("pxq")).value) * (1 + 1e-9)
    # Few pixels, of which two rows count: a mean, whose programs compile faster in E_p than over a texel's edges.
    depth = np.geomspace(3, 60, 24)[::-1, None] * np.ones((24, 32))
    edges = np.zeros((24, 32))
    edges[8] = edges[20] = 1
    weighed = SceneView(CAMERA, LIGHT, DepthBuffer(depth, weights=edges), screen=(640, 400), shadow_map=(512, 512))
    mean = cascades.plan(weighed, 2, Objective("p", "l1"))
    log = cascades.errors(weighed, splits.logarithmic(3.0, 60.0, 2), Objective("p", "l1"))
    assert float(mean.value) <= float(log.value) * (1 + 1e-9)
    # Without an objective: by the weights where there are some, else the logarithm.
    np.testing.assert_array_equal(cascades.plan(weighed, 2).splits, mean.splits)
    plain = eqx.tree_at(lambda v: v.receivers, weighed, DepthBuffer(depth))
    np.testing.assert_allclose(cascades.plan(plain, 2).splits, splits.logarithmic(3.0, 60.0, 2), rtol=1e-6)
    box = SceneView(CAMERA, LIGHT, ConvexBody.box((-20, -1, -90), (20, 5, -4)))
    body = cascades.plan(box, 2, Objective())
    assert float(body.lower) <= float(body.value) <= 1.001 * float(body.lower)


@pytest.mark.thorough
def test_maps_that_are_turned_only_for_a_gain_prove_less():
    """By that factor; without warps each lies along its own warp's direction, which proves nothing."""
    points = next(sets_of_points(1, 8))
    view = SceneView(
        CAMERA, LIGHT, PointReceivers(points), warp_direction="best", turn_only_if=1.5, lateral="free"
    )  # fmt: skip
    z = np.sort(np.asarray(CAMERA.to_eye(points))[:, 2])
    halves = [z[0], (z[3] + z[4]) / 2, z[7]]
    made = cascades.errors(view, halves, Objective("pxq"))
    assert float(made.lower) == pytest.approx(float(made.errors.min()) / 1.5, rel=1e-12)
    plain = cascades.errors(view, halves, Objective("pxq"), warp=False)
    assert np.isnan(plain.lower)
    assert "direction of its own" in plain.lower_because


@pytest.mark.parametrize("weights", [None, "depth", (1.0, 3.0, 0.5)])
def test_histograms_are_split_for_means(weights):
    """Each cascade counts as its bins do, cut ones by their share; the plan is as good as any split of a scan."""
    bins = DepthHistogram([2.0, 6.0, 20.0, 80.0], [5.0, 2.0, 1.0], weights=weights)
    view = SceneView(CAMERA, LIGHT, bins)
    mean = Objective("q", "l2")
    plan = cascades.plan(view, 2, mean)
    scan = [cascades.errors(view, [2.0, z, 80.0], mean) for z in np.geomspace(2.5, 70, 12)]
    assert float(plan.value) <= min(float(each.value) for each in scan) * (1 + 1e-4)
    # The whole is the mean of the parts: of two maps without warps, with one map's axes, it is one map's norm.
    inner = float(plan.splits[1])
    per_unit = np.array([5.0, 2.0, 1.0]) / [4.0, 14.0, 60.0] * (weights if isinstance(weights, tuple) else 1)
    power = 2 if weights == "depth" else 1

    def mass(low, high):
        a, b = np.clip([2.0, 6.0, 20.0], low, high), np.clip([6.0, 20.0, 80.0], low, high)
        return (per_unit * (b**power - a**power)).sum()

    shares = np.array([mass(2.0, inner), mass(inner, 80.0)]) / mass(2.0, 80.0)
    np.testing.assert_allclose(float(plan.value) ** 2, (shares * np.asarray(plan.errors) ** 2).sum(), rtol=1e-9)


def test_orthographic_cameras_have_equal_splits():
    """Errors do not depend on the depth: lengths count, not ratios; also in what `count` says."""
    camera = warpopt.Camera.orthographic((0, 20, 0), (0, -1, -1), (0, 1, 0), 1.0, 100.0, half_height=10.0)
    view = SceneView(camera, LIGHT, PointReceivers([(0.0, 0.0, 0.0), (0.0, 0.0, -20.0), (3.0, 1.0, -9.0)]))
    made = np.asarray(cascades.plan(view, 4).splits)
    np.testing.assert_allclose(np.diff(made), np.diff(made).mean(), rtol=1e-12)


@pytest.mark.parametrize("overlap", [0.0, 0.2])
def test_one_solve_of_a_frustum_serves_all_its_cascades(overlap):
    """What the plan says of each is what each has by itself: error, eta, and the warp's place along the view."""
    for warp in (True, False):
        plan = cascades.plan(view_of(ANGLES), 3, Objective("pxq"), overlap=overlap, warp=warp)
        alone = cascades.errors(view_of(ANGLES), plan.splits, Objective("pxq"), overlap=overlap, warp=warp)
        for one, other in zip(jax.tree.leaves((plan.errors, plan.warps)), jax.tree.leaves((alone.errors, alone.warps)),
                              strict=True):  # fmt: skip
            np.testing.assert_allclose(one, other, rtol=1e-12)


def test_splits_in_steps_cover_and_stay():
    """They cover the range and lie at powers; a range that grows and shrinks by less than a step moves none of them."""
    random = np.random.default_rng(5)
    before, moves, alone = None, 0, 0
    last = None
    for t in range(200):
        near, far = 2 * 1.1 ** (0.5 + 0.3 * np.sin(t)), 90 * 1.1 ** random.uniform(-0.4, 0.4)
        exact = np.asarray(splits.logarithmic(near, far, 4))
        made = np.asarray(splits.stepped(exact, 1.1, before))
        places = np.log(made) / np.log(1.1)
        np.testing.assert_allclose(places, np.round(places), atol=1e-9)
        assert made[0] <= near * (1 + 1e-6)
        assert made[-1] >= far * (1 - 1e-6)
        assert (np.abs(np.log(made / exact) / np.log(1.1)) < [2, 1, 1, 1, 2]).all()
        fresh = np.asarray(splits.stepped(exact, 1.1))
        moves += before is not None and not np.array_equal(made, before)
        alone += last is not None and not np.array_equal(fresh, last)
        before, last = made, fresh
    assert moves <= 4 < 50 < alone
    for wrong, words in (([1.0, 2.0], "previous: got shape"), ([1.0, 2.0, np.nan], "previous")):
        with pytest.raises(ValueError, match=words):
            splits.stepped([1.0, 2.0, 3.0], 1.1, wrong)


@pytest.mark.parametrize(
    ("ratio", "maps", "warped", "plain"),
    [
        (1e2, 1, (21.5, 25.8, 119, 979, 979), (2150, 1340, 979, 979, 979)),
        (1e2, 4, (1.88, 2.58, 3.91, 3.92, 3.92), (5.94, 4.55, 3.92, 3.92, 3.92)),
        (1e3, 2, (8.87, 10.8, 33.3, 135, 135), (280, 181, 135, 135, 135)),
        (1e3, 4, (2.68, 3.42, 6.93, 8.54, 8.54), (15.1, 10.6, 8.54, 8.54, 8.54)),
        (1e5, 4, (5.83, 7.22, 19.1, 52.6, 52.6), (104, 69.2, 52.6, 52.6, 52.6)),
    ],
)
def test_storage_over_the_bound(ratio, maps, warped, plain):
    """K S(R^(1/K)) over the bound (T60) at 90, 60, 30, 10 and 0 degrees, to three digits."""
    for degrees, *told in zip((90, 60, 30, 10, 0), warped, plain, strict=True):
        view = view_of(float(np.deg2rad(degrees)), ratio)
        bound = float(warpopt.lower_bound(cascades.counts.in_world(view), Objective("storage")))
        found = [float(cascades.count(view, warp=warp)[1][maps - 1]) / bound for warp in (True, False)]
        np.testing.assert_allclose(found, told, rtol=5e-3)


def test_maps_of_a_scene_are_counted_with_what_each_holds():
    """Eight of them: the sum of the errors of the logarithmic split, and the price."""
    points = next(sets_of_points(1, 8))
    view, objective = SceneView(CAMERA, LIGHT, PointReceivers(points)), Objective("storage")
    totals = cascades.count(view, 0.25)[1]
    z = np.asarray(CAMERA.to_eye(points))[:, 2]
    each = cascades.errors(view, splits.logarithmic(z.min(), z.max(), 8), objective).errors
    assert float(totals[7]) == pytest.approx(float(each.sum()) + 8 * 0.25, rel=1e-9)


@pytest.mark.parametrize("shares", [None, pytest.param((1.0, 0.5, 0.3), marks=pytest.mark.thorough)])
def test_gradients_are_those_of_the_optimum(shares):
    """Also where splits are found by bisection; and compiled, as a part of a user's program."""

    def value(theta, far):
        return cascades.plan(FrustumView(ViewFrustum(1.0, far, PHI), theta), 3, shares=shares).value

    assert float(jax.jit(value)(1.1, 300.0)) == pytest.approx(float(value(1.1, 300.0)), rel=1e-12)
    found = jax.grad(value, (0, 1))(1.1, 300.0)
    step = 1e-5
    exact = ((value(1.1 + step, 300.0) - value(1.1 - step, 300.0)) / (2 * step),
             (value(1.1, 300.0 + step) - value(1.1, 300.0 - step)) / (2 * step))  # fmt: skip
    np.testing.assert_allclose(found, exact, rtol=1e-6)


VIEW = view_of(1.0)
HORIZON = SceneView(
    warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), 0.1, np.inf, 0.5),
    LIGHT,
    warpopt.receivers.GroundPlane((0, 1, 0), 0),
)
ENDLESS = SceneView(warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=np.inf, half_fov=0.6), LIGHT)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cascades.plan(VIEW, 0), "count: got 0"), (lambda: cascades.plan(VIEW, 17), "count: got 17"),
        (lambda: cascades.plan(VIEW, 2, overlap=1.0), "overlap"), (lambda: cascades.plan(VIEW, 2, overlap=-1), "over"),
        (lambda: cascades.plan(VIEW, 2, shares=(1, 0)), "shares"), (lambda: cascades.plan(VIEW, 2, shares=(1,)), "sh"),
        (lambda: cascades.plan(view_of(1.0, 1.1), 2, overlap=0.2), "far: got 1.1, expected far/near > 1.25"),
        (lambda: cascades.plan(CAMERA, 2), "view: got"), (lambda: cascades.plan(VIEW, 2, "p"), "objective"),
        (lambda: cascades.plan(VIEW, 2, warp=1), "warp"), (lambda: cascades.errors(VIEW, [1.0]), "splits: got shape"),
        (lambda: cascades.errors(VIEW, [1.0, 50, 9, 1000]), "non-decreasing"),
        (lambda: cascades.errors(VIEW, [0.5, 50, 1000]), "within the frustum"),
        (lambda: cascades.errors(VIEW, [1.0, 50, 1001]), "within the frustum"),
        (lambda: jax.jit(lambda v: cascades.plan(VIEW, 2, overlap=v).value)(0.1), "got a traced overlap"),
        (lambda: cascades.errors(VIEW, [2.0, 50, 1000]), "a first depth"),
        (lambda: cascades.errors(VIEW, [1.0, 50, 900]), "a last depth"),
        (lambda: cascades.errors(VIEW, [1.0, np.nan, 1000]), "splits"),
        (lambda: cascades.plan(VIEW, 2).matrices(), "FrustumView"), (lambda: cascades.count(VIEW, -1), "price"),
        (lambda: cascades.count(ENDLESS), "got far = inf with the whole frustum"),
        (lambda: cascades.count(HORIZON), "sees to its horizon"),
        (lambda: splits.uniform(1.0, np.inf, 2), "far"), (lambda: splits.godot(0.1, 9.0, 3), "count: got 3"),
        (lambda: splits.fractions(20.0, 100.0, (0.1, 0.2)), "shares"), (lambda: splits.bevy(0.1, 9.0), "first"),
        (lambda: splits.practical(1.0, 9.0, 2, 2.0), "weight"), (lambda: splits.unreal(1.0, 9.0, 2, 0.5), "exponent"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()

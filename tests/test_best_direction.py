"""The search for direction and aspect: against exhaustive search, its edge cases, refusals and derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_directions import CAMERA, COUNT, EDGE, STORAGE, sets, view_of

import warpopt
from warpopt import Camera, DirectionalLight, Objective, Outcome, SceneView, Warp, error_norm, optimal_warp
from warpopt.receivers import DepthBuffer, GroundPlane, PointReceivers
from warpopt.theory import LightFrame
from warpopt.theory.direction import gradient, middle

SCREEN = {"screen": (640, 400), "shadow_map": (1024, 1024)}
FEW = 12  # sets that are searched exhaustively


@functools.partial(jax.jit, static_argnames=("objective",))
def _searched(objective, turn_only_if):
    _, world, lights, _ = (v[:FEW] for v in sets())
    etas = jnp.geomspace(1e-4, 1, 60)

    def one(points, light):
        options = {"warp_direction": "best", "turn_only_if": turn_only_if}
        found = optimal_warp(view_of(points, light, **options, **SCREEN), objective, throw=False)
        ahead = view_of(points, light, **SCREEN).frame()

        def along(turn):
            axis = CAMERA.rotation.T @ ahead.turned(jnp.cos(turn), jnp.sin(turn)).z_axis
            view = view_of(points, light, warp_direction=axis, **SCREEN)
            return error_norm(view, Warp.from_eta(etas, view.footprint(objective)), objective)

        return found, jax.lax.map(along, jnp.linspace(0, 2 * jnp.pi, 90, endpoint=False)), ahead.z_axis

    return jax.vmap(one)(world, lights)


@functools.cache
def searched(objective, turn_only_if=1.0):
    """(the solutions over the first sets, the norms over 90 directions and 60 eta of each, the view's axes)."""
    return jax.device_get(_searched(objective, jnp.asarray(turn_only_if)))


@pytest.mark.parametrize("objective", [STORAGE, EDGE], ids=lambda o: o.name)
@pytest.mark.thorough("storage")
def test_the_best_direction_is_exhaustive_search_s(objective):
    """Never above the least of 90 directions times 60 eta by more than 0.1 %; `unturned` is the view's optimum."""
    found, norms, _ = searched(objective)
    assert (np.asarray(found.value) <= np.asarray(norms).min((1, 2)) * 1.001).all()
    assert (np.asarray(found.unturned) <= np.asarray(norms)[:, 0].min(1) * (1 + 1e-9)).all()
    gains = np.asarray(found.unturned / found.value)
    assert gains.min() >= 1
    assert gains.max() > 1.3
    assert (np.asarray(found.directions) > 32).all()
    length = np.linalg.norm(found.direction, axis=1)
    np.testing.assert_allclose(length, 1, rtol=1e-12)
    np.testing.assert_allclose((np.asarray(found.direction) * sets()[2][:FEW]).sum(1), 0, atol=1e-12)


@pytest.mark.thorough
def test_the_best_aspect_is_a_scan_s():
    """No aspect of 33, with any of 200 eta, gives less, beyond the alternation's 0.2 %; texels are as many."""
    _, world, lights, _ = (v[:FEW] for v in sets())

    @jax.jit
    @jax.vmap
    def solved(points, light):
        return optimal_warp(view_of(points, light, map_aspect="best", **SCREEN), EDGE, throw=False)

    @jax.jit
    @functools.partial(jax.vmap, in_axes=(0, 0, None))
    @functools.partial(jax.vmap, in_axes=(None, None, 0))
    def least(points, light, aspect):
        view = view_of(points, light, map_aspect=aspect, **SCREEN)
        return error_norm(view, Warp.from_eta(jnp.geomspace(1e-4, 1, 200), view.footprint(EDGE)), EDGE).min()

    found, every = solved(world, lights), least(world, lights, np.geomspace(1 / 8, 8, 33))
    np.testing.assert_allclose(np.prod(found.shares, axis=1), 1, rtol=1e-12)
    assert (np.asarray(found.value) <= np.asarray(every).min(1) * 1.002).all()
    assert (np.asarray(found.value) >= np.asarray(every).min(1) * 0.97).all()  # it is the same function
    chosen = np.asarray(found.shares[:, 0] / found.shares[:, 1])
    assert chosen.min() < 0.9
    assert chosen.max() > 1.1


@pytest.mark.thorough
def test_max_with_the_best_aspect_is_the_root_of_storage():
    """max E_p and max E_q are equal there, and their product is the storage's least."""
    _, world, lights, _ = (v[:FEW] for v in sets())

    @jax.jit
    @jax.vmap
    def one(points, light):
        shaped = optimal_warp(view_of(points, light, map_aspect="best", **SCREEN), Objective("max"), throw=False)
        return shaped.value, shaped.shares

    value, shares = map(np.asarray, one(world, lights))
    inside = np.abs(np.log(shares[:, 0] / shares[:, 1])) < np.log(7.9)
    assert inside.sum() > FEW / 2
    storage = searched(STORAGE)[0].unturned  # along the view
    np.testing.assert_allclose(value[inside] ** 2, storage[inside], rtol=1e-6)


def test_turning_only_where_it_gains_enough():
    """`turn_only_if` keeps the view's direction where the gain is below it, and nothing else changes."""
    free, _, _ = searched(EDGE)
    gains = free.unturned / free.value
    least = float(np.median(gains)) + 1e-9
    found, _, ahead = searched(EDGE, least)
    kept = np.abs(found.frame.z_axis - ahead).max(1) < 1e-12
    assert (kept == (gains <= least)).all()
    assert 0 < kept.sum() < FEW
    np.testing.assert_allclose(found.value, np.where(kept, found.unturned, free.value), rtol=1e-12)


@functools.partial(jax.jit, static_argnums=1)
def sketched(receivers, objective):
    return receivers.sketch(CAMERA, objective)


@jax.jit
def of_cells_and_receivers(sketch, receivers, frame):
    """(start, end along Z_w, width without a warp, width at eta = 0.3) of the sketch and of the receivers."""
    footprints = [r.footprint(CAMERA, frame, STORAGE) for r in (sketch, receivers)]
    return [(f.start, f.start + f.mu, sum(f.half_widths(1.0)), sum(f.half_widths(0.3))) for f in footprints]


@pytest.mark.thorough
def test_pixels_are_searched_as_their_cells():
    """A depth buffer: the sketch holds every pixel, and the direction is as good as that of the pixels as points."""
    rng = np.random.default_rng(2)
    height, width = 60, 96
    up, across = np.mgrid[1 : -1 : height * 1j, -1 : 1 : width * 1j] * np.array([0.5, 0.8])[:, None, None]
    depth = np.minimum(1.7 / np.maximum(0.12 - up, 1e-3), 60 + 10 * np.sin(5 * across))
    for _ in range(6):
        row, column = rng.integers(5, height - 15), rng.integers(0, width - 10)
        depth[row : row + 14, column : column + 8] = rng.uniform(3, 20)
    view = SceneView(CAMERA, DirectionalLight((0.3, -0.2, -1)), DepthBuffer(depth), warp_direction="best", **SCREEN)
    found = optimal_warp(view, STORAGE)
    sketch = sketched(view.receivers, STORAGE)
    assert sketch.near.size < depth.size
    frame = view.frame_along("view")
    for turn in (0.0, 1.0, 2.5, 4.0):
        turned = frame.turned(jnp.cos(turn), jnp.sin(turn))
        cells, pixels = of_cells_and_receivers(sketch, view.receivers, turned)
        assert cells[0] <= pixels[0] + 1e-9
        assert cells[1] >= pixels[1] - 1e-9
        # With the same eta the looser map begins earlier, with another apex: widths are nearly ordered, not strictly.
        for loose, tight, least in zip(cells[2:], pixels[2:], (1 - 1e-9, 0.95), strict=True):
            assert tight * least <= loose <= tight * 1.1
    assert float(found.unturned / found.value) > 1.02


def test_sums_of_a_sketch_are_the_pixels_own():
    """Over all cells: weights over depths, and their moments, by NumPy; and each cell's centroid lies in it."""
    rng = np.random.default_rng(6)
    depth = np.exp(rng.uniform(0, 4, (94, 75)))
    depth[:9] = np.inf
    weights = rng.uniform(0, 1, depth.shape)
    sketch = sketched(DepthBuffer(depth, weights=weights), EDGE)
    left, right, bottom, top = np.asarray(CAMERA.window)
    x = left + (right - left) * (np.arange(75) + 0.5) / 75
    y = top - (top - bottom) * (np.arange(94) + 0.5) / 94
    seen = depth < float(CAMERA.far)
    z = np.where(seen, depth, 1)
    share = np.where(seen, weights, 0) / z
    share = share * z[seen].min() / weights[seen].sum()
    places = np.stack([z * x, z * y[:, None], z])
    exact = [share.sum(), *(share * places).sum((1, 2))]
    *sums, mass = (float(part.sum()) for part in sketch.sums)
    np.testing.assert_allclose(np.array(sums) / mass, exact, rtol=1e-12)
    filled = np.asarray(sketch.sums.weight) > 0
    depth_of = np.asarray(sketch.sums.z)[filled] / np.asarray(sketch.sums.weight)[filled]
    for i, part in enumerate((sketch.sums.x, sketch.sums.y)):
        slope = np.asarray(part)[filled] / np.asarray(sketch.sums.z)[filled]
        assert (slope >= np.asarray(sketch.low)[filled, i] - 1e-12).all()
        assert (slope <= np.asarray(sketch.high)[filled, i] + 1e-12).all()
    assert (depth_of >= np.asarray(sketch.near)[filled] * (1 - 1e-12)).all()
    assert (depth_of <= np.asarray(sketch.far)[filled] * (1 + 1e-12)).all()


def test_many_points_are_searched_as_cells():
    """5,000 points: cells that hold them."""
    rng = np.random.default_rng(5)
    z = np.exp(rng.uniform(0.5, 4.5, 5000))
    eye = np.stack([rng.uniform(-0.7, 0.7, 5000) * z, -1.7 + 0.1 * rng.normal(size=5000), z], 1)
    points = eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)
    view = view_of(points, np.array([0.6, -0.4, -0.7]), warp_direction="best")
    sketch = sketched(view.receivers, STORAGE)
    assert type(sketch) is not type(view.receivers)
    cells, exact = of_cells_and_receivers(sketch, view.receivers, view.frame_along("view"))
    assert cells[0] <= exact[0] + 1e-9
    assert cells[1] - cells[0] >= exact[1] - exact[0] - 1e-9
    assert cells[2] >= exact[2] - 1e-9


@pytest.mark.thorough
def test_derivatives_are_the_chosen_direction_s():
    """Those of the same map with its direction given; at a kink in the direction, as maxima have, that is all."""
    _, world, lights, _ = sets()
    found = searched(STORAGE)[0]
    i = int(np.argmax(found.unturned / found.value))
    light = lights[i]

    def value(points, direction):
        return optimal_warp(view_of(points, light, warp_direction=direction, **SCREEN), STORAGE, throw=False).value

    tangent = np.random.default_rng(1).normal(size=(COUNT, 3))
    one, other = (
        jax.jit(lambda p, how=how: jax.jvp(lambda q: value(q, how), (p,), (tangent,)))(world[i])
        for how in ("best", found.direction[i])
    )
    np.testing.assert_allclose(one, other, rtol=1e-6)


def test_gradient_and_middle():
    """Least squares by NumPy with weights z^-2, and the sum of the vectors to the receivers."""
    eye, world, lights, _ = sets()
    for i in range(5):
        frame = LightFrame(CAMERA, DirectionalLight(lights[i]))
        x, d, z = eye[i] @ np.asarray(frame.x_axis), eye[i] @ np.asarray(frame.z_axis), eye[i][:, 2]
        (_, across, along), *_ = np.linalg.lstsq(
            np.stack([np.ones(COUNT), x, d], 1) / z[:, None], np.ones(COUNT), rcond=None
        )
        exact = across * np.asarray(frame.x_axis) + along * np.asarray(frame.z_axis)
        found = np.asarray(gradient(frame, jnp.asarray(eye[i]), jnp.ones(COUNT)))
        np.testing.assert_allclose(found / np.linalg.norm(found), exact / np.linalg.norm(exact), atol=1e-9)
        view = view_of(world[i], lights[i], warp_direction="gradient")
        np.testing.assert_allclose(view.frame().z_axis, exact / np.linalg.norm(exact), atol=1e-9)
        total = np.asarray(middle(jnp.asarray(eye[i]), jnp.ones(COUNT)))
        np.testing.assert_allclose(total, eye[i].sum(0), rtol=1e-12)
        axis = np.asarray(view_of(world[i], lights[i], warp_direction="middle").frame().z_axis)
        l = np.asarray(frame.light)  # noqa: E741
        flat = total - l * (l @ total)
        np.testing.assert_allclose(axis, flat / np.linalg.norm(flat), atol=1e-9)


LIGHT = DirectionalLight((0.2, -1.0, -0.3))
AHEAD = Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.5)
POSTS = np.array([[-2.0, 0.0, -5.0], [2.0, 0.0, -9.0], [4.0, 1.0, -40.0], [-9.0, 2.0, -60.0]])
BEHIND = [0.0, 0.0, 9.0]  # not seen


@pytest.mark.parametrize("how", ["view", "gradient", "middle", "best"])
@pytest.mark.parametrize(
    ("points", "light", "outcome"),
    [
        ([BEHIND] * 4, (0.2, -1.0, -0.3), Outcome.empty),
        ([POSTS[0]] * 4, (0.2, -1.0, -0.3), Outcome.flat),
        (POSTS, (0.0, 0.0, -1.0), None),  # a light along the view: Z_w is free
        (POSTS * [1, 1, 0] - [0, 0, 20], (0.2, -1.0, -0.3), None),  # a wall that faces the viewer: z is constant
        ([[0.0, 0, -5], [0, 0, -9], [0, 0, -40], BEHIND], (0.0, -1.0, 0.0), None),  # a line in the light's plane
        ([[0.0, 3, -5], [0, 0, -5], [0, 1, -5], BEHIND], (0.0, -1.0, 0.0), Outcome.flat),  # along the light
    ],
    ids=["none", "one", "along the view", "a wall", "a line", "along the light"],
)
def test_degenerate_cases(how, points, light, outcome):
    """Outcomes: finite numbers, a map that holds the receivers, and never worse than the view's direction."""
    points = np.array(points)
    view = SceneView(AHEAD, DirectionalLight(light), PointReceivers(points), warp_direction=how, lateral="free")
    found = optimal_warp(view, STORAGE)
    assert all(np.isfinite(leaf).all() for leaf in (found.value, found.warp.eta, found.direction, found.unturned))
    if outcome is not None:
        assert Outcome(int(found.result)) is outcome
        assert found.value == 0
    matrix = np.asarray(warpopt.shadow_matrix(view, found))
    assert np.isfinite(matrix).all()
    points = points[points[:, 2] < 0]
    if len(points):
        clip = np.c_[points, np.ones(len(points))] @ matrix.T
        assert (np.abs(clip[:, :2]) <= clip[:, 3:] * (1 + 1e-6)).all()
    if how == "best":
        assert found.value <= found.unturned * (1 + 1e-12)


@pytest.mark.thorough
def test_a_plane_seen_edge_on_or_behind():
    """A plane behind the camera, through the eye, and along the light."""
    for normal, offset, light in (
        ((0, 0, 1), -5.0, LIGHT),
        ((0, 1, 0), -2.0, LIGHT),
        ((1, 0, 0), 0.0, (0.0, -1.0, -1.0)),
    ):
        direction = light if isinstance(light, DirectionalLight) else DirectionalLight(light)
        view = SceneView(AHEAD, direction, GroundPlane(normal, offset), warp_direction="best", lateral="free")
        found = optimal_warp(view, STORAGE)
        assert np.isfinite(found.value)
        assert np.isfinite(warpopt.shadow_matrix(view, found)).all()


POINTS = PointReceivers(POSTS)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"warp_direction": "up"},
            "warp_direction: got 'up', expected 'view', 'gradient', 'middle', 'best' or 'steady'",
        ),
        ({"warp_direction": (0.2, -1.0, -0.3)}, "expected a vector that is not along the light"),
        ({"warp_direction": (0.0, 0.0, 0.0)}, "warp_direction: got 0.0, expected a vector that is not zero"),
        ({"warp_direction": (np.nan, 0.0, 1.0)}, "warp_direction: got nan, expected finite numbers"),
        ({"warp_direction": (1.0, 0.0)}, r"warp_direction: got shape \(2,\), expected \(3,\)"),
        ({"map_aspect": 0.0}, "map_aspect: got 0.0, expected a positive number, or 'best'"),
        ({"map_aspect": -1.0}, "map_aspect: got -1.0, expected a positive number"),
        ({"map_aspect": np.nan}, "map_aspect: got nan"),
        ({"map_aspect": "wide"}, "map_aspect: got 'wide', expected 'best' or a positive number"),
        ({"map_aspect": (1.0, 2.0)}, r"map_aspect: got shape \(2,\), expected one number"),
        ({"lateral": "none"}, "lateral: got 'none', expected 'eye' or 'free'"),
        ({"turn_only_if": 0.9}, "turn_only_if: got 0.9, expected a finite number >= 1"),
    ],
)
def test_views_refuse(options, message):
    with pytest.raises(ValueError, match=message):
        SceneView(AHEAD, LIGHT, POINTS, **options)


@pytest.mark.parametrize(
    ("options", "objective", "message"),
    [
        (
            {"warp_direction": "best"},
            Objective(),
            "warp_direction: got 'best' with E_p, norm inf, which does not compare",
        ),
        ({"warp_direction": "best"}, Objective("q"), "expected 'pxq', 'storage', 'edge' or 'band'"),
        ({"warp_direction": "best"}, Objective("max"), "warp_direction: got 'best' with E_max, norm inf"),
        (
            {"map_aspect": "best"},
            Objective("p", "l2"),
            "got 'best' with E_p, norm l2, which a map of slivers",
        ),
        ({"lateral": "free"}, EDGE, "lateral: got 'free' with edge, norm l1"),
    ],
)
def test_solves_refuse(options, objective, message):
    with pytest.raises(ValueError, match=message):
        optimal_warp(SceneView(AHEAD, LIGHT, POINTS, **options), objective)


def test_what_needs_a_direction_asks_for_it():
    """A searched direction is the solution's: a bare warp does not know it."""
    view = SceneView(AHEAD, LIGHT, POINTS, warp_direction="best", lateral="free")  # as above: compiled once
    found = optimal_warp(view, STORAGE)
    words = "warp_direction: got 'best', which optimal_warp finds, expected its solution"
    for call in (view.frame, view.footprint, view.reduced, lambda: error_norm(view, found.warp, STORAGE)):
        with pytest.raises(ValueError, match=words):
            call()
    assert float(error_norm(view, found, STORAGE)) == pytest.approx(float(found.value), rel=1e-12)
    turned = view.along(found)
    assert float(error_norm(turned, found.warp, STORAGE)) == pytest.approx(float(found.value), rel=1e-12)
    np.testing.assert_allclose(
        warpopt.shadow_matrix(view, found), warpopt.shadow_matrix(turned, found.warp), atol=1e-12
    )
    with pytest.raises(ValueError, match="solution: got 3, expected a SceneSolution of this view"):
        view.along(3)
    with pytest.raises(ValueError, match="norm: got 'l2', expected 'inf' with metric 'storage'"):
        Objective("storage", "l2")


def test_ground_refuses():
    with pytest.raises(ValueError, match=r"normal: got 0\.0, expected a vector that is not zero"):
        GroundPlane((0, 0, 0), 1.0)
    with pytest.raises(ValueError, match="norm: got 'l2' with GroundPlane, expected 'inf'"):
        optimal_warp(SceneView(AHEAD, LIGHT, GroundPlane((0, 1, 0), 0)), Objective("p", "l2"))
    endless = Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=np.inf, half_fov=0.5)
    with pytest.raises(ValueError, match="receivers: got a plane that a camera with far = inf sees to its horizon"):
        optimal_warp(SceneView(endless, LIGHT, GroundPlane((0, 1, 0), 0)))
    steep = Camera((0, 2, 0), (0, -1, 0), (0, 0, 1), near=0.1, far=np.inf, half_fov=0.5)
    assert np.isfinite(optimal_warp(SceneView(steep, LIGHT, GroundPlane((0, 1, 0), 0))).value)


@pytest.mark.thorough
def test_rules_are_compared_along_the_view():
    """Rules and "no warp" have the view's direction and an axis through the eye; the optimum is the turned one."""
    lights = jax.vmap(DirectionalLight)(np.array([[0.6, -0.5, -1.0], [0.0, -1.0, 0.0]]))
    turned = SceneView(AHEAD, lights, POINTS, warp_direction="gradient", lateral="free")
    straight = SceneView(AHEAD, lights, POINTS)
    found, plain = (warpopt.compare_rules(view, ["lispsm"], STORAGE) for view in (turned, straight))
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-12)
    np.testing.assert_allclose(found.unwarped, plain.unwarped, rtol=1e-12)
    assert np.abs(found.solution.value / plain.solution.value - 1).max() > 0.05
    assert (found.bound == plain.bound).all()


def test_single_precision():
    """float32 inputs with x64 on: all results are in float32. Only traced: a loop would refuse other dtypes."""
    _, world, lights, _ = sets()
    single = jax.tree.map(lambda v: v.astype(np.float32), (CAMERA, np.float32(world[0]), np.float32(lights[0])))

    def solve(camera, points, light):
        view = SceneView(camera, DirectionalLight(light), PointReceivers(points), warp_direction="best")
        return optimal_warp(view, STORAGE, throw=False), optimal_warp(view, EDGE, throw=False)

    for leaf in jax.tree.leaves(jax.eval_shape(solve, *single)):
        assert leaf.dtype in (np.float32, np.int32, bool)

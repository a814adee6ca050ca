"""Orthographic cameras: z is a constant in the errors. Against perspective cameras moved away, and sums over points."""

import itertools

import jax
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Objective, Outcome, SceneView, optimal_warp
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers, WholeFrustum

POSE = (0.0, 40.0, 0.0), (0.2, -0.7, -1.0), (0.0, 1.0, 0.0)
CAMERA = Camera.orthographic(*POSE, near=1.0, far=120.0, half_height=20.0, aspect=1.5)
LIGHT = DirectionalLight((0.4, -1.0, 0.3))


def seen_points(count=200, seed=1):
    """World points that the camera sees, more of them far along the light plane."""
    rng = np.random.default_rng(seed)
    eye = np.c_[
        rng.uniform(-30, 30, count), rng.uniform(-20, 20, count) * rng.random(count), rng.uniform(1, 120, count)
    ]
    return eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)


@pytest.mark.parametrize(
    ("receivers", "metric"),
    [(WholeFrustum(), "p"), (ConvexBody.box((-9, -2, -60), (9, 3, -5)), "q"), (PointReceivers(seen_points()), "p")],
    ids=lambda v: type(v).__name__,
)
def test_every_maximum_is_least_without_a_warp(receivers, metric):
    """E_p = rho mu A^2/eta is largest at A = 1, whatever eta: no warp. Its value: mu and width over the window's."""
    solution = optimal_warp(SceneView(CAMERA, LIGHT, receivers), Objective(metric))
    assert Outcome(int(solution.result)) == Outcome.no_warp
    assert float(solution.warp.eta) == 1
    size = solution.footprint.mu if metric == "p" else sum(solution.footprint.half_widths(np.float64(1)))
    assert float(solution.value) == pytest.approx(float(size) / 20, rel=1e-12)  # a screen 2 high


LOWER, UPPER = np.array([4.0, -2, -66]), np.array([18.0, 3, -48])  # all of it in view
BOX_VIEW = SceneView(CAMERA, LIGHT, ConvexBody.box(LOWER, UPPER))


def on_light_plane(points, view):
    """(d, x) of world points, from the eye."""
    frame = view.frame()
    eye = (points - np.asarray(CAMERA.position)) @ np.asarray(CAMERA.rotation).T
    return eye @ np.asarray(frame.z_axis), eye @ np.asarray(frame.x_axis)


def test_no_map_of_a_body_is_better_than_none_in_linf():
    """E_p's bound is its optimum; storage's is the area that the light sees; E_q's the widest section of the box."""
    rho = 1 / 20  # a screen 2 high, of a window 40 high
    for view in (SceneView(CAMERA, LIGHT), BOX_VIEW):
        assert warpopt.lower_bound(view) == pytest.approx(float(optimal_warp(view).value), rel=1e-9)
    light, corners = np.asarray(LIGHT.direction), np.array(list(itertools.product(*zip(LOWER, UPPER, strict=True))))
    size = np.ptp(corners, axis=0)
    area = np.abs(light) @ (size.prod() / size)
    assert warpopt.lower_bound(BOX_VIEW, Objective("storage")) == pytest.approx(area * rho**2, rel=1e-9)
    d, x = on_light_plane(corners, BOX_VIEW)
    widest = 0.0
    for level in d:  # a section's corners are on the box's edges
        pairs = [(i, j) for i in range(8) for j in range(8) if d[i] <= level <= d[j] and d[j] > d[i]]
        at = [x[i] + (x[j] - x[i]) * (level - d[i]) / (d[j] - d[i]) for i, j in pairs]
        widest = max(widest, np.ptp(at))
    assert warpopt.lower_bound(BOX_VIEW, Objective("q")) == pytest.approx(widest * rho, rel=1e-9)


@pytest.mark.thorough
def test_bounds_of_means_are_hoelders_for_the_density_along_the_warp():
    """(int W^(1/(P+1)))^(P+1)/int W over the box's density along Z_w, from many points; and the map that has it."""
    n = 160
    points = (np.stack(np.meshgrid(*(np.arange(n),) * 3), -1).reshape(-1, 3) + 0.5) / n * (UPPER - LOWER) + LOWER
    density, edges = np.histogram(on_light_plane(points, BOX_VIEW)[0], 400)
    for order in (1.0, 2.0):
        total = (density ** (1 / (order + 1))).sum() * np.diff(edges)[0]
        expected = (total ** (order + 1) / (density.sum() * np.diff(edges)[0])) ** (1 / order) / 20
        found = warpopt.lower_bound(BOX_VIEW, Objective("p", order))
        assert found == pytest.approx(expected, rel=3e-3)
        assert found < float(optimal_warp(BOX_VIEW, Objective("p", order)).value)
    assert warpopt.lower_bound_map(BOX_VIEW).value == pytest.approx(warpopt.lower_bound(BOX_VIEW), rel=1e-9)
    few = SceneView(CAMERA, LIGHT, PointReceivers(points[::997]))
    for metric, below in (("p", 0.1), ("q", 0.1), ("storage", 0.25)):
        solid = warpopt.lower_bound(BOX_VIEW, Objective(metric))
        assert warpopt.lower_bound(few, Objective(metric)) == pytest.approx(solid, rel=below)


def test_rules_have_no_eye_to_begin_from():
    """No warp alone is defined, and the optimum of every maximum; the bound stands beside them."""
    lights = jax.vmap(DirectionalLight)(np.array([[0.4, -1.0, 0.3], [0.0, -1.0, 0.1]]))
    view = SceneView(CAMERA, lights, PointReceivers(seen_points()))
    found = warpopt.compare_rules(view, ["lispsm", "ssm", lambda frustum, theta: 1 / 0])
    assert found.defined.tolist() == [[False] * 2, [True] * 2, [False] * 2]
    assert np.isnan(found.values[[0, 2]]).all()
    np.testing.assert_allclose(found.ratio[1], 1, rtol=1e-12)
    assert (found.over_bound[1] > 1).all()
    assert (found.ranking(), "no eye" in found.undefined_because) == (["ssm"], True)
    perspective = SceneView(Camera(*POSE, 1.0, 120.0, 0.4), lights, PointReceivers(seen_points()))
    assert warpopt.compare_rules(perspective, ["ssm"]).undefined_because is None


@pytest.mark.parametrize("kind", ["points", "cells of points", "cells of pixels"])
def test_the_best_direction_is_the_least_rectangles(kind):
    """storage: no warp, and of the receivers' rectangles on the light plane the least; many receivers as cells."""
    rng, count, receivers = np.random.default_rng(4), 200 if kind == "points" else 5000, None
    strip = rng.uniform(-1, 1, (count, 1)) * [25, 12, 9] + rng.uniform(-2, 2, (count, 3)) + [0, 0, 60]
    seen = strip @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)
    if kind == "cells of pixels":
        across, up = (np.arange(90) + 0.5) / 90 * 60 - 30, 20 - (np.arange(60) + 0.5) / 60 * 40
        z = 60 + 25 * np.sin(across / 9) + 10 * np.cos(up / 5)[:, None]
        eye = np.stack(np.broadcast_arrays(across, up[:, None], z), -1).reshape(-1, 3)
        seen, receivers = eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position), DepthBuffer(z)
    view = SceneView(CAMERA, LIGHT, receivers or PointReceivers(seen), warp_direction="best")
    found = optimal_warp(view, Objective("storage"))
    d, x = on_light_plane(seen, SceneView(CAMERA, LIGHT))
    angles = np.linspace(0, np.pi / 2, 2000)[:, None]
    one, other = (
        np.ptp(v, axis=1) for v in (np.cos(angles) * d + np.sin(angles) * x, np.cos(angles) * x - np.sin(angles) * d)
    )
    assert float(found.value) == pytest.approx((one * other).min() / 400, rel=0.005 if kind == "points" else 0.03)
    assert float(found.unturned) >= float(found.value)
    assert Outcome(int(found.result)) == Outcome.no_warp


def test_cells_keep_the_sums_of_their_receivers():
    """Weights, and weighted places, of all pixels and of the same as points: z counts in no weight."""
    rng = np.random.default_rng(6)
    z, weights = rng.uniform(5, 110, (94, 75)), rng.uniform(0, 1, (94, 75))
    across, up = (np.arange(75) + 0.5) / 75 * 60 - 30, 20 - (np.arange(94) + 0.5) / 94 * 40
    eye = np.stack(np.broadcast_arrays(across, up[:, None], z), -1)
    world = eye.reshape(-1, 3) @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)
    share = weights / weights.sum()
    exact = [1, *(share[..., None] * eye).sum((0, 1))]
    for receivers in (DepthBuffer(z, weights=weights), PointReceivers(world, weights=weights.ravel())):
        cells = jax.jit(lambda receivers: receivers.sketch(CAMERA, Objective("edge")))(receivers)
        *sums, mass = (float(part.sum()) for part in cells.sums)
        np.testing.assert_allclose(np.array(sums) / mass, exact, rtol=1e-9, atol=1e-9)
        assert (float(cells.unit), cells.parallel) == (1, True)


@pytest.mark.thorough
def test_a_stable_window_scrolls():
    """Every frame holds all receivers, and between fits the map moves by whole texels."""
    window = warpopt.StableWindow(warp_direction="view", shadow_map=(256, 256), screen=(300, 200))
    state, points = window.start(), PointReceivers(seen_points())
    moves, actions = [], []
    for step in range(6):
        way = np.array([0.7 * step, 0, 0])
        place = np.asarray(CAMERA.position) + way
        camera = Camera.orthographic(place, *POSE[1:], near=1.0, far=120.0, half_height=20.0, aspect=1.5)
        seen = seen_points() + way
        points = PointReceivers(seen)
        update, state = window.update(state, camera, LIGHT, points)
        clip = np.c_[seen, np.ones(len(seen))] @ np.asarray(update.matrix).T
        assert (np.abs(clip[:, :3] / clip[:, 3:]) <= 1 + 1e-6).all()
        actions.append(int(update.action))
        place = np.append(np.zeros(3), 1) @ np.asarray(update.matrix).T
        moves.append(place[:2] / place[3] * 128)
    assert warpopt.stable.Action.REFITTED not in actions
    assert warpopt.stable.Action.SCROLLED in actions
    steps = np.diff(moves, axis=0)
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)


def test_moved_away_perspective_cameras_tend_to_it():
    """The gain of a warp is at most 1 + (4/3)(z_max/z_min - 1), and the errors tend to the orthographic ones."""
    eye = (seen_points() - np.asarray(CAMERA.position)) @ np.asarray(CAMERA.rotation).T
    forward = np.asarray(CAMERA.rotation)[2]
    exact = {
        m: float(optimal_warp(SceneView(CAMERA, LIGHT, PointReceivers(seen_points())), Objective(m)).value)
        for m in "pq"
    }
    for distance in (100.0, 1e3, 1e5):
        z = eye[:, 2] + distance
        for metric in "pq":
            place = np.asarray(CAMERA.position) - distance * forward
            near, far, slope = z.min() * 0.99, z.max() * 1.01, 20 / distance
            camera = Camera(place, POSE[1], POSE[2], near, far, np.arctan(slope * 1.2), 1.5)
            solution = optimal_warp(SceneView(camera, LIGHT, PointReceivers(seen_points())), Objective(metric))
            gain = float(solution.unwarped / solution.value)
            assert 1 - 1e-12 <= gain <= 1 + 4 / 3 * (z.max() / z.min() - 1)
            # Its window is 1.2 times as high at that distance, so that it sees every point.
            assert float(solution.value) * 1.2 == pytest.approx(exact[metric], rel=2 * (z.max() / z.min() - 1))


@pytest.mark.parametrize(("metric", "norm"), [("p", "l2"), ("pxq", "l1")])
def test_means_are_of_the_receivers_along_the_warp_alone(metric, norm):
    """Sums over points by hand, z^0: the optimum of a grid of eta, and the norm there."""
    view, objective = SceneView(CAMERA, LIGHT, PointReceivers(seen_points())), Objective(metric, norm)
    solution = optimal_warp(view, objective)
    eye = (seen_points() - np.asarray(CAMERA.position)) @ np.asarray(CAMERA.rotation).T
    d, x = eye @ np.asarray(solution.frame.z_axis), eye @ np.asarray(solution.frame.x_axis)
    delta, mu, order = (d - d.min()) / np.ptp(d), np.ptp(d), objective.order
    axis = np.clip(0, x.min(), x.max())

    def norm_of(eta):
        blend = eta + (1 - eta) * delta
        width = ((x - axis) / blend).max() + ((axis - x) / blend).max()
        e = mu * blend**2 / eta / 20 * (width * blend / 20 if metric == "pxq" else 1)
        return (e**order).mean() ** (1 / order)

    assert float(solution.value) == pytest.approx(norm_of(float(solution.warp.eta)), rel=1e-9)
    assert float(solution.value) <= min(map(norm_of, np.geomspace(1e-3, 1, 400))) * (1 + 1e-9)


def test_means_over_bodies_are_those_of_many_points():
    """Moments of the whole view, and of a body that is all of it, against a regular grid in it."""
    whole, body = (
        optimal_warp(SceneView(CAMERA, LIGHT, receivers), Objective("p", "l2"))
        for receivers in (WholeFrustum(), ConvexBody.box((-999,) * 3, (999,) * 3))
    )
    assert float(body.value) == pytest.approx(float(whole.value), rel=1e-9)
    n = 60
    grid = (np.stack(np.meshgrid(*(np.arange(n),) * 3), -1).reshape(-1, 3) + 0.5) / n
    delta = (grid * [60, 40, 119] + [-30, -20, 1]) @ np.asarray(whole.frame.z_axis) - float(whole.warp.start)
    delta = delta / float(whole.warp.mu)
    assert delta.min() >= 0
    assert delta.max() <= 1
    eta = float(whole.warp.eta)
    many = np.sqrt(((float(whole.warp.mu) * (eta + (1 - eta) * delta) ** 2 / eta / 20) ** 2).mean())
    assert many == pytest.approx(float(whole.value), rel=1e-3)  # midpoints, of second order in 1/60


def test_depth_buffers_are_linear():
    """Eye depth, and both encodings, which parallel rays leave linear: the same points, from each pixel's centre."""
    rng = np.random.default_rng(0)
    z = rng.uniform(5, 110, (6, 9))
    z[0] = 0  # background
    across, up = (np.arange(9) + 0.5) / 9 * 60 - 30, 20 - (np.arange(6) + 0.5) / 6 * 40
    eye = np.stack(np.broadcast_arrays(across, up[:, None], z), -1)[1:].reshape(-1, 3)
    points = PointReceivers(eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position))
    objective = Objective("p", "l2")
    expected = optimal_warp(SceneView(CAMERA, LIGHT, points), objective)
    found = optimal_warp(SceneView(CAMERA, LIGHT, DepthBuffer(z)), objective)
    assert float(found.value) == pytest.approx(float(expected.value), rel=1e-9)
    assert float(found.warp.eta) == pytest.approx(float(expected.warp.eta), rel=1e-9)
    share = np.where(z > 0, (z - 1) / 119, 1)
    for buffer in (DepthBuffer(share, "standard"), DepthBuffer(1 - share, "reversed")):
        np.testing.assert_allclose(buffer.eye_depth(CAMERA), np.where(z > 0, z, np.inf), rtol=1e-12)


def test_derivatives_and_single_precision():
    def value(direction):
        view = SceneView(CAMERA, DirectionalLight(direction), PointReceivers(seen_points()))
        return optimal_warp(view, Objective("p", "l2"), throw=False).value

    at, step = np.array([0.4, -1.0, 0.3]), np.array([1e-5, 0, 0])
    _, slope = jax.jvp(value, (at,), (np.array([1.0, 0, 0]),))
    assert float(slope) == pytest.approx(float(value(at + step) - value(at - step)) / 2e-5, rel=1e-5)
    single = jax.tree.map(lambda v: np.asarray(v, np.float32), CAMERA)
    view = SceneView(single, DirectionalLight(np.float32(at)), PointReceivers(seen_points().astype(np.float32)))
    found = jax.eval_shape(lambda v: optimal_warp(v, Objective("pxq", "l1"), throw=False), view)
    assert {v.dtype for v in jax.tree.leaves(found) if np.issubdtype(v.dtype, np.floating)} == {np.dtype(np.float32)}


def test_what_it_does_not_serve_is_refused():
    box = ConvexBody.box((-9, -2, -60), (9, 3, -5))
    view = SceneView(CAMERA, LIGHT, box)
    for action, words in (
        (
            lambda: SceneView(CAMERA, LIGHT, DepthHistogram([1.0, 9.0], [1.0])),
            "camera: got an orthographic one with Dep",
        ),
        (
            lambda: SceneView(CAMERA, LIGHT, box, warp_direction="gradient"),
            "warp_direction: got 'gradient' with an ortho",
        ),
        (lambda: optimal_warp(view, Objective("p", "l2", "ground")), "measure: got 'ground' with an orthographic"),
        (lambda: warpopt.lower_bound(view, Objective("pxq")), "No lower bound is known for a product"),
        (
            lambda: warpopt.edge_weights(np.zeros((2, 2)), DepthBuffer(np.ones((2, 2))), CAMERA, last_camera=CAMERA),
            "camera: got an orthographic one, expected a perspective one: surfaces are followed",
        ),
        (
            lambda: Camera.orthographic(*POSE, 1.0, 9.0, half_height=0.0),
            "half_height: got 0.0, expected a finite number",
        ),
        (lambda: Camera.orthographic(*POSE, 0.0, 9.0, half_height=1.0), "near: got 0.0"),
    ):
        with pytest.raises(ValueError, match=words):
            action()

"""Directions, aspects and lateral fits of a warp: (T58) to (T62) from raw geometry."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from warpopt import (
    Camera,
    DirectionalLight,
    FrustumView,
    Objective,
    SceneView,
    ViewFrustum,
    Warp,
    lower_bound,
    optimal_warp,
    shadow_matrix,
)
from warpopt.receivers import ConvexBody, GroundPlane, PointReceivers, WholeFrustum
from warpopt.receivers.profiles.nearness import over_points
from warpopt.theory.ground import ground_optimum

COUNT, SETS = 64, 60
CAMERA = Camera((0.3, 1.7, 0.2), (0.1, -0.15, -1), (0.05, 1, 0), near=0.1, far=400.0, half_fov=0.5, aspect=1.6)
STORAGE, EDGE = Objective("storage"), Objective("edge")
ETAS = np.geomspace(1e-4, 1, 2000)
WEAKER = 0.6


@functools.cache
def sets() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(eye points, world points, lights, directions): receivers between depth 1 and up to 300."""
    rng = np.random.default_rng(11)
    reach = rng.uniform(np.log(2), np.log(300), (SETS, 1))
    z = np.exp(rng.uniform(0, 1, (SETS, COUNT)) * reach)
    slopes = rng.uniform(-1, 1, (SETS, COUNT, 2)) * np.tan(0.5) * [1.6, 1] * rng.uniform(0.1, 1, (SETS, 1, 2))
    eye = np.concatenate([slopes * z[..., None], z[..., None]], -1)
    world = eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)
    lights = rng.normal(size=(SETS, 3))
    return eye, world, lights / np.linalg.norm(lights, axis=1, keepdims=True), rng.normal(size=(SETS, 3))


def view_of(points, light, **options) -> SceneView:
    return SceneView(CAMERA, DirectionalLight(light), PointReceivers(points), **options)


def axes_of(light, direction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(X, Z, l) in eye coordinates, from world vectors."""
    turn = np.asarray(CAMERA.rotation)
    l, v = turn @ light, turn @ direction  # noqa: E741
    z_axis = v - l * (l @ v)
    z_axis /= np.linalg.norm(z_axis)
    return np.cross(z_axis, l), z_axis, l


def free_width(x, delta, blend) -> tuple[float, float]:
    """(least w with |x - m0 - m1 delta| <= w A / 2, the least |m1| of these), by linear programs."""
    ones = np.ones_like(x)
    rows = np.r_[np.c_[-ones, -delta, -blend / 2], np.c_[ones, delta, -blend / 2]]
    bounds = [(None, None)] * 3
    width = linprog([0, 0, 1], rows, np.r_[-x, x], bounds=bounds, method="highs").fun
    # |m1| as a fourth variable, with the width given.
    slope = np.array([[0, 1, 0, -1], [0, -1, 0, -1], [0, 0, 1, 0]])
    rows = np.r_[np.c_[rows, 0 * np.r_[ones, ones]], slope]
    sides = np.r_[-x, x, 0, 0, width * (1 + 1e-11)]
    return width, linprog([0, 0, 0, 1], rows, sides, bounds=[(None, None)] * 4, method="highs").fun


@functools.cache
def free_solutions():
    _, world, lights, directions = sets()

    def solve(points, light, direction):
        view = view_of(points, light, warp_direction=direction, lateral="free")
        found = optimal_warp(view, STORAGE, throw=False)
        # Not at the optimum, which is where two chords are equally wide: there the axis is pinned.
        weaker = Warp.from_eta(WEAKER, found.footprint)
        return found, shadow_matrix(view, weaker), found.footprint.lateral_fit(weaker.eta)

    return jax.jit(jax.vmap(solve))(world, lights, directions)


def test_storage_has_one_minimum_and_it_is_found():
    """(T59) on raw geometry, with a map whose axis is free: falling, then rising, and no eta of 2,000 is better."""
    eye, _, lights, directions = sets()
    found, _, _ = jax.device_get(free_solutions())
    for i in range(SETS):
        x_axis, z_axis, _ = axes_of(lights[i], directions[i])
        d, x, z = eye[i] @ z_axis, eye[i] @ x_axis, eye[i][:, 2]
        delta = (d - d.min()) / np.ptp(d)
        etas = np.append(ETAS, float(found.warp.eta[i]))
        blend = (1 - delta) * etas[:, None] + delta
        e_p = (np.ptp(d) * blend**2 / etas[:, None] / z).max(1) / np.tan(0.5)
        chords = chords_of(delta, x)
        width = np.max([(chord / ((1 - at) * etas + at)) for at, chord in chords], 0)
        storage = e_p * width * (blend / z).max(1) / np.tan(0.5)
        assert storage[-1] == pytest.approx(float(found.value[i]), rel=1e-11)
        assert storage[:-1].min() >= float(found.value[i]) * (1 - 1e-11)
        steps = np.sign(np.diff(storage[:-1]) * (np.abs(np.diff(np.log(storage[:-1]))) > 1e-12))
        assert (np.diff(steps[steps != 0]) >= 0).all()  # never from rising to falling


def chords_of(delta, x) -> list[tuple[float, float]]:
    """(delta, x-extent of the convex hull) at every point's delta: by all pairs of points, no hull algorithm."""
    order = np.argsort(delta)
    delta, x = delta[order], x[order]
    upper, lower = x.copy(), x.copy()
    for j in range(len(x)):
        left, right = np.arange(j), np.arange(j + 1, len(x))
        if len(left) and len(right):
            share = ((delta[j] - delta[left])[:, None]) / (delta[right][None] - delta[left][:, None])
            between = x[left][:, None] + share * (x[right][None] - x[left][:, None])
            upper[j], lower[j] = max(upper[j], between.max()), min(lower[j], between.min())
    return list(zip(delta, upper - lower, strict=True))


def test_the_free_fit_is_the_linear_program_s():
    """(T62): the least width, the least |m1| of its axes, and a map that holds every receiver."""
    eye, world, lights, directions = sets()
    found, matrices, fits = free_solutions()
    wide = np.sum(jax.vmap(lambda footprint: footprint.half_widths(WEAKER))(found.footprint), 0)
    matrices, fits = jax.device_get((matrices, fits))
    tilted = 0
    for i in range(SETS):
        x_axis, z_axis, _ = axes_of(lights[i], directions[i])
        d, x = eye[i] @ z_axis, eye[i] @ x_axis
        delta = (d - d.min()) / np.ptp(d)
        width, least = free_width(x, delta, (1 - delta) * WEAKER + delta)
        assert float(fits.left[i] + fits.right[i]) == pytest.approx(width, rel=1e-10)
        assert wide[i] == pytest.approx(width, rel=1e-10)
        assert abs(float(fits.m1[i])) == pytest.approx(least, abs=1e-6 * np.ptp(x))  # the program's own tolerance
        tilted += least > 1e-3 * np.ptp(x)
        clip = np.c_[world[i], np.ones(COUNT)] @ matrices[i].T
        inside = clip[:, :2] / clip[:, 3:]
        assert (clip[:, 3] > 0).all()
        assert np.abs(inside).max() <= 1 + 1e-9
        # The map is as narrow as it can be: it touches all four sides.
        np.testing.assert_allclose([inside.min(0), inside.max(0)], [[-1, -1], [1, 1]], atol=1e-9)
        # A caster on a receiver's ray shares its texel.
        behind = np.c_[world[i] - 30 * lights[i], np.ones(COUNT)] @ matrices[i].T
        np.testing.assert_allclose(behind[:, :2] / behind[:, 3:], inside, atol=1e-8)
        assert (behind[:, 2] / behind[:, 3] < clip[:, 2] / clip[:, 3]).all()
    assert tilted > 10  # the slope matters


def test_of_many_axes_the_one_with_the_least_slope_is_taken():
    """Of a trapezoid, whose far side is its widest chord, a range of axes has the least width: a linear program's."""
    ground = GroundPlane((0, 1, 0), 0)

    def one(light):
        view = SceneView(CAMERA, DirectionalLight(light), ground, warp_direction="gradient", lateral="free")
        return view.footprint(STORAGE).lateral_fit(jnp.asarray(WEAKER)), view.frame()

    rng = np.random.default_rng(9)
    lights = rng.normal(size=(20, 3)) * [1, 0, 1] - [0, 0.5, 0]
    fits, frames = jax.device_get(jax.jit(jax.vmap(one))(lights))
    points, weights = (np.asarray(v) for v in ground.places(CAMERA))
    points = points[weights > 0]
    ranges = 0
    for i in range(20):
        d, x = points @ frames.z_axis[i], points @ frames.x_axis[i]
        delta = (d - d.min()) / np.ptp(d)
        blend = (1 - delta) * WEAKER + delta
        width, least = free_width(x, delta, blend)
        assert float(fits.left[i] + fits.right[i]) == pytest.approx(width, rel=1e-9)
        assert abs(float(fits.m1[i])) == pytest.approx(least, abs=1e-6 * np.ptp(x))
        ranges += least < 0.9 * abs(np.polyfit(delta, x, 1)[0])
    assert ranges > 5


def test_a_texel_s_area_is_e_p_times_e_q():
    """(T58): |det d(q,p)/d(t,s)| = E_p E_q |N.c|/(z |N.l|), through the matrix by autodiff.

    Turned and sheared maps, and pixels that are no squares.
    """
    rng = np.random.default_rng(3)
    eye, world, lights, directions = sets()
    screen, texels = np.array([900.0, 500.0]), np.array([700.0, 1200.0])

    def deviation(points, light, direction, point, normal, eta):
        view = view_of(points, light, warp_direction=direction, lateral="free", screen=screen, shadow_map=texels)
        footprint = view.footprint(STORAGE)
        matrix = shadow_matrix(view, Warp.from_eta(eta, footprint))
        frame = view.frame()

        def pixel(on_plane):
            """Screen pixels of a point of the receiver's plane, and its texel."""
            one = jnp.cross(normal, jnp.array([0.3, 0.5, 0.8]))
            where = point + on_plane[0] * one + on_plane[1] * jnp.cross(normal, one)
            left, right, bottom, top = CAMERA.window
            seen = where[:2] / where[2] / jnp.stack([right - left, top - bottom]) * screen
            clip = matrix @ jnp.append(where @ CAMERA.rotation + CAMERA.position, 1)
            return seen, clip[:2] / clip[3] / 2 * texels

        by_screen, by_map = jax.jacfwd(pixel)(jnp.zeros(2))
        area = jnp.abs(jnp.linalg.det(by_screen) / jnp.linalg.det(by_map))
        depth, _, z = footprint.coordinates(frame, point)
        blend = depth.blend(eta)
        fit = footprint.lateral_fit(eta)
        e_p = frame.density_p * footprint.mu * blend**2 / (eta * z)
        e_q = frame.density_q * (fit.left + fit.right) * blend / z
        factor = jnp.abs(normal @ point) / (z * jnp.abs(normal @ frame.light))
        return area / (e_p * e_q * factor)

    normals = rng.normal(size=(SETS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    etas = rng.uniform(0.05, 1, SETS)
    ratio = jax.jit(jax.vmap(deviation))(world, lights, directions, eye[:, 0], normals, etas)
    np.testing.assert_allclose(ratio, 1, rtol=1e-8)


def test_the_shear_is_the_axis_of_a_column():
    """sigma = dx/dd at constant t, by autodiff through the matrix, for turned maps with a free axis."""
    eye, world, lights, directions = sets()

    def both(points, light, direction, point, eta):
        view = view_of(points, light, warp_direction=direction, lateral="free")
        footprint, frame = view.footprint(STORAGE), view.frame()
        matrix = shadow_matrix(view, Warp.from_eta(eta, footprint))

        def t_of(move):
            where = point + move[0] * frame.x_axis + move[1] * frame.z_axis
            clip = matrix @ jnp.append(where @ CAMERA.rotation + CAMERA.position, 1)
            return clip[0] / clip[3]

        by_x, by_d = jax.grad(t_of)(jnp.zeros(2))
        depth, x, _ = footprint.coordinates(frame, point)
        return -by_d / by_x, footprint.lateral_fit(eta).shear(depth, x, eta) / footprint.mu

    exact, found = jax.jit(jax.vmap(both))(world, lights, directions, eye[:, 1], np.full(SETS, 0.3))
    np.testing.assert_allclose(found, exact, rtol=1e-8, atol=1e-9)


SUNS = [(elevation, azimuth) for elevation in (4, 12, 30, 55, 80) for azimuth in (0, 35, 90, 140)] + [
    (89, 10),
    (20, 180),
]


@pytest.mark.parametrize("objective", [STORAGE, Objective("pxq")], ids=lambda o: o.name)
@pytest.mark.thorough("pxq")
def test_level_ground_has_its_closed_form(objective):
    """22 suns and pitches: the closed form along the gradient, which no searched direction betters."""

    def solve(elevation, azimuth, pitch):
        zero = jnp.zeros_like(pitch)
        forward = jnp.stack([zero, -jnp.sin(pitch), -jnp.cos(pitch)])
        camera = Camera((0, 1.7, 0), forward, (0, 1, 0), near=0.1, far=90.0, half_fov=0.5, aspect=1.6)
        light = DirectionalLight(
            -jnp.stack(
                [jnp.cos(elevation) * jnp.sin(azimuth), jnp.sin(elevation), jnp.cos(elevation) * jnp.cos(azimuth)]
            )
        )
        ground = GroundPlane((0.0, 2.0, 0.0), 0.0)
        views = [SceneView(camera, light, ground, warp_direction=how, lateral="free") for how in ("gradient", "best")]
        along, searched = (optimal_warp(view, objective, throw=False) for view in views)
        extent = ground.depth_extent(camera)
        normal, _ = ground.in_eye(camera)
        exact = ground_optimum(normal, camera.rotation @ light.direction, *extent, jnp.asarray(0.5), jnp.asarray(1.6))
        return along, searched.value, exact, camera.rotation.T @ exact.direction

    suns = np.deg2rad(np.array(SUNS, float))
    pitches = np.linspace(-0.2, 0.4, len(suns))
    along, searched, exact, direction = jax.jit(jax.vmap(solve))(*suns.T, pitches)
    least, eta = (exact.storage, exact.storage_eta) if objective.storage else (exact.area, exact.area_eta)
    np.testing.assert_allclose(along.value, least, rtol=1e-10)
    np.testing.assert_allclose(along.warp.eta, eta, rtol=1e-6)
    np.testing.assert_allclose(along.direction, direction, atol=1e-9)
    np.testing.assert_allclose(searched, least, rtol=1e-10)


def test_the_texels_that_any_maps_need():
    """(T60) against a quadrature over rays, for off-centre frusta and any light; and it is below every map."""
    rng = np.random.default_rng(8)
    for _ in range(4):
        window = np.array(
            [-rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8), -rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8)]
        )
        light = rng.normal(size=3)
        light /= np.linalg.norm(light)
        camera = Camera.off_centre((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 6.0, tuple(window))
        view = SceneView(camera, DirectionalLight(light))
        bound = lower_bound(view, STORAGE)
        l = light * [1, 1, -1]  # noqa: E741
        corners = np.array([(x * z, y * z, z) for z in (1, 6) for x in window[:2] for y in window[2:]])
        other = np.eye(3)[np.argmin(abs(l))]
        one = np.cross(l, other) / np.linalg.norm(np.cross(l, other))
        axes = np.stack([one, np.cross(l, one)])
        low, high = (corners @ axes.T).min(0), (corners @ axes.T).max(0)
        side = [a + (b - a) * (np.arange(900) + 0.5) / 900 for a, b in zip(low, high, strict=True)]
        a, b = np.meshgrid(*side, indexing="ij")
        base = a[..., None] * axes[0] + b[..., None] * axes[1]
        planes = np.array(
            [[1, 0, -window[0]], [-1, 0, window[1]], [0, 1, -window[2]], [0, -1, window[3]], [0, 0, 1], [0, 0, -1]]
        )
        offsets = np.array([0, 0, 0, 0, -1, 6.0])
        rate, at = planes @ l, base @ planes.T + offsets
        with np.errstate(divide="ignore"):
            cut = -at / rate
        start, end = np.where(rate > 0, cut, -np.inf).max(-1), np.where(rate < 0, cut, np.inf).min(-1)
        nearest = np.minimum((base + start[..., None] * l)[..., 2], (base + end[..., None] * l)[..., 2])
        cell = (side[0][1] - side[0][0]) * (side[1][1] - side[1][0])
        density = (2 / (window[3] - window[2])) ** 2
        exact = density * cell * np.where(end > start, nearest, np.inf)[end > start].astype(float) ** -2
        assert bound == pytest.approx(exact.sum(), rel=4e-3)  # of cells cut by the outline: 900 of them to a side
        for direction in ("view", rng.normal(size=3)):
            turned = SceneView(camera, view.light, warp_direction=direction, lateral="free")
            assert optimal_warp(turned, STORAGE).value > bound


@pytest.mark.parametrize("theta", [0.0, 0.3, 0.5235987755982988, 1.0, np.pi / 2, 2.5])
def test_the_bound_over_a_frustum_is_the_bodies(theta):
    """The closed form over AT09's frustum, the faces of the frustum, and of a body that contains it."""
    phi, ratio = np.pi / 6, 250.0
    light = DirectionalLight((0, -np.sin(theta), -np.cos(theta)))
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, ratio, phi)
    closed = float(lower_bound(FrustumView(ViewFrustum(1.0, ratio, phi), theta), STORAGE))
    for receivers in (WholeFrustum(), ConvexBody.box((-1e4,) * 3, (1e4,) * 3)):
        assert lower_bound(SceneView(camera, light, receivers), STORAGE) == pytest.approx(closed, rel=1e-9)


def test_points_stand_for_each_place_once():
    """A near point in a cell of its own, which is a quarter of a far one's: three quarters are left for that."""
    near, far = (0.1, 0.1, 1.0), (0.3, 0.3, 2.0)
    points = np.array([near, far])
    found = over_points(points, points[:, 2], np.array([0.0, 0.0, 1.0]), 0.5)
    assert found == pytest.approx(0.5**2 * (1 / 1**2 + (4 - 1) / 2**2), rel=1e-12)


def test_points_stand_for_the_surfaces_between_them():
    """A plane's pixels in cells against the plane itself, which is exact: within 10 % while cells are filled."""
    camera = Camera((0, 1.7, 0), (0, -0.2, -1), (0, 1, 0), near=0.1, far=30.0, half_fov=0.5, aspect=1.6)
    light = DirectionalLight((0.3, -0.8, -0.4))
    across = np.linspace(-1, 1, 800) * np.tan(0.5) * 1.6
    up = np.linspace(1, -1, 500) * np.tan(0.5)
    rays = np.stack([*np.meshgrid(across, up), np.ones((500, 800))], -1) @ np.asarray(camera.rotation)
    z = np.where(rays[..., 1] < 0, -1.7 / np.where(rays[..., 1] < 0, rays[..., 1], -1), np.inf)
    points = (np.asarray(camera.position) + rays * z[..., None])[(z < 30) & (z > 0.1)]
    exact = lower_bound(SceneView(camera, light, GroundPlane((0, 1, 0), 0)), STORAGE)
    found = [
        lower_bound(SceneView(camera, light, PointReceivers(points)), STORAGE, bins=bins) for bins in (64, 128, 256)
    ]
    assert found[0] > found[1] > found[2]  # falls as cells shrink
    assert found[2] == pytest.approx(exact, rel=0.1)

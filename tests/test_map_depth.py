"""The map's own depth: receivers, and casters that can shadow one; against linear programs and geometry."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from warpopt import Camera, ClipSpace, DirectionalLight, SceneView, Warp, optimal_warp, shadow_matrix
from warpopt.receivers import ConvexBody, PointReceivers
from warpopt.render.casters import casters_of
from warpopt.render.map_depth import map_depth
from warpopt.render.shadow_matrix import matrix_and_depth

# A box's corners, by bits, and the two triangles of each of its faces.
CORNERS = np.array([[i >> 2, i >> 1 & 1, i & 1] for i in range(8)], float)
FACES = [(a, a ^ p, a ^ q, a ^ p ^ q) for p, q, r in ((1, 2, 4), (2, 4, 1), (4, 1, 2)) for a in (0, r)]
TRIANGLES = np.array([face[k : k + 3] for face in FACES for k in (0, 1)])


def box_of(lower, upper):
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    return lower + CORNERS * (upper - lower)


def scene(seed: int, dtype=np.float64):
    """A camera over a box of buildings, that casts and receives, and an eta as optima have it."""
    rng = np.random.default_rng(seed)
    yaw, r = rng.uniform(0, 2 * np.pi), rng.uniform(20, 200)
    forward = np.array([np.cos(yaw), rng.uniform(-0.4, 0.1), np.sin(yaw)])
    place = np.array([0, rng.uniform(2, 10), 0])
    camera = Camera(*(v.astype(dtype) for v in (place, forward, np.array([0.0, 1, 0]))), dtype(0.1),
                    dtype(rng.uniform(50, 500)), dtype(0.45), dtype(1.6))  # fmt: skip
    light = rng.normal(size=3)
    light[1] = -abs(light[1]) - 0.2
    corners = box_of((-r, -1, -r), (r, rng.uniform(2, 40), r)).astype(dtype)
    view = SceneView(camera, DirectionalLight(light.astype(dtype)), ConvexBody.box(corners[0], corners[-1]))
    return view, dtype(10 ** rng.uniform(-2, -0.5)), corners


@jax.jit
def depth_of(view: SceneView, eta, casters):
    """What shadow_matrix uses, with the receivers' own body as casters or another."""
    footprint = view.footprint()
    return map_depth(view.camera, view.frame(), footprint, eta, casters), footprint.start, footprint.mu


def least_by_program(view, eta, depth, start, mu, casters: ConvexBody) -> float:
    """min (l . c - reference)/A over casters c of which c + t l, t >= 0, is a receiver: a linear program.

    In (y, t, s) = (c, t, 1)/A (Charnes and Cooper): the least l . y - reference s, eta s + (1 - eta) delta(y) being 1.
    """
    camera, frame = view.camera, view.frame()
    z, light = np.asarray(frame.z_axis), np.asarray(frame.light)
    rotation, position = np.asarray(camera.rotation), np.asarray(camera.position)

    def in_eye(body):
        planes = np.asarray(body.planes)
        return np.c_[planes[:, :3] @ rotation.T, planes[:, 3] + planes[:, :3] @ position]

    received = np.concatenate([in_eye(view.receivers), np.asarray(camera.planes())])
    cast = in_eye(casters)
    rows = [np.r_[-p[:3], 0, -p[3]] for p in cast] + [np.r_[-p[:3], -p[:3] @ light, -p[3]] for p in received]
    scale = np.abs(rows).max(1, keepdims=True)
    blend = np.r_[(1 - eta) * z / mu, 0, eta - (1 - eta) * start / mu]
    found = linprog(
        np.r_[light, 0, -float(depth.reference)], np.array(rows) / scale, np.zeros(len(rows)), blend[None], [1.0],
        bounds=[(None, None)] * 3 + [(0, None)] * 2, method="highs",
    )  # fmt: skip
    return found.fun if found.status == 0 else np.inf


def least_over_points(view, eta, depth, start, mu, casters) -> float:
    """The same over the hull of points: c = sum of a_i c_i, in (a, y + t l)/A."""
    frame, camera = view.frame(), view.camera
    light, z = np.asarray(frame.light), np.asarray(frame.z_axis)
    planes, rotation = np.asarray(view.receivers.planes), np.asarray(camera.rotation)
    received = np.c_[planes[:, :3] @ rotation.T, planes[:, 3] + planes[:, :3] @ np.asarray(camera.position)]
    received = np.concatenate([received, np.asarray(camera.planes())])
    eye = np.asarray(camera.to_eye(casters))
    rows = np.array([np.r_[-(eye @ p[:3] + p[3]), -p[:3] @ light] for p in received])
    blend = np.r_[eta + (1 - eta) * (eye @ z - start) / mu, 0]
    scale = np.abs(rows).max(1, keepdims=True)
    found = linprog(
        np.r_[eye @ light - float(depth.reference), 0], rows / scale, np.zeros(len(rows)), blend[None], [1.0],
        bounds=[(0, None)] * (len(eye) + 1), method="highs",
    )  # fmt: skip
    return found.fun if found.status == 0 else np.inf


def test_receivers_get_the_depth_that_no_caster_needs():
    """100 scenes: 60 % of the depth at least, or a caster that shadows a receiver needs the rest.

    The sweep's base of 32 sides adds at most 7 % of the span, and next to nothing at the median.
    """
    shares, loose = [], []
    for seed in range(100):
        view, eta, _ = scene(seed)
        depth, start, mu = depth_of(view, eta, view.receivers)
        exact = min(least_by_program(view, eta, depth, float(start), float(mu), view.receivers), float(depth.first))
        span = float(depth.largest - depth.least)
        assert float(depth.least) <= exact + 1e-6 * span, f"scene {seed}: a caster that shadows is not in the map"
        loose.append((exact - float(depth.least)) / span)
        needed = (float(depth.first) - exact) / (float(depth.largest) - exact)
        shares.append(float(depth.share))
        assert shares[-1] >= 0.6 or needed >= 0.4, f"scene {seed}: {shares[-1]:.3f}, where casters need {needed:.3f}"
        # Of the extent along the light too, which a warp that is nearly none would hide.
        vertices, there = view.receivers.vertices(view.camera)
        along = (np.asarray(vertices) @ np.asarray(view.frame().light))[np.asarray(there)]
        lowest = least_by_program(view, 1.0, depth, float(start), float(mu), view.receivers) + float(depth.reference)
        needed = np.ptp(along) / (along.max() - min(lowest, along.min()))
        assert 0.9 * needed <= float(depth.extent) <= needed * (1 + 1e-6), f"scene {seed}"
    assert max(loose) < 0.1
    assert np.median(loose) < 1e-5
    assert np.mean(np.array(shares) >= 0.6) > 0.8


def test_a_land_that_casts_leaves_the_depth_to_the_view():
    """A box of 245 km, a view of 6.6 km: 2.1 % of the depth where all corners of the box counted; and finer steps."""
    camera = Camera((0, 200, 0), (0, 0, -1), (0, 1, 0), 1.0, 6656.0, np.radians(27.5), 1.7778)
    corners = box_of((-122_880, -2000, -122_880), (122_880, 8000, 122_880))
    view = SceneView(camera, DirectionalLight((0.3, -1, -0.4)), ConvexBody.box(corners[0], corners[-1]))
    depth, start, mu = depth_of(view, 0.0122, view.receivers)
    assert float(depth.share) > 0.6
    exact = least_by_program(view, 0.0122, depth, float(start), float(mu), view.receivers)
    span = float(depth.largest - depth.least)
    assert -1e-9 <= (exact - float(depth.least)) / span < 1e-3
    assert float(depth_of(view, 0.0122, None)[0].share) == 1


def test_a_box_its_corners_and_its_triangles_are_the_same_casters():
    """Also as thousands of triangles, which are grouped: never less, and no more than the groups' 4 %."""
    for seed in range(3):
        view, eta, corners = scene(seed)
        exact = depth_of(view, eta, view.receivers)[0]
        for other in (corners, corners[TRIANGLES]):
            found = depth_of(view, eta, casters_of(other))[0]
            np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-9 * float(exact.largest))
    many = np.tile(corners[TRIANGLES], (200, 1, 1))
    found = depth_of(view, eta, casters_of(many))[0]
    assert 0 <= float(exact.least - found.least) + 1e-9 < 0.04 * float(exact.largest - exact.least)
    # As receivers: a body's depth is that of its vertices.
    vertices, there = view.receivers.vertices(view.camera)
    points = np.asarray(vertices)[np.asarray(there)] @ np.asarray(view.camera.rotation) + np.asarray(
        view.camera.position
    )
    points = points[np.unique(points.round(9), axis=0, return_index=True)[1]]
    by_points = SceneView(view.camera, view.light, PointReceivers(points))
    body, set_of_points = (depth_of(v, eta, None)[0] for v in (view, by_points))
    np.testing.assert_allclose(set_of_points[:4], body[:4], rtol=1e-6, atol=1e-6 * float(body.largest))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_depth_spans_zero_to_one_and_grows_along_the_light(dtype):
    """z/w at the receivers, clamped or not, within 4 eps (1 + |largest coordinate|/extent along the light)."""
    rng = np.random.default_rng(0)
    eps = np.finfo(dtype).eps
    for seed in range(4):
        view, eta, _ = scene(seed, dtype)
        warp = Warp.from_eta(eta, view.footprint())
        vertices, there = view.receivers.vertices(view.camera)
        eye = np.asarray(vertices, np.float64)[np.asarray(there)]
        rotation, position = (np.asarray(v, np.float64) for v in (view.camera.rotation, view.camera.position))
        # What single precision rounds is the coordinates, from the eye, over the extent; both as they are in the map.
        points = eye @ rotation + position
        matrix = shadow_matrix(view, warp, ClipSpace.vulkan(), depth_clamp=True, casters=view.receivers)
        clip = np.c_[points, np.ones(len(points))] @ np.asarray(matrix, np.float64).T
        u = clip[:, 2] / clip[:, 3]
        light = np.asarray(view.light.direction, np.float64)
        extent = np.ptp(points @ light)
        bound = 4 * eps * (1 + np.abs(points).max() / extent) / float(eta)
        assert abs(u.min()) <= bound
        assert abs(u.max() - 1) <= bound
        plain = shadow_matrix(view, warp, ClipSpace.vulkan())
        np.testing.assert_array_equal(matrix, plain)
        # Along one ray of light, by a thousandth of the extent.
        start = points[rng.integers(len(points))]
        ray = start - light * np.linspace(extent, 0, 1000)[:, None]
        clip = np.c_[ray, np.ones(1000)] @ np.asarray(matrix, np.float64).T
        assert (np.diff(clip[:, 2] / clip[:, 3]) > 0).all()


def test_points_cast_as_their_hull_does():
    """Random ones, in space, in a plane, on a line and alone, against the linear program over their hull's planes or
    their own weights; traced they count as a larger body, and the result says so."""
    rng = np.random.default_rng(3)
    matrix_of = jax.jit(lambda view, eta, casters: matrix_and_depth(view, Warp.from_eta(eta, view.footprint()),
                                                                    casters=casters))  # fmt: skip
    shadowed = 0
    for seed, flat in enumerate((0, 0, 0, 1, *([2] * 8), *([3] * 4))):
        view, eta, corners = scene(seed)
        middle = corners.mean(0) - np.asarray(view.light.direction) * rng.uniform(5, 100)
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [80, 30 * (flat < 2), 10 * (flat < 1)] * (flat < 3)
        casters = middle + rng.normal(size=(9, 3)) @ axes.T
        depth, start, mu = depth_of(view, eta, casters_of(casters))
        exact = min(least_over_points(view, eta, depth, float(start), float(mu), casters), float(depth.first))
        span = float(depth.largest - depth.least)
        assert -1e-9 <= (exact - float(depth.least)) / span < 0.2  # the sweep's base of 32 sides is wider than the hull
        assert (exact < float(depth.first)) == (float(depth.share) < 1)
        shadowed += flat == 2 and float(depth.share) < 1
        if flat == 0:
            _, traced = matrix_of(view, eta, casters)
            _, own = matrix_and_depth(view, Warp.from_eta(eta, view.footprint()), casters=casters)
            assert float(traced.extent) <= float(own.extent) * (1 + 1e-9)
            assert bool(traced.bounded) > bool(own.bounded)
    assert shadowed > 3


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_receivers_on_one_side_in_groups_have_the_whole_depth(dtype):
    """600 points to the left of the axis, more than are taken one by one, and a caster above the first or the last.

    Each has another 3 to its right, in its group: a group reaches from its first to its last.
    """
    rng = np.random.default_rng(4)
    place, forward, up = (np.array(v, dtype) for v in ((0, 5, 0), (0, -0.1, -1), (0, 1, 0)))
    camera = Camera(place, forward, up, *(dtype(v) for v in (0.5, 200.0, 0.6, 1.6)))
    close = 64 * float(np.finfo(dtype).eps) * 800 / 4  # of the caster's distance over the receivers' height
    z = np.exp(rng.uniform(np.log(12), np.log(90), 300))
    points = np.stack([-z * rng.uniform(0.3, 0.8, 300), rng.uniform(-1, 3, 300), -z], 1).astype(dtype)
    points = np.concatenate([points, points + np.array([3, 0, 0], dtype)])
    view = SceneView(camera, DirectionalLight(np.array((0.05, -1, -0.1), dtype)), PointReceivers(points))
    ends = (points[pick(points[:, 0])] for pick in (np.argmin, np.argmax))
    for caster in (None, *(end - 800 * np.asarray(view.light.direction) for end in ends)):
        for eta in (0.02, 0.3):
            casters = None if caster is None else caster[None]
            warp = Warp.from_eta(eta, view.footprint())
            matrix = np.asarray(shadow_matrix(view, warp, ClipSpace.vulkan(), casters=casters))

            def depth(points, matrix=matrix):
                clip = np.c_[points, np.ones(len(points))] @ matrix.T
                return clip[:, 2] / clip[:, 3]

            u = depth(points)
            assert u.min() >= -close / eta
            assert 0.96 < u.max() <= 1 + close / eta  # A differs by 4 % within a group
            if caster is None:
                assert u.min() < 0.04
            else:
                assert -close / eta <= depth(casters)[0] < u.min()


def test_casters_as_far_as_numbers_go_are_refused():
    """z/w would be the same for all receivers; clamped, they need no depth."""
    view, eta, _ = scene(0)
    warp = Warp.from_eta(eta, view.footprint())
    largest, endless = np.finfo(np.float32).max, ConvexBody.box((-np.inf,) * 3, (np.inf,) * 3)
    far = box_of((-largest,) * 3, (largest,) * 3)
    for casters in (far, far[TRIANGLES], endless):
        with pytest.raises(ValueError, match=r"casters: got ones so far before .* of the extent along the light"):
            shadow_matrix(view, warp, casters=casters)
        clamped = shadow_matrix(view, warp, casters=casters, depth_clamp=True)
        np.testing.assert_array_equal(clamped, shadow_matrix(view, warp))
    # One triangle overhead, in numbers whose squares overflow.
    for dtype, sizes in ((np.float32, (1e18, 1e20, 1e30, 3e38, 1e39)), (np.float64, (1e150, 1e160, 1e300, 1e308))):
        seen, own, _ = scene(0, dtype)
        for size in sizes:
            over = size * np.array([[[-1, 1, -1], [1, 1, -1], [0, 1, 1.0]]])
            with pytest.raises(ValueError, match="casters: got ones so far before"):
                shadow_matrix(seen, Warp.from_eta(own, seen.footprint()), casters=over)
    traced = jax.jit(lambda view, eta: shadow_matrix(view, Warp.from_eta(eta, view.footprint()), casters=endless))
    assert jnp.isnan(traced(view, eta)).all()
    with pytest.raises(ValueError, match=r"casters: got shape \(4, 2\)"):
        shadow_matrix(view, warp, casters=np.zeros((4, 2)))
    with pytest.raises(ValueError, match="depth_clamp: got 1"):
        shadow_matrix(view, warp, depth_clamp=1)


@pytest.mark.parametrize("body", [False, True])
def test_derivatives_through_the_warp_are_those_of_differences(body):
    """Of the matrix by the light, with eta the optimum's; parts of the casters are not in the prism."""
    camera = Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.45, aspect=1.6)
    points = np.random.default_rng(0).normal(size=(20, 3)) * 3 + np.array([0, 1, -20])
    corners = box_of((-2, 8, -22), (2, 12, -18))
    casters = ConvexBody.box(corners[0], corners[-1]) if body else corners[TRIANGLES]

    @jax.jit
    def numbers(light):
        view = SceneView(camera, DirectionalLight(light), PointReceivers(points))
        return shadow_matrix(view, optimal_warp(view, throw=False), casters=casters).ravel()

    light, step = np.array([0.3, -1.0, -0.2]), 1e-6
    found = np.asarray(jax.jacfwd(numbers)(light))
    differences = [(numbers(light + d) - numbers(light - d)) / (2 * step) for d in step * np.eye(3)]
    np.testing.assert_allclose(found, np.stack(differences, 1), atol=1e-7)  # rounding over the step
    assert np.isfinite(jax.grad(lambda light: numbers(light).sum())(light)).all()

"""Receivers: each kind against brute force, and what is conservative about groups."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

import warpopt
from warpopt import (
    Camera,
    DirectionalLight,
    Objective,
    Outcome,
    SceneView,
    Warp,
    optimal_warp,
    shadow_matrix,
)
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers, WholeFrustum, bins
from warpopt.theory import Extent

CAMERA = Camera((1, 2, 3), (0.3, -0.2, -1), (0, 1, 0), 0.5, 80.0, 0.5, 1.4)
LIGHT = DirectionalLight((0.4, -1, -0.3))
NONE = Warp.from_eta(1.0, Extent(0.0, 1.0))
BOXES = {
    "around the camera": ((-20, -5, -40), (30, 8, 20)),
    "ahead": ((-4, 0, -40), (14, 5, -10)),
    "partly beside": ((5, -3, -30), (60, 10, -5)),
    "cut by the near plane": ((0.5, 1.4, 2), (1.6, 2.4, 2.9)),
    "holding the frustum": ((-500, -500, -500), (500, 500, 500)),
}


COUNT = 200  # of points wherever their number does not matter: each number is another program to compile


def points_of(few) -> PointReceivers:
    """A few world points, repeated to `COUNT` of them: the same extents."""
    return PointReceivers(np.resize(np.asarray(few, float), (COUNT, 3)))


def planes_of(box):
    lower, upper = (np.array(v, float) for v in box)
    return np.concatenate([np.c_[np.eye(3), -lower], np.c_[-np.eye(3), upper]])


def half_spaces(box):
    """SciPy's form (A x + b <= 0) of box and view frustum, in eye coordinates by the camera's public methods."""
    world = planes_of(box)
    rotation, position = np.asarray(CAMERA.rotation), np.asarray(CAMERA.position)
    eye = np.c_[world[:, :3] @ rotation.T, world[:, 3] + world[:, :3] @ position]
    return -np.concatenate([np.asarray(CAMERA.planes()), eye])


@pytest.mark.parametrize("name", BOXES)
def test_vertices_are_those_of_the_intersection(name):
    """Against Qhull's intersection of half-spaces, from an interior point found by brute force."""
    spaces = half_spaces(BOXES[name])
    rng = np.random.default_rng(0)
    z = np.exp(rng.uniform(np.log(0.5), np.log(80), 400_000))
    window = np.asarray(CAMERA.window)
    eye = np.c_[rng.uniform(*window[:2], z.size) * z, rng.uniform(*window[2:], z.size) * z, z]
    depth = -(eye @ spaces[:, :3].T + spaces[:, 3]).max(1)
    inside = eye[np.argmax(depth)]
    assert depth.max() > 0
    exact = HalfspaceIntersection(spaces, inside).intersections
    found, valid = ConvexBody.box(*BOXES[name]).vertices(CAMERA)
    found = np.asarray(found)[np.asarray(valid)]
    gaps = np.linalg.norm(exact[:, None] - found, axis=-1)
    assert gaps.min(1).max() < 1e-9  # every true vertex is found
    assert gaps.min(0).max() < 1e-9  # and nothing else is


def test_a_body_without_thickness_keeps_its_corners():
    """From anywhere: which of two equal planes a corner is beside is rounding. Killed: no tolerance for it."""
    vertices_of = jax.jit(lambda body, camera: body.vertices(camera))
    for seed, (length, width) in enumerate([(1, 1), (1, 0), (0, 0)] * 12):  # a square, a line, a point
        body = ConvexBody.box((-length, 0, -width), (length, 0, width))
        corners = np.array([[x, 0, z] for x in (-length, length) for z in (-width, width)])
        rng = np.random.default_rng(seed)
        position = rng.normal(size=3)
        position *= 10 / np.linalg.norm(position)
        camera = Camera(position, -position, rng.normal(size=3), 0.5, 80.0, 0.5)
        found, valid = (np.asarray(v) for v in vertices_of(body, camera))
        assert valid.any()
        gaps = np.linalg.norm(np.asarray(camera.to_eye(corners))[:, None] - found[valid], axis=-1)
        assert gaps.min(1).max() < 1e-9
        assert gaps.min(0).max() < 1e-9


def test_integrals_over_a_body_are_exact():
    """E_p L1 (moments of degree 2) over a body: against the volume's integral by Qhull's tetrahedra, Gauss on each."""
    box = BOXES["ahead"]
    vertices, valid = ConvexBody.box(*box).vertices(CAMERA)
    hull = ConvexHull(np.unique(np.asarray(vertices)[np.asarray(valid)].round(12), axis=0))
    corners = hull.points[hull.vertices]
    centre = corners.mean(0)
    x, w = np.polynomial.legendre.leggauss(14)
    x, w = (x + 1) / 2, w / 2
    for measure, exponent in (("volume", 0), ("ground", 4)):
        solution = optimal_warp(SceneView(CAMERA, LIGHT, ConvexBody.box(*box)), Objective("p", "l1", measure))
        # Collapsed Gauss nodes: r from the centre (weight r^2), s from a corner of a face (weight s), t along its edge.
        r, s, t = (v.ravel() for v in np.meshgrid(x, x, x, indexing="ij"))
        weight = np.einsum("i,j,k->ijk", w, w, w).ravel() * r * r * s
        points, weights = [], []
        for simplex in hull.simplices:
            a, b, c = (hull.points[i] - centre for i in simplex)
            points.append(centre + r[:, None] * (a + np.outer(s, b - a) + np.outer(s * t, c - b)))
            weights.append(weight * abs(np.linalg.det([a, b, c])))
        points, weights = np.concatenate(points), np.concatenate(weights)
        weights = weights * points[:, 2] ** -exponent
        errors = solution.aliasing_error(points, "p")
        # 14 nodes on z ratios up to 4
        assert float(solution.value) == pytest.approx(np.average(errors, weights=weights), rel=1e-9)


THIN = Objective("p"), Objective("pxq", "l2", "volume")  # both kinds of norm; the next two tests' programs


@pytest.mark.parametrize("objective", THIN, ids=lambda o: o.title)
def test_a_body_that_holds_the_frustum_is_the_whole_frustum(objective):
    """Two derivations of the same moments: polygons slice by slice, and polar forms of tabulated integrals."""
    whole, body = (
        optimal_warp(SceneView(CAMERA, LIGHT, receivers), objective)
        for receivers in (None, ConvexBody.box(*BOXES["holding the frustum"]))
    )
    np.testing.assert_allclose(body.warp.eta, whole.warp.eta, rtol=1e-12)
    np.testing.assert_allclose(body.value, whole.value, rtol=1e-12)


@pytest.mark.parametrize("thickness", [0.0, 1e-300, 1e-17, 1e-12, 1e-6])
def test_a_body_thinner_than_rounding_is_a_plane(thickness):
    """The ground as a box without height: as the limit of thick ones, in L-inf and in L2, any light."""
    for objective in THIN:
        for light in (LIGHT, DirectionalLight((0, -1, 0))):
            thick, thin = (
                optimal_warp(SceneView(CAMERA, light, ConvexBody.box((-30, -1, -60), (30, -1 + h, 0))), objective)
                for h in (1e-5, thickness)
            )
            np.testing.assert_allclose(thin.warp.eta, thick.warp.eta, rtol=1e-4)  # of the order of 1e-5 over eta
            np.testing.assert_allclose(thin.value, thick.value, rtol=1e-4)


def test_the_same_plane_twice_counts_once():
    """A box that shares the frustum's near plane, and planes given twice: no area is counted double."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 50.0, 0.5)
    planes = planes_of(((-5, -5, -20), (5, 5, -1)))
    once, twice = ConvexBody(planes), ConvexBody(np.concatenate([planes, planes * 3]))
    a, b = (optimal_warp(SceneView(camera, LIGHT, body), Objective("p", "l2")) for body in (once, twice))
    np.testing.assert_allclose(a.value, b.value, rtol=1e-12)
    np.testing.assert_allclose(a.warp.eta, b.warp.eta, rtol=1e-12)


def test_boxes_behind_or_beside_the_view_are_empty():
    for box in (((-1, -1, 10), (1, 1, 20)), ((500, 0, -20), (600, 5, -10)), ((-3, 0, -900), (3, 5, -300))):
        solution = optimal_warp(SceneView(CAMERA, LIGHT, ConvexBody.box(*box)), Objective("p", "l2"))
        assert Outcome(int(solution.result)) == Outcome.empty
        assert solution.value == 0
        assert solution.warp.eta == 1


def test_nothing_at_all_is_empty():
    """No points, a body without a point: outcomes of a frame loop; casters may be none too."""
    nothing = PointReceivers(np.zeros((0, 3))), ConvexBody([[1.0, 0, 0, -1], [-1, 0, 0, 0]] * 3)  # as many as a box
    for receivers in nothing:
        for norm in ("inf", "l2"):
            solution = optimal_warp(SceneView(CAMERA, LIGHT, receivers), Objective(norm=norm))
            assert Outcome(int(solution.result)) == Outcome.empty
    matrix = shadow_matrix(SceneView(CAMERA, LIGHT), solution.warp, casters=np.zeros((0, 3)))
    plain = shadow_matrix(SceneView(CAMERA, LIGHT), solution.warp)
    np.testing.assert_allclose(matrix, plain, rtol=1e-12)


def test_a_box_upside_down_is_refused():
    for lower, upper in (((0, 0, 0), (1, -1, 1)), ((np.inf,) * 3, (-np.inf,) * 3)):
        with pytest.raises(ValueError, match=r"upper: got .*, expected numbers >= those of lower"):
            ConvexBody.box(lower, upper)


def test_an_infinite_box_is_the_whole_frustum():
    whole, body = (
        optimal_warp(SceneView(CAMERA, LIGHT, receivers), Objective("p", "l2"))
        for receivers in (WholeFrustum(), ConvexBody.box((-np.inf,) * 3, (np.inf,) * 3))
    )
    np.testing.assert_allclose(body.warp.eta, whole.warp.eta, rtol=1e-12)


def test_points_on_the_frustums_boundary_are_seen():
    """Its own corners as points are the whole frustum in L-inf, in any pose and window: none is lost to rounding.

    Killed: a window that is taken to be centred.
    """
    left, right, bottom, top = window = (-0.7, 0.9, -0.3, 0.6)
    corners = np.array([[x, y, 1] for x in (left, right) for y in (bottom, top)])
    eye = np.concatenate([corners * 0.3, corners * 200.0])
    for seed in range(6):
        rng = np.random.default_rng(seed)
        pose = rng.normal(size=3) * 30, rng.normal(size=3), rng.normal(size=3)
        camera = Camera.off_centre(*pose, 0.3, 200.0, window)
        light = DirectionalLight(rng.normal(size=3))
        world = eye @ np.asarray(camera.rotation) + np.asarray(camera.position)
        points, whole = (
            optimal_warp(SceneView(camera, light, receivers), Objective("pxq"))
            for receivers in (points_of(world), WholeFrustum())
        )
        np.testing.assert_allclose(points.value, whole.value, rtol=1e-11)  # eps |position| / near
        np.testing.assert_allclose(points.warp.eta, whole.warp.eta, rtol=1e-11)


def test_points_that_the_camera_does_not_see_count_for_nothing():
    """Behind it, beside its window, before the near and beyond the far plane, or of weight 0."""
    rng = np.random.default_rng(8)
    z = rng.uniform(2, 60, 12)
    eye = np.c_[rng.uniform(-0.4, 0.4, (12, 2)) * z[:, None], z]
    eye[7:] = [0, 0, -9], [40, 0, 20], [0, -30, 20], [0, 0, 0.2], [0, 0, 300]
    world = eye @ np.asarray(CAMERA.rotation) + np.asarray(CAMERA.position)
    weights = np.where(np.arange(12) == 3, 0.0, 1.0)
    few = np.delete(np.arange(7), 3)
    repeated = np.concatenate([few, few[[-1] * 6]])  # of one shape: the last, of all weights together, seven times
    shares = np.where(np.arange(12) < 5, 1, 1 / 7)
    every, seen = (
        optimal_warp(SceneView(CAMERA, LIGHT, PointReceivers(*of)), Objective("pxq", "l2"))
        for of in ((world, weights), (world[repeated], shares))
    )
    np.testing.assert_allclose(every.warp.eta, seen.warp.eta, rtol=1e-12)
    np.testing.assert_allclose(every.value, seen.value, rtol=1e-12)
    np.testing.assert_allclose(every.warp.mu, seen.warp.mu, rtol=1e-12)


def test_receivers_at_one_depth_up_to_rounding_are_flat():
    """A wall across Z_w in poses that nothing is aligned with. Killed: a depth range of rounding taken for one."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        camera = Camera(rng.normal(size=3) * 5, rng.normal(size=3), rng.normal(size=3), 0.3, 200.0, 0.6)
        light = DirectionalLight(rng.normal(size=3))
        view, towards = (np.asarray(v) for v in (camera.rotation[2], light.direction))
        z_axis = view - towards * (towards @ view)
        z_axis /= np.linalg.norm(z_axis)
        across = np.linalg.svd(z_axis[None])[2][1:]
        wall = np.asarray(camera.position) + 20 * view + rng.uniform(-3, 3, (8, 2)) @ across
        solution = optimal_warp(SceneView(camera, light, points_of(wall)), Objective("pxq"))
        assert Outcome(int(solution.result)) == Outcome.flat
        assert (solution.warp.eta, solution.value) == (1, 0)


def test_bins_are_as_fine_as_they_are_said_to_be():
    """256 in delta: A = (1 - delta) eta + delta varies by at most 3.7 % within one for eta >= 1e-4."""
    edges = bins.bin_edges(bins.BINS)
    for eta in (1e-4, 1e-3, 0.1):
        blend = (1 - edges) * eta + edges
        assert (blend[1:] / blend[:-1]).max() < 1.037
    middles = jnp.asarray((edges[1:] + edges[:-1]) / 2)
    np.testing.assert_array_equal(bins.bin_of(middles), np.arange(bins.BINS))


def test_the_excess_bounds_the_regret_of_grouping():
    """Many points in few groups against a search over eta with every point for itself."""
    etas = np.geomspace(1e-3, 1, 4000)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        z = np.exp(rng.uniform(0, 4, 600))
        points = np.c_[rng.uniform(-0.5, 0.5, (600, 2)) * z[:, None], -z]
        camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 0.5, 80.0, 0.5)
        light = DirectionalLight(rng.normal(size=3))
        grouped, *alone = (
            optimal_warp(SceneView(camera, light, PointReceivers(part)), Objective("pxq"))
            for part in (points, *np.array_split(points, 3))  # of COUNT each
        )
        assert all(part.excess == 0 for part in alone)
        found, x, z = grouped.coordinates(camera.to_eye(points))
        depth, x, depths = (np.asarray(v) for v in (found.delta, x, z))
        blend = (1 - depth) * etas[:, None] + depth
        width = (x / blend).max(1) - (x / blend).min(1)
        along = float(grouped.frame.density_p * grouped.footprint.mu) * blend**2 / etas[:, None] / depths
        across = float(grouped.frame.density_q) * width[:, None] * blend / depths
        exact = (along * across).max(1).min()
        regret = float(grouped.value) / exact - 1
        assert -0.004 < regret <= float(grouped.excess) + 1e-9  # a step of the grid is 0.17 %
        assert grouped.excess < 0.2


def test_receivers_on_the_axis_alone_have_nothing_to_warp_across():
    """E_q and E_pxq are zero for every warp: none is the answer, and the larger eta of a flat minimum."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 0.5, 80.0, 0.5)
    points = points_of([[0, 0, -5.0], [0, 0, -20], [0, 0, -60]])
    view = SceneView(camera, DirectionalLight((0.0, -1, -0.3)), points)
    for metric in ("q", "pxq"):
        solution = optimal_warp(view, Objective(metric))
        assert Outcome(int(solution.result)) == Outcome.no_warp
        assert (solution.warp.eta, solution.margin, solution.value) == (1, 0, 0)
        assert solution.warp.mu > 50  # a depth range that E_p would have warped


BINS = 64


def test_a_histogram_is_cut_by_the_view_as_it_says():
    """A bin that begins before the near plane keeps the share of its count that lies behind it."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 5.0, 200.0, 0.4)
    beyond = np.linspace(100, 110, BINS - 1)  # empty bins: one number of them for all histograms here
    cut, plain = (
        optimal_warp(
            SceneView(camera, LIGHT, DepthHistogram([first, 10, *beyond], [count, 1, *[0] * (BINS - 2)])),
            Objective("p", "l2"),
        )
        for first, count in ((1, 9), (5, 5))
    )
    np.testing.assert_allclose(cut.value, plain.value, rtol=1e-12)


def image(height=54, width=90):
    """Eye depths of a hilly ground under a sky, and each pixel's world point."""
    left, right, bottom, top = np.asarray(CAMERA.window)
    x = left + (right - left) * (np.arange(width) + 0.5) / width
    y = top - (top - bottom) * (np.arange(height) + 0.5) / height
    rays = x[None, :, None] * np.asarray(CAMERA.rotation)[0] + y[:, None, None] * np.asarray(CAMERA.rotation)[1]
    rays = rays + np.asarray(CAMERA.rotation)[2]
    down = np.minimum(rays[..., 1], -1e-9)
    z = -2 * (1 + 0.2 * np.sin(20 * x)) / down
    z = np.where((rays[..., 1] < 0) & (z < 80) & (z > 0.5), z, 0)
    return z, np.asarray(CAMERA.position) + rays * z[..., None]


@pytest.mark.parametrize(("metric", "norm"), [("p", "l2"), ("pxq", "inf"), ("q", "l2")])
def test_a_depth_buffer_is_its_pixels(metric, norm):
    """Against the pixels as points: moments to rounding; groups at most `excess` above, and never below."""
    z, points = image()
    buffer = optimal_warp(SceneView(CAMERA, LIGHT, DepthBuffer(z)), Objective(metric, norm))
    pixels = np.asarray(CAMERA.to_eye(points[z > 0]))
    np.testing.assert_allclose(buffer.warp.mu, np.ptp(pixels @ np.asarray(buffer.frame.z_axis)), rtol=1e-12)
    if (metric, norm) == ("p", "l2"):
        exact = optimal_warp(SceneView(CAMERA, LIGHT, PointReceivers(points[z > 0])), Objective(metric, norm))
        np.testing.assert_allclose(buffer.value, exact.value, rtol=1e-12)
        np.testing.assert_allclose(buffer.warp.eta, exact.warp.eta, rtol=1e-12)
    else:
        errors = np.asarray(buffer.aliasing_error(pixels, metric))  # with the conservative width
        true = errors.max() if norm == "inf" else np.sqrt((errors**2).mean())
        assert buffer.value >= true * (1 - 1e-12)
        assert buffer.value <= true * (1 + buffer.excess) * (1 + 1e-12)
        assert buffer.excess < 0.12  # 3.7 % a bin, to the power of E_pxq's A^3
    matrix = shadow_matrix(SceneView(CAMERA, LIGHT, DepthBuffer(z)), buffer.warp)
    clip = np.c_[points[z > 0], np.ones((z > 0).sum())] @ np.asarray(matrix).T
    assert (np.abs(clip[:, :3] / clip[:, 3:]) < 1 + 1e-9).all()
    assert (clip[:, 3] > 0).all()


def test_encodings_are_one_buffer():
    """Linear, standard and reversed z: the same pixels, the same background."""
    z, _ = image()  # linear z is compiled for the test above
    n, f = float(CAMERA.near), float(CAMERA.far)
    safe = np.where(z > 0, z, 1.0)
    standard = np.where(z > 0, f * (safe - n) / (safe * (f - n)), 1.0)
    linear, one, other = DepthBuffer(z), DepthBuffer(standard, "standard"), DepthBuffer(1 - standard, "reversed")
    for buffer in (one, other):  # 1 - d has d's rounding: eps f/n in z
        np.testing.assert_allclose(buffer.eye_depth(CAMERA), linear.eye_depth(CAMERA), rtol=1e-10)
    etas = [optimal_warp(SceneView(CAMERA, LIGHT, each), Objective("p", "l2")).warp.eta for each in (linear, one)]
    np.testing.assert_allclose(etas[1], etas[0], rtol=1e-10)


def test_a_depth_buffer_of_sky_alone_is_empty():
    """In every objective and encoding that the tests above have compiled: moments, groups, and the extent alone."""
    size = image()[0].shape
    linear, standard = DepthBuffer(np.zeros(size)), DepthBuffer(np.ones(size), "standard")
    weighed = DepthBuffer(np.zeros(size), weights="depth")
    cases = (
        (linear, "p", "l2"), (linear, "pxq", "inf"), (linear, "q", "l2"), (standard, "p", "l2"), (weighed, "p", "l2")
    )  # fmt: skip
    for sky, metric, norm in cases:
        solution = optimal_warp(SceneView(CAMERA, LIGHT, sky), Objective(metric, norm))
        assert Outcome(int(solution.result)) == Outcome.empty
        assert solution.value == 0
        matrix = shadow_matrix(SceneView(CAMERA, LIGHT, sky), solution.warp)
        assert jnp.isfinite(matrix).all()


def test_a_histogram_of_the_whole_range_is_the_whole_frustum():
    """Uniform over the screen at each depth, with the screen measure's flat density in z."""
    edges = np.geomspace(0.5, 80, BINS + 1)
    whole = optimal_warp(SceneView(CAMERA, LIGHT), Objective("p", "l2"))
    histogram = optimal_warp(SceneView(CAMERA, LIGHT, DepthHistogram(edges, np.diff(edges))), Objective("p", "l2"))
    np.testing.assert_allclose(histogram.value, whole.value, rtol=1e-10)
    np.testing.assert_allclose(histogram.warp.eta, whole.warp.eta, rtol=1e-10)
    far_half = DepthHistogram(edges, np.where(edges[:-1] > 10, 1.0, 0.0))
    part = optimal_warp(SceneView(CAMERA, LIGHT, far_half), Objective("pxq"))
    assert part.warp.mu < whole.warp.mu
    assert part.excess == 0  # its corners are exact


@pytest.mark.thorough
def test_gradients_are_those_of_the_whole_solve_and_finite_everywhere():
    """Light, camera, box and points: centred differences of the solve against the equation's derivative."""
    points = np.random.default_rng(3).normal(size=(40, 3)) * [6, 2, 8] + [3, 0, -20]

    def answers(inputs, metric, norm, kind):
        camera = Camera(inputs["position"], inputs["forward"], jnp.array([0.0, 1, 0]), 0.5, inputs["far"], 0.5)
        light = DirectionalLight(inputs["light"])
        receivers = {
            "box": ConvexBody.box(inputs["lower"], inputs["lower"] + jnp.array([20.0, 4.0, 40.0])),
            "points": PointReceivers(inputs["points"]),
        }[kind]
        solution = optimal_warp(SceneView(camera, light, receivers), Objective(metric, norm), throw=False)
        return jnp.stack([solution.warp.eta, solution.value])

    inputs = {
        "position": np.array([1.0, 2, 3]), "forward": np.array([0.1, -0.2, -1.0]), "far": np.array(80.0),
        "light": np.array([0.4, -1.0, -0.3]), "lower": np.array([-9.0, -1.0, -60.0]), "points": points,
    }  # fmt: skip
    rng = np.random.default_rng(7)
    direction = jax.tree.map(lambda v: rng.normal(size=v.shape), inputs)
    for kind, metric, norm in (("box", "p", "l2"), ("points", "pxq", "inf")):

        def solve(v, m=metric, n=norm, k=kind):
            return answers(v, m, n, k)

        @jax.jit
        def pulled(v, weights, solve=solve):  # the answers, and the derivatives of their weighted sum
            at, pull = jax.vjp(solve, v)
            return at, pull(weights)[0]

        pulled = functools.partial(lambda call, *given: jax.device_get(call(*given)), pulled)
        weights = np.array([1.0, 0.0]), np.array([0.0, 1.0])
        at, _ = pulled(inputs, weights[0])
        along = [sum((pulled(inputs, w)[1][name] * direction[name]).sum() for name in inputs) for w in weights]
        step = 1e-6
        plus, minus = (
            pulled(jax.tree.map(lambda v, d, h=h: v + h * d, inputs, direction), weights[0])[0] for h in (step, -step)
        )
        difference = (plus - minus) / (2 * step)
        size = np.abs(at)
        np.testing.assert_allclose(along / size, difference / size, rtol=2e-6, atol=2e-7)  # eps/step
        for edge in (
            {"light": inputs["forward"]}, {"light": np.array([0.0, -1.0, 0.0])}, {"light": -inputs["forward"]},
            {"lower": np.array([-9.0, -1.0, 60.0])}, {"points": points * np.array([1.0, 1.0, 0.0]) - 5.0},
            {"lower": np.array([1.0, 2.0, 3.0])}, {"points": np.zeros_like(points)},
        ):  # fmt: skip
            gradient = pulled(inputs | edge, np.ones(2))[1]
            assert all(np.isfinite(g).all() for g in gradient.values()), (kind, metric, norm, edge)


@pytest.mark.wrong_types
@pytest.mark.parametrize(("make", "words"), [
    (lambda: Camera((0, 0, 0), (0, 0, 0), (0, 1, 0), 1, 2, 0.5), "forward: got 0.0, expected a vector that is"),
    (lambda: Camera((0, 0, 0), (0, 2, 0), (0, 1, 0), 1, 2, 0.5), "not parallel to forward"),
    (lambda: Camera((0, 0, np.nan), (0, 0, 1), (0, 1, 0), 1, 2, 0.5), "position: got nan, expected finite"),
    (lambda: Camera((0, 0), (0, 0, 1), (0, 1, 0), 1, 2, 0.5), r"position: got shape \(2,\), expected \(3,\)"),
    (lambda: Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1, 2, 0.5, -1), "aspect: got -1.0"),
    (lambda: Camera.from_view_matrix(np.zeros((4, 4)), 1, 2, 0.5), "view: got 0.0, expected a regular, rigid"),
    (lambda: Camera.from_view_matrix(np.eye(3), 1, 2, 0.5), r"view: got shape \(3, 3\)"),
    (lambda: Camera.off_centre((0, 0, 0), (0, 0, 1), (0, 1, 0), 1, 2, (1, -1, -1, 1)), "window: got .* left < right"),
    (lambda: DirectionalLight((0, 0, 0)), "direction: got 0.0, expected a vector that is not zero"),
    (lambda: DirectionalLight((0, np.nan, 0)), "direction: got nan, expected finite numbers"),
    (lambda: ConvexBody(np.zeros((2, 4))), "normals that are not zero"),
    (lambda: ConvexBody.box((0, 0, np.nan), (1, 1, 1)), "lower: got nan, expected numbers"),
    (lambda: Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), [1, 2], 3, 0.5), r"near: got shape \(2,\), expected a number"),
    (lambda: Camera.off_centre((0, 0, 0), (0, 0, 1), (0, 1, 0), 1, 2, (0, 1, 2)), r"window: got \(0, 1, 2\)"),
    (lambda: optimal_warp(SceneView(CAMERA, LIGHT, PointReceivers([[0.0, 0.0, -5.0]])), Objective("p", 34.0)),
     "order at most 66, or inf"),  # binomial coefficients beyond 64 bits ended in a traceback
    (lambda: optimal_warp(warpopt.FrustumView(warpopt.ViewFrustum(1.0, 9.0, 0.5), 1.0), min_eta=2.0),
     "min_eta: got 2.0, expected"),
    (lambda: SceneView(CAMERA, (0, 0, 1)), r"light: got \(0, 0, 1\), expected a DirectionalLight"),
    (lambda: SceneView(CAMERA, LIGHT, np.zeros((3, 3))), "receivers: got ndarray, expected one of"),
    (lambda: SceneView(CAMERA, LIGHT, screen=5, shadow_map=(1, 1)), r"screen: got shape \(\), expected two numbers"),
    (lambda: shadow_matrix(SceneView(CAMERA, LIGHT), 0.5), "warp: got 0.5, expected a warpopt.Warp or a solution"),
    (lambda: shadow_matrix(SceneView(CAMERA, LIGHT), NONE, "vulkan"),
     "clip_space: got 'vulkan', expected a ClipSpace"),
    (lambda: shadow_matrix(SceneView(CAMERA, LIGHT), NONE, padding=(0.5, 0.1)),
     "padding: got"),
    (lambda: optimal_warp(SceneView(CAMERA, LIGHT, ConvexBody(np.eye(3, 4))), Objective(measure="axis")),
     "measure: got 'axis' with ConvexBody, expected one of"),
    (lambda: PointReceivers(np.zeros(3)), r"points: got shape \(3,\), expected \(N, 3\)"),
    (lambda: PointReceivers(np.zeros((2, 3)), [1.0]), r"weights: got shape \(1,\), expected \(2,\)"),
    (lambda: PointReceivers(np.zeros((2, 3)), [1.0, -1.0]), "weights: got -1.0"),
    (lambda: DepthBuffer(np.zeros(4)), r"depth: got shape \(4,\), expected \(height, width\)"),
    (lambda: DepthBuffer([[1.0, np.nan]]), "depth: got nan, expected eye depths, not NaN"),
    (lambda: DepthBuffer([[1.0, np.nan]], "standard"), r"depth: got nan, expected numbers in \[0, 1\]"),
    (lambda: DepthBuffer([[1.0]], "log"), "encoding: got 'log'"),
    (lambda: DepthHistogram([1.0, 2.0], [1.0, 2.0]), r"counts: got shape \(2,\) with edges \(2,\)"),
    (lambda: DepthHistogram([2.0, 1.0], [1.0]), "edges: got 2.0, expected increasing depths"),
    (lambda: optimal_warp(SceneView(CAMERA, LIGHT), Objective(norm=1.7)),
     r"order 1.7 over receivers, expected one with \(2 alpha \+ beta\) order an integer"),
    (lambda: optimal_warp(SceneView(CAMERA, LIGHT), min_eta=0.0), "min_eta: got 0.0"),
    (lambda: shadow_matrix(SceneView(CAMERA, LIGHT), NONE, casters=[1.0]),
     r"casters: got shape \(1,\)"),
])  # fmt: skip
def test_bad_input_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_a_view_matrix_is_its_camera():
    """OpenGL's and Direct3D's matrices of one pose give the camera made from vectors."""
    rotation, position = np.asarray(CAMERA.rotation), np.asarray(CAMERA.position)
    gl, d3d = np.eye(4), np.eye(4)
    gl[:3, :3] = rotation * np.array([[1], [1], [-1]])
    d3d[:3, :3] = rotation
    points = np.random.default_rng(1).normal(size=(5, 3))
    for view, looks in ((gl, "-z"), (d3d, "+z")):
        view[:3, 3] = -view[:3, :3] @ position
        camera = Camera.from_view_matrix(view, 0.5, 80.0, 0.5, 1.4, looks_along=looks)
        np.testing.assert_allclose(camera.to_eye(points), CAMERA.to_eye(points), atol=1e-13)
    rough = Camera.from_view_matrix(gl.astype(np.float32).round(5), 0.5, 80.0, 0.5, 1.4)  # as a log file has it
    np.testing.assert_allclose(rough.rotation @ rough.rotation.T, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(rough.to_eye(points), CAMERA.to_eye(points), atol=1e-4)
    off = Camera.off_centre(position, rotation[2], rotation[1], 0.5, 80.0, tuple(np.asarray(CAMERA.window)))
    np.testing.assert_allclose(off.planes(), CAMERA.planes(), atol=1e-14)
    left = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1, 2, 0.5, handedness="left")
    np.testing.assert_allclose(left.to_eye((1.0, 2.0, 3.0)), [1, 2, 3])

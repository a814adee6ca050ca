"""The matrix to render with: where points land, in conventions of every kind."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import turned

import warpopt
from warpopt import Camera, ClipSpace, DirectionalLight, Objective, SceneView, Warp, optimal_warp, shadow_matrix
from warpopt.receivers import ConvexBody, PointReceivers

N, F, PHI = 1.0, 100.0, np.pi / 6
# Half of the sixteen, each compiled for itself: every three of the four choices in all eight ways.
CONVENTIONS = [
    ClipSpace(z, y, reverse, z ^ y ^ reverse)
    for z in (False, True) for y in (False, True) for reverse in (False, True)
]  # fmt: skip


def through(matrix, points, convention):
    """(t, s, depth, w) of world points: depth from 0, nearest to the light, to 1."""
    columns = matrix.T if convention.row_vectors else matrix
    x, y, z, w = np.asarray(columns @ np.c_[points, np.ones(len(points))].T)
    t, s, depth = (x / w + 1) / 2, (y / w + 1) / 2, z / w
    s = 1 - s if convention.y_down else s
    depth = depth if convention.z_zero_to_one else (depth + 1) / 2
    return t, s, 1 - depth if convention.reversed_z else depth, w


def posed(theta, seed=5):
    """A camera in a random pose, AT09's light before it, and the world points of eye coordinates."""
    rotation, shift = turned(seed)
    camera = Camera(shift, rotation @ jnp.array([0, 0, -1.0]), rotation @ jnp.array([0, 1.0, 0]), N, F, PHI)
    light = DirectionalLight(rotation @ jnp.array([0, np.sin(theta), -np.cos(theta)]))

    def to_world(eye):
        return np.asarray(shift + jnp.asarray(eye * np.array([1, 1, -1])) @ rotation.T)

    return camera, light, to_world


def eye_points(seed, count=300):
    rng = np.random.default_rng(seed)
    z = rng.uniform(N, F, count)
    corners = np.array([[x, y, 1] for x in (-1, 1) for y in (-1, 1)]) * [np.tan(PHI), np.tan(PHI), 1]
    inner = np.c_[rng.uniform(-1, 1, (count, 2)) * np.tan(PHI), np.ones(count)] * z[:, None]
    return np.concatenate([inner, corners * N, corners * F])


@pytest.mark.parametrize("theta", [0.2, 0.8, np.pi / 2, 2.2])
def test_texture_coordinates_are_the_theorys(theta):
    """(t, s) through the matrix equals AT09's to 1e-12, in eight conventions, for any pose; the map is just filled."""
    camera, light, to_world = posed(theta)
    frustum = warpopt.ViewFrustum(N, F, PHI)
    warp = Warp.from_eta(0.07, warpopt.FrustumView(frustum, theta))
    eye = eye_points(0)
    u = (1 - eye[:, 1] / (eye[:, 2] * np.tan(PHI))) / 2
    u = u if theta <= np.pi / 2 else 1 - u
    t0, s0 = warpopt.theory.texture_coordinates(frustum, theta, warp, *eye.T)
    for convention in CONVENTIONS:
        matrix = shadow_matrix(SceneView(camera, light), warp, convention)
        t, s, depth, w = through(matrix, to_world(eye), convention)
        np.testing.assert_allclose(t, t0, atol=1e-12)
        np.testing.assert_allclose(s, s0, atol=1e-12)
        assert (w > 0).all()
        assert depth.min() == pytest.approx(0, abs=1e-12)
        assert depth.max() == pytest.approx(1, abs=1e-12)


def test_no_warp_is_the_plain_focused_map():
    """eta = 1: an affine matrix, orthogonal to the light, whose map is the frustum's bounding rectangle."""
    camera, light, to_world = posed(0.9)
    view = SceneView(camera, light)
    matrix = shadow_matrix(view, Warp.from_eta(1.0, view.footprint()))
    np.testing.assert_allclose(matrix[3], [0, 0, 0, 1], atol=1e-15)
    t, s, _, _ = through(matrix, to_world(eye_points(1)), ClipSpace())
    assert [v.min() for v in (t, s)] == pytest.approx([0, 0], abs=1e-12)
    assert [v.max() for v in (t, s)] == pytest.approx([1, 1], abs=1e-12)
    moved = matrix @ jnp.append(light.direction, 0.0)  # along the light only the depth changes
    np.testing.assert_allclose(moved[:2], 0, atol=1e-14)
    assert moved[2] > 0


@pytest.mark.parametrize("theta", [0.7, 1.2, np.pi / 2])
def test_it_is_scherzers_construction(theta):
    """SC (1)-(3): apex C_eye - (n_opt - z_n) V_P, V_P the view along W's axis; lambda = n_opt - z_n + d0 where > 0.

    SC's frustum is made here from its words: a perspective projection from the apex along V_P, scaled to the map.
    """
    camera, light, to_world = posed(theta, seed=8)
    view, direction = (np.asarray(v) for v in (camera.rotation[2], light.direction))
    v_p = view - direction * (direction @ view)
    v_p /= np.linalg.norm(v_p)
    frustum = warpopt.ViewFrustum(N, F, PHI)
    rule = warpopt.rules.scherzer(frustum, theta)
    n_opt = (N + np.sqrt(N * (N + float(rule.mu)))) / np.sin(theta)  # Dz: the body's extent along V_P
    apex = np.asarray(camera.position) - (n_opt - N) * v_p
    side = np.cross(direction, v_p)
    points = to_world(eye_points(2))
    along = (points - apex) @ v_p
    near, far = along.min(), along.max()
    assert near > 0
    s = (1 / near - 1 / along) / (1 / near - 1 / far)
    across = (points - apex) @ side / along
    t = (across - across.min()) / np.ptp(across)
    np.testing.assert_allclose(rule.lam, near, rtol=1e-12)
    found_t, found_s, _, _ = through(shadow_matrix(SceneView(camera, light), rule), points, ClipSpace())
    np.testing.assert_allclose(found_s, s, atol=1e-12)
    # left and right on the map are a convention of X_w's sense
    assert min(np.abs(found_t - t).max(), np.abs(found_t - (1 - t)).max()) < 1e-12


def test_casters_before_receivers_stay_in_the_map_with_w_positive():
    """Any point between the light and a receiver: t and s are the receiver's, w the same, depth in [0, 1]."""
    rng = np.random.default_rng(4)
    camera = Camera((0, 2, 0), (0.2, -0.3, -1), (0, 1, 0), 0.1, 300.0, 0.5, 1.6)
    light = DirectionalLight((0.4, -1, 0.3))
    lower, upper = np.array([-40.0, 0, -90]), np.array([40.0, 6, -10])
    box = ConvexBody.box(lower, upper)
    corners = np.array([[x, y, z] for x in (-40, 40) for y in (0, 30) for z in (-90, 0)], float)
    view = SceneView(camera, light, box)
    best = optimal_warp(view)
    assert best.warp.eta < 0.5
    matrix = shadow_matrix(view, best, ClipSpace.vulkan(), casters=corners)
    points = rng.uniform(lower, upper, (4000, 3))
    eye = np.asarray(camera.to_eye(points))
    seen = (eye @ np.asarray(camera.planes())[:, :3].T + np.asarray(camera.planes())[:, 3] > 0).all(1)
    receivers = points[seen]
    assert len(receivers) > 100
    t, s, depth, w = through(matrix, receivers, ClipSpace.vulkan())
    for value in (t, s, depth):
        assert value.min() > -1e-12
        assert value.max() < 1 + 1e-12
    assert w.min() > 0
    # up the light to the height of the tallest caster
    towards = receivers - np.asarray(light.direction) * rng.uniform(0, 20, len(receivers))[:, None]
    up = towards[towards @ np.asarray(light.direction) > (corners @ np.asarray(light.direction)).min()]
    t2, s2, depth2, w2 = through(matrix, up, ClipSpace.vulkan())
    kept = towards @ np.asarray(light.direction) > (corners @ np.asarray(light.direction)).min()
    np.testing.assert_allclose(t2, t[kept], atol=1e-9)
    np.testing.assert_allclose(s2, s[kept], atol=1e-9)
    np.testing.assert_allclose(w2, w[kept], rtol=1e-9)
    assert depth2.min() > -1e-12
    assert (depth2 <= depth[kept] + 1e-12).all()
    without = shadow_matrix(view, best, ClipSpace.vulkan())
    # The depth that casters take is taken from the receivers': without them it is finer.
    assert np.ptp(through(without, receivers, ClipSpace.vulkan())[2]) > 1.2 * np.ptp(depth)


def test_round_trip_and_orientation():
    """The inverse brings points back; s grows away from the eye along W's axis, depth away from the light."""
    camera, light, to_world = posed(1.1)
    view = SceneView(camera, light)
    points = to_world(eye_points(3))
    matrix = shadow_matrix(view, Warp.from_eta(0.1, view.footprint()))
    clip = np.c_[points, np.ones(len(points))] @ np.asarray(matrix).T
    back = (clip / clip[:, 3:]) @ np.linalg.inv(np.asarray(matrix)).T
    np.testing.assert_allclose(back[:, :3] / back[:, 3:], points, atol=1e-9)
    here = points[:1]
    ahead = here + np.asarray(camera.rotation[2])
    below = here + 0.1 * np.asarray(light.direction)
    s = [through(matrix, p, ClipSpace())[1][0] for p in (here, ahead)]
    depths = [through(matrix, p, ClipSpace())[2][0] for p in (here, below)]
    assert s[0] < s[1]
    assert depths[0] < depths[1]


def test_the_order_of_light_reaches_the_light_from_receivers_to_sky():
    """Reversed z, z in [0, 1]: the receiver nearest to the light has z/w = 1."""
    camera, light, to_world = posed(np.pi / 2)
    view = SceneView(camera, light)
    convention = ClipSpace.direct3d(reversed_z=True)
    matrix = shadow_matrix(view, Warp.from_eta(1.0, view.footprint()), convention)
    points = to_world(eye_points(6))
    clip = np.c_[points, np.ones(len(points))] @ np.asarray(matrix)
    nearest = np.argmin(points @ np.asarray(light.direction))
    assert clip[nearest, 2] / clip[nearest, 3] == pytest.approx(1, abs=1e-12)


def test_receivers_of_any_kind_land_in_the_map():
    """No receiver outside, ever: a thousand points that are grouped conservatively, at their own optimum."""
    rng = np.random.default_rng(9)
    z = np.exp(rng.uniform(0, 4, 3000))
    points = np.c_[rng.uniform(-0.5, 0.5, (3000, 2)) * z[:, None], -z]
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI)
    for direction in ((0.2, -1, -0.6), (1, 0.1, 0.4)):
        light = DirectionalLight(direction)
        view = SceneView(camera, light, PointReceivers(points))
        best = optimal_warp(view, Objective("pxq"))
        t, s, depth, w = through(shadow_matrix(view, best), points, ClipSpace())
        for value in (t, s, depth):
            assert value.min() > -1e-12
            assert value.max() < 1 + 1e-12
        assert w.min() > 0
        assert 0 <= best.excess < 0.12  # the bins' 3.7 %, to the power of E_pxq's A^3


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_caster_and_receiver_share_a_texel_next_to_parallel_too(dtype):
    """Frozen axes are perpendicular to the light as it is: moving along it changes neither t, s nor w."""
    camera = jax.tree.map(lambda v: v.astype(dtype), Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI))
    for size in (3e-4, 1e-5, 0.0):
        light = DirectionalLight(np.array([size, size / 2, -1], dtype))
        view = SceneView(camera, light)
        matrix = shadow_matrix(view, Warp.from_eta(dtype(0.4), view.footprint()))
        moved = np.asarray(matrix @ jnp.append(light.direction, 0))[[0, 1, 3]] * 100
        np.testing.assert_allclose(moved, 0, atol=200 * np.finfo(dtype).eps)


def test_the_gradient_is_frozen_where_light_and_view_are_parallel():
    """Below sin(theta) = sqrt(eps) W's axes are fixed: finite derivatives; above, they grow as 1/sin(theta)."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), N, F, PHI)

    def matrix(direction):
        view = SceneView(camera, DirectionalLight(direction))
        return shadow_matrix(view, Warp.from_eta(0.5, view.footprint()))

    derivative = jax.jit(jax.jacfwd(matrix))
    for size in (0.0, 1e-300, 1e-9):
        assert jnp.isfinite(derivative(jnp.array([0.0, size, -1.0]))).all()
    turning = [jnp.abs(derivative(jnp.array([0.0, size, -1.0]))[..., 0]).max() for size in (1e-3, 1e-5, 1e-7)]
    assert 50 < turning[1] / turning[0] < 200
    assert 50 < turning[2] / turning[1] < 200  # not frozen before it must be


@pytest.mark.parametrize("eta", [1.0, 0.2])
def test_errors_are_what_the_matrix_does_to_pixels_and_texels(eta):
    """Densities against derivatives of the matrix: pixels that are no squares, t != s and a light that rolls the map.

    Along X_w, and for Z_w, the direction in which s alone depends on a point, across X_w's image: pixels that a step
    moves on the screen, over texels that a step in space moves in the map. So E_p E_q is an area, also where pixels
    are no squares. Killed: t in the place of s, width of height.
    """
    columns, rows, texels = 1920, 1080, np.array([2048, 640])
    window = np.array([-0.5, 0.9, -0.4, 0.3])
    camera = Camera.off_centre((1, 2, 3), (0.2, -0.1, -1), (0.3, 1, 0.1), N, F, tuple(window))
    light = DirectionalLight((0.7, -0.5, -0.3))
    view = SceneView(camera, light, screen=(columns, rows), shadow_map=texels)
    solution = optimal_warp(view, Objective("max"))
    matrix, plain = (shadow_matrix(view, Warp.from_eta(v, solution.footprint)) for v in (eta, 1.0))

    def texel(matrix, eye):
        clip = matrix @ jnp.append(eye @ camera.rotation + camera.position, 1)
        return (clip[:2] / clip[3] + 1) / 2 * texels

    x_axis, z_axis = (v / np.linalg.norm(v) for v in np.asarray(jax.jacfwd(texel, 1)(plain, jnp.array([0.0, 0, 5]))))
    pixels = np.array([columns / (window[1] - window[0]), rows / (window[3] - window[2])])
    for eye in np.array([[0.1, -0.2, 1.0], [3.0, 2.0, 12.0], [-20.0, 10.0, 70.0]]):
        moved = np.asarray(jax.jacfwd(texel, 1)(matrix, jnp.asarray(eye)))
        row, column = (axis[:2] / np.linalg.norm(axis[:2]) * pixels / eye[2] for axis in (x_axis, z_axis))
        height = abs(row[0] * column[1] - row[1] * column[0]) / np.linalg.norm(row)
        for metric, exact in (
            ("q", np.linalg.norm(row) / abs(moved[0] @ x_axis)), ("p", height / abs(moved[1] @ z_axis)),
        ):  # fmt: skip
            assert float(solution.aliasing_error(eye, metric, eta)) == pytest.approx(exact, rel=1e-11), metric


def test_padding_leaves_its_share_of_the_map_free():
    """At each edge: t and s of the unpadded map go to pad + (1 - 2 pad) of them; the depth stays."""
    camera, light, to_world = posed(0.8)
    points = to_world(eye_points(1))
    view = SceneView(camera, light)
    warp = optimal_warp(view)
    plain, padded = (
        np.stack(through(shadow_matrix(view, warp, padding=padding), points, ClipSpace())[:3])
        for padding in ((0.0, 0.0), (0.05, 0.2))
    )
    pads = np.array([0.05, 0.2, 0.0])[:, None]
    np.testing.assert_allclose(padded, pads + (1 - 2 * pads) * plain, atol=1e-12)

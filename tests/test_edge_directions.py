"""The mean offset of edges whose directions are known, against brute force from raw geometry."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_means import CAMERA, ETAS, MAP, SCREEN, brute, hills, norm_of, pixels_of, sets

import warpopt
from warpopt import Camera, DirectionalLight, Objective, SceneView, edge_weights, optimal_warp
from warpopt.receivers import DepthBuffer, DepthHistogram, EdgeWeights, PointReceivers
from warpopt.solve.means.cell_bounds import _narrowing, corner_mean, covariance_loss
from warpopt.theory import edge_offset, offset_across

BAND = Objective("band")


@functools.cache
def normals():
    """(300, 64, 2) unit normals."""
    angle = np.random.default_rng(8).uniform(0, 2 * np.pi, (300, 64))
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def view_of(points, weights, light, normals):
    receivers = PointReceivers(points, EdgeWeights(weights, normals))
    return SceneView(CAMERA, DirectionalLight(light), receivers, screen=SCREEN, shadow_map=MAP)


@functools.cache
def solver():
    return jax.jit(jax.vmap(lambda *each: optimal_warp(view_of(*each), BAND, throw=False)))


@pytest.mark.thorough
def test_the_optimum_over_edges_of_known_directions_is_brute_force_s():
    """300 sets. The grid's least value is above the optimum by its spacing; the value must be exact at eta."""
    points, weights, lights = sets()
    found = jax.device_get(solver()(points, weights, lights, normals()))
    for i, value in enumerate(found.value):
        args = points[i], weights[i], lights[i], BAND
        at_eta = brute(*args, float(found.warp.eta[i]), normals=normals()[i])[0]
        np.testing.assert_allclose(value, at_eta, rtol=1e-12)
        assert value <= brute(*args, ETAS, normals=normals()[i]).min() * (1 + 1e-9)
        assert 0 <= found.gap[i] <= 1e-6
    assert not found.excess.any()


def test_a_curve_lies_below_the_mean():
    """For all pairs of 40 eta, over 300 sets, of which the last have one receiver that counts.

    Over these the term with the pole is needed: columns that lean just short of their edge.
    """
    points, weights, lights = (v.copy() for v in sets())
    weights[100:] = np.arange(64) == np.arange(200)[:, None] % 24
    eta = np.geomspace(1e-3, 1, 40)
    touch = jax.jit(lambda *each: jax.vmap(norm_of(view_of(*each), BAND).touch)(jnp.asarray(eta)))
    step = eta - eta[:, None]
    needed = 0
    for i in range(300):
        value, slope, bend, pole = map(np.asarray, touch(points[i], weights[i], lights[i], normals()[i]))
        below = value[:, None] + slope[:, None] * step - (bend[:, None] + pole[:, None] / eta) * step**2
        assert (below <= value * (1 + 1e-12)).all()
        needed += (below + pole[:, None] / eta * step**2 > value * (1 + 1e-9)).any()
    assert needed >= 3


@pytest.mark.parametrize("shear", [-0.7, 0.0, 1.5])
def test_the_mean_over_all_directions_is_the_band(shear):
    """Trapezoidal sums over the circle are exact but at kinks: 40,000 leave 1e-8."""
    t = np.arange(40_000) * (np.pi / 40_000)
    e_p, e_q = 1.7, 0.6
    mean = offset_across(jnp.asarray(e_p * (np.cos(t) + shear * np.sin(t))), jnp.asarray(e_q * np.sin(t))).mean()
    np.testing.assert_allclose(mean, edge_offset(*map(jnp.asarray, (e_p, shear, e_q))), rtol=1e-7)


def test_an_offset_is_the_mean_over_a_texel():
    """Of |u a + v b| by a midpoint rule; its gradients are finite and between -1/4 and 1/4, also at 0."""
    u = (np.arange(1000) + 0.5) / 1000 - 0.5
    for a, b in ((3.0, 1.0), (-0.2, 5.0), (2.0, -2.0), (1.0, 0.0), (0.0, 0.0)):
        mean = np.abs(u[:, None] * a + u * b).mean()
        np.testing.assert_allclose(offset_across(jnp.asarray(a), jnp.asarray(b)), mean, rtol=1e-5)
        gradient = jnp.stack(jax.grad(offset_across, (0, 1))(a, b))
        assert (jnp.abs(gradient) <= 0.25).all()


def rounded(c, s, count=16):
    """The nearest of 16 directions, even in s/(|c| + |s|)."""
    c, s = np.where(c < 0, -c, c), np.where(c < 0, -s, s)
    c = np.where(c + np.abs(s) > 0, c, 1)  # away from edges: whatever it is, its weight is 0
    place = np.clip(np.floor((s / (c + np.abs(s)) + 1) * count / 2), 0, count - 1)
    s = (place + 0.5) / (count / 2) - 1
    return (1 - np.abs(s)) / np.hypot(1 - np.abs(s), s), s / np.hypot(1 - np.abs(s), s)


def hills_of(seed):
    depth, lit = hills(seed)
    edges = edge_weights(lit, DepthBuffer(depth), CAMERA)
    seen = depth > 0
    points, weights = pixels_of(depth, edges.weights)
    return depth, edges, points, weights, np.asarray(edges.normals)[seen]


@jax.jit
def bounds_at(norm, eta):
    """Below and above the mean over the pixels; the width of maps of sides 3 and 2 % narrower at best, its own, and the
    factor between them."""
    scale, sides = jnp.exp(norm.log_scale), norm.footprint.sides
    reached = 0.97 * sides.right, 0.98 * sides.left
    footprint = eqx.tree_at(lambda f: f.sides.reached, norm.footprint, reached, is_leaf=lambda v: v is None)
    best = eqx.tree_at(lambda n: n.footprint, norm, footprint.at_best())
    below, above = (norm.touch(eta).value - covariance_loss(norm, eta, eta)) * scale, corner_mean(norm, eta) * scale
    return below, above, best.width(eta), norm.width(eta), _narrowing(norm, best, eta)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.thorough("0")
def test_cells_of_a_buffer_are_its_pixels_within_the_bound(seed):
    depth, edges, points, weights, across = hills_of(seed)
    rng = np.random.default_rng(seed)
    light = np.array([rng.normal(), -1.0, rng.normal()])
    view = SceneView(CAMERA, DirectionalLight(light), DepthBuffer(depth, weights=edges), screen=SCREEN, shadow_map=MAP)
    solution = optimal_warp(view, BAND)
    etas = [float(solution.warp.eta), *np.geomspace(1e-3, 1, 100)]
    true = brute(points, weights, light, BAND, etas, normals=across, rounded=rounded)
    assert 0 < solution.excess <= 1e-3
    assert true[0] <= true[1:].min() * (1 + solution.excess)
    np.testing.assert_allclose(solution.value, true[0], rtol=float(solution.excess))
    assert abs(float(solution.value) / true[0] - 1) > 1e-9  # it is an approximation: the bound has work to do
    # Directions are rounded by 7 degrees at most: errors of both signs, of about 1 % at any eta, less at the optimum.
    exact = brute(points, weights, light, BAND, etas, normals=across)
    np.testing.assert_allclose(exact, true, rtol=0.02)
    assert exact[0] <= exact[1:].min() * (1 + 2e-3)
    # The bounds hold at every eta, not only at the optimum.
    norm = norm_of(view, BAND)
    for eta in (0.004, 0.05, 0.6):
        below, most, narrowest, width, factor = bounds_at(norm, eta)
        assert factor * width * (1 - 1e-12) <= narrowest < width
        assert factor > 0.9
        between = brute(points, weights, light, BAND, eta, normals=across, rounded=rounded)[0]
        assert below * (1 - 1e-3) <= between <= most  # cells' sides are at most a thousandth too wide


def test_frames_compile_nothing_anew():
    """Of a mask, its edges and their directions: the first frame's programs are all that is needed."""
    solve = warpopt.solve.scene.solve_scene
    lights = np.random.default_rng(0).normal(size=(3, 3))
    for i, light in enumerate(lights):
        depth, edges, *_ = hills_of(i)
        buffer = DepthBuffer(depth, weights=edges)
        optimal_warp(SceneView(CAMERA, DirectionalLight(light), buffer, screen=SCREEN, shadow_map=MAP), BAND)
        if not i:
            before = solve._cache_size()
    assert solve._cache_size() == before


def test_directions_turn_the_optimum():
    """Across edges whose normals are Z_w's image a texel is E_p long: E_p in L1. Others need narrower texels."""
    points, weights, lights = sets()
    axes = jax.jit(jax.vmap(lambda *each: view_of(*each).frame().screen_axes))(points, weights, lights, normals())
    across = np.repeat(np.asarray(axes)[:, :1], 64, 1)
    across[150:] = np.repeat(np.asarray(axes)[:, 1:], 64, 1)[:150]
    again = [np.concatenate([v[:150], v[:150]]) for v in (points, weights, lights)]
    found = solver()(*again, across)
    eta = np.asarray(found.warp.eta)
    coordinates = jax.jit(jax.vmap(lambda each, at: each.coordinates(CAMERA.to_eye(at))))
    depths, _, z = jax.tree.map(np.asarray, coordinates(found, again[0]))
    for i in range(150):
        share = weights[i] / z[i]
        squares = [(share * d[i] ** 2).sum() for d in depths]
        np.testing.assert_allclose(eta[i], min(1, np.sqrt(squares[0] / squares[1])), rtol=1e-7)
    assert (eta[150:] < eta[:150] * (1 + 1e-7)).mean() > 0.9


def test_an_unknown_direction_is_the_mean_over_all():
    points, weights, lights = (v[5] for v in sets())
    known = normals()[5]
    half = np.where(np.arange(64)[:, None] % 2, known, 0)
    warp = warpopt.Warp.from_eta([0.02, 0.5], view_of(points, weights, lights, known).footprint())

    def value(weights, normals):
        return warpopt.error_norm(view_of(points, weights, lights, normals), warp, BAND)

    none = np.zeros((64, 2))
    undirected = SceneView(
        CAMERA, DirectionalLight(lights), PointReceivers(points, weights), screen=SCREEN, shadow_map=MAP
    )
    np.testing.assert_allclose(value(weights, none), warpopt.error_norm(undirected, warp, BAND), rtol=1e-14)
    odd = np.arange(64) % 2
    share = (weights * odd).sum() / weights.sum()
    parts = share * value(weights * odd, known) + (1 - share) * value(weights * (1 - odd), none)
    np.testing.assert_allclose(value(weights, half), parts, rtol=1e-13)
    # Neither the length of a normal nor its sign says anything.
    np.testing.assert_allclose(value(weights, known), value(weights, -3e200 * known), rtol=1e-13)


def test_other_objectives_do_not_look_at_directions():
    points, weights, lights = (v[5] for v in sets())
    view = view_of(points, weights, lights, normals()[5])
    assert view.footprint(Objective("edge")).directed is None
    assert view.footprint(BAND).directed is not None


def test_without_any_weight_no_direction_is_left():
    points, weights, lights = (v[5] for v in sets())
    view = view_of(points, 0 * weights, lights, normals()[5])
    warp = warpopt.Warp.from_eta([0.02, 0.5], view.footprint())
    named = SceneView(CAMERA, DirectionalLight(lights), PointReceivers(points, "depth"), screen=SCREEN, shadow_map=MAP)
    one, other = (warpopt.error_norm(each, warp, BAND) for each in (named, view))
    np.testing.assert_allclose(one, other, rtol=1e-13)
    assert view.footprint(BAND).depth_weighted


def test_the_normals_of_a_mask_are_across_its_edges():
    """Straight edges of any direction to 17 degrees, 5 in the mean; thin lines too; nothing away from edges."""
    rows, columns = np.mgrid[0:40, 0:56]
    off = []
    for angle in np.linspace(0, np.pi, 37):
        across = np.cos(angle) * (columns - 28) - np.sin(angle) * (rows - 20)
        for lit in (across > 0.3, np.abs(across) < 1.2):
            edges = edge_weights(lit)
            inner = np.asarray(edges.weights) > 0
            inner[:3] = inner[-3:] = inner[:, :3] = inner[:, -3:] = False
            right, up = np.asarray(edges.normals)[inner].T
            off.append(np.abs((np.arctan2(up, right) - angle + np.pi / 2) % np.pi - np.pi / 2))
            assert not np.asarray(edges.normals)[np.asarray(edges.weights) == 0].any()
    off = np.rad2deg(np.concatenate(off))
    assert off.max() < 18
    assert off.mean() < 6


def test_the_background_has_no_normals():
    """The sky is dark in the mask, and the edges of what it covers are level: its outline does not turn them."""
    rows, columns = np.mgrid[0:12, 0:12]
    depth = np.where(rows + columns > 9, 5.0, 0.0)
    edges = edge_weights(
        (rows > 6) & (depth > 0), DepthBuffer(depth), Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), 0.1, 50.0, 0.5)
    )
    there = np.asarray(edges.weights) > 0
    assert there.any()
    np.testing.assert_allclose(np.abs(np.asarray(edges.normals)[there]), [[0, 1]] * there.sum(), atol=1e-12)


def test_the_last_frame_s_normals_turn_with_the_camera():
    """A wall seen by a camera that rolls by 30 degrees: normals turn the other way."""
    wall, angle = DepthBuffer(np.full((60, 60), 10.0)), np.deg2rad(30)
    straight = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 0.1, 50.0, 0.5, 1.0)
    rolled = Camera((0, 0, 0), (0, 0, -1), (np.sin(angle), np.cos(angle), 0), 0.1, 50.0, 0.5, 1.0)
    rows, columns = np.mgrid[0:60, 0:60]
    for lit, own in ((columns > 30, (1, 0)), (rows > 30, (0, 1))):
        edges = edge_weights(lit, wall, rolled, last_camera=straight)
        there = np.asarray(edges.weights) > 0
        there[:2] = there[-2:] = there[:, :2] = there[:, -2:] = False
        # The camera's right is (cos, -sin), its up (sin, cos) in the world.
        expected = np.array(
            [np.cos(angle) * own[0] - np.sin(angle) * own[1], np.sin(angle) * own[0] + np.cos(angle) * own[1]]
        )
        found = np.asarray(edges.normals)[there]
        np.testing.assert_allclose(np.abs(found @ expected), 1, atol=1e-9)


def test_the_screen_axes_are_the_images_of_the_texel_s():
    """On the view's axis: d(pixel)/d(depth along Z_w, x) over planes that are lit and seen, by elimination."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 0.1, 50.0, 0.5, 1.0)
        light = rng.normal(size=3)
        frame = SceneView(camera, DirectionalLight(light), PointReceivers([[0.0, 0, -5]])).frame()
        l, z_axis, x_axis = (np.asarray(v) for v in (frame.light, frame.z_axis, frame.x_axis))  # noqa: E741
        normal = rng.normal(size=3)
        normal = normal if normal[2] < 0 else -normal
        if normal @ l >= -0.1:
            continue
        images = []
        for axis in (z_axis, x_axis):
            step = axis - l * (normal @ axis) / (normal @ l)  # the same place on the light plane, on the surface
            images.append(step[:2] / 5.0)
        along, across = np.asarray(frame.screen_axes)
        assert images[0] @ along > 0
        np.testing.assert_allclose(images[0] @ np.array([-along[1], along[0]]), 0, atol=1e-12)
        assert images[1] @ across > 0


def test_gradients_reach_the_directions():
    """Implicit derivatives are those of all means; here those of the mean itself, also for a normal of 0."""
    points, weights, light = (v[11] for v in sets())
    warp = warpopt.Warp.from_eta(0.1, view_of(points, weights, light, normals()[11]).footprint())

    @jax.jit
    def value(turn):
        turned = jnp.asarray(normals()[11]) + turn * jnp.array([0.3, -0.2])
        return warpopt.error_norm(view_of(points, weights, light, turned * (jnp.arange(64) > 2)[:, None]), warp, BAND)

    slope = (value(0.2 + 1e-6) - value(0.2 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.grad(value)(0.2), slope, rtol=1e-6)  # of a difference: eps/1e-6 of the value


BAD = {
    "shape": (lambda: EdgeWeights(np.ones(3), np.ones((2, 2))), r"normals: got shape \(2, 2\), expected \(3, 2\)"),
    "NaN": (lambda: EdgeWeights(np.ones(1), [[np.nan, 0]]), "normals: got nan, expected finite numbers"),
    "negative": (lambda: EdgeWeights([-1.0], [[1, 0]]), "weights: got -1.0, expected finite numbers >= 0"),
    "receivers": (
        lambda: PointReceivers(np.ones((3, 3)), EdgeWeights(np.ones(2), np.ones((2, 2)))),
        r"weights: got shape \(2,\), expected \(3,\)",
    ),
    "histogram": (
        lambda: DepthHistogram([1.0, 2.0], [1.0], EdgeWeights([1.0], [[1.0, 0]])),
        "weights: got EdgeWeights with a DepthHistogram, expected one number for each bin",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_one_sentence(name):
    make, words = BAD[name]
    with pytest.raises(ValueError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)

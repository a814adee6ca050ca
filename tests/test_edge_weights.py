"""Weights of pixels beside a shadow edge: by hand, from files, from the last frame, from a ray-cast shadow map."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import warpopt
from warpopt import Camera, ClipSpace, DirectionalLight, RenderedMap, SceneView, Warp, edge_weights, shadow_matrix
from warpopt.receivers import DepthBuffer
from warpopt.render import edge_weights as module

MASK = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [0, 1, 1, 1]], bool)
BESIDE = np.array([[0, 0, 1, 1], [1, 0, 0, 1], [1, 1, 0, 0]], float)
CAMERA = Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=50.0, half_fov=0.5, aspect=4 / 3)


def weights_of(*arguments, **more):
    return np.asarray(edge_weights(*arguments, **more).weights)


def test_pixels_on_both_sides_of_an_edge_count():
    edges = edge_weights(MASK)
    np.testing.assert_array_equal(edges.weights, BESIDE)
    assert edges.share == 0.5
    # Corners that touch are no neighbours, and the screen's border is no edge.
    np.testing.assert_array_equal(weights_of(np.eye(2)), np.ones((2, 2)))
    np.testing.assert_array_equal(weights_of(np.ones((3, 4))), np.zeros((3, 4)))
    np.testing.assert_array_equal(weights_of(np.array([[1, 0, 0]])), [[1, 1, 0]])
    np.testing.assert_array_equal(weights_of(np.array([[0], [0], [1]])), [[0], [1], [1]])


def test_the_background_has_no_edges():
    depth = np.full(MASK.shape, 5.0)
    depth[0, 3] = 0.0  # the sky, which the mask calls dark
    depth[2, 1] = 60.0  # beyond the far plane
    np.testing.assert_array_equal(
        weights_of(MASK, DepthBuffer(depth), CAMERA), [[0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]]
    )


def test_no_edge_makes_weights_by_depth():
    depth = np.linspace(2, 9, 12).reshape(3, 4)
    edges = edge_weights(np.ones((3, 4), bool), DepthBuffer(depth), CAMERA)
    assert edges.share == 0
    view = SceneView(CAMERA, DirectionalLight((0.1, -1, 0.2)), DepthBuffer(depth, weights=edges))
    assert view.footprint(warpopt.Objective("p", "l2")).depth_weighted


FILES = {
    "bool.npy": MASK,
    "uint8.npy": MASK * np.uint8(255),
    "ones.npy": MASK * np.uint8(1),
    "signed.npy": MASK * np.int64(1),
    "uint16.npy": MASK * np.uint16(65535),
    "float.npy": MASK * np.float32(0.75),
    "bit.png": MASK,
    "grey8.png": MASK * np.uint8(200),
    "grey16.png": MASK * np.uint16(40000),
}


@pytest.mark.parametrize("name", FILES)
def test_a_mask_may_be_a_file(name, tmp_path):
    path = tmp_path / name
    np.save(path, FILES[name]) if name.endswith("npy") else Image.fromarray(FILES[name]).save(path)
    np.testing.assert_array_equal(weights_of(path), BESIDE)
    np.testing.assert_array_equal(weights_of(str(path)), BESIDE)


def wall_camera(columns=0.0, rows=0.0, z=0.0):
    """A camera before the wall z = -10, moved by pixels' widths on it."""
    pixel = 2 * 10 * np.tan(0.5) / 9
    return Camera((columns * pixel, -rows * pixel, z), (0, 0, -1), (0, 1, 0), 0.1, 50.0, 0.5, 16 / 9)


WALL = DepthBuffer(np.full((9, 16), 10.0))


@pytest.mark.parametrize("move", [(0, 0), (3, 0), (-2, 0), (0, 1), (0, -4), (5, 2)])
def test_edges_of_the_last_frame_are_carried_over(move):
    """By whole pixels: exactly, and 0 where the last camera saw nothing."""
    lit = np.random.default_rng(0).random((9, 16)) < 0.8
    last = weights_of(lit)
    columns, rows = move
    expected = np.zeros((9, 16))
    for i, j in np.ndindex(9, 16):
        if 0 <= i + rows < 9 and 0 <= j + columns < 16:
            expected[i, j] = last[i + rows, j + columns]
    found = edge_weights(lit, WALL, wall_camera(*move), last_camera=wall_camera())
    np.testing.assert_array_equal(found.weights, expected)
    np.testing.assert_allclose(found.share, expected.mean(), rtol=1e-15)


def test_a_mask_of_another_size_is_carried_over():
    lit = np.arange(48) * np.ones((27, 1)) < 23
    found = weights_of(lit, WALL, wall_camera(), last_camera=wall_camera())
    np.testing.assert_array_equal(found, (np.arange(16) == 7) * np.ones((9, 1)))  # at 22.5 and 25.5 of 48


def test_what_was_behind_the_last_camera_has_no_edges():
    lit = np.random.default_rng(0).random((9, 16)) < 0.8
    depth = np.where(np.arange(16) < 8, 10.0, 2.0) * np.ones((9, 1))
    found = weights_of(lit, DepthBuffer(depth), wall_camera(), last_camera=wall_camera(z=-6.0))
    assert found[:, :8].any()
    assert not found[:, 8:].any()  # mirrored, they would be on its screen


# A box on the plane y = 0.
BOX = np.array([[-1.5, 0, -11.0], [1.0, 2.0, -8.5]])
HEIGHT, WIDTH, TEXELS = 100, 160, 256
ABOVE = Camera((0, 9, -3), (0, -1.2, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.4, aspect=1.6)


def cast(origins, directions):
    """Along each ray the places of the plane and the box, in lengths of its direction; inf for none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = -origins[..., 1] / directions[..., 1]
        near, far = ((corner - origins) / directions for corner in BOX)
    first, last = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
    return np.where(plane > 1e-9, plane, np.inf), np.where((first <= last) & (last > 1e-9), first, np.inf)


def seen_of(camera, light):
    """(eye depths, which pixels the light reaches): faces that turn away from it are dark."""
    left, right, bottom, top = np.asarray(camera.window)
    x = left + (right - left) * (np.arange(WIDTH) + 0.5) / WIDTH
    y = top - (top - bottom) * (np.arange(HEIGHT) + 0.5) / HEIGHT
    rays = np.stack(np.broadcast_arrays(x, y[:, None], 1.0), -1) @ np.asarray(camera.rotation)
    plane, box = cast(np.asarray(camera.position), rays)
    depth = np.minimum(plane, box)
    points = np.asarray(camera.position) + rays * depth[..., None]
    # Of the box's six planes the nearest to a point is its face.
    face = np.abs(points[..., None, :] - BOX).reshape(*depth.shape, 6).argmin(-1)
    lit_faces = np.concatenate([light, -light]) > 0
    shaded = np.isfinite(cast(points, np.broadcast_to(-light, points.shape))[1])
    return depth, np.where(box < plane, lit_faces[face], ~shaded)


def map_of(matrix, clip_space):
    """The map's depths: the first hit of the ray through each texel's centre."""
    matrix = np.asarray(matrix.T if clip_space.row_vectors else matrix)
    centres = (np.arange(TEXELS) + 0.5) / TEXELS * 2 - 1
    ends = []
    for z in (0 if clip_space.z_zero_to_one else -1, 1):
        clip = np.stack(np.broadcast_arrays(centres, centres[:, None], z, 1.0), -1)
        world = clip @ np.linalg.inv(matrix).T
        ends.append(world[..., :3] / world[..., 3:])
    start, end = ends[::-1] if clip_space.reversed_z else ends
    # From a whole range before the map's, which rounding puts at the first caster.
    start, span = 2 * start - end, end - start
    hit = np.minimum(*cast(start, span))
    there = np.isfinite(hit)
    world = start + span * np.where(there, hit, 0)[..., None]
    clip = world @ matrix[:, :3].T + matrix[:, 3]
    depth = clip[..., 2] / clip[..., 3]
    depth = depth if clip_space.z_zero_to_one else (depth + 1) / 2
    return np.clip(np.where(there, depth, 0 if clip_space.reversed_z else 1), 0, 1)


def grown(edges):
    """With the eight pixels around each."""
    wide = np.pad(edges, 1)
    return np.max([wide[i : i + HEIGHT, j : j + WIDTH] for i in range(3) for j in range(3)], axis=0)


def rendered(camera, light, clip_space=None, eta=1.0):
    """(the map, the receivers, the true edges) of the box over the plane."""
    light = np.array(light) / np.linalg.norm(light)
    depth, lit = seen_of(camera, light)
    receivers = DepthBuffer(depth)
    view = SceneView(camera, DirectionalLight(light), receivers).reduced()  # one pass over them for all clip spaces
    corners = np.array(list(itertools.product(*BOX.T)))
    clip_space = clip_space or ClipSpace()
    matrix = shadow_matrix(view, Warp.from_eta(eta, view.footprint()), clip_space, casters=corners)
    return RenderedMap(map_of(matrix, clip_space), matrix, clip_space), receivers, weights_of(lit) > 0


LIGHTS = [
    (0.7, -1, 0.3), (-0.9, -1, -0.4), (0.2, -1, -0.9), (0.1, -1, 0.8), (1, -0.35, 0.1), (-0.3, -1, -0.2),
    (0.3, -1, 0.7), (0.5, -2, 0.2), (-2, -1, 0.5),
]  # fmt: skip
WAYS = {
    "opengl": ClipSpace.opengl(),
    "opengl reversed": ClipSpace.opengl(reversed_z=True),
    "direct3d": ClipSpace.direct3d(),
    "direct3d reversed": ClipSpace.direct3d(reversed_z=True),
    "vulkan": ClipSpace.vulkan(),
    "vulkan reversed": ClipSpace.vulkan(reversed_z=True),
}


@pytest.mark.parametrize("way", WAYS)
def test_edges_of_a_rendered_map_are_the_shadows(way):
    """Texels are smaller than pixels: all edges within a pixel, and none elsewhere but one pixel where three meet."""
    for light in LIGHTS if way == "opengl" else LIGHTS[:2]:
        shadow_map, receivers, true = rendered(ABOVE, light, WAYS[way])
        found = weights_of(shadow_map, receivers, ABOVE) > 0
        assert true.sum() > 80
        assert (found & ~grown(true)).sum() <= 1
        assert not (true & ~grown(found)).any()


@pytest.mark.parametrize("eta", [0.7, 1.0])
def test_a_warped_map_and_one_in_sixteen_bits(eta):
    for light in LIGHTS[:4]:
        shadow_map, receivers, true = rendered(ABOVE, light, eta=eta)
        depth = np.round(np.asarray(shadow_map.depth) * 65535) / 65535
        found = weights_of(RenderedMap(depth, shadow_map.matrix), receivers, ABOVE) > 0
        assert (found & ~grown(true)).sum() <= 1
        assert (true & ~grown(found)).sum() <= 1


def test_a_lit_plane_has_no_acne():
    """Under all lights down to 3 degrees: also at the end of the map's depth, in float32 and for left-handed worlds."""
    for dtype, handedness in ((float, "right"), (np.float32, "right"), (float, "left")):
        forward = (0, -1.2, -1 if handedness == "right" else 1)
        camera = Camera((60, 9, 30), forward, (0, 1, 0), 0.1, 100.0, 0.4, 1.6, handedness=handedness)
        camera = jax.tree.map(lambda v, dtype=dtype: v.astype(dtype), camera)
        for light in ((0, -1, 0), (0.1, -1, 1), (-14, -1, 14)):
            light = np.array(light) / np.linalg.norm(light)
            depth, _ = seen_of(jax.tree.map(lambda v: v.astype(float), camera), light)
            receivers = DepthBuffer(depth.astype(dtype))
            view = SceneView(camera, DirectionalLight(light.astype(dtype)), receivers).reduced()
            matrix = shadow_matrix(view, Warp.from_eta(dtype(1), view.footprint()), casters=[[60, dtype(2), 30]])
            stored = map_of(np.asarray(matrix, float), ClipSpace()).astype(dtype)
            edges = edge_weights(RenderedMap(stored, matrix), receivers, camera)
            assert edges.share == 0


def test_pixels_without_a_neighbour_on_their_surface_have_no_acne():
    """Every second row is background: no slope is known, and a fixed share of the map's depth is the bias."""
    light = np.array([0.1, -1, 1]) / np.sqrt(2.01)
    camera = Camera((60, 9, 30), (0, -1.2, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.4, aspect=1.6)
    depth, _ = seen_of(camera, light)
    depth[::2] = 0
    view = SceneView(camera, DirectionalLight(light), DepthBuffer(depth))
    matrix = shadow_matrix(view, Warp.from_eta(1.0, view.footprint()), casters=[[60.0, 2, 30]])
    assert edge_weights(RenderedMap(map_of(matrix, ClipSpace()), matrix), DepthBuffer(depth), camera).share == 0


def test_what_is_outside_of_the_map_is_lit():
    """A map of the view's middle alone, without a caster, under a light that reaches all that is seen of the box."""
    shadow_map, receivers, true = rendered(ABOVE, LIGHTS[1])
    matrix = np.diag([4.0, 4, 1, 1]) @ np.asarray(shadow_map.matrix)
    assert true.any()
    assert edge_weights(RenderedMap(np.ones((TEXELS, TEXELS)), matrix), receivers, ABOVE).share == 0


def test_frames_compile_nothing_anew():
    traced = []

    @jax.jit
    def frame(lit, shadow_map, receivers, camera, last_camera):
        traced.append(1)
        return (
            edge_weights(lit, receivers, camera).share,
            edge_weights(lit, receivers, camera, last_camera=last_camera).share,
            edge_weights(shadow_map, receivers, camera).share,
        )

    shares = []
    for i, light in enumerate(LIGHTS[:3]):
        camera = Camera((0.1 * i, 9, -3), (0, -1.2, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.4, aspect=1.6)
        shadow_map, receivers, true = rendered(camera, light)
        shares.append(frame(jnp.asarray(true), shadow_map, receivers, camera, ABOVE))
        eager = edge_weights(shadow_map, receivers, camera), edge_weights(true, receivers, camera)
        np.testing.assert_array_equal(shares[-1][2], eager[0].share)
        np.testing.assert_array_equal(shares[-1][0], eager[1].share)
        if not i:
            sizes = module._of_map._cache_size(), module._beside._cache_size()
    assert len(traced) == 1
    assert (module._of_map._cache_size(), module._beside._cache_size()) == sizes
    assert len({float(share[2]) for share in shares}) == 3


SMALL = DepthBuffer(np.full((3, 4), 5.0))
MAP = RenderedMap(np.ones((4, 4)), np.eye(4))
AWAY = Camera((0, 2, 0), (0, 0, 1), (0, 1, 0), near=0.1, far=50.0, half_fov=0.5, aspect=4 / 3)
BAD = {
    "size": (
        lambda _: edge_weights(np.ones((4, 3)), SMALL, CAMERA),
        r"lit: got shape \(4, 3\), expected the receivers' \(3, 4\)",
    ),
    "axes": (lambda _: edge_weights(np.ones(4)), r"lit: got shape \(4,\), expected \(height, width\)"),
    "grey": (lambda _: edge_weights(MASK * 0.5), "lit: got 0.5, expected true or false"),
    "no camera": (lambda _: edge_weights(MASK, SMALL), "camera: got none with receivers, expected both or neither"),
    "no receivers": (lambda _: edge_weights(MASK, camera=CAMERA), "receivers: got none with camera"),
    "carried": (lambda _: edge_weights(MASK, last_camera=CAMERA), "receivers: got none with last_camera"),
    "map": (lambda _: edge_weights(MAP), "receivers: got none with a RenderedMap"),
    "two": (lambda _: edge_weights(MAP, SMALL, CAMERA, last_camera=CAMERA), "last_camera: got one with a RenderedMap"),
    "away": (
        lambda _: edge_weights(MASK, SMALL, CAMERA, last_camera=AWAY),
        "last_camera: got one that sees none of this frame's receivers, expected it to see some",
    ),
    "kind": (lambda _: edge_weights(MASK, np.ones((3, 4)), CAMERA), "receivers: got .*expected a DepthBuffer"),
    "text": (lambda path: edge_weights(path / "text.png"), "neither .npy nor OpenEXR, expected one of"),
    "colours": (lambda path: edge_weights(path / "colours.png"), "got a PNG of mode RGB, expected one channel of grey"),
    "cube": (
        lambda path: edge_weights(path / "cube.npy"),
        r"got an array of shape \(2, 2, 2\), expected \(height, width\)",
    ),
    "signed": (lambda path: edge_weights(path / "signed.npy"), r"got integers \(int16\), expected 0 and 1, or 8 or 16"),
    "values": (lambda path: edge_weights(path / "values.npy"), "got 7.0, expected numbers in"),
    "depths": (lambda _: RenderedMap(np.full((4, 4), 2.0), np.eye(4)), r"depth: got 2.0, expected numbers in \[0, 1\]"),
    "row": (lambda _: RenderedMap(np.ones(4), np.eye(4)), r"depth: got shape \(4,\), expected \(rows, columns\)"),
    "matrix": (lambda _: RenderedMap(np.ones((4, 4)), np.eye(3)), r"matrix: got shape \(3, 3\), expected \(4, 4\)"),
    "way": (
        lambda _: RenderedMap(np.ones((4, 4)), np.eye(4),
        "vulkan"), "clip_space: got 'vulkan', expected a ClipSpace",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_one_sentence(name, tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    Image.new("RGB", (4, 3)).save(tmp_path / "colours.png")
    np.save(tmp_path / "cube.npy", np.ones((2, 2, 2)))
    np.save(tmp_path / "signed.npy", np.full((3, 4), 255, np.int16))
    np.save(tmp_path / "values.npy", np.full((3, 4), 7.0))
    make, words = BAD[name]
    with pytest.raises(ValueError, match=words) as caught:
        make(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_the_systems_error(tmp_path):
    with pytest.raises(OSError, match="nowhere"):
        edge_weights(tmp_path / "nowhere.npy")

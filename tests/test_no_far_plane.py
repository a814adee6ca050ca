"""Cameras without a far plane, and the backgrounds of depth buffers.

The oracle is the same scene under a camera whose far plane is behind all that is seen: up to rounding it is one scene.
Each test says which line it guards.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers, WholeFrustum

NEAR, FAR, SHAPE = 0.1, 1e7, (24, 32)
LIGHT = warpopt.DirectionalLight((0.3, -1, -0.4))
MEAN = warpopt.Objective("p", "l2")
SPACES = [
    make(reversed_z=reverse)
    for make in (warpopt.ClipSpace.opengl, warpopt.ClipSpace.direct3d, warpopt.ClipSpace.vulkan)
    for reverse in (False, True)
]


def camera_of(far: float, dtype=np.float64) -> warpopt.Camera:
    camera = warpopt.Camera((0, 2, 0), (0, -0.2, -1), (0, 1, 0), NEAR, far, 0.4, aspect=4 / 3)
    return jax.tree.map(lambda v: v.astype(dtype), camera)


def ground() -> np.ndarray:
    """Eye depths of hilly ground, 2 to 300 away; 0 for sky."""
    up = np.tan(0.4) * (1 - 2 * (np.arange(SHAPE[0]) + 0.5) / SHAPE[0])
    fall = np.maximum(0.2 - up, 1e-3)[:, None]
    z = 2.04 / fall * (1 + 0.2 * np.sin(np.arange(SHAPE[1])))
    return np.where(z < 300, z, 0)


def encoded(z: np.ndarray, encoding: str, far: float, near: float = NEAR) -> np.ndarray:
    """What a renderer writes for eye depths, 0 for background, of a projection with far or without it."""
    seen, safe = z > 0, np.where(z > 0, z, 1)
    reversed_ = near / safe if np.isinf(far) else near * (far - safe) / (safe * (far - near))
    return {
        "linear": z,
        "standard": np.where(seen, 1 - reversed_, 1),
        "reversed": np.where(seen, reversed_, 0),
    }[encoding]


def points_of(z: np.ndarray) -> np.ndarray:
    points, seen = warpopt.receivers.depth_buffer.eye_points(DepthBuffer(z), camera_of(FAR))
    camera = camera_of(FAR)
    return np.asarray(points[seen] @ camera.rotation + camera.position)


KINDS = {
    "box": lambda far: ConvexBody.box((-20, -1, -80), (20, 6, -5)),
    "points": lambda far: PointReceivers(points_of(ground())),
    "histogram": lambda far: DepthHistogram((0.5, 5.0, 40.0, 250.0), (3.0, 1.0, 2.0)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_receivers_that_end_do_not_see_the_far_plane(kind):
    """Guards `far_plane` (all of space for inf), the histogram's clip, and that nothing else reads the far plane."""
    views = [warpopt.SceneView(camera_of(far), LIGHT, KINDS[kind](far)) for far in (np.inf, FAR)]
    endless, deep = (warpopt.optimal_warp(view, MEAN) for view in views)
    assert warpopt.Outcome(int(endless.result)).succeeded
    assert 0 < endless.warp.eta < 1
    assert endless.value < 0.9 * endless.unwarped
    for name in ("value", "unwarped", "margin"):
        np.testing.assert_allclose(getattr(endless, name), getattr(deep, name), rtol=1e-12, err_msg=name)
    np.testing.assert_allclose(endless.warp.eta, deep.warp.eta, rtol=1e-10)  # flat about the optimum
    bounds = [warpopt.lower_bound(view, MEAN) for view in views]
    assert 0 < bounds[0] < endless.value
    np.testing.assert_allclose(*bounds, rtol=1e-11)
    extents = [view.receivers.depth_extent(view.camera) for view in views]
    np.testing.assert_allclose(*extents, rtol=1e-12)
    assert extents[0][1] < 301


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_matrices_are_finite_and_hold_the_receivers(space):
    """Guards `shadow_matrix`, which takes the receivers' extent and never the far plane."""
    receivers = DepthBuffer(encoded(ground(), "reversed", np.inf), "reversed")
    view = warpopt.SceneView(camera_of(np.inf), LIGHT, receivers)
    solution = warpopt.optimal_warp(view)
    matrix = np.asarray(warpopt.shadow_matrix(view, solution, space))
    assert np.isfinite(matrix).all()
    points = points_of(ground())
    clip = np.c_[points, np.ones(len(points))] @ (matrix if space.row_vectors else matrix.T)
    assert (clip[:, 3] > 0).all()
    inside = clip[:, :3] / clip[:, 3:]
    low = [-1, -1, 0 if space.z_zero_to_one else -1]
    assert (inside >= np.array(low) - 1e-9).all()
    assert (inside <= 1 + 1e-9).all()
    np.testing.assert_allclose(np.ptp(inside, 0)[:2], 2, rtol=0.05)  # and fill the map


@pytest.mark.thorough
def test_single_precision_without_a_far_plane():
    """Guards the decoding's form: near / (shallow v + (1 - v)) has no difference of large terms."""
    depth = encoded(ground(), "reversed", np.inf).astype(np.float32)
    light = jax.tree.map(lambda v: v.astype(np.float32), LIGHT)
    view = warpopt.SceneView(camera_of(np.inf, np.float32), light, DepthBuffer(depth, "reversed"))
    solution = warpopt.optimal_warp(view)
    assert solution.value.dtype == np.float32
    assert np.isfinite(warpopt.shadow_matrix(view, solution)).all()
    exact = warpopt.optimal_warp(warpopt.SceneView(camera_of(FAR), LIGHT, DepthBuffer(ground())))
    # Differences of depths along the warp: 64 eps covers the rounding of coordinates.
    np.testing.assert_allclose(solution.value, exact.value, rtol=64 * np.finfo(np.float32).eps)


@pytest.mark.parametrize("kind", ["standard", "box"])
@pytest.mark.thorough("standard")
def test_gradients_are_finite_without_a_far_plane(kind):
    """Guards the double where of `far_plane` and of the decoding: far = inf has the derivative 0, not NaN."""
    standard = DepthBuffer(encoded(ground(), "standard", np.inf), "standard")
    receivers = standard if kind == "standard" else KINDS[kind](np.inf)

    def value(camera, receivers):
        view = warpopt.SceneView(camera, LIGHT, receivers)
        return warpopt.optimal_warp(view, throw=False).value

    gradients = jax.jit(jax.grad(value, (0, 1)))(camera_of(np.inf), receivers)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))
    assert gradients[0].far == 0
    assert gradients[0].near != 0 or kind == "box"  # encoded depth is in units of near


def test_rules_take_the_farthest_receiver_for_far():
    """Guards `compare.over_scene._far`: Filament's rule reads the camera's planes, which here end with the scene."""
    z, lights = ground(), jax.vmap(warpopt.DirectionalLight)(jnp.array([[0.3, -1, -0.4], [0.1, -0.3, 1.0]]))
    ends = z.max() * (1 + 1e-12)
    compared = [
        warpopt.compare_rules(warpopt.SceneView(camera_of(far), lights, DepthBuffer(z))) for far in (np.inf, ends)
    ]
    assert np.isfinite(compared[0].bound).all()
    assert len(compared[0].names) > 5
    for name in ("eta", "values", "unwarped", "bound"):
        np.testing.assert_allclose(*(getattr(c, name) for c in compared), rtol=1e-8, err_msg=name)
    empty = warpopt.compare_rules(warpopt.SceneView(camera_of(np.inf), lights, DepthBuffer(0 * z)))
    assert (empty.unwarped == 0).all()


WARP = warpopt.Warp.from_eta(0.5, warpopt.FrustumView(warpopt.ViewFrustum(1.0, 10.0, 0.4), 1.0))
VERBS = {
    "optimal_warp": warpopt.optimal_warp,
    "error_norm": lambda view: warpopt.error_norm(view, WARP),
    "shadow_matrix": lambda view: warpopt.shadow_matrix(view, WARP),
    "lower_bound": warpopt.lower_bound,
    "reduced": lambda view: view.reduced(),
    "compare_rules": lambda view: warpopt.compare_rules(
        warpopt.SceneView(view.camera, jax.vmap(warpopt.DirectionalLight)(jnp.array([[0.3, -1, -0.4]])), view.receivers)
    ),
}
ENDLESS = {
    "whole frustum": (
        WholeFrustum(),
        "camera: got far = inf with the whole frustum as receivers, expected a finite far",
    ),
    "half-space": (ConvexBody([[0, 1, 0, 0]]), "receivers: got an unbounded body in the view"),
    "slab": (ConvexBody([[0, 1, 0, 0], [0, -1, 0, 5]]), "receivers: got an unbounded body in the view"),
    "endless box": (
        ConvexBody.box((-np.inf, 0, -np.inf), (np.inf, 3, -1)),
        "receivers: got an unbounded body",
    ),
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("receivers", ENDLESS)
def test_what_has_no_end_is_refused_by_every_verb(receivers, verb):
    """Guards `check` of `WholeFrustum` and `ConvexBody`, and that every verb asks it."""
    body, words = ENDLESS[receivers]
    with pytest.raises(ValueError, match=words):
        VERBS[verb](warpopt.SceneView(camera_of(np.inf), LIGHT, body))


def test_what_has_no_end_gives_no_number_when_traced():
    """Guards `Footprint.lost_where`: nothing can be refused there, and a finite number would be wrong."""
    result = jax.jit(lambda view: warpopt.optimal_warp(view, throw=False).result)
    for body, _ in list(ENDLESS.values())[::2]:
        assert result(warpopt.SceneView(camera_of(np.inf), LIGHT, body)) == warpopt.Outcome.not_finite
        assert result(warpopt.SceneView(camera_of(FAR), LIGHT, body)) != warpopt.Outcome.not_finite


def test_the_end_of_a_body_is_seen_from_every_side():
    """Guards `vertices_of`'s edges without end: a slab whose planes are parallel up to rounding, turned at random."""
    random = np.random.default_rng(0)
    for _ in range(40):
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        forward, position, up = (turn @ v for v in ([0.3 * random.normal(), -0.1, -1], [0, 2.0, 0], [0, 1.0, 0]))
        camera = warpopt.Camera(position, forward, up, NEAR, np.inf, 0.4)
        slab = np.c_[np.array([[0, 1, 0], [0, -1, 0]]) @ turn.T, [0, 5]]
        with pytest.raises(ValueError, match="unbounded body"):
            ConvexBody(slab).check(camera, LIGHT, None)
        ended = np.r_[slab, [[*-forward, 90.0]]]  # 90 along the view from the origin
        ConvexBody(ended).check(camera, LIGHT, None)
        below = np.r_[slab, [[*turn @ [0, -1.0, 0], -50.0]]]  # and nothing at all: y <= -50
        ConvexBody(below).check(camera, LIGHT, None)


@pytest.mark.parametrize("far", [np.inf, 250.0])
def test_background_of_a_depth_buffer(far):
    """Guards `(value > 0) & (value < f)`: 0, negative and infinite values, and those at or beyond a far plane."""
    z = ground()
    z[:4, :4] = [[0, -3, np.inf, -np.inf], [249.9, 250, 250.1, 1e30]] * 2
    found = np.asarray(DepthBuffer(z).eye_depth(camera_of(far)))
    np.testing.assert_array_equal(np.isfinite(found), (z > 0) & (z < far))
    np.testing.assert_array_equal(found[np.isfinite(found)], z[np.isfinite(found)])
    # Its own output, which has inf for background, is taken back as it is.
    np.testing.assert_array_equal(DepthBuffer(found).eye_depth(camera_of(far)), found)


def test_shapes_and_dtypes_of_a_depth_buffer():
    """Guards the squeezed channel, the widened half and the refusals of `DepthBuffer.__init__`."""
    z, camera = ground(), camera_of(np.inf)
    np.testing.assert_array_equal(DepthBuffer(z[..., None]).depth, z)
    half = DepthBuffer(z.astype(np.float16))
    assert half.depth.dtype == np.float32
    np.testing.assert_array_equal(half.eye_depth(camera), np.where(z > 0, z, np.inf).astype(np.float16))
    for bad, words in (
        (np.where(z == 0, np.nan, z), "depth: got nan, expected eye depths, not NaN"),
        (np.zeros((4, 4, 2)), r"depth: got shape \(4, 4, 2\), expected \(height, width\)"),
        (np.zeros((0, 4)), r"depth: got shape \(0, 4\)"),
    ):
        with pytest.raises(ValueError, match=words):
            DepthBuffer(bad)
    for encoding in ("standard", "reversed"):
        with pytest.raises(ValueError, match=r"depth: got .*, expected numbers in \[0, 1\]"):
            DepthBuffer(z, encoding)


@pytest.mark.parametrize("encoding", ["standard", "reversed"])
@pytest.mark.parametrize("far", [np.inf, 1000.0])
def test_encoded_depth_decodes_to_eye_depth(encoding, far):
    """Guards both branches of the decoding, by the projections themselves."""
    z = ground()
    found = np.asarray(DepthBuffer(encoded(z, encoding, far), encoding).eye_depth(camera_of(far)))
    np.testing.assert_allclose(found, np.where(z > 0, z, np.inf), rtol=1e-11)


def test_cameras_refuse_what_is_no_far_plane():
    """Guards `far > near` and that near alone must be finite."""
    assert np.isinf(camera_of(np.inf).far)
    for far in (np.nan, -np.inf, NEAR, 0.0):
        with pytest.raises(ValueError, match=r"far: got .*, expected a number > near, or inf"):
            camera_of(far)
    with pytest.raises(ValueError, match="near: got inf, expected a finite number > 0"):
        warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), np.inf, np.inf, 0.4)
    last = np.asarray(camera_of(np.inf).planes())[5]
    np.testing.assert_array_equal(last, [0, 0, 0, 1])

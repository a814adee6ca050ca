"""Shadow maps on pixels: truth, map reading and errors, against counts by hand and a ray caster in NumPy."""

import numpy as np
import pytest
from frame_cases import FLOOR, box, brute_truth, camera_at, tables

import warpopt
from warpopt.frames import LitScene, Reading, ShadowMap, judge, measured, predicted_wrong, see, texel_footprints
from warpopt.frames.measure import shifts
from warpopt.receivers import DepthBuffer

pytest.importorskip("embreex")


def overhead_matrix(half: float) -> np.ndarray:
    """A plain map of the square |x|, |z| <= half for a light from above: t along x, s along z."""
    return np.array([[1 / half, 0, 0, 0], [0, 0, 1 / half, 0], [0, -1 / 100, 0, 0], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("light", [(0, -1, 0), (0.4, -1, 0.3), (-0.9, -0.5, 0.2)])
def test_truth_is_that_of_a_ray_caster_in_numpy(light):
    triangles = tables(4)
    camera = camera_at((3, 5, 9), (0, 0.5, 0))
    frame = see(LitScene(triangles, np.array(light)), camera, 24, 32)
    depth, lit = brute_truth(triangles, camera, np.array(light, float), 24, 32)
    there = np.isfinite(depth)
    assert np.array_equal(np.isfinite(frame.depth), there)
    # Doubles on both sides: only the order of a few products differs.
    np.testing.assert_allclose(frame.depth[there], depth[there], rtol=1e-10)
    assert frame.defined
    assert np.array_equal(frame.lit, lit[frame.judged])


def aligned(texels: int, corner: float, pixels: int = 64):
    """A box's shadow on the floor, seen from straight above through a map of whole texels; and its frame."""
    triangles = np.concatenate([FLOOR, box((-2 + corner, 1, -2), (2 + corner, 1.5, 2))])
    scene = LitScene(triangles, np.array([0, -1.0, 0]))
    # From below the box nothing hides its shadow: the eye is between the floor and the box.
    camera = camera_at((0, 0.8, 0), (0, 0, 0), up=(0, 0, -1), half_fov=float(np.arctan(4 / 0.8)))
    return see(scene, camera, pixels, pixels), ShadowMap(scene, overhead_matrix(4.0), (texels, texels))


def test_a_box_aligned_with_the_texels_has_no_wrong_pixel():
    """Floor and map span |x|, |z| <= 4 in 16 texels; the box's edges lie on texel edges."""
    frame, shadow_map = aligned(16, 0.0)
    assert frame.judged.all()
    assert (~frame.lit).sum() == 32 * 32
    assert measured(frame, shadow_map, groups=1).wrong == 0


@pytest.mark.parametrize(("corner", "missing_columns", "false_columns"), [
    (0.125, 1, 1), (0.24, 2, 2), (0.26, 2, 2), (0.375, 1, 1), (-0.125, 1, 1),
])  # fmt: skip
def test_wrong_columns_beside_a_misaligned_box_can_be_counted(corner, missing_columns, false_columns):
    """Texels are half a unit (4 pixels) wide: an edge less than half a texel from a texel's edge snaps back to it, one
    farther away snaps on to the next. Pixels are 1/8 wide with centres at odd sixteenths."""
    frame, shadow_map = aligned(16, corner)
    verdict = measured(frame, shadow_map, groups=1)
    lit, shown = frame.image(frame.lit, True), frame.image(verdict.shown > 0.5, True)
    wrong = lit != shown
    assert wrong.sum(1).max() == missing_columns + false_columns
    assert (wrong.sum(1) > 0).sum() == 32
    rows = 32 / 64**2
    assert verdict.missing == pytest.approx(missing_columns * rows)
    assert verdict.false == pytest.approx(false_columns * rows)
    assert verdict.wrong == pytest.approx(verdict.missing + verdict.false)
    assert verdict.far == 0


def test_shifted_grids_lose_a_quarter_texel_at_each_edge():
    """Over uniform shifts an edge moves by |u| texels, u in [-1/2, 1/2]: a quarter in the mean, of 4 edges of 32 pixels
    with 4 pixels a texel: 128 pixels. Prediction from footprints says the same, but for the 4 corners."""
    frame, shadow_map = aligned(16, 0.0)
    counts = [measured(frame, shadow_map, seed=seed, groups=8).wrong * 64**2 for seed in range(40)]
    # Standard error over 40 seeds, about 2 of 128; corners count once, not twice: 2 pixels or so each.
    assert np.mean(counts) == pytest.approx(128, rel=0.06)
    assert predicted_wrong(frame, shadow_map) == pytest.approx(128, rel=0.06)
    np.testing.assert_allclose(texel_footprints(frame, shadow_map), [[[4, 0], [0, 4]]] * 64**2, atol=1e-9)


def test_pcf_of_a_straight_edge_is_a_ramp():
    """Bilinear 2x2 taps rise from 0 to 1 over one texel across an aligned edge, linearly."""
    frame, shadow_map = aligned(16, 0.0)
    shown = frame.image(shadow_map.visibility(frame, Reading("pcf2")), np.nan)
    np.testing.assert_allclose(shown[32, 14:18], [0.875, 0.625, 0.375, 0.125], atol=1e-6)
    three = frame.image(shadow_map.visibility(frame, Reading("pcf3")), np.nan)
    np.testing.assert_allclose(three[32, 8:24], np.repeat([1, 2 / 3, 1 / 3, 0], 4), atol=1e-6)
    blur = frame.image(shadow_map.visibility(frame, Reading("eye_blur", blur_pixels=8.0)), np.nan)
    # A standard deviation of 4 pixels: half at the edge, 0.977 two of them away; 2x2 taps add little.
    assert blur[32, 15] + blur[32, 16] == pytest.approx(1, abs=0.01)
    assert blur[32, 8] == pytest.approx(0.97, abs=0.02)
    # All is at one depth: with depth the width is the same.
    same = frame.image(shadow_map.visibility(frame, Reading("eye_blur_depth", blur_pixels=8.0)), np.nan)
    np.testing.assert_allclose(same, blur)


def scene_view(frame, light):
    camera = warpopt.Camera.off_centre(
        frame.camera.position, frame.camera.rotation[2], frame.camera.rotation[1], frame.camera.near, frame.camera.far,
        frame.camera.window,
    )  # fmt: skip
    return warpopt.SceneView(camera, warpopt.DirectionalLight(light), DepthBuffer(frame.depth))


@pytest.mark.parametrize("eta", [1.0, 0.2])
def test_map_and_truth_agree_as_texels_shrink(eta):
    """Through `shadow_matrix`, warped or not: error falls as 1/R, and is gone at R = 32768."""
    light = (0.5, -1.0, 0.3)
    scene = LitScene(tables(9), np.array(light))
    frame = see(scene, camera_at((3, 4, 9), (0, 0.5, 0)), 96, 128)
    view = scene_view(frame, light)
    footprint = warpopt.optimal_warp(view).footprint
    matrix = np.asarray(warpopt.shadow_matrix(view, warpopt.Warp.from_eta(eta, footprint)), float)

    def error(size: int) -> float:
        return float(np.mean([measured(frame, ShadowMap(scene, matrix, (size, size)), seed=k).wrong for k in range(6)]))

    errors = {size: error(size) for size in (64, 256, 32768)}
    judged = frame.judged.sum()
    assert errors[64] * judged > 60
    # Six seeds of eight shifts leave 5 % of noise where hundreds of pixels are wrong, 15 % where there are 20.
    assert errors[64] / errors[256] == pytest.approx(4, rel=0.3)
    assert errors[32768] * judged < 4 * errors[64] * judged * 64 / 32768 + 1
    predicted = predicted_wrong(frame, ShadowMap(scene, matrix, (256, 256)))
    assert errors[256] * judged == pytest.approx(predicted, rel=0.3)


def test_biases_hide_acne_and_too_much_hides_shadows():
    light = (0.9, -1.0, 0.2)
    scene = LitScene(tables(9), np.array(light))
    frame = see(scene, camera_at((3, 4, 9), (0, 0.5, 0)), 96, 128)
    matrix = np.asarray(warpopt.shadow_matrix(scene_view(frame, light), warpopt.Warp.from_eta(1.0, scene_view(
        frame, light).footprint())), float)  # fmt: skip
    shadow_map = ShadowMap(scene, matrix, (256, 256))
    none = measured(frame, shadow_map, Reading(amount=0.0))
    slope = measured(frame, shadow_map, Reading())
    huge = measured(frame, shadow_map, Reading(bias="constant", amount=0.5))
    assert none.false > 5 * slope.false  # acne
    assert slope.far < 0.01
    assert huge.missing > 2 * slope.missing
    for bias in ("plane", "second_depth", "back_faces"):
        assert measured(frame, shadow_map, Reading(bias=bias)).wrong < none.wrong, bias
    # Without a warp w = 1, and the map's depth is linear in the distance.
    same = measured(frame, shadow_map, Reading(warped_depth=True))
    assert same.wrong == pytest.approx(slope.wrong, abs=3 / len(frame.lit))


def test_shifts_are_even_and_follow_the_seed():
    frame, _ = aligned(16, 0.0)
    one, again, other = shifts(frame, 1), shifts(frame, 1), shifts(frame, 2)
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    for axis in (0, 1):
        assert len(set(np.floor(8 * np.unique(one[:, axis])))) == 8


def test_a_frame_without_a_shadow_has_no_error():
    frame = see(LitScene(FLOOR, np.array([0, -1.0, 0])), camera_at((0, 3, 0), (0, 0, 0), up=(0, 0, -1)), 8, 8)
    assert not frame.defined
    assert np.isnan(judge(frame, frame.lit.astype(float)).wrong)


def test_a_camera_inside_a_box_is_told():
    scene = LitScene(np.concatenate([FLOOR, box((-2, 1, -2), (2, 3, 2))]), np.array([0.1, -1.0, 0.2]))
    assert see(scene, camera_at((0, 2, 0), (1, 2, 0)), 4, 4).inside
    assert not see(scene, camera_at((0, 5, 0), (1, 4, 0)), 4, 4).inside


@pytest.mark.parametrize(("triangles", "light", "words"), [
    (np.zeros((0, 3, 3)), (0, -1, 0), "triangles: got none, expected at least one shadow caster"),
    (np.zeros((2, 3)), (0, -1, 0), "triangles: got shape"),
    (np.full((1, 3, 3), np.nan), (0, -1, 0), "not finite"),
    (FLOOR, (0, 0, 0), "light: got"),
])  # fmt: skip
def test_bad_scenes_are_refused(triangles, light, words):
    with pytest.raises(ValueError, match=words):
        LitScene(triangles, np.array(light, float))


def test_bad_readings_and_matrices_are_refused():
    with pytest.raises(ValueError, match="filter: got 'box', expected 'nearest'"):
        Reading("box")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="amount: got -1"):
        Reading(amount=-1)
    scene = LitScene(FLOOR, np.array([0, -1.0, 0]))
    with pytest.raises(ValueError, match="another light"):
        ShadowMap(scene, np.eye(4), (4, 4))

"""Warps by name on a frame, footprints on the screen, pictures, and frames in motion."""

import dataclasses

import numpy as np
import pytest
from frame_cases import FLOOR, box, camera_at, tables

import warpopt
from warpopt import theory
from warpopt.frames import LitScene, Reading, ShadowMap, judge, measured, see, texel_footprints
from warpopt.frames.fits import SCAN, Fitting, edges_in_map
from warpopt.frames.methods import HELD, method_of, snapped_sphere
from warpopt.frames.names import DEFAULT, PREFIXES, objective_of, title_of
from warpopt.frames.paths import MOTIONS, SPEED, Moment, flips, path, seen_again, stepped_far
from warpopt.frames.pictures import FALSE, MISSING, map_picture, painted, worst_places, wrong_pixels
from warpopt.receivers import ConvexBody, DepthBuffer

pytest.importorskip("embreex")
LIGHT = np.array([0.5, -1.0, 0.3])


@pytest.fixture(scope="module")
def scene():
    return LitScene(tables(9), LIGHT)


@pytest.fixture(scope="module")
def frame(scene):
    return see(scene, camera_at((3, 4, 9), (0, 0.5, 0), aspect=96 / 60), 60, 96)


@pytest.mark.thorough
def test_each_name_fits_what_the_library_computes(scene, frame):
    fitting = Fitting(scene, frame, (64, 64), turn_only_if=1.0)
    camera = fitting.view("depth").camera
    view = warpopt.SceneView(
        camera, warpopt.DirectionalLight(LIGHT), DepthBuffer(frame.depth), screen=(96, 60), shadow_map=(64, 64)
    )
    assert fitting.fitted("none").eta == 1
    assert fitting.fitted("p-inf").eta == pytest.approx(float(warpopt.optimal_warp(view).warp.eta), rel=1e-12)
    assert fitting.fitted("lispsm").eta == pytest.approx(
        float(warpopt.compare_rules(view, "lispsm").eta[0, 0]), rel=1e-9
    )
    unwarped = fitting.fitted("none")
    weights = edges_in_map(scene, frame, unwarped)
    assert 0 < weights.share < 0.5
    weighted = warpopt.SceneView(
        camera, warpopt.DirectionalLight(LIGHT), DepthBuffer(frame.depth, weights=weights), screen=(96, 60),
        shadow_map=(64, 64),
    )  # fmt: skip
    best = warpopt.optimal_warp(weighted, warpopt.Objective("edge"))
    assert fitting.fitted("edge").eta == pytest.approx(float(best.warp.eta), rel=1e-9)
    hold_what_is_seen(fitting, [name for name in DEFAULT if name != "best" and not name.startswith(PREFIXES)])


def hold_what_is_seen(fitting, names):
    """Every judged receiver is in the map, on the side of the light that has w > 0."""
    for name in names:
        texture = fitting.map_of(fitting.fitted(name)).texture(fitting.frame.places)
        assert texture.min() > -1e-6, name
        assert texture.max() < 1 + 1e-6, name


@pytest.mark.thorough
def test_turned_and_shaped_maps_promise_and_hold_what_is_seen(scene, frame):
    fitting = Fitting(scene, frame, (64, 64), turn_only_if=1.0)
    assert fitting.fitted("turned-storage-inf").promised > 1
    assert fitting.fitted("shaped-edge").promised >= 1
    hold_what_is_seen(fitting, ["turned-storage-inf", "shaped-edge"])


@pytest.mark.thorough
def test_an_engine_fits_the_frustum_cut_by_the_scene(scene, frame):
    engine = Fitting(scene, frame, (64, 64), "engine")
    view = warpopt.SceneView(
        engine.view("plain").camera, warpopt.DirectionalLight(LIGHT), ConvexBody.box(*scene.corners)
    )
    rules = ["lispsm", "filament", "ogre"]
    for rule, expected in zip(rules, np.asarray(warpopt.compare_rules(view, rules).eta)[:, 0], strict=True):
        assert engine.fitted(rule).eta == pytest.approx(float(expected), rel=1e-9)
    own = Fitting(scene, frame, (64, 64)).fitted("lispsm").eta  # of one rule: the receivers are the view's
    assert engine.fitted("lispsm").eta != pytest.approx(own, rel=1e-3)


def test_a_scan_finds_an_eta_that_nothing_beats_by_more_than_noise(scene, frame):
    fitting = Fitting(scene, frame, (64, 64))
    best, errors = fitting.scan(Reading())
    assert best.eta == pytest.approx(SCAN[int(errors.argmin())])
    assert errors.min() < 0.8 * errors[-1]


@pytest.mark.parametrize("eta", [1.0, 0.3])
def test_footprints_are_e_times_the_projection_factor(scene, frame, eta):
    """|det d(q, p)/d(t, s)| = E_p E_q |N.c|/(z |N.l|): through the matrix against AT09's formulas, to rounding."""
    fitting = Fitting(scene, frame, (64, 64))
    view, made = fitting.view("depth"), fitting.fitted("none", eta)
    light_frame, footprint = view.frame(), view.footprint()
    across, up = frame.camera.slopes(60, 96)
    rows, columns = np.nonzero(frame.judged)
    z = frame.depth[frame.judged]
    point = np.stack([across[columns] * z, up[rows] * z, z], 1)
    blend = (1 - eta) * (point @ np.asarray(light_frame.z_axis) - float(footprint.start)) / float(footprint.mu) + eta
    width = float(sum(footprint.half_widths(eta)))
    e_p, e_q = theory.errors(
        blend, eta, float(light_frame.density_p) * float(footprint.mu) / z, float(light_frame.density_q) * width / z
    )
    normal = scene.normals[frame.triangles] @ (frame.camera.rotation @ scene.axes.T).T
    factor = np.abs((normal * point).sum(1)) / (z * np.abs(normal @ np.asarray(light_frame.light)))
    area = np.abs(np.linalg.det(texel_footprints(frame, fitting.map_of(made))))
    # Two inverses of 3 x 3 and 2 x 2 matrices on each side, of condition up to 1e4.
    np.testing.assert_allclose(area, e_p * e_q * factor, rtol=1e-9)


def test_names():
    assert objective_of("max-l1") == warpopt.Objective("max", "l1")
    assert [title_of(name) for name in ("none", "ogre", "band")] == ["no warp", "OGRE", "band"]
    for wrong in ("ssm", "lispsmm", "p", "p-", "x-inf", 3):
        with pytest.raises(ValueError, match="got"):
            objective_of(wrong)
    with pytest.raises(ValueError, match="method: got 'best'"):
        method_of("best", 64)


def test_pictures_paint_what_is_wrong(scene, frame):
    flipped = 1.0 - frame.lit
    image = painted(scene, frame, flipped)
    assert np.allclose(image[frame.image(frame.lit, False)], FALSE)
    assert np.allclose(image[frame.image(~frame.lit, False)], MISSING)
    assert wrong_pixels(frame, flipped).sum() == frame.judged.sum()
    truth = painted(scene, frame, frame.lit.astype(float))
    lit, shade = truth[frame.image(frame.lit, False)].mean(), truth[frame.image(~frame.lit, False)].mean()
    assert lit > shade + 0.2
    wrong = np.zeros((20, 30))
    wrong[11:14, 22:25] = 1
    wrong[2, 3] = 1
    (first, second) = worst_places(wrong, (4, 5), 2)
    assert wrong[first[0] : first[0] + 4, first[1] : first[1] + 5].sum() == 9
    assert wrong[second[0] : second[0] + 4, second[1] : second[1] + 5].sum() == 1


def test_a_map_s_picture_has_the_light_at_zero():
    scene = LitScene(np.concatenate([FLOOR, box((-1, 1, -1), (1, 2, 1))]), np.array([0, -1.0, 0]))
    matrix = np.array([[0.5, 0, 0, 0], [0, 0, 0.5, 0], [0, -0.1, 0, 0], [0, 0, 0, 1]])
    picture = map_picture(ShadowMap(scene, matrix, (8, 8)), 64)
    expected = np.ones((8, 8))
    expected[2:6, 2:6] = 0  # the box's top is nearest to the light
    np.testing.assert_allclose(picture, expected)


@pytest.mark.parametrize("kind", MOTIONS)
def test_paths_move_as_they_say(kind):
    camera = camera_at((0, 2, 0), (0, 1.5, -5))
    steps = path(kind, camera, LIGHT, 31, 30.0)
    (first, sun), (last, late) = steps[0], steps[-1]
    np.testing.assert_allclose(first.rotation, camera.rotation, atol=1e-9)
    moved = np.linalg.norm(last.position - first.position)
    assert moved == pytest.approx(SPEED if kind in ("walk", "look") else 0, abs=1e-9)
    turned = np.degrees(np.arccos(np.clip(first.rotation[2] @ last.rotation[2], -1, 1)))
    assert (turned > 30) == (kind == "turn")
    assert np.array_equal(sun, late) != (kind == "sun")
    with pytest.raises(ValueError, match="path: got 'fly'"):
        path("fly", camera, LIGHT, 2, 30.0)  # pyright: ignore[reportArgumentType]


def test_paths_keep_a_camera_s_roll_and_handedness():
    """Turned about the vertical, a mirrored and a rolled camera stay so: the same rotation of all three rows."""
    camera = camera_at((0, 2, 0), (0, 1.5, -5))
    mirrored = dataclasses.replace(camera, rotation=camera.rotation * [[-1], [1], [1]])
    c, s = np.cos(0.4), np.sin(0.4)
    rolled = dataclasses.replace(camera, rotation=np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ camera.rotation)
    for each in (camera, mirrored, rolled):
        last, _ = path("turn", each, LIGHT, 31, 30.0)[-1]
        assert np.linalg.det(last.rotation) == pytest.approx(np.linalg.det(each.rotation))
        plain = camera.rotation.T @ path("turn", camera, LIGHT, 31, 30.0)[-1][0].rotation
        np.testing.assert_allclose(each.rotation.T @ last.rotation, plain, atol=1e-15)
        np.testing.assert_allclose(last.rotation[:, 1], each.rotation[:, 1])  # against the vertical


def moment(scene, camera, matrix=None, texels=48):
    frame = see(scene, camera, 48, 64)
    made = snapped_sphere(scene, frame, 30.0, texels) if matrix is None else matrix
    return Moment(scene, frame, ShadowMap(scene, made, (texels, texels)))


def test_what_does_not_change_does_not_flicker_and_what_changes_does(scene):
    """The same map twice: none. A snapped sphere while walking and turning: none. A map moved by half a texel: as much
    as two independent errors share; by a whole texel: none."""
    camera = camera_at((3, 4, 9), (0, 0.5, 0))
    one = moment(scene, camera)
    assert flips(one, one, Reading()) == (0, len(one.frame.lit))
    walked = dataclasses.replace(camera, position=camera.position + np.array([0.05, 0, -0.04]))
    after = moment(scene, walked)
    changed, compared = flips(one, after, Reading())
    assert compared > 0.9 * len(one.frame.lit)
    assert changed <= 2  # single precision at a texel's edge
    matrix = snapped_sphere(scene, one.frame, 30.0, 48)
    moves = {}
    for share in (0.5, 1.0):
        shifted = matrix.copy()
        shifted[0, 3] += share * 2 / 48
        moves[share] = flips(one, moment(scene, camera, shifted), Reading())[0] / len(one.frame.lit)
    static = judge(one.frame, one.shadow_map.visibility(one.frame, Reading())).wrong
    assert moves[1.0] == 0
    assert 0.3 * static < moves[0.5] < 3 * static


def test_points_out_of_sight_are_not_compared(scene):
    camera = camera_at((3, 4, 9), (0, 0.5, 0))
    one, away = moment(scene, camera), moment(scene, camera_at((3, 4, 9), (6, 4, 12)))
    assert not seen_again(one, away).any()
    assert seen_again(one, one).all()


def test_a_sphere_holds_the_frustum(scene, frame):
    texels = 64
    matrix = snapped_sphere(scene, frame, stepped_far(frame), texels)
    texture = ShadowMap(scene, matrix, (texels, texels)).texture(frame.places)
    # Snapping moves it by less than the texel that is left over; the frame fills a part of the sphere.
    assert texture.min() > 0
    assert texture.max() < 1


def test_a_held_fit_changes_every_few_frames(scene, frame):
    held, fresh = method_of("held-p-inf", 64), method_of("p-inf", 64)
    first = held(0, scene, frame).plane
    other = see(scene, camera_at((2.9, 4, 9), (0, 0.5, 0)), 60, 96)
    assert np.array_equal(held(1, scene, other).plane, first)
    assert not np.array_equal(held(HELD, scene, other).plane, first)
    assert not np.array_equal(fresh(1, scene, other).plane, fresh(0, scene, frame).plane)
    moved = LitScene(tables(9), LIGHT + np.array([0.01, 0, 0]))
    assert not np.array_equal(held(HELD + 1, moved, see(moved, frame.camera, 60, 96)).plane, first)


def test_measured_is_a_mean_over_shifts(scene, frame):
    fitting = Fitting(scene, frame, (32, 32))
    shadow_map = fitting.map_of(fitting.fitted("none"))
    values = {measured(frame, shadow_map, seed=seed).wrong for seed in range(4)}
    assert len(values) > 1
    assert measured(frame, shadow_map, seed=1).wrong == measured(frame, shadow_map, seed=1).wrong
    blurred = measured(frame, shadow_map, Reading("eye_blur"))
    assert blurred.filtered > blurred.wrong > 0

"""Cascades on pixels: names, several maps read as one, and their fits."""

import typing

import numpy as np
import pytest
from frame_cases import camera_at, tables

import warpopt
from warpopt.app.splits.settings import Scheme
from warpopt.cascades import splits
from warpopt.frames import FILTERS, LitScene, Reading, ShadowMap, measured, names, see
from warpopt.frames.cascade_fits import fit_cascades, maps_of
from warpopt.frames.cascaded_map import CascadedMap
from warpopt.frames.fits import Fitting, of_aspect
from warpopt.frames.methods import STEP, method_of, method_title
from warpopt.frames.names import Cascades, cascades_of, refuse_unknown, title_of, warp_of_method
from warpopt.frames.paths import Moment, flips, path

pytest.importorskip("embreex")
LIGHT = np.array([0.5, -1.0, 0.3])


@pytest.fixture(scope="module")
def fitting():
    scene = LitScene(tables(9), LIGHT)
    return Fitting(scene, see(scene, camera_at((3, 4, 9), (0, 0.5, 0), aspect=96 / 60), 60, 96), (64, 64))


def test_names_say_how_many_which_splits_and_which_warp():
    assert cascades_of("2-p-inf-pxq-l2") == Cascades(2, "p-inf", "pxq-l2")
    assert cascades_of("16-godot-sphere") == Cascades(16, "godot", "sphere")
    for name in ("lispsm", "p-inf", "shaped-edge", "none", ""):
        assert cascades_of(name) is None
    assert title_of("4-edge-turned-band") == "4 cascades, best edge-weighted splits, band, turned"
    unknown = (
        "4", "4-logarithmic", "0-logarithmic-none", "17-logarithmic-none", "4-turned-edge-none", "4-none-none",
        "4-logarithmic-lispsm", "4-logarithmic-best", "4-logarithmic-turned-p-inf",
    )  # fmt: skip
    for name in unknown:
        with pytest.raises(ValueError, match="expected COUNT-SPLITS-WARP"):
            refuse_unknown(name)


def test_names_of_splits_are_the_library_s():
    """Frames and settings name them where JAX must not be imported."""
    assert tuple(splits.SCHEMES) == names.SCHEMES
    assert tuple(splits.ENGINES) == names.ENGINES
    assert splits.MOST == names.MOST
    assert set(typing.get_args(Scheme)) == {*names.SCHEMES, *names.ENGINES}


@pytest.mark.parametrize("filter_", FILTERS)
def test_one_map_in_several_parts_reads_as_it_does_whole(fitting, filter_):
    """Blurs too, which read across the borders of cascades."""
    frame, reading = fitting.frame, Reading(filter_)
    whole = ShadowMap(fitting.scene, fitting.fitted("none").matrix, (64, 64))
    shift = np.random.default_rng(0).random((len(frame.places), 2))
    parts = CascadedMap(frame.camera, (whole, None, whole, whole), (9.0, 9.5, 11.0, 30.0))
    np.testing.assert_array_equal(
        parts.visibility(frame, reading, shift), whole.visibility(frame, reading, shift)
    )  # fmt: skip
    assert len(np.unique(parts.which(frame))) == 3


def test_a_receiver_reads_the_cascade_of_its_depth(fitting):
    frame = fitting.frame
    depth = frame.depth[frame.judged]
    ends = (float(np.quantile(depth, 0.3)) + 1e-9, float(np.quantile(depth, 0.7)) + 1e-9, float(depth.max()))
    maps = [ShadowMap(fitting.scene, fitting.fitted("none").matrix, (size, size)) for size in (16, 32, 64)]
    shown = CascadedMap(frame.camera, tuple(maps), ends).visibility(frame, Reading())
    for k, (first, last) in enumerate(zip((0, *ends), ends, strict=False)):
        mine = (depth > first) & (depth <= last)
        np.testing.assert_array_equal(shown[mine], maps[k].visibility(frame, Reading())[mine])
    for wrong, words in (((maps[:1], ends), "ends"), ((maps, ends[::-1]), "ends"), (((None,), (3.0,)), "maps")):
        with pytest.raises(ValueError, match=words):
            CascadedMap(frame.camera, tuple(wrong[0]), wrong[1])


@pytest.mark.thorough
def test_fits_are_the_library_s_plan_and_hold_every_receiver(fitting):
    """Also the best direction of each, at as many texels together, and engines' ranges."""
    frame = fitting.frame
    depth = frame.depth[np.isfinite(frame.depth)]
    made = fit_cascades(fitting, "2-logarithmic-p-inf")
    np.testing.assert_allclose(made.splits, np.geomspace(depth.min(), depth.max(), 3), rtol=1e-12)
    view = fitting.uniform()
    halves = warpopt.SceneView(view.camera, view.light, view.receivers, screen=view.screen, shadow_map=(45, 45))
    plan = warpopt.cascades.errors(halves, made.splits, warpopt.Objective("p"))
    matrices, _ = plan.matrices(casters=fitting.scene.corners_all)
    for part, matrix, eta in zip(made.parts, np.asarray(matrices), np.asarray(plan.warps.eta), strict=True):
        np.testing.assert_allclose(part.matrix, matrix, rtol=1e-12, atol=1e-12)
        assert (part.eta, part.size) == (pytest.approx(float(eta)), (45, 45))
    for name in ("2-logarithmic-p-inf", "2-logarithmic-turned-storage-inf", "2-logarithmic-sphere"):
        made = fit_cascades(fitting, name)
        maps = maps_of(fitting, made)
        which = maps.which(frame)
        for k, each in enumerate(maps.maps):
            texture = each.texture(frame.places[which == k])
            assert -1e-6 < texture.min() < texture.max() < 1 + 1e-6, name
        texels = sum(part.size[0] * part.size[1] for part in made.parts)
        assert texels == pytest.approx(64 * 64, rel=0.03)  # sides are whole: half a texel of 45
    assert of_aspect((512, 512), 1.25) == (640, 410)  # of the best aspect: as many texels, up to rounding
    far = fit_cascades(fitting, "2-bevy-none")  # the same program: all here have two maps
    np.testing.assert_allclose(far.splits, warpopt.cascades.splits.bevy(0.05, 100.0, 2))
    assert far.eta == (1, 1)
    plan = warpopt.cascades.plan(halves, 2, warpopt.Objective("p"))
    np.testing.assert_array_equal(fit_cascades(fitting, "2-p-inf-p-inf").splits, plan.splits)
    assert list(fitting.best_splits) == [(2, "p-inf", True)]
    with pytest.raises(ValueError, match="got 'p-inf', expected COUNT-SPLITS-WARP"):
        fit_cascades(fitting, "p-inf")


def test_a_cascade_that_holds_nothing_has_no_map(fitting):
    """Of two maps split behind all that is seen, the second; engines have it where the camera's range is split."""
    frame = fitting.frame
    depth = frame.depth[np.isfinite(frame.depth)]
    view = fitting.uniform()
    plan = warpopt.cascades.errors(view, [float(depth.min()), 1.001 * float(depth.max()), 99.0], warp=False)
    matrices, _ = plan.matrices()
    assert list(np.isfinite(matrices).all((1, 2))) == [True, False]


def test_cascades_have_a_smaller_error_than_one_map(fitting):
    """Of as many texels: a sanity check on the whole chain, by a margin that no grid shift closes."""
    frame = fitting.frame
    one = measured(frame, fitting.map_of(fitting.fitted("none")))
    two = measured(frame, maps_of(fitting, fit_cascades(fitting, "2-logarithmic-none")))
    spheres = measured(frame, maps_of(fitting, fit_cascades(fitting, "2-logarithmic-sphere")))
    assert two.wrong < 0.95 * one.wrong
    assert two.wrong < spheres.wrong


@pytest.mark.parametrize("name", ["2-logarithmic-sphere", "window-2-logarithmic-none"])
@pytest.mark.thorough("window-2-logarithmic-none")
def test_along_a_path_spheres_and_windows_hold_still(fitting, name):
    """A walk of four frames: while splits stay and nothing is fitted anew, almost no verdict changes; fitted in each
    frame, many do. Splits are at powers of the step."""
    scene, size = fitting.scene, fitting.frame.judged.shape
    still, fresh = method_of(name, 64), method_of("2-logarithmic-none", 64)
    told = {"still": [0, 0], "fresh": [0, 0]}
    before = {}
    for number, (camera, _) in enumerate(path("walk", fitting.frame.camera, LIGHT, 4, 30.0)):
        frame = see(scene, camera, *size)
        for kind, method in (("still", still), ("fresh", fresh)):
            moment = Moment(scene, frame, method(number, scene, frame))
            same = kind in before and before[kind].shadow_map.ends == moment.shadow_map.ends
            if kind == "fresh" or (same and not getattr(still, "refitted", False)):
                counts = flips(before[kind], moment, Reading()) if kind in before else (0, 0)
                told[kind] = [a + b for a, b in zip(told[kind], counts, strict=True)]
            before[kind] = moment
        ends = np.log(before["still"].shadow_map.ends) / np.log(STEP)
        np.testing.assert_allclose(ends, np.round(ends), atol=1e-6)
    one, other = before["still"].shadow_map.maps
    assert not np.allclose(one.plane, other.plane)  # each holds its own receivers
    assert told["still"][1] > len(fitting.frame.lit)
    # A receiver that comes nearer may go to the next cascade.
    assert told["still"][0] < 0.1 * told["fresh"][0] * told["still"][1] / told["fresh"][1]


def test_methods_with_cascades_by_name():
    assert warp_of_method("window-4-godot-turned-edge") == "4-godot-turned-edge"
    assert method_title("window-2-logarithmic-none").endswith("no warp, each in a stable window")
    assert method_title("2-logarithmic-sphere") == "2 cascades, logarithmic splits, snapped spheres"
    for name in ("held-2-logarithmic-none", "window-2-edge-none", "window-2-logarithmic-sphere", "2-x-none"):
        with pytest.raises(ValueError, match="COUNT-SPLITS-WARP"):
            method_of(name, 64)

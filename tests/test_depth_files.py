"""Depth images as renderers write them: kinds of files, windows, background, conventions."""

from pathlib import Path

import numpy as np
import pytest
from depth_cases import DEPTH, KINDS, deep, exr, parts, written

from warpopt.scene_files.depth_files import read_depth_image
from warpopt.scene_files.depth_image import decoded_image, pinhole_window, ray_lengths
from warpopt.scene_files.scene_camera import centred_window, centred_window_across

CASES = Path(__file__).parent / "cases"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file_holds_the_same_depths(folder, kind):
    path, settings = KINDS[kind]()
    image = read_depth_image(path, **settings)
    assert image.depth.dtype == float
    np.testing.assert_allclose(image.depth, DEPTH, rtol=1e-12)
    assert (image.seen, image.smallest, image.why_blank()) == (12, 1.0, None)


def test_a_broken_part_is_not_passed_over(folder):
    """The reader gives what it could read, and tells of the rest on the terminal alone."""
    content = bytearray(parts().read_bytes())
    content[-8:] = b"\xff" * 8
    with pytest.raises(ValueError, match="cannot be read as OpenEXR: got broken or missing data"):
        read_depth_image(written(bytes(content)), part=1)


def test_a_deep_pixel_without_samples_is_background(folder):
    depth = read_depth_image(deep(hole=True)).depth
    assert np.isinf(depth[1, 2])
    assert np.isfinite(depth).sum() == 11


def test_the_display_window_is_the_screen(folder):
    """Overscan is cropped, what is missing is background, whatever the origin."""
    values = np.arange(1, 13, dtype="f4").reshape(3, 4)
    for window, display, rows, columns in (
        (((1, 2), (4, 4)), ((0, 0), (7, 5)), slice(2, 5), slice(1, 5)),  # inside
        (((-2, -1), (1, 1)), ((-2, -1), (1, 1)), slice(0, 3), slice(0, 4)),  # the same
        (((10, 10), (13, 12)), ((11, 9), (14, 11)), slice(1, 3), slice(0, 3)),  # overlapping
    ):
        image = read_depth_image(exr("a.exr", {"Z": values}, window, display))
        (left, top), (right, bottom) = display
        assert image.depth.shape == (bottom - top + 1, right - left + 1)
        inside = image.depth[rows, columns]
        dx, dy = max(left - window[0][0], 0), max(top - window[0][1], 0)
        np.testing.assert_array_equal(inside, values[dy : dy + inside.shape[0], dx : dx + inside.shape[1]])
        assert np.isinf(image.depth).sum() == image.depth.size - inside.size
    apart = read_depth_image(exr("a.exr", {"Z": values}, ((0, 0), (3, 2)), ((100, 0), (103, 2))))
    assert apart.why_blank() == "all 12 values are infinite, 0, negative or missing: nothing is seen"


def test_files_that_failed_are_read():
    display = read_depth_image(CASES / "display.exr", far=500.0)
    assert display.depth.shape == (136, 256)
    assert 0 < display.seen < display.depth.size
    overscan = read_depth_image(CASES / "overscan.exr", far=500.0)
    np.testing.assert_allclose(overscan.depth, display.depth, rtol=1e-5)
    half = read_depth_image(CASES / "blender_half.exr", far=500.0)
    both = np.isfinite(half.depth) & np.isfinite(display.depth)
    assert both.sum() > 0.99 * display.seen
    np.testing.assert_allclose(half.depth[both], display.depth[both], rtol=2**-11)


def test_background_is_one_mark():
    values = np.array([[0, -3, np.inf, -np.inf, np.nan, 7, 100, 101]], float)
    seen = {
        (): [5, 6, 7],
        (("background", 101.0),): [5, 6],
        (("background", 100.0),): [5],
        (("far", 101.0),): [5, 6],
        (("far", 100.0), ("background", 101.0)): [5],
    }
    for settings, columns in seen.items():
        image = decoded_image(values, nan_is_background=True, **dict(settings))
        assert np.flatnonzero(np.isfinite(image.depth[0])).tolist() == columns
        np.testing.assert_array_equal(image.depth[0, columns], values[0, columns])
        assert not np.isnan(image.depth).any()
        assert (image.seen, image.smallest) == (len(columns), 7)
    with pytest.raises(
        ValueError, match=r"got NaN in row 0, column 4 \(1 of 8 pixels are like that\), expected numbers"
    ):
        decoded_image(values)


def test_encoded_depth_keeps_its_values():
    values = np.array([[0.0, 0.25, 0.999, 1.0, np.nan]])
    standard = decoded_image(values, encoding="standard", nan_is_background=True)
    np.testing.assert_array_equal(standard.depth, [[0, 0.25, 0.999, 1, 1]])
    assert standard.seen == 3
    reversed_ = decoded_image(values, encoding="reversed", nan_is_background=True)
    np.testing.assert_array_equal(reversed_.depth, [[0, 0.25, 0.999, 1, 0]])
    assert reversed_.seen == 3
    cut = {"standard": [0, 0.25, 1, 1, 1], "reversed": [0, 0, 0.999, 1, 0]}
    for encoding, limit in (("standard", 0.9), ("reversed", 0.3)):
        image = decoded_image(values, encoding=encoding, nan_is_background=True, background=limit)
        np.testing.assert_array_equal(image.depth, [cut[encoding]])
    whole = np.array([[0, 65535, 30000]], "u2")
    image = decoded_image(whole, encoding="standard", scale=1 / 65535)
    np.testing.assert_allclose(image.depth, [[0, 1, 30000 / 65535]])
    assert image.seen == 2


def test_a_blank_buffer_is_explained():
    far = decoded_image(np.full((136, 256), 3290.0) + np.eye(136, 256), far=500.0)
    assert far.why_blank() == "all 34,816 values are at or beyond far = 500; the smallest is 3,290: units?"
    given = decoded_image(np.full((2, 3), 9.0), far=500.0, background=5.0)
    assert given.why_blank() == "all 6 values are at or beyond background = 5; the smallest is 9: units?"
    nearer = decoded_image(np.full((2, 3), 9.0), far=5.0, background=8.0)
    assert nearer.why_blank() == "all 6 values are at or beyond far = 5; the smallest is 9: units?"
    assert "infinite, 0, negative or missing" in decoded_image(np.zeros((2, 3))).why_blank()
    assert "background for encoding 'standard'" in decoded_image(np.ones((2, 3)), encoding="standard").why_blank()


def test_distance_along_the_ray_becomes_eye_depth():
    """Brute force: the ray to each pixel's centre, one by one. Rows are turned before, so that it fits the screen."""
    window = (-0.5, 0.8, -0.3, 0.6)
    z = np.random.default_rng(3).uniform(1, 90, (5, 7))
    ray = np.empty_like(z)
    for i, j in np.ndindex(z.shape):
        x = window[0] + (window[1] - window[0]) * (j + 0.5) / 7
        y = window[3] - (window[3] - window[2]) * (i + 0.5) / 5
        ray[i, j] = np.linalg.norm(z[i, j] * np.array([x, y, 1]))
    image = decoded_image(ray[::-1], distance="ray", window=window, rows="bottom_up")
    np.testing.assert_allclose(image.depth, z, rtol=1e-14)
    # The camera's far plane is planar; a background that the user names is what the file says.
    np.testing.assert_array_equal(np.isinf(decoded_image(ray, distance="ray", window=window, far=50.0).depth), z >= 50)
    named = decoded_image(ray, distance="ray", window=window, background=50.0).depth
    np.testing.assert_array_equal(np.isinf(named), ray >= 50)
    assert ray_lengths((-1, 1, -1, 1), 1, 1) == 1


def test_pinhole_numbers_give_the_window():
    """A centred principal point is a centred window, and every pixel's centre is on the pinhole's own ray."""
    focal = 64 / np.tan(0.4)
    np.testing.assert_allclose(pinhole_window(focal, focal, 96, 64, 192, 128), centred_window(0.4, 1.5), rtol=1e-14)
    np.testing.assert_allclose(centred_window_across(0.4, 1.5), centred_window(np.arctan(np.tan(0.4) / 1.5), 1.5))
    for first in (0.5, 0.0):
        left, right, bottom, top = pinhole_window(500, 400, 310.5, 250.25, 640, 480, first_centre=first)
        for column, row in ((0, 0), (639, 479), (17, 300)):
            x = left + (right - left) * (column + 0.5) / 640
            y = top - (top - bottom) * (row + 0.5) / 480
            assert x == pytest.approx((column + first - 310.5) / 500, rel=1e-12)
            assert y == pytest.approx((250.25 - row - first) / 400, rel=1e-12)
    with pytest.raises(ValueError, match="fx: got 0, expected a finite number > 0"):
        pinhole_window(0, 1, 1, 1, 2, 2)

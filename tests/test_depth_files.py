"""Depth images as renderers write them: kinds of files, windows, background, conventions, and refusals."""

import io
import struct
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from warpopt.scene_files.depth_files import read_depth_image
from warpopt.scene_files.depth_image import decoded_image, pinhole_window, ray_lengths
from warpopt.scene_files.scene_camera import centred_window, centred_window_across

CASES = Path(__file__).parent / "cases"
DEPTH = np.array([[1.0, 2.5, 3.0, 400.0], [5.0, 6.0, 7.25, 8.0], [9.0, 10.0, 11.0, 12.0]])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def exr(path, channels, window=None, display=None, **header):
    OpenEXR = pytest.importorskip("OpenEXR")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    for key, corners in (("dataWindow", window), ("displayWindow", display)):
        if corners is not None:
            header[key] = tuple(np.array(corner, "i4") for corner in corners)
    OpenEXR.File(header, channels).write(str(path))
    return Path(path)


def png(path: str, values: np.ndarray) -> Path:
    """A grey PNG by the specification: big-endian samples, a filter byte of 0 before each row."""
    height, width = values.shape
    rows = b"".join(b"\0" + row.astype(f">u{values.itemsize}").tobytes() for row in values)

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8 * values.itemsize, 0, 0, 0, 0)
    Path(path).write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )
    return Path(path)


def pfm(path: str, values: np.ndarray, order: str) -> Path:
    """By the format: the lowest row first, a negative scale for little-endian numbers."""
    height, width = values.shape
    head = f"Pf\n{width} {height}\n{-1.0 if order == '<' else 1.0}\n".encode()
    Path(path).write_bytes(head + values[::-1].astype(f"{order}f4").tobytes())
    return Path(path)


def npy(path: str, values: np.ndarray) -> Path:
    np.save(path, values)
    return Path(path)


KINDS = {
    "npy": lambda: (npy("a.npy", DEPTH), {}),
    "npy, big-endian and by columns": lambda: (npy("a.npy", np.asfortranarray(DEPTH.astype(">f4"))), {}),
    "npy, a channel": lambda: (npy("a.npy", DEPTH[..., None]), {}),
    "npy, half": lambda: (npy("a.npy", DEPTH.astype("f2")), {}),
    "npy, millimetres": lambda: (npy("a.npy", (1000 * DEPTH).astype("i4")), {"scale": 0.001}),
    "npz": lambda: (np.savez("a.npz", z=DEPTH) or Path("a.npz"), {}),
    "npz with a key": lambda: (np.savez_compressed("a.npz", z=DEPTH, y=0 * DEPTH) or Path("a.npz"), {"key": "z"}),
    "pfm, little-endian": lambda: (pfm("a.pfm", DEPTH, "<"), {}),
    "pfm, big-endian": lambda: (pfm("a.pfm", DEPTH, ">"), {}),
    "png": lambda: (png("a.png", (100 * DEPTH).astype("u2")), {"scale": 0.01}),
    "exr": lambda: (exr("a.exr", {"Z": DEPTH.astype("f4")}), {}),
    "exr, half": lambda: (exr("a.exr", {"Z": DEPTH.astype("f2")}), {}),
    "exr, one channel of another name": lambda: (exr("a.exr", {"depth.V": DEPTH.astype("f4")}), {}),
    "exr, a layer": lambda: (exr("a.exr", {"View.Depth.Z": DEPTH.astype("f4"), "View.R": 0 * DEPTH.astype("f4")}), {}),
    "exr, one of two layers": lambda: (
        exr("a.exr", {"A.Z": DEPTH.astype("f4"), "B.Z": 0 * DEPTH.astype("f4")}),
        {"channel": "A"},
    ),
    "exr, depth beside normals": lambda: (
        exr(
            "a.exr",
            {"Depth.Z": DEPTH.astype("f4")}
            | {f"{kind}{c}": 0 * DEPTH.astype("f4") for kind in ("", "N.") for c in "XYZ"},
        ),
        {},
    ),
    "exr, a lone mask before the depth": lambda: (_parts(("A",)), {}),
    "exr, integers": lambda: (exr("a.exr", {"Z": (100 * DEPTH).astype("u4")}), {"scale": 0.01}),
    "exr, tiles": lambda: (_tiled(), {}),
    "exr, parts": lambda: (_parts(), {}),
    "exr, a part by name": lambda: (_parts(), {"part": "depth"}),
    "exr, a part by number": lambda: (_parts(), {"part": 1}),
    "exr, deep": lambda: (_deep(), {}),
    "upwards": lambda: (npy("a.npy", DEPTH[::-1]), {"rows": "bottom_up"}),
}


def _tiled() -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 2
    return exr("a.exr", {"Z": DEPTH.astype("f4")}, type=OpenEXR.tiledimage, tiles=tiles)


def _parts(colours: tuple[str, ...] = ("R", "G", "B")) -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    colour = np.zeros((3, 4), "f4")
    parts = [
        OpenEXR.Part({"name": "beauty"}, dict.fromkeys(colours, colour)),
        OpenEXR.Part({"name": "depth"}, {"Z": DEPTH.astype("f4")}),
        OpenEXR.Part({"name": "holdout"}, {"Z": colour + 1}),
    ]
    OpenEXR.File(parts).write("a.exr")
    return Path("a.exr")


def _deep(hole: bool = False) -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    samples = np.empty(DEPTH.shape, object)
    for place, z in np.ndenumerate(DEPTH):
        samples[place] = np.array([z + 3, z, z + 1], "f4")  # in no order
    if hole:
        samples[1, 2] = None
    return exr("a.exr", {"Z": samples}, type=OpenEXR.deepscanline, compression=OpenEXR.ZIPS_COMPRESSION)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file_holds_the_same_depths(folder, kind):
    path, settings = KINDS[kind]()
    image = read_depth_image(path, **settings)
    assert image.depth.dtype == float
    np.testing.assert_allclose(image.depth, DEPTH, rtol=1e-12)
    assert (image.seen, image.smallest, image.why_blank()) == (12, 1.0, None)


def test_a_broken_part_is_not_passed_over(folder):
    """The reader gives what it could read, and tells of the rest on the terminal alone."""
    content = bytearray(_parts().read_bytes())
    content[-8:] = b"\xff" * 8
    with pytest.raises(ValueError, match="cannot be read as OpenEXR: got broken or missing data"):
        read_depth_image(_bytes(bytes(content)), part=1)


def test_a_deep_pixel_without_samples_is_background(folder):
    depth = read_depth_image(_deep(hole=True)).depth
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


def _header(shape: str, descr: str = "<f8") -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _colours() -> Path:
    rows = zlib.compress(b"\0" + bytes(6))
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 2, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n"
    for kind, inner in chunks:
        content += struct.pack(">I", len(inner)) + kind + inner + struct.pack(">I", zlib.crc32(kind + inner))
    return _bytes(content)


def _bytes(content: bytes) -> Path:
    Path("bad").write_bytes(content)
    return Path("bad")


def _bomb() -> Path:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("z.npy", _header("(1000000, 1000000)") + bytes(100))
    return _bytes(held.getvalue())


def _cut(path: Path, share: float = 0.6) -> Path:
    content = path.read_bytes()
    return _bytes(content[: int(len(content) * share)])


def _wide_exr() -> Path:
    content = exr("a.exr", {"Z": DEPTH.astype("f4")}).read_bytes()
    at = content.index(b"dataWindow\0box2i\0") + 21
    return _bytes(content[:at] + struct.pack("<4i", 0, 0, 200_000, 200_000) + content[at + 16 :])


NOISE = np.random.default_rng(0).uniform(1, 9, (60, 80)).astype("f4")
BAD = {
    "integers without scale": (
        lambda: npy("a.npy", np.ones((2, 2), "u2")),
        {},
        "got integers (uint16), expected scale",
    ),
    "a PNG without scale": (lambda: png("a.png", np.ones((2, 2), "u2")), {}, "got integers (uint16), expected scale"),
    "scale": (lambda: npy("a.npy", DEPTH), {"scale": -1.0}, "scale: got -1, expected a finite number > 0"),
    "NaN": (lambda: npy("a.npy", DEPTH * np.nan), {}, "got NaN in row 0, column 0 (12 of 12"),
    "out of range": (lambda: npy("a.npy", DEPTH), {"encoding": "reversed"}, "got 2.5 in row 0, column 1 (11 of 12"),
    "ray without window": (lambda: npy("a.npy", DEPTH), {"distance": "ray"}, "expected linear encoding and a window"),
    "rows": (lambda: npy("a.npy", DEPTH), {"rows": "up"}, "rows: got 'up', expected one of 'top_down', 'bottom_up'"),
    "background": (lambda: npy("a.npy", DEPTH), {"background": 0.0}, "background: got 0, expected a number > 0"),
    "channels": (
        lambda: npy("a.npy", np.ones((2, 2, 3))),
        {},
        "got an array of shape (2, 2, 3), expected (height, width)",
    ),
    "nothing": (lambda: npy("a.npy", np.ones((0, 3))), {}, "got an array of shape (0, 3)"),
    "complex": (lambda: npy("a.npy", 1j * DEPTH), {}, "got values of type complex128"),
    "objects": (lambda: _bytes(_header("(2, 2)", "|O") + b"cos"), {}, "got Python objects, expected numbers"),
    "a cut array": (lambda: _cut(npy("a.npy", NOISE)), {}, "expected 19,200 of shape (60, 80)"),
    "an array without end": (lambda: _bytes(_header("(1000000, 1000000)")), {}, "8,000,000,000,000 of shape"),
    "an array without end in an archive": (_bomb, {}, "expected 8,000,000,000,000 of shape"),
    "a negative shape": (lambda: _bytes(_header("(-1, 2)") + bytes(64)), {}, "of shape (-1, 2)"),
    "a broken header": (lambda: _bytes(b"\x93NUMPY\x01\x00\x09\x00{'descr"), {}, "got a broken header"),
    "a key too few": (
        lambda: np.savez("a.npz", y=DEPTH, z=DEPTH) or Path("a.npz"),
        {},
        "got arrays y, z, expected the key",
    ),
    "a key too much": (
        lambda: npy("a.npy", DEPTH),
        {"key": "z"},
        "got key 'z', expected none for a file that is not .npz",
    ),
    "another key": (lambda: np.savez("a.npz", y=DEPTH) or Path("a.npz"), {"key": "z"}, "got arrays y, expected 'z'"),
    "a cut archive": (lambda: _cut(np.savez("a.npz", y=DEPTH) or Path("a.npz")), {}, "got a broken archive"),
    "colours": (_colours, {}, "got a PNG of mode RGB, expected one channel of grey"),
    "a cut PNG": (lambda: _cut(png("a.png", (99 * NOISE).astype("u2"))), {}, "cannot be read as PNG"),
    "a cut PFM": (lambda: _cut(pfm("a.pfm", NOISE, "<")), {}, "cannot be read as PFM"),
    "colours in PFM": (lambda: _bytes(b"PF\n1 1\n-1.0\n" + bytes(12)), {}, "cannot be read as PFM"),
    "text": (lambda: _bytes(b"no array"), {}, "neither .npy nor OpenEXR, expected one of .npy, .npz"),
    "a cut EXR": (
        lambda: _cut(exr("a.exr", {"Z": NOISE})),
        {},
        "cannot be read as OpenEXR: got broken or missing data",
    ),
    "an EXR without end": (_wide_exr, {}, "got a dataWindow of 200001 x 200001 pixels"),
    "no channel": (lambda: exr("a.exr", {"R": NOISE, "G": NOISE}), {}, "got channels G, R, expected 'Z' among them"),
    "another channel": (
        lambda: exr("a.exr", {"Z": NOISE}),
        {"channel": "W"},
        "got channels Z, expected 'W' among them",
    ),
    "two layers": (lambda: exr("a.exr", {"A.Z": NOISE, "B.Z": NOISE}), {}, "got channels A.Z, B.Z, expected a choice"),
    "a normal": (lambda: exr("a.exr", {"X": NOISE, "Y": NOISE, "Z": NOISE}), {}, "got channels X, Y, Z, expected 'Z'"),
    "another part": (_parts, {"part": "x"}, "got part(s) 'beauty', 'depth', 'holdout', expected 'x' among them"),
    "part 7": (_parts, {"part": 7}, "got 3 part(s), expected one of index 7"),
    "a part without Z": (_parts, {"part": 0}, "got channels B, G, R, expected 'Z' among them"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_flaw_is_told_in_one_sentence(folder, capfd, name):
    make, settings, words = BAD[name]
    path = make()
    with pytest.raises(ValueError, match=str(path)) as error:
        read_depth_image(path, **settings)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert "\n" not in message
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_stays_an_os_error(folder):
    with pytest.raises(FileNotFoundError):
        read_depth_image(Path("none.npy"))


@pytest.mark.parametrize(("library", "kind"), [("OpenEXR", "exr"), ("PIL", "png")])
def test_a_missing_library_is_named(folder, monkeypatch, library, kind):
    path, settings = KINDS[kind]()
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ValueError, match=r"expected the package \w+ to read it with: pip install 'warpopt\[scene\]'"):
        read_depth_image(path, **settings)


def fuzzed(seed: int) -> str:
    """What reading a file with some bytes changed comes to; any other exception is a defect."""
    random = np.random.default_rng(seed)
    path, settings = KINDS[list(KINDS)[seed % len(KINDS)]]()
    content = bytearray(path.read_bytes())
    for _ in range(random.integers(1, 5)):
        content[random.integers(len(content))] = random.integers(256)
    if random.random() < 0.2:
        content = content[: random.integers(len(content))]
    try:
        image = read_depth_image(_bytes(bytes(content)), **settings)
    except ValueError as error:
        told = str(error)
        assert told.startswith("bad: ")
        assert "\n" not in told
        return told
    assert not np.isnan(image.depth).any()
    assert (image.depth > 0).all()
    assert image.seen == np.isfinite(image.depth).sum()
    return "read"


@pytest.mark.parametrize("seed", range(44))
def test_a_mutated_file_is_read_or_refused(folder, capfd, seed):
    fuzzed(seed)
    assert capfd.readouterr() == ("", "")

"""Every way in which a depth image can be wrong is refused in one sentence; mutated files are read or refused."""

import io
import struct
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from depth_cases import DEPTH, KINDS, exr, npy, parts, pfm, png, written

from warpopt.scene_files.depth_files import read_depth_image


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _header(shape: str, descr: str = "<f8") -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _colours() -> Path:
    rows = zlib.compress(b"\0" + bytes(6))
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 2, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n"
    for kind, inner in chunks:
        content += struct.pack(">I", len(inner)) + kind + inner + struct.pack(">I", zlib.crc32(kind + inner))
    return written(content)


def _bomb() -> Path:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("z.npy", _header("(1000000, 1000000)") + bytes(100))
    return written(held.getvalue())


def _cut(path: Path, share: float = 0.6) -> Path:
    content = path.read_bytes()
    return written(content[: int(len(content) * share)])


def _wide_exr() -> Path:
    content = exr("a.exr", {"Z": DEPTH.astype("f4")}).read_bytes()
    at = content.index(b"dataWindow\0box2i\0") + 21
    return written(content[:at] + struct.pack("<4i", 0, 0, 200_000, 200_000) + content[at + 16 :])


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
    "objects": (lambda: written(_header("(2, 2)", "|O") + b"cos"), {}, "got Python objects, expected numbers"),
    "a cut array": (lambda: _cut(npy("a.npy", NOISE)), {}, "expected 19,200 of shape (60, 80)"),
    "an array without end": (lambda: written(_header("(1000000, 1000000)")), {}, "8,000,000,000,000 of shape"),
    "an array without end in an archive": (_bomb, {}, "expected 8,000,000,000,000 of shape"),
    "a negative shape": (lambda: written(_header("(-1, 2)") + bytes(64)), {}, "of shape (-1, 2)"),
    "a broken header": (lambda: written(b"\x93NUMPY\x01\x00\x09\x00{'descr"), {}, "got a broken header"),
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
    "colours in PFM": (lambda: written(b"PF\n1 1\n-1.0\n" + bytes(12)), {}, "cannot be read as PFM"),
    "text": (lambda: written(b"no array"), {}, "neither .npy nor OpenEXR, expected one of .npy, .npz"),
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
    "another part": (parts, {"part": "x"}, "got part(s) 'beauty', 'depth', 'holdout', expected 'x' among them"),
    "part 7": (parts, {"part": 7}, "got 3 part(s), expected one of index 7"),
    "a part without Z": (parts, {"part": 0}, "got channels B, G, R, expected 'Z' among them"),
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
        image = read_depth_image(written(bytes(content)), **settings)
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

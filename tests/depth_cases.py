"""Depth images in files of all kinds, as tagged data for the tests of the reader."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

DEPTH = np.array([[1.0, 2.5, 3.0, 400.0], [5.0, 6.0, 7.25, 8.0], [9.0, 10.0, 11.0, 12.0]])


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
    "exr, a lone mask before the depth": lambda: (parts(("A",)), {}),
    "exr, integers": lambda: (exr("a.exr", {"Z": (100 * DEPTH).astype("u4")}), {"scale": 0.01}),
    "exr, tiles": lambda: (tiled(), {}),
    "exr, parts": lambda: (parts(), {}),
    "exr, a part by name": lambda: (parts(), {"part": "depth"}),
    "exr, a part by number": lambda: (parts(), {"part": 1}),
    "exr, deep": lambda: (deep(), {}),
    "upwards": lambda: (npy("a.npy", DEPTH[::-1]), {"rows": "bottom_up"}),
}


def tiled() -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 2
    return exr("a.exr", {"Z": DEPTH.astype("f4")}, type=OpenEXR.tiledimage, tiles=tiles)


def parts(colours: tuple[str, ...] = ("R", "G", "B")) -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    colour = np.zeros((3, 4), "f4")
    held = [
        OpenEXR.Part({"name": "beauty"}, dict.fromkeys(colours, colour)),
        OpenEXR.Part({"name": "depth"}, {"Z": DEPTH.astype("f4")}),
        OpenEXR.Part({"name": "holdout"}, {"Z": colour + 1}),
    ]
    OpenEXR.File(held).write("a.exr")
    return Path("a.exr")


def deep(hole: bool = False) -> Path:
    OpenEXR = pytest.importorskip("OpenEXR")
    samples = np.empty(DEPTH.shape, object)
    for place, z in np.ndenumerate(DEPTH):
        samples[place] = np.array([z + 3, z, z + 1], "f4")  # in no order
    if hole:
        samples[1, 2] = None
    return exr("a.exr", {"Z": samples}, type=OpenEXR.deepscanline, compression=OpenEXR.ZIPS_COMPRESSION)


def written(content: bytes) -> Path:
    Path("bad").write_bytes(content)
    return Path("bad")

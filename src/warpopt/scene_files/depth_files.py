"""Depth images and masks from files: `.npy`, `.npz`, OpenEXR, PFM and PNG."""

import contextlib
import os
import warnings
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from .depth_image import DepthImage, Encoding, decoded_image
from .exr_files import MAGIC as _EXR
from .exr_files import read_exr

_NPY, _NPZ, _PNG = b"\x93NUMPY", b"PK\x03\x04", b"\x89PNG\r\n\x1a\n"
_PFM = (b"Pf", b"PF")
_KINDS = ".npy, .npz, OpenEXR, PFM, PNG"
_MOST_PIXELS = 1 << 28


def read_depth_image(
    path: Path,
    *,
    encoding: Encoding = "linear",
    channel: str | None = None,
    part: int | str | None = None,
    key: str | None = None,
    scale: float | None = None,
    background: float | None = None,
    far: float = np.inf,
    nan_is_background: bool = False,
    rows: str = "top_down",
    distance: str = "planar",
    window: tuple[float, float, float, float] | None = None,
) -> DepthImage:
    """The depths in a file; background is inf if linear, 1 if standard and 0 if reversed.

    Args:
        path: `.npy`, `.npz`, OpenEXR, `.pfm` or `.png`, recognised by its first bytes.
        encoding: "linear", "standard" or "reversed", see `warpopt.DepthBuffer`.
        channel, part: of an OpenEXR file, see `exr_files.read_exr`.
        key: of a `.npz` with more than one array.
        scale: factor for the file's values, such as 0.001 for millimetres; required for integers.
        background: values at or beyond it (at or below it if reversed) are background; applied after `scale` and before
            `distance`. In linear depth, infinity, 0 and negative values are always background.
        far: of the camera; linear eye depths at or beyond it are background.
        nan_is_background: otherwise NaN is refused.
        rows: "top_down" or "bottom_up": meaning of the format's first row (PFM, stored bottom-up, is already flipped).
        distance: "planar" or "ray", linear depth along the view or along each pixel's ray.
        window: slopes of the camera's side planes, for `distance="ray"`.

    Raises:
        ValueError: one sentence that names the file, what was got and what was expected.
        OSError: a file that cannot be read.
    """
    values, there = read_values(path, channel=channel, part=part, key=key)
    try:
        return decoded_image(
            values, there, encoding=encoding, scale=scale, background=background, far=far,
            nan_is_background=nan_is_background, rows=rows, distance=distance, window=window,
        )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_mask(path: Path) -> NDArray[np.bool_]:
    """(H, W), true where the value is above half of the file's largest possible one; row 0 is the top.

    Args:
        path: `.npy`, `.npz` or `.png`, one channel: booleans, integers of the whole range, or numbers in [0, 1].

    Raises:
        ValueError: one sentence that names the file, what was got and what was expected.
        OSError: a file that cannot be read.
    """
    values, _ = read_values(path)
    if values.dtype == np.bool_:
        return values
    if values.dtype.kind in "iu":
        if ((values == 0) | (values == 1)).all():
            return values == 1
        if values.dtype.kind == "i" or values.dtype.itemsize > 2:
            raise ValueError(f"{path}: got integers ({values.dtype}), expected 0 and 1, or 8 or 16 bits without a sign")
        return values > np.iinfo(values.dtype).max / 2
    if not ((values >= 0) & (values <= 1)).all():
        raise ValueError(f"{path}: got {values[~((values >= 0) & (values <= 1))].flat[0]}, expected numbers in [0, 1]")
    return values > 0.5


def read_values(
    path: Path, *, channel: str | None = None, part: int | str | None = None, key: str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(a file's unconverted values, which pixels have one), each (height, width).

    Raises:
        ValueError: one sentence, for a file of another format.
        OSError: a file that cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(8)
    given = {"channel": channel, "part": part, "key": key}
    if start[:4] == _EXR:
        _refuse(path, given, "channel", "part")
        return read_exr(path, channel, part)
    if start[:6] == _NPY or start[:4] == _NPZ:
        _refuse(path, given, *(("key",) if start[:4] == _NPZ else ()))
        values = _npz(path, key) if start[:4] == _NPZ else _npy(path)
    elif start == _PNG or (start[:2] in _PFM and start[2:3].isspace()):
        _refuse(path, given)
        values = _picture(path, "PNG" if start == _PNG else "PFM")
    else:
        raise ValueError(f"{path}: got a file that is neither .npy nor OpenEXR, expected one of {_KINDS}")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2 or 0 in values.shape:
        raise ValueError(f"{path}: got an array of shape {values.shape}, expected (height, width)")
    return values, np.ones(values.shape, bool)


def _refuse(path: Path, given: dict[str, int | str | None], *understood: str) -> None:
    for name, value in given.items():
        if value is not None and name not in understood:
            kinds = ".npz" if name == "key" else "OpenEXR"
            raise ValueError(f"{path}: got {name} {value!r}, expected none for a file that is not {kinds}")


def _npy(path: Path) -> np.ndarray:
    with path.open("rb") as file:
        return _array(path, file, os.fstat(file.fileno()).st_size)


def _npz(path: Path, key: str | None) -> np.ndarray:
    try:
        archive = zipfile.ZipFile(path)
    except Exception:  # a broken directory can raise anything
        raise ValueError(f"{path}: cannot be read as .npz: got a broken archive") from None
    with archive:
        names = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        told = f"{path}: got arrays {', '.join(names) or 'none'}"
        if key is None and len(names) != 1:
            raise ValueError(f"{told}, expected the key of one")
        if key is not None and key not in names:
            raise ValueError(f"{told}, expected {key!r} among them")
        info = next(iter(names.values())) if key is None else names[key]
        try:
            file = archive.open(info)
        except Exception:  # encrypted, unknown compression, or a broken header
            raise ValueError(f"{path}: cannot be read as .npz: got a broken or locked entry {info.filename}") from None
        with file:
            return _array(path, file, info.file_size)


def _array(path: Path, file: IO[bytes], size: int) -> np.ndarray:
    """The array of a `.npy` stream of `size` bytes."""
    try:
        with _quiet():
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, turned, dtype = read(file)
    except Exception:  # the header is a Python literal, whose parser can raise anything
        raise ValueError(f"{path}: cannot be read as .npy: got a broken header") from None
    if dtype.hasobject:
        raise ValueError(f"{path}: cannot be read as .npy: got Python objects, expected numbers")
    if dtype.kind not in "fiub":
        raise ValueError(f"{path}: got values of type {dtype}, expected real numbers")
    promised = dtype.itemsize
    for length in shape:  # Python integers do not overflow
        promised *= length
    # Checked before allocation: a header of 100 bytes may promise terabytes.
    if promised > size or min(shape, default=0) < 0:
        raise ValueError(f"{path}: cannot be read as .npy: got {size:,} bytes, expected {promised:,} of shape {shape}")
    try:
        content = file.read(promised)
    except Exception:  # a broken archive can raise anything
        content = b""
    if len(content) < promised:
        raise ValueError(f"{path}: cannot be read as .npy: got {len(content):,} bytes of values, expected {promised:,}")
    return np.ndarray(shape, dtype, content, order="F" if turned else "C")


def _picture(path: Path, kind: str) -> np.ndarray:
    try:
        from PIL import Image
    except ImportError:
        raise ValueError(
            f"{path}: got a {kind} file, expected the package pillow to read it with: pip install 'warpopt[scene]'"
        ) from None
    values = None
    try:
        with _quiet(), Image.open(path, formats=("PNG",) if kind == "PNG" else ("PPM",)) as image:
            mode, (width, height) = image.mode, image.size
            fits = width * height <= _MOST_PIXELS
            if fits and (mode in ("1", "F", "L") or mode.startswith("I")):
                values = np.array(image)
    except Exception:  # broken data can raise anything
        raise ValueError(f"{path}: cannot be read as {kind}: got broken data, or colours") from None
    if not fits:
        raise ValueError(f"{path}: got {width} x {height} pixels, expected at most {_MOST_PIXELS:,}")
    if values is None:
        raise ValueError(f"{path}: got a {kind} of mode {mode}, expected one channel of grey")
    return values


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of large images, whose size is limited here
        yield

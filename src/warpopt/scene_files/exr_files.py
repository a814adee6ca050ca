"""Depth channels of OpenEXR files: parts, layers, data and display windows, deep pixels."""

import contextlib
import dataclasses
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

MAGIC = bytes.fromhex("762f3101")
_MOST_PIXELS = 1 << 28
_Result = TypeVar("_Result")


def read_exr(path: Path, channel: str | None = None, part: int | str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(values, which pixels have one) over the display window, each (height, width), row 0 at the top.

    Pixels of the display window outside the data window have no value; pixels outside the display window are cropped.

    Args:
        path: of the file.
        channel: its full name, or a layer's name before ".Z"; by default Z, otherwise the only layer's Z, otherwise the
            only channel.
        part: name or index; by default the first that has the channel.

    Raises:
        ValueError: one sentence, for a file or channel that cannot be read.
    """
    try:
        import OpenEXR
    except ImportError:
        raise ValueError(
            f"{path}: got an OpenEXR file, expected the package OpenEXR to read it with: pip install 'warpopt[scene]'"
        ) from None
    try:
        # The header first: its declared sizes are checked before memory is allocated.
        headers = _read(OpenEXR, path, True, lambda parts: [_Header.of(part) for part in parts])
        index, wanted = _chosen(path, headers, channel, part)
        data, display = (_size(path, *named) for named in headers[index].windows.items())
        values, held = _read(OpenEXR, path, False, lambda parts: _pixels(parts[index].channels[wanted].pixels))
    except _BrokenError:
        raise ValueError(f"{path}: cannot be read as OpenEXR: got broken or missing data") from None
    left, top, width, height = data
    if values.shape != (height, width):
        raise ValueError(
            f"{path}: channel {wanted}: got {values.shape[1]} x {values.shape[0]} pixels, expected one for each of the "
            f"{width} x {height} of the data window"
        )
    across, down, width, height = display
    whole, there = np.zeros((height, width), values.dtype), np.zeros((height, width), bool)
    # The intersection of both windows, in pixel indices of each.
    first = max(left, across), max(top, down)
    last = min(left + data[2], across + width), min(top + data[3], down + height)
    if first[0] < last[0] and first[1] < last[1]:
        inside = np.s_[first[1] - down : last[1] - down, first[0] - across : last[0] - across]
        whole[inside] = values[first[1] - top : last[1] - top, first[0] - left : last[0] - left]
        there[inside] = held[first[1] - top : last[1] - top, first[0] - left : last[0] - left]
    return whole, there


class _BrokenError(Exception):
    """Any error of the reader."""


@dataclasses.dataclass(frozen=True)
class _Header:
    """A part's name, its channels, and the corners (left, top, right, bottom) of its windows."""

    name: str
    channels: list[str]
    windows: dict[str, tuple[int, ...]]

    @classmethod
    def of(cls, part: Any) -> "_Header":
        names = sorted(channel.name for channel in part.header["channels"])
        corners = {key: np.concatenate(part.header[key]).tolist() for key in ("dataWindow", "displayWindow")}
        return cls(part.name(), names, corners)


def _read(reader: Any, path: Path, header_only: bool, use: Callable[[list[Any]], _Result]) -> _Result:
    """The result of `use` for the file's parts."""
    printed = io.StringIO()
    try:
        # The reader reports broken pixels only on the terminal, and then returns a file without parts.
        with contextlib.redirect_stdout(printed), _silent():
            parts = list(reader.File(str(path), separate_channels=True, header_only=header_only).parts)
            result = use(parts)
    except Exception:  # it has no error class, and decodes names only on access
        raise _BrokenError from None
    if not parts or "Exception" in printed.getvalue():
        raise _BrokenError
    return result


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Suppress standard error of code that is not Python's."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _chosen(path: Path, headers: list[_Header], channel: str | None, part: int | str | None) -> tuple[int, str]:
    """(part, name of the channel)."""
    if isinstance(part, int) and not 0 <= part < len(headers):
        raise ValueError(f"{path}: got {len(headers)} part(s), expected one of index {part}")
    asked = range(len(headers)) if part is None else [part] if isinstance(part, int) else []
    if isinstance(part, str):
        asked = [i for i, header in enumerate(headers) if header.name == part]
        if not asked:
            there = ", ".join(repr(header.name) for header in headers)
            raise ValueError(f"{path}: got part(s) {there}, expected {part!r} among them")
    # A single channel is depth only if no part has a Z.
    for lone in (False, True):
        for index in asked:
            found = _candidates(headers[index].channels, channel, lone)
            if len(found) > 1:
                raise ValueError(f"{path}: got channels {', '.join(found)}, expected a choice among them")
            if found:
                return index, found[0]
    names = list(dict.fromkeys(name for index in asked for name in headers[index].channels))
    raise ValueError(f"{path}: got channels {', '.join(names) or 'none'}, expected {channel or 'Z'!r} among them")


def _candidates(names: list[str], channel: str | None, lone: bool) -> list[str]:
    if channel is not None:
        return [name for name in (channel, f"{channel}.Z") if name in names][:1]
    if lone:
        return names if len(names) == 1 else []
    # Next to an X, Z is a component of a normal or a position.
    depths = [name for name in names if name.split(".")[-1] == "Z" and f"{name[:-1]}X" not in names]
    return ["Z"] if "Z" in depths else depths


def _size(path: Path, key: str, corners: tuple[int, ...]) -> tuple[int, int, int, int]:
    """(left, top, width, height) in pixels."""
    left, top, right, bottom = corners
    width, height = right - left + 1, bottom - top + 1
    if width < 1 or height < 1 or width * height > _MOST_PIXELS:
        raise ValueError(f"{path}: got a {key} of {width} x {height} pixels, expected 1 to {_MOST_PIXELS:,} of them")
    return left, top, width, height


def _pixels(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(values, which pixels have one) over the data window."""
    pixels = np.asarray(pixels)
    if pixels.dtype != object:
        return pixels, np.ones(pixels.shape, bool)
    # Deep: a list of samples for each pixel, unordered and possibly empty.
    held = np.array([samples is not None and len(samples) > 0 for samples in pixels.flat], bool).reshape(pixels.shape)
    nearest = np.zeros(pixels.shape)
    nearest[held] = [np.min(samples) for samples in pixels[held]]
    return nearest, held

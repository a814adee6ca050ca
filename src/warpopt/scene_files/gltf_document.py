"""A glTF file: its JSON, references between objects, and the bytes of its buffers.

The JSON is parsed directly: pygltflib (1.16.5) turns 0.7 into the index 0, drops unknown fields, and takes 70 times as
long.
"""

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes, urlsplit

from .gltf_item import GltfError, Item, short

_GLB_MAGIC = b"glTF"
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942  # "JSON", "BIN"
_NOT_GLTF = "got a file that is not glTF, expected .gltf or .glb of version 2"
_KINDS = {"bufferViews": "buffer view", "meshes": "mesh"}


class Document:
    """A parsed file.

    Attributes:
        path: of the file.
        root: the JSON's outermost object.
    """

    def __init__(self, path: Path):
        """Read the file.

        Raises:
            GltfError: a file that is not glTF of version 2.
            OSError: a file that cannot be read.
        """
        self.path = path
        text, self._binary = _chunks(path.read_bytes())
        data = _parsed(text)
        if not isinstance(data, dict) or not isinstance(data.get("asset"), dict):
            raise GltfError(_NOT_GLTF)
        self.root = Item(data, "the file")
        asset = self.root.required("asset")
        for key in ("version", "minVersion"):
            version = asset.text(key)
            if version.split(".")[0] != "2" and (version or key == "version"):
                raise GltfError(f"got glTF of {key} {version or 'none'}, expected 2.0")
        if asset.text("minVersion") not in ("", "2.0"):
            raise GltfError(f"got glTF of minVersion {asset.text('minVersion')}, expected 2.0")
        self._buffers: dict[int, memoryview] = {}

    def count(self, kind: str) -> int:
        """The number of "nodes", "meshes" and so on."""
        value = self.root.data.get(kind, [])
        if not isinstance(value, list):
            raise self.root.refused(kind, "a list")
        return len(value)

    def item(self, kind: str, index: int) -> Item:
        """The object of a kind with an index."""
        value = self.root.data[kind][index]
        singular = _KINDS.get(kind, kind[:-1])
        if not isinstance(value, dict):
            raise GltfError(f"{singular} {index}: got {short(value)}, expected an object")
        name = value.get("name")
        return Item(value, f"{singular} {index}" + (f" {short(name)}" if isinstance(name, str) and name else ""))

    def index(self, item: Item, key: str, kind: str) -> int:
        """The checked index that `key` of an item refers to.

        Raises:
            GltfError: missing or out of range.
        """
        there = self.count(kind)
        index = item.integer(key)
        if index >= there:
            raise item.refused(key, f"one of the file's {there} {kind}")
        return index

    def indices(self, item: Item, key: str, kind: str) -> list[int]:
        """The checked indices in a list; empty if it is missing."""
        value = item.data.get(key, [])
        if not isinstance(value, list):
            raise item.refused(key, f"a list of {kind}")
        return [self.index(Item({key: v}, item.where), key, kind) for v in value]

    def refers(self, item: Item, key: str, kind: str) -> Item | None:
        """The item that `key` refers to; None if it is missing."""
        return self.item(kind, self.index(item, key, kind)) if key in item else None

    def slice(self, item: Item) -> memoryview:
        """The bytes of a buffer view, or of an object with the same keys."""
        buffer = self._buffer(self.index(item, "buffer", "buffers"))
        start, size = item.integer("byteOffset", 0), item.integer("byteLength", least=1)
        if start + size > len(buffer):
            raise GltfError(
                f"{item.where}: got bytes {start:,} to {start + size:,}, expected at most the {len(buffer):,} of its "
                "buffer"
            )
        return buffer[start : start + size]

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            item = self.item("buffers", index)
            size = item.integer("byteLength", least=1)
            content = self._content(item, index)
            if size > len(content):
                raise GltfError(f"{item.where}: got byteLength {size:,}, expected at most the {len(content):,} there")
            self._buffers[index] = memoryview(content)[:size]
        return self._buffers[index]

    def _content(self, item: Item, index: int) -> bytes | memoryview:
        if "uri" not in item:
            if index or self._binary is None:
                raise item.refused("uri", "one, as there is no binary chunk")
            return self._binary
        uri = item.text("uri")
        if uri[:5].lower() == "data:":
            return _data_uri(item, uri)
        try:
            parts = urlsplit(uri)
        except ValueError:
            raise item.refused("uri", "a path relative to the file") from None
        name = unquote_to_bytes(uri).decode(errors="replace")
        if len(parts.scheme) > 1 or parts.netloc or not name or "\0" in name:
            raise item.refused("uri", "a path relative to the file, or data:")
        try:
            return (self.path.parent / name).read_bytes()
        except OSError as error:
            raise GltfError(f"{item.where}: {name}: cannot be read: {error.strerror}") from None


def _chunks(raw: bytes) -> tuple[bytes, memoryview | None]:
    """(the JSON, the binary chunk) of a file's bytes."""
    if raw[:4] != _GLB_MAGIC:
        return raw, None
    if len(raw) < 20:
        raise GltfError(f"got a .glb of {len(raw)} bytes, expected a header and a chunk")
    version, length = struct.unpack_from("<II", raw, 4)
    if version != 2:
        raise GltfError(f"got a .glb of version {version}, expected 2")
    if length > len(raw):
        raise GltfError(f"got {len(raw):,} bytes, expected the {length:,} that the header promises")
    chunks, start = [], 12
    while start + 8 <= length:
        size, kind = struct.unpack_from("<II", raw, start)
        if start + 8 + size > length:
            raise GltfError(f"got a chunk of {size:,} bytes, expected at most the {length - start - 8:,} left")
        chunks.append((kind, start + 8, size))
        start += 8 + size
    if not chunks or chunks[0][0] != _JSON_CHUNK:
        raise GltfError("got a .glb without a JSON chunk at its start, expected one")
    parts = [memoryview(raw)[start : start + size] for _, start, size in chunks[:2]]
    return bytes(parts[0]), parts[1] if len(chunks) > 1 and chunks[1][0] == _BINARY_CHUNK else None


def _parsed(text: bytes) -> Any:
    try:
        decoded = text.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise GltfError(_NOT_GLTF) from None
    if not decoded.lstrip().startswith("{"):
        raise GltfError(_NOT_GLTF)
    try:
        return json.loads(decoded)
    except json.JSONDecodeError as error:
        raise GltfError(
            f"got text that is not JSON at line {error.lineno}, column {error.colno}, expected glTF"
        ) from None
    except (ValueError, RecursionError):  # a number with thousands of digits, or very deep nesting
        raise GltfError("got JSON with a number that is too long or nesting that is too deep, expected glTF") from None


def _data_uri(item: Item, uri: str) -> bytes:
    head, comma, payload = uri.partition(",")
    if not comma:
        raise item.refused("uri", "data:...;base64,...")
    if not head.lower().endswith(";base64"):
        return unquote_to_bytes(payload)
    try:
        return base64.b64decode(unquote_to_bytes(payload) if "%" in payload else payload, validate=True)
    except (binascii.Error, ValueError):
        raise item.refused("uri", "valid base64") from None

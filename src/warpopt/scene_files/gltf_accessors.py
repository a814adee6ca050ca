"""Accessors of a glTF file as arrays: strides, sparse values, quantised and normalised integers, compressed views."""

import numpy as np

from .gltf_document import Document
from .gltf_item import GltfError, Item

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MOST_ZEROS = 1 << 28  # limit in bytes for an accessor without data in the file
# A block of 256 elements takes at least two bits per byte column (version 1 of the format), a triangle one byte.
_MOST_COMPRESSED = 1024
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")


class Accessors:
    """The accessors of a document; decompressed data is cached."""

    def __init__(self, document: Document):
        self._document = document
        self._decompressed: dict[int, np.ndarray] = {}

    def count(self, item: Item, key: str) -> int:
        """The number of elements of the accessor that `key` refers to."""
        return self._accessor(item, key).integer("count", least=1)

    def floats(self, item: Item, key: str, kind: str) -> np.ndarray:
        """(count, size) numbers; integers are converted to the values that they represent.

        Args:
            item, key: the object and key that refer to the accessor.
            kind: "VEC3" and so on.

        Raises:
            GltfError: names the error.
        """
        accessor = self._accessor(item, key)
        return real(self._values(accessor, kind), accessor)

    def integers(self, item: Item, key: str, kind: str) -> np.ndarray:
        """(count, size) unsigned integers."""
        accessor = self._accessor(item, key)
        values = self._values(accessor, kind)
        if values.dtype.kind != "u":
            raise accessor.refused("componentType", "5121, 5123 or 5125 (unsigned integers)")
        return values

    def accessor(self, item: Item, key: str) -> Item:
        """The accessor that `key` refers to."""
        return self._accessor(item, key)

    def _accessor(self, item: Item, key: str) -> Item:
        return self._document.item("accessors", self._document.index(item, key, "accessors"))

    def _values(self, accessor: Item, kind: str) -> np.ndarray:
        if accessor.data.get("type") != kind:
            raise accessor.refused("type", repr(kind))
        count, size, dtype = accessor.integer("count", least=1), _TYPES[kind], _component(accessor)
        if "bufferView" in accessor:
            values = self._strided(accessor, count, size, dtype, stride=True)
        elif count * size * dtype.itemsize > _MOST_ZEROS:
            raise accessor.refused("count", f"at most {_MOST_ZEROS // size // dtype.itemsize:,} without a bufferView")
        else:
            values = np.zeros((count, size), dtype)
        sparse = accessor.child("sparse")
        return values if sparse is None else self._substituted(sparse, values)

    def _substituted(self, sparse: Item, values: np.ndarray) -> np.ndarray:
        count = sparse.integer("count", least=1)
        if count > len(values):
            raise sparse.refused("count", f"at most the accessor's {len(values)}")
        where, what = sparse.child("indices"), sparse.child("values")
        if where is None or what is None:
            raise sparse.refused("indices" if where is None else "values", "an object")
        dtype = _component(where)
        if dtype.kind != "u":
            raise where.refused("componentType", "5121, 5123 or 5125 (unsigned integers)")
        places = self._strided(where, count, 1, dtype, stride=False)[:, 0].astype(np.int64)
        if (np.diff(places) <= 0).any():
            raise GltfError(f"{where.where}: got places that do not rise, expected each once and in order")
        if places[-1] >= len(values):
            raise GltfError(f"{where.where}: got index {places[-1]}, expected indices below {len(values)}")
        values = values.copy()
        values[places] = self._strided(what, count, values.shape[1], values.dtype, stride=False)
        return values

    def _strided(self, item: Item, count: int, size: int, dtype: np.dtype, stride: bool) -> np.ndarray:
        index = self._document.index(item, "bufferView", "bufferViews")
        view = self._document.item("bufferViews", index)
        content = self._content(index, view)
        element = size * dtype.itemsize
        step = view.integer("byteStride", element, least=1) if stride else element
        if step < element:
            raise view.refused("byteStride", f"at least {element}, the size of an element")
        start = item.integer("byteOffset", 0)
        end = start + (count - 1) * step + element
        if end > len(content):
            raise GltfError(f"{item.where}: got {end:,} bytes, expected at most the {len(content):,} of {view.where}")
        return np.ndarray((count, size), dtype, content, start, (step, dtype.itemsize))

    def _content(self, index: int, view: Item) -> memoryview:
        for name in MESHOPT:
            packed = view.extension(name)
            if packed is not None:
                if index not in self._decompressed:
                    self._decompressed[index] = self._unpacked(packed, name)
                return self._decompressed[index].data
        return self._document.slice(view)

    def _unpacked(self, packed: Item, name: str) -> np.ndarray:
        content = self._document.slice(packed)
        count, step = packed.integer("count", least=1), packed.integer("byteStride", least=1)
        mode, filter_ = packed.text("mode"), packed.text("filter") or "NONE"
        if mode not in _MODES:
            raise packed.refused("mode", f"one of {', '.join(_MODES)}")
        if filter_ not in _FILTERS:
            raise packed.refused("filter", f"one of {', '.join(_FILTERS)}")
        if count * step > _MOST_COMPRESSED * len(content):
            raise packed.refused("count", f"fewer elements than {len(content):,} compressed bytes can hold")
        try:
            import meshopt
        except ImportError:
            raise GltfError(
                f"{packed.where}: got compressed data, expected the package meshopt to read it with: "
                "pip install 'warpopt[meshopt]'"
            ) from None
        try:
            unpacked = meshopt.decode_gltf_buffer(bytes(content), count, step, mode, filter_)
        except Exception:  # broken data can raise anything
            raise GltfError(f"{packed.where}: got data that cannot be decompressed, expected {name}") from None
        return np.ascontiguousarray(unpacked).view(np.uint8).reshape(-1)


def real(values: np.ndarray, accessor: Item) -> np.ndarray:
    """An accessor's values as numbers, integers normalised if it is marked so."""
    if values.dtype.kind == "f" or not accessor.flag("normalized", False):
        return values if values.dtype.kind == "f" else values.astype(float)
    # The lowest signed integer has no positive counterpart; like the next one, it means -1.
    return np.maximum(values / np.iinfo(values.dtype).max, -1)


def _component(item: Item) -> np.dtype:
    kind = item.integer("componentType")
    if kind not in _COMPONENTS:
        raise item.refused("componentType", f"one of {', '.join(map(str, _COMPONENTS))}")
    return np.dtype(_COMPONENTS[kind])

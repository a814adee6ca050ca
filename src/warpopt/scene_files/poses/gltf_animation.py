"""The path of a glTF file's camera under one of its animations."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..gltf_accessors import Accessors
from ..gltf_camera import GltfCamera, camera_of
from ..gltf_document import Document
from ..gltf_item import GltfError, Item, told_of

_KINDS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
MOST = 100_000


def read_gltf_path(path: Path, camera: int | str, animation: int | str, rate: float) -> list[GltfCamera]:
    """The camera at times 1/rate apart, from the animation's first key to its last.

    Args:
        path: a `.gltf` or `.glb` file of version 2.
        camera: as for `read_gltf_camera`.
        animation: its name or number.
        rate: frames a second.

    Raises:
        ValueError: one sentence: a broken file, no such animation, or one that moves no node.
        OSError: a file that cannot be read.
    """
    with told_of(path):
        document = Document(path)
        channels = _channels(document, animation)
        first = min(channel.times[0] for channel in channels)
        last = max(channel.times[-1] for channel in channels)
        count = int(np.floor((last - first) * rate * (1 + 1e-9))) + 1
        if count > MOST:
            raise GltfError(f"got {count:,} frames at {rate:g} a second, expected at most {MOST:,}")
        found = []
        for time in first + np.arange(count) / rate:
            for channel in channels:
                channel.pose(time)
            found.append(camera_of(document, camera))
    return found


class _Channel:
    """One property of one node over time."""

    def __init__(self, node: dict[str, Any], key: str, times: np.ndarray, values: np.ndarray, kind: str, where: str):
        self.node, self.key, self.times, self.values, self.kind = node, key, times, values, kind
        if key == "rotation":
            keys = values.reshape(len(times), -1, 4)
            if not (np.linalg.norm(keys[:, keys.shape[1] // 2], axis=1) > 0).all():
                raise GltfError(f"{where}: got a rotation of length 0, expected unit quaternions")

    def pose(self, time: float) -> None:
        """Put the node where it is at that time."""
        self.node[self.key] = self._at(float(np.clip(time, self.times[0], self.times[-1]))).tolist()

    def _at(self, time: float) -> np.ndarray:
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(len(self.times) - 2, 0)))
        values = self.values
        if self.kind == "CUBICSPLINE":
            return self._spline(i, time, values.reshape(len(self.times), 3, -1))
        if len(self.times) == 1 or time >= self.times[-1]:
            return values[-1]
        if self.kind == "STEP":
            return values[i]
        if self.key == "rotation":
            pair = Slerp(self.times[i : i + 2], Rotation.from_quat(values[i : i + 2]))
            return pair(time).as_quat()
        share = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        return (1 - share) * values[i] + share * values[i + 1]

    def _spline(self, i: int, time: float, values: np.ndarray) -> np.ndarray:
        """glTF 2.0, Appendix C: keys are (in-tangent, value, out-tangent), tangents over a second."""
        if len(self.times) == 1:
            made = values[0, 1]
        else:
            span = self.times[i + 1] - self.times[i]
            t = (time - self.times[i]) / span
            made = (
                (2 * t**3 - 3 * t**2 + 1) * values[i, 1] + span * (t**3 - 2 * t**2 + t) * values[i, 2]
                + (3 * t**2 - 2 * t**3) * values[i + 1, 1] + span * (t**3 - t**2) * values[i + 1, 0]
            )  # fmt: skip
        return made / np.linalg.norm(made) if self.key == "rotation" else made


def _channels(document: Document, which: int | str) -> list[_Channel]:
    count = document.count("animations")
    items = [document.item("animations", i) for i in range(count)]
    if isinstance(which, int):
        chosen = [items[which]] if 0 <= which < count else []
    else:
        chosen = [item for item in items if item.text("name") == which]
    if len(chosen) != 1:
        told = ", ".join(repr(item.text("name")) for item in items[:10]) or "none"
        raise GltfError(f"got {len(chosen)} animations {which!r} of {count} ({told}), expected one")
    (animation,) = chosen
    accessors, samplers = Accessors(document), animation.children("samplers", "sampler")
    made = []
    for channel in animation.children("channels", "channel"):
        target = channel.required("target")
        key = target.text("path")
        if key == "weights" or "node" not in target:
            continue
        if key not in _KINDS:
            raise target.refused("path", "translation, rotation, scale or weights")
        index = channel.integer("sampler")
        if index >= len(samplers):
            raise channel.refused("sampler", f"one of {len(samplers)}")
        node = document.item("nodes", document.index(target, "node", "nodes"))
        if "matrix" in node:
            raise GltfError(f"{node.where}: got matrix and an animation, expected translation, rotation and scale")
        made.append(_channel(accessors, samplers[index], node.data, key))
    if not made:
        raise GltfError(f"{animation.where}: got no channel that moves a node, expected one")
    return made


def _channel(accessors: Accessors, sampler: Item, node: dict[str, Any], key: str) -> _Channel:
    kind = sampler.text("interpolation") or "LINEAR"
    if kind not in _INTERPOLATIONS:
        raise sampler.refused("interpolation", ", ".join(_INTERPOLATIONS))
    times = accessors.floats(sampler, "input", "SCALAR")[:, 0].astype(float)
    values = accessors.floats(sampler, "output", _KINDS[key]).astype(float)
    keys = len(times) * (3 if kind == "CUBICSPLINE" else 1)
    if len(values) != keys:
        raise GltfError(f"{sampler.where}: got {len(values)} values for {len(times)} times, expected {keys}")
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise GltfError(f"{sampler.where}: got times that do not increase, expected seconds that do")
    if not np.isfinite(values).all():
        raise GltfError(f"{sampler.where}: got a value that is not finite, expected finite numbers")
    return _Channel(node, key, times, values, kind, sampler.where)

"""Meshes and cameras of glTF files: trimesh reads the meshes, the cameras are read from the file's own JSON.

trimesh drops a camera's near and far planes and the transforms of its parent nodes, so it is asked for neither.
"""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from .scene_camera import SceneCamera, centred_window, unit

_GLB_MAGIC = b"glTF"
_JSON_CHUNK = 0x4E4F534A  # "JSON"


def read_triangles(path: Path) -> np.ndarray:
    """All triangles of a `.gltf` or `.glb` file in world space, (N, 3, 3), its nodes' transforms applied.

    Raises:
        ValueError: for what is no such file, one without a triangle, or vertices that are not finite.
        OSError: for a file that cannot be read.
    """
    data, binary = _parts(path)
    try:
        import trimesh
    except ImportError:
        raise ValueError(
            f"{path}: got a glTF file, expected the package trimesh to read it with: pip install 'warpopt[scene]'"
        ) from None
    parts = []
    try:
        # trimesh loses what hangs on a node with a camera.
        for node in data.get("nodes", []):
            node.pop("camera", None)
        file = io.BytesIO(_packed(data, binary))
        resolver = trimesh.resolvers.FilePathResolver(str(path))
        scene = trimesh.load_scene(file, file_type="glb" if binary is not None else "gltf", resolver=resolver)
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            geometry = scene.geometry[name]
            if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
                corners = np.asarray(geometry.vertices, float)[np.asarray(geometry.faces)]
                parts.append(corners @ transform[:3, :3].T + transform[:3, 3])
    except Exception as error:  # whatever a broken file makes the loader stumble over
        raise ValueError(f"{path}: cannot be read as glTF: {type(error).__name__}: {error}") from None
    if not parts:
        raise ValueError(f"{path}: got no triangle, expected a node with a mesh of triangles")
    triangles = np.concatenate(parts)
    if not np.isfinite(triangles).all():
        raise ValueError(f"{path}: got vertices that are NaN or infinite, expected finite ones")
    return triangles


def read_camera(path: Path, index: int, aspect: float | None, far: float | None) -> SceneCamera:
    """A perspective camera of the file.

    Args:
        path: a `.gltf` or `.glb` file.
        index: of the camera among the nodes that have one, in the scene's order.
        aspect, far: for a camera that leaves them open, as glTF allows; `far` overrides the file's.

    Raises:
        ValueError: for a file without this camera, or one that is not a complete perspective.
        OSError: for a file that cannot be read.
    """
    data, _ = _parts(path)
    try:
        found = _camera_nodes(data)
        if index >= len(found):
            raise ValueError(
                f"{path}: got {len(found)} camera(s), expected one of index {index}, or a [camera] section"
            )
        which, world = found[index]
        lens = data["cameras"][which]
        if lens.get("type") != "perspective":
            raise ValueError(f"{path}: camera {index}: got type {lens.get('type')!r}, expected 'perspective'")
        lens = lens["perspective"]
        near, half_fov = float(lens["znear"]), float(lens["yfov"]) / 2
        far = far or lens.get("zfar")
        aspect = lens.get("aspectRatio") or aspect
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"{path}: got a broken camera or node ({type(error).__name__}: {error})") from None
    if far is None:
        raise ValueError(f"{path}: camera {index}: got no zfar, expected receivers.gltf.far beside it")
    if not (0 < near < far < np.inf and 0 < half_fov < np.pi / 2):
        raise ValueError(
            f"{path}: camera {index}: got znear {near:g}, zfar {far:g}, yfov {2 * half_fov:g}; expected "
            "0 < znear < zfar and 0 < yfov < pi"
        )
    # glTF: a camera looks along -z of its node, whose scale does not count.
    if not np.isfinite(world).all() or abs(np.linalg.det(world)) < 1e-30:
        raise ValueError(f"{path}: camera {index}: got a singular node transform, expected an invertible one")
    right, up, back = (unit(world[:3, i]) for i in range(3))
    rotation = np.stack([right, up, -back])
    return SceneCamera(world[:3, 3], rotation, near, float(far), centred_window(half_fov, aspect or 1.0))


def _parts(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """The JSON of a glTF file, and for `.glb` the chunks after it.

    Raises:
        ValueError: for what is neither `.gltf` nor `.glb`.
        OSError: for a file that cannot be read.
    """
    raw, binary = path.read_bytes(), None
    try:
        if raw[:4] == _GLB_MAGIC:
            (length,) = struct.unpack("<I", raw[12:16])
            raw, binary = raw[20 : 20 + length], raw[20 + length :]
        data = json.loads(raw)
    except (ValueError, struct.error):
        data = None
    if not isinstance(data, dict) or not isinstance(data.get("asset"), dict):
        raise ValueError(f"{path}: got a file that is not glTF, expected .gltf or .glb of version 2")
    return data, binary


def _packed(data: dict[str, Any], binary: bytes | None) -> bytes:
    """The inverse of `_parts`."""
    text = json.dumps(data).encode()
    if binary is None:
        return text
    text += b" " * (-len(text) % 4)
    head = _GLB_MAGIC + struct.pack("<IIII", 2, 20 + len(text) + len(binary), len(text), _JSON_CHUNK)
    return head + text + binary


def _camera_nodes(data: dict[str, Any]) -> list[tuple[int, np.ndarray]]:
    """(camera, node to world) of the default scene's nodes with a camera, depth first."""
    nodes = data.get("nodes", [])
    scenes = data.get("scenes", [])
    roots = scenes[data.get("scene", 0)].get("nodes", []) if scenes else range(len(nodes))
    found, seen = [], set()
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        index, parent = stack.pop()
        if index in seen:  # a broken file may go in circles
            continue
        seen.add(index)
        node = nodes[index]
        world = parent @ _local(node)
        if "camera" in node:
            found.append((node["camera"], world))
        stack += [(child, world) for child in reversed(node.get("children", []))]
    return found


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.reshape(np.array(node["matrix"], float), (4, 4)).T
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), float)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix

"""glTF files: their visible triangles, cameras and directional lights.

Everything that moves a vertex is applied or refused: accessors of all kinds, node transforms, skins in the file's
pose, morph targets at their default weights, and the extensions in `gltf_extensions`. Textures are not read; of
materials, only the name and whether it is masked.
"""

from collections.abc import Sequence
from pathlib import Path

from .gltf_camera import GltfCamera, camera_of, light_of
from .gltf_document import Document
from .gltf_geometry import GltfGeometry, GltfReport, geometry_of
from .gltf_item import told_of

__all__ = ["GltfCamera", "GltfGeometry", "GltfReport", "read_geometry", "read_gltf_camera", "read_light"]


def read_geometry(
    path: Path, *, include: Sequence[str] = (), exclude: Sequence[str] = (), most_triangles: int = 50_000_000
) -> GltfGeometry:
    """All triangles of the default scene in world space, and a report of what was left out.

    Args:
        path: a `.gltf` or `.glb` file of version 2.
        include, exclude: patterns such as "Sky*" for the names of nodes (with all nodes below them) and of materials,
            not case-sensitive. Matches of `exclude` are left out; with `include`, only matches are read.
        most_triangles: maximum number, at 72 bytes each, counting every instance.

    Raises:
        ValueError: one sentence that names the file, the node and the reason.
        OSError: a file that cannot be read.
    """
    with told_of(path):
        return geometry_of(Document(path), tuple(include), tuple(exclude), most_triangles)


def read_gltf_camera(path: Path, which: int | str = 0) -> GltfCamera:
    """A camera of the default scene.

    Args:
        path: a `.gltf` or `.glb` file of version 2.
        which: the name of the camera or its node, or an index among the nodes with a camera, depth first.

    Raises:
        ValueError: one sentence, for a file without this camera, or a broken one.
        OSError: a file that cannot be read.
    """
    with told_of(path):
        return camera_of(Document(path), which)


def read_light(path: Path, which: int | str | None = None) -> tuple[float, float, float]:
    """The world direction of a directional light of the default scene, of length 1.

    Args:
        path: a `.gltf` or `.glb` file of version 2.
        which: the name of the light or its node, or an index; optional if there is only one.

    Raises:
        ValueError: one sentence, for a file without this light.
        OSError: a file that cannot be read.
    """
    with told_of(path):
        return light_of(Document(path), which)

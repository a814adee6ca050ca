"""Cameras and directional lights of a glTF file, in world space."""

import dataclasses

import numpy as np

from .gltf_document import Document
from .gltf_extensions import check_extensions
from .gltf_item import GltfError, Item
from .gltf_nodes import Node, Nodes
from .scene_camera import SceneCamera, centred_window, unit

_SHEAR = 1e-4  # allows for single precision in a chain of nodes


@dataclasses.dataclass(frozen=True, eq=False)
class GltfCamera:
    """A camera of a file.

    Attributes:
        name: the node's, otherwise the camera's; for messages.
        kind: "perspective" or "orthographic".
        position, rotation: as in `SceneCamera`.
        near, far: of the planes; `far` is inf for a perspective without one.
        half_fov: half the vertical field of view, in radians; None if orthographic.
        aspect: width over height; None if the file does not give it.
        half_size: half the width and height of an orthographic view; None if perspective.
    """

    name: str
    kind: str
    position: np.ndarray
    rotation: np.ndarray
    near: float
    far: float
    half_fov: float | None
    aspect: float | None
    half_size: tuple[float, float] | None

    def scene_camera(self, default_aspect: float, far: float | None = None) -> SceneCamera:
        """The camera for the rasteriser, whose `far` may be inf, with another far plane if given.

        Parallel rays have no eye: an orthographic camera whose near plane passes through its position is moved back by
        its depth.
        """
        if self.half_fov is None:
            assert self.half_size is not None  # of an orthographic one
            right, top = self.half_size
            back = 0.0 if self.near > 0 else self.far
            far = far or self.far
            position, window = self.position - back * self.rotation[2], (-right, right, -top, top)
            return SceneCamera(position, self.rotation, self.near + back, far + back, window, True)
        window = centred_window(self.half_fov, self.aspect or default_aspect)
        return SceneCamera(self.position, self.rotation, self.near, far or self.far, window)


def camera_of(document: Document, which: int | str) -> GltfCamera:
    """See `gltf.read_gltf_camera`."""
    check_extensions(document)
    nodes = [node for node in Nodes(document).shown if "camera" in node.item]
    lenses = [document.item("cameras", document.index(node.item, "camera", "cameras")) for node in nodes]
    names = [(node.item.text("name"), lens.text("name")) for node, lens in zip(nodes, lenses, strict=True)]
    chosen = _chosen("camera", which, names)
    return _camera(nodes[chosen], lenses[chosen])


def light_of(document: Document, which: int | str | None) -> tuple[float, float, float]:
    """See `gltf.read_light`."""
    check_extensions(document)
    extension = document.root.extension("KHR_lights_punctual")
    lights = [] if extension is None else extension.children("lights", "light")
    nodes, names, others = [], [], 0
    for node in Nodes(document).shown:
        held = node.item.extension("KHR_lights_punctual")
        if held is None or not node.visible:
            continue
        index = held.integer("light")
        if index >= len(lights):
            raise held.refused("light", f"one of the file's {len(lights)} lights")
        if lights[index].text("type") == "directional":
            nodes.append(node)
            names.append((node.item.text("name"), lights[index].text("name")))
        else:
            others += 1
    if not nodes:
        found = f" ({others} of another type)" if others else ""
        raise GltfError(f"got no directional light{found}, expected one (KHR_lights_punctual)")
    if which is None and len(nodes) > 1:
        raise GltfError(f"got {len(nodes)} directional lights ({_told(names)}), expected one, or a choice")
    node = nodes[_chosen("directional light", 0 if which is None else which, names)]
    back = node.world[:3, 2]
    if not np.isfinite(back).all() or not back.any():
        raise GltfError(f"{node.item.where}: got a singular transform of a light, expected a direction")
    x, y, z = (float(v) + 0.0 for v in -unit(back))  # -0.0 is 0.0
    return x, y, z


def _chosen(what: str, which: int | str, names: list[tuple[str, str]]) -> int:
    if isinstance(which, int):
        if not 0 <= which < len(names):
            raise GltfError(f"got {len(names)} {what}(s), expected one of index {which}")
        return which
    found = [i for i, both in enumerate(names) if which in both]
    if len(found) != 1:
        raise GltfError(
            f"got {len(found)} {what}s named {which!r} of {len(names)} ({_told(names)}), expected one"
            + (", or an index" if found else "")
        )
    return found[0]


def _told(names: list[tuple[str, str]]) -> str:
    return ", ".join(repr(node or own) for node, own in names[:10]) or "none"


def _camera(node: Node, lens: Item) -> GltfCamera:
    kind = lens.text("type")
    if kind not in ("perspective", "orthographic"):
        raise lens.refused("type", "'perspective' or 'orthographic'")
    values = lens.child(kind)
    if values is None:
        raise lens.refused(kind, "an object")
    near, far = values.number("znear"), values.number("zfar", np.inf)
    half_fov = aspect = half_size = None
    if kind == "perspective":
        half_fov = values.number("yfov") / 2
        if not (0 < near < far and 0 < half_fov < np.pi / 2):
            raise GltfError(
                f"{lens.where}: got znear {near:g}, zfar {far:g}, yfov {2 * half_fov:g}; expected 0 < znear < zfar "
                "and 0 < yfov < pi"
            )
        if "aspectRatio" in values:
            aspect = values.number("aspectRatio")
            if aspect <= 0:
                raise values.refused("aspectRatio", "a number > 0")
    else:
        half_size = abs(values.number("xmag")), abs(values.number("ymag"))
        if not (0 <= near < far < np.inf) or 0 in half_size:
            raise GltfError(
                f"{lens.where}: got znear {near:g}, zfar {far:g}, xmag and ymag {half_size}; expected "
                "0 <= znear < zfar and sizes that are not 0"
            )
        aspect = half_size[0] / half_size[1]
    name = node.item.text("name") or lens.text("name") or node.item.where
    return GltfCamera(name, kind, node.world[:3, 3], _orientation(node), near, far, half_fov, aspect, half_size)


def _orientation(node: Node) -> np.ndarray:
    """Rows right, up and forward: a camera looks along -z of its node, whose scale is ignored."""
    turn = node.world[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt((turn * turn).sum(0))
    if not np.isfinite(node.world).all() or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise GltfError(f"{node.item.where}: got a singular transform of a camera, expected an invertible one")
    right, up, back = (unit(turn[:, i]) for i in range(3))
    shear = max(abs(right @ up), abs(up @ back), abs(back @ right))
    if shear > _SHEAR:
        raise GltfError(f"{node.item.where}: got a camera in a sheared space, expected right angles")
    # Orthonormalised to rounding; keeps the view direction and the handedness.
    up = unit(up - (up @ back) * back)
    side = np.cross(up, back)
    return np.stack([side if side @ right > 0 else -side, up, -back])

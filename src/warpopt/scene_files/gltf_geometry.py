"""All visible triangles of a glTF file in world space, and a report of what was left out."""

import dataclasses
import fnmatch

import numpy as np

from .gltf_accessors import Accessors
from .gltf_document import Document
from .gltf_extensions import check_extensions
from .gltf_item import GltfError, Item
from .gltf_nodes import Node, Nodes, instances
from .gltf_primitives import FAN, LINES, POINTS, TRIANGLES, Primitive, read_primitive, skinned, triangle_count


@dataclasses.dataclass(frozen=True)
class GltfReport:
    """What was read and left out of a file. Names are those of nodes or materials.

    Attributes:
        triangles: their number.
        points, lines: number of such primitives, which are left out.
        without_position: number of primitives without positions, which are left out.
        hidden: nodes with a mesh that are not visible in the file.
        excluded: nodes and materials that the caller left out.
        masked, blended: materials with holes or transparency, whose triangles count as opaque.
        unmatched: patterns that match no node and no material.
        unknown_extensions: extensions used, but not required, and not known here.
    """

    triangles: int
    points: int = 0
    lines: int = 0
    without_position: int = 0
    hidden: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()
    masked: tuple[str, ...] = ()
    blended: tuple[str, ...] = ()
    unmatched: tuple[str, ...] = ()
    unknown_extensions: tuple[str, ...] = ()

    def notes(self) -> tuple[str, ...]:
        """Sentences about everything that may surprise a user."""
        found = [
            (self.points, f"{_counted(self.points, 'primitive')} of points left out"),
            (self.lines, f"{_counted(self.lines, 'primitive')} of lines left out"),
            (self.without_position, f"{_counted(self.without_position, 'primitive')} without POSITION left out"),
            (self.hidden, f"not visible in the file and left out: {_listed(self.hidden)}"),
            (self.excluded, f"excluded: {_listed(self.excluded)}"),
            (self.masked, f"alpha-masked, counted as opaque: {_listed(self.masked)}"),
            (self.blended, f"alpha-blended, counted as opaque: {_listed(self.blended)}"),
            (self.unmatched, f"no node or material is named like {_listed(self.unmatched)}"),
            (self.unknown_extensions, f"extensions not known and ignored: {_listed(self.unknown_extensions)}"),
        ]
        return tuple(sentence for there, sentence in found if there)


@dataclasses.dataclass(frozen=True, eq=False)
class GltfGeometry:
    """Triangles (N, 3, 3) in world space, and the report."""

    triangles: np.ndarray
    report: GltfReport


def geometry_of(
    document: Document, include: tuple[str, ...], exclude: tuple[str, ...], most_triangles: int
) -> GltfGeometry:
    """See `gltf.read_geometry`.

    Raises:
        GltfError: names the error.
    """
    return _Collection(document, include, exclude, most_triangles).geometry()


class _Collection:
    def __init__(self, document: Document, include: tuple[str, ...], exclude: tuple[str, ...], most_triangles: int):
        self._document, self._most = document, most_triangles
        self._include, self._exclude = include, exclude
        self._unknown = check_extensions(document)
        self._accessors = Accessors(document)
        self._primitives: dict[tuple, Primitive] = {}
        self._skins: dict[int, np.ndarray] = {}
        self._parts: list[np.ndarray] = []
        self._promised = 0
        self._points = self._lines = self._bare = 0
        # Dictionaries keep order without duplicates.
        self._hidden, self._excluded, self._masked, self._blended, self._matched = ({} for _ in range(5))

    def geometry(self) -> GltfGeometry:
        self._nodes = Nodes(self._document)
        for node in self._nodes.shown:
            if "mesh" in node.item:
                self._add_node(node)
        triangles = self._parts[0] if len(self._parts) == 1 else np.concatenate([np.zeros((0, 3, 3)), *self._parts])
        report = GltfReport(
            len(triangles), self._points, self._lines, self._bare, tuple(self._hidden), tuple(self._excluded),
            tuple(self._masked), tuple(self._blended),
            tuple(p for p in dict.fromkeys((*self._include, *self._exclude)) if p not in self._matched), self._unknown,
        )  # fmt: skip
        if not len(triangles):
            notes = "; ".join(report.notes())
            raise GltfError(
                "got no triangle, expected a node with a mesh of triangles" + (f" ({notes})" if notes else "")
            )
        return GltfGeometry(triangles, report)

    def _add_node(self, node: Node) -> None:
        try:
            self._add_mesh(node)
        except GltfError as error:
            # Errors in parts of the file are reported with the node that shows them.
            told = str(error)
            raise GltfError(told if told.startswith(node.item.where) else f"{node.item.where}: {told}") from None

    def _add_mesh(self, node: Node) -> None:
        index = self._document.index(node.item, "mesh", "meshes")
        mesh = self._document.item("meshes", index)
        if not node.visible:
            self._hidden[_name(node.item)] = True
            return
        weights = node.item if "weights" in node.item else mesh
        if "weights" in weights and not isinstance(weights.data["weights"], list):
            raise weights.refused("weights", "a list of numbers")
        weights = weights.numbers("weights", [], len(weights.data.get("weights", [])))
        skin = None
        if "skin" in node.item:
            skin = self._skin(self._document.index(node.item, "skin", "skins"))
        repeated = instances(node.item, self._accessors)
        if skin is not None and repeated is not None:
            raise GltfError(f"{node.item.where}: got instances of a mesh on a skin, expected one or the other")
        with np.errstate(over="ignore", invalid="ignore"):
            places = node.world[None] if repeated is None else node.world @ repeated
        for number, primitive in enumerate(mesh.children("primitives", "primitive")):
            if self._wanted(node, primitive):
                self._add(primitive, (index, number), weights, skin, places)

    def _wanted(self, node: Node, primitive: Item) -> bool:
        """Whether a primitive has triangles and is not left out; counts those that have none."""
        attributes = primitive.child("attributes")
        mode = primitive.integer("mode", TRIANGLES)
        if mode > FAN:
            raise primitive.refused("mode", "0 to 6")
        material = self._document.refers(primitive, "material", "materials")
        names = [] if not (self._include or self._exclude) else node.names()
        if material is not None:
            names.append(material.text("name"))
        included = self._like(names, self._include) if self._include else True
        if not included or self._like(names, self._exclude):
            self._excluded[_name(node.item)] = True
            return False
        if attributes is None or "POSITION" not in attributes:
            self._bare += 1
        elif mode == POINTS:
            self._points += 1
        elif mode in LINES:
            self._lines += 1
        else:
            alpha = "" if material is None else material.text("alphaMode")
            if alpha in ("MASK", "BLEND"):
                assert material is not None  # it has a mode
                (self._masked if alpha == "MASK" else self._blended)[_name(material)] = True
            return True
        return False

    def _like(self, names: list[str], patterns: tuple[str, ...]) -> bool:
        # Test all patterns, so that matches are recorded for each.
        hits = [p for p in patterns if any(fnmatch.fnmatchcase(n.lower(), p.lower()) for n in names if n)]
        self._matched.update(dict.fromkeys(hits, True))
        return bool(hits)

    def _add(self, item: Item, key: tuple, weights: np.ndarray, skin: np.ndarray | None, places: np.ndarray) -> None:
        self._promised += triangle_count(item, self._accessors) * len(places)
        if self._promised > self._most:
            raise GltfError(f"got {self._promised:,} triangles and more, expected at most {self._most:,}")
        key = (*key, *weights)
        with np.errstate(over="ignore", invalid="ignore"):
            if key not in self._primitives:
                self._primitives[key] = read_primitive(item, weights, self._document, self._accessors)
            primitive = self._primitives[key]
            if skin is not None:
                world = skinned(primitive, skin, item.where)[None]
            else:
                vertices = primitive.vertices.astype(float)
                # Not `@`: a multithreaded BLAS takes ten times as long for such a small matrix.
                world = np.einsum("kij,vj->kvi", places[:, :3, :3], vertices) + places[:, None, :3, 3]
        corners = world.take(primitive.triangles, axis=1).reshape(-1, 3, 3)
        # Transform all vertices first, as they are fewer; vertices without a triangle may have any value.
        if not np.isfinite(world).all() and not np.isfinite(corners).all():
            raise GltfError(f"{item.where}: got vertices that are NaN or infinite, expected finite ones")
        self._parts.append(corners)

    def _skin(self, index: int) -> np.ndarray:
        """(J, 4, 4), mesh space to world for each joint."""
        if index not in self._skins:
            skin = self._document.item("skins", index)
            joints = self._document.indices(skin, "joints", "nodes")
            if not joints:
                raise skin.refused("joints", "a list of nodes")
            worlds = np.stack([self._nodes.worlds[joint] for joint in joints])
            if "inverseBindMatrices" in skin:
                inverse = self._accessors.floats(skin, "inverseBindMatrices", "MAT4")
                if len(inverse) < len(joints):
                    raise GltfError(f"{skin.where}: got {len(inverse)} inverseBindMatrices, expected {len(joints)}")
                inverse = inverse[: len(joints)].astype(float).reshape(-1, 4, 4).swapaxes(1, 2)
                if not (np.abs(inverse[:, 3] - [0, 0, 0, 1]) < 1e-6).all():
                    raise GltfError(f"{skin.where}: got inverseBindMatrices that are not affine, expected affine ones")
                with np.errstate(over="ignore", invalid="ignore"):
                    worlds = worlds @ inverse
            self._skins[index] = worlds
        return self._skins[index]


def _name(item: Item) -> str:
    name = item.data.get("name")
    return name if isinstance(name, str) and name else item.where


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("s" if count > 1 else "")


def _listed(names: tuple[str, ...]) -> str:
    shown = ", ".join(repr(name) for name in names[:5])
    return shown + (f" and {len(names) - 5} more" if len(names) > 5 else "")

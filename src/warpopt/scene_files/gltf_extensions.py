"""glTF extensions that are read, that do not affect triangle positions, or that are refused.

Based on the registry of KhronosGroup/glTF: ratified, multi-vendor and vendor extensions.
"""

from .gltf_document import Document
from .gltf_item import GltfError

READ = frozenset(
    {
        "EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_lights_punctual",
        "KHR_mesh_quantization", "KHR_meshopt_compression", "KHR_node_visibility",
    }
)  # fmt: skip

# Appearance, sound, metadata, other forms of the same triangles: a file may require them and is still drawn the same.
_HARMLESS_STARTS = (
    "ADOBE_materials_", "EXT_lights_", "EXT_materials_", "EXT_texture_", "KHR_audio", "KHR_lights_", "KHR_materials_",
    "KHR_texture_", "MSFT_packing_", "MSFT_texture_", "OMI_audio", "OMI_physics",
)  # fmt: skip
_HARMLESS = frozenset(
    {
        "CESIUM_primitive_outline", "CESIUM_tile_edges", "EXT_feature_metadata", "EXT_instance_features",
        "EXT_mesh_features", "EXT_mesh_manifold", "EXT_mesh_primitive_edge_visibility", "EXT_mesh_primitive_restart",
        "EXT_structural_metadata", "FB_geometry_metadata", "FB_ngon_encoding", "GODOT_single_root",
        "KHR_animation_pointer", "KHR_implicit_shapes", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_physics_rigid_bodies", "KHR_xmp", "KHR_xmp_json_ld", "MSFT_lod", "VRMC_materials_mtoon",
    }
)  # fmt: skip

# They move or create geometry, so a file that uses them cannot be drawn correctly without them.
_MOVING = {
    "AGI_articulations": "its articulations move nodes",
    "CESIUM_RTC": "its positions are relative to a centre",
    "KHR_blend": "its positions may be blended",
    "KHR_materials_displacement": "its surfaces are displaced",
    "KHR_techniques_webgl": "its vertex shaders may move what they draw",
    "KHR_visibility": "a draft that KHR_node_visibility replaced",
    "MPEG_accessor_timed": "its positions are a stream",
    "MPEG_buffer_circular": "its positions are a stream",
    "MPEG_mesh_linking": "its meshes move with others",
    "MPEG_scene_dynamic": "its scene is a stream",
    "WEB3D_quantized_attributes": "its positions are decoded by a matrix",
}


def check_extensions(document: Document) -> tuple[str, ...]:
    """Names of used extensions that are not required and not known here.

    Raises:
        GltfError: a required extension is unknown, or one moves vertices in an unsupported way.
    """
    required = document.root.texts("extensionsRequired")
    used = sorted({*required, *document.root.texts("extensionsUsed")})
    for name in used:
        if name in _MOVING:
            raise GltfError(f"got extension {name!r}, which is not read ({_MOVING[name]}), expected a file without it")
    unknown = [n for n in used if n not in READ and n not in _HARMLESS and not n.startswith(_HARMLESS_STARTS)]
    for name in unknown:
        if name in required:
            raise GltfError(f"got extensionsRequired {name!r}, which is not read, expected a file without it")
    return tuple(unknown)

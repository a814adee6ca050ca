"""Paths of cameras: from a table of poses, or from a glTF file's animation."""

from .gltf_animation import read_gltf_path
from .pose_table import read_poses

__all__ = ["read_gltf_path", "read_poses"]

"""AT09 as pure functions and small frozen modules: view frustum, camera, light, the light's frame, warps, errors."""

from .aliasing import (
    aggregate,
    aliasing_error,
    aliasing_error_uz,
    errors,
    local_aliasing_error,
    projection_factors,
    screen_coordinates,
    texture_coordinates,
)
from .camera import Camera, DirectionalLight
from .far_limit import far_limit
from .light_frame import LightFrame
from .light_space import LightDepth, LightSpace
from .texel import KERNELS, edge_offset, larger_error, lean, longest_edge, offset_across
from .view_frustum import ViewFrustum
from .warp import Extent, Warp

__all__ = [
    "KERNELS",
    "Camera",
    "DirectionalLight",
    "Extent",
    "LightDepth",
    "LightFrame",
    "LightSpace",
    "ViewFrustum",
    "Warp",
    "aggregate",
    "aliasing_error",
    "aliasing_error_uz",
    "edge_offset",
    "errors",
    "far_limit",
    "larger_error",
    "lean",
    "local_aliasing_error",
    "longest_edge",
    "offset_across",
    "projection_factors",
    "screen_coordinates",
    "texture_coordinates",
]

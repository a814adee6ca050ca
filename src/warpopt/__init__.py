"""warpopt: optimal perspective warps for shadow maps.

The names are loaded on first use, so that the command line can answer and refuse without waiting for JAX.
"""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOME = {
    "rules": "",
    "Comparison": "compare.comparison",
    "compare_rules": "compare.comparison",
    "compare_scene_rules": "compare.scene_comparison",
    "ConvexBody": "receivers.convex_body",
    "DepthBuffer": "receivers.depth_buffer",
    "DepthHistogram": "receivers.depth_histogram",
    "PointReceivers": "receivers.points",
    "WholeFrustum": "receivers.view_frustum",
    "ClipSpace": "render.shadow_matrix",
    "shadow_matrix": "render.shadow_matrix",
    "texel_snap": "render.shadow_matrix",
    "limit": "solve.limit",
    "Solution": "solve.optimal_warp",
    "compare_warps": "solve.optimal_warp",
    "error_norm": "solve.optimal_warp",
    "optimal_warp": "solve.optimal_warp",
    "Outcome": "solve.outcome",
    "scene_limit": "solve.scene_limit",
    "scene_limit_map": "table.limit_map",
    "SceneSolution": "solve.scene_warp",
    "scene_error_norm": "solve.scene_warp",
    "scene_warp": "solve.scene_warp",
    "LambdaTable": "table.lambda_table",
    "LimitMap": "table.limit_map",
    "build_table": "table.build",
    "limit_map": "table.limit_map",
    "aliasing_error": "theory.aliasing",
    "aliasing_error_uz": "theory.aliasing",
    "local_aliasing_error": "theory.aliasing",
    "projection_factors": "theory.aliasing",
    "screen_coordinates": "theory.aliasing",
    "texture_coordinates": "theory.aliasing",
    "Camera": "theory.camera",
    "DirectionalLight": "theory.camera",
    "Metric": "theory.error_norm",
    "ViewFrustum": "theory.frustum",
    "LightFrame": "theory.light_frame",
    "LightSpace": "theory.light_space",
    "Warp": "theory.warp",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from . import rules
    from .compare.comparison import Comparison, compare_rules
    from .compare.scene_comparison import compare_scene_rules
    from .receivers.convex_body import ConvexBody
    from .receivers.depth_buffer import DepthBuffer
    from .receivers.depth_histogram import DepthHistogram
    from .receivers.points import PointReceivers
    from .receivers.view_frustum import WholeFrustum
    from .render.shadow_matrix import ClipSpace, shadow_matrix, texel_snap
    from .solve.limit import limit
    from .solve.optimal_warp import Solution, compare_warps, error_norm, optimal_warp
    from .solve.outcome import Outcome
    from .solve.scene_limit import scene_limit
    from .solve.scene_warp import SceneSolution, scene_error_norm, scene_warp
    from .table.build import build_table
    from .table.lambda_table import LambdaTable
    from .table.limit_map import LimitMap, limit_map, scene_limit_map
    from .theory.aliasing import (
        aliasing_error,
        aliasing_error_uz,
        local_aliasing_error,
        projection_factors,
        screen_coordinates,
        texture_coordinates,
    )
    from .theory.camera import Camera, DirectionalLight
    from .theory.error_norm import Metric
    from .theory.frustum import ViewFrustum
    from .theory.light_frame import LightFrame
    from .theory.light_space import LightSpace
    from .theory.warp import Warp


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'warpopt' has no attribute {name!r}")
    if name == "rules":
        return importlib.import_module(".rules", __name__)
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

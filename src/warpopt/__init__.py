"""warpopt: optimal perspective warps for shadow maps.

The names are loaded on first use, so that the command line can print help and errors without waiting for JAX.
"""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOME = {
    "receivers": "",
    "rules": "",
    "stable": "",
    "theory": "",
    "lower_bound": "bound.lower_bound",
    "lower_bound_map": "bound.lower_bound",
    "BoundMap": "bound.map",
    "compare_rules": "compare.compare_rules",
    "export_closed_form": "export.sources",
    "export_source": "export.sources",
    "Metric": "objective",
    "Objective": "objective",
    "edge_weights": "render.edge_weights",
    "RenderedMap": "render.edge_weights",
    "ClipSpace": "render.shadow_matrix",
    "shadow_matrix": "render.shadow_matrix",
    "error_norm": "solve.optimal_warp",
    "optimal_warp": "solve.optimal_warp",
    "Outcome": "solve.outcome",
    "SceneSolution": "solve.solution",
    "Solution": "solve.solution",
    "StableWindow": "stable.window",
    "build_table": "table.build.build_table",
    "LambdaTable": "table.lambda_table",
    "Camera": "theory.camera",
    "DirectionalLight": "theory.camera",
    "ViewFrustum": "theory.view_frustum",
    "Warp": "theory.warp",
    "FrustumView": "views",
    "SceneView": "views",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from . import receivers, rules, stable, theory
    from .bound.lower_bound import lower_bound, lower_bound_map
    from .bound.map import BoundMap
    from .compare.compare_rules import compare_rules
    from .export.sources import export_closed_form, export_source
    from .objective import Metric, Objective
    from .render.edge_weights import RenderedMap, edge_weights
    from .render.shadow_matrix import ClipSpace, shadow_matrix
    from .solve.optimal_warp import error_norm, optimal_warp
    from .solve.outcome import Outcome
    from .solve.solution import SceneSolution, Solution
    from .stable.window import StableWindow
    from .table.build.build_table import build_table
    from .table.lambda_table import LambdaTable
    from .theory.camera import Camera, DirectionalLight
    from .theory.view_frustum import ViewFrustum
    from .theory.warp import Warp
    from .views import FrustumView, SceneView


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'warpopt' has no attribute {name!r}")
    if not _HOME[name]:
        return importlib.import_module(f".{name}", __name__)
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

"""warpopt: optimal perspective warps for shadow maps."""

from . import rules
from .solve.optimal_warp import Solution, error_norm, optimal_warp
from .solve.outcome import Outcome
from .theory.aliasing import (
    aliasing_error,
    aliasing_error_uz,
    local_aliasing_error,
    projection_factors,
    screen_coordinates,
    texture_coordinates,
)
from .theory.error_norm import Metric
from .theory.frustum import ViewFrustum
from .theory.light_space import LightSpace
from .theory.warp import Warp

__all__ = [
    "LightSpace",
    "Metric",
    "Outcome",
    "Solution",
    "ViewFrustum",
    "Warp",
    "aliasing_error",
    "aliasing_error_uz",
    "error_norm",
    "local_aliasing_error",
    "optimal_warp",
    "projection_factors",
    "rules",
    "screen_coordinates",
    "texture_coordinates",
]

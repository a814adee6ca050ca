"""Receivers: one kind per file, behind the base class `Receivers`."""

from .bodies.convex_body import ConvexBody
from .bodies.ground_plane import GroundPlane
from .bodies.whole_frustum import WholeFrustum
from .depth_buffer import DepthBuffer
from .depth_histogram import DepthHistogram
from .footprint import Footprint
from .points import PointReceivers
from .receivers import Receivers
from .weighted.weights import EdgeWeights

__all__ = [
    "ConvexBody",
    "DepthBuffer",
    "DepthHistogram",
    "EdgeWeights",
    "Footprint",
    "GroundPlane",
    "PointReceivers",
    "Receivers",
    "WholeFrustum",
]

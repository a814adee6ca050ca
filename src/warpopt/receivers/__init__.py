"""Receivers: one kind per file, behind the base class `Receivers`."""

from .convex_body import ConvexBody
from .depth_buffer import DepthBuffer
from .depth_histogram import DepthHistogram
from .footprint import Footprint
from .points import PointReceivers
from .receivers import Receivers
from .weighted.weights import EdgeWeights
from .whole_frustum import WholeFrustum

__all__ = [
    "ConvexBody",
    "DepthBuffer",
    "DepthHistogram",
    "EdgeWeights",
    "Footprint",
    "PointReceivers",
    "Receivers",
    "WholeFrustum",
]

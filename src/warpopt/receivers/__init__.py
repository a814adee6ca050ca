"""Receivers: one kind per file, behind the base class `Receivers`."""

from .convex_body import ConvexBody
from .depth_buffer import DepthBuffer
from .depth_histogram import DepthHistogram
from .footprint import Footprint
from .points import PointReceivers
from .receivers import Receivers
from .whole_frustum import WholeFrustum

__all__ = [
    "ConvexBody",
    "DepthBuffer",
    "DepthHistogram",
    "Footprint",
    "PointReceivers",
    "Receivers",
    "WholeFrustum",
]

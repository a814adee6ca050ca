"""Lower bounds, and the map that attains one."""

from .map import BoundMap as BoundMap

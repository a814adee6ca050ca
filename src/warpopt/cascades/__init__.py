"""Several maps, split by view depth: where to split, each map's warp, and how far from the best a choice is."""

from . import splits as splits
from .counts import count
from .plan import Plan, errors, plan
from .spheres import sphere_texels

__all__ = ["Plan", "count", "errors", "plan", "sphere_texels"]

"""Scenes from a seed, in NumPy alone: hills with trees, a city of boxes, a forest, a corridor with columns."""

from .scenes import KINDS, MadeScene, made_scene

__all__ = ["KINDS", "MadeScene", "made_scene"]

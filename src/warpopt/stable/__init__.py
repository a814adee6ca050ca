"""Maps that stay where they are in the world while the camera moves: a warp with a margin, scrolled by whole texels."""

from .state import WindowState
from .update import Action, Reason, Update
from .window import StableWindow

__all__ = ["Action", "Reason", "StableWindow", "Update", "WindowState"]

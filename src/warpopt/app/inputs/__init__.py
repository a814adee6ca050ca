"""The scene inputs of commands: settings, files as numbers, and values for the library.

A separate package: every command over a scene uses it, and `common` does not handle scene files. `read_settings` reads
a scene's settings, `read_scene` its files, `scene_values.views_of` makes views of them; each raises a `ConfigError`.
"""

from ..common.settings import ConfigError
from .scene_files import SceneInput, read_scene
from .scene_settings import SceneSettings, read_settings

__all__ = ["ConfigError", "SceneInput", "SceneSettings", "read_scene", "read_settings"]

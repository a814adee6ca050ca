"""The arguments of `warpopt scene`."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax


@dataclasses.dataclass(frozen=True)
class Scene(Configured):
    """Solve a scene: cameras, lights and receivers; writes matrices, tables and error maps."""

    @staticmethod
    def model() -> Any:
        from .settings import SceneConfig

        return SceneConfig

    def answer(self, overrides: list[str]) -> int:
        from ..inputs.scene_files import read_scene
        from .casters import caster_shape

        config = self.read(overrides)
        scene = read_scene(config, self.config.parent)
        casters = caster_shape(config.casters, config, scene, self.config.parent)
        prepare_jax()
        from .run import run_scene

        return run_scene(config, scene, casters)

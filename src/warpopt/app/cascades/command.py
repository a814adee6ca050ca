"""The arguments of `warpopt cascades`."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax
from ..common.output import check_replaceable


@dataclasses.dataclass(frozen=True)
class Cascades(Configured):
    """Split a frustum or a scene into several maps: the best splits beside published and engines' ones."""

    @staticmethod
    def model() -> Any:
        from .settings import CascadesConfig, SceneCascadesConfig

        return CascadesConfig | SceneCascadesConfig

    def answer(self, overrides: list[str]) -> int:
        from ..inputs.scene_files import read_scene
        from .settings import SceneCascadesConfig, read_cascades_config

        config = read_cascades_config(self.config, overrides)
        check_replaceable(config.output.directory)
        scene = read_scene(config, self.config.parent) if isinstance(config, SceneCascadesConfig) else None
        prepare_jax()
        from .run import run_cascades

        return run_cascades(config, scene)

"""The arguments of `warpopt compare`."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax
from ..common.output import check_replaceable


@dataclasses.dataclass(frozen=True)
class Compare(Configured):
    """Compare rules (published, engines', yours) with the optimum and the limit, over a frustum or a scene."""

    @staticmethod
    def model() -> Any:
        from .settings import CompareConfig, SceneCompareConfig

        return CompareConfig | SceneCompareConfig

    def answer(self, overrides: list[str]) -> int:
        from ..inputs.scene_files import read_scene
        from .own_rules import check_modules, own_rules
        from .settings import SceneCompareConfig, read_compare_config

        config, folder = read_compare_config(self.config, overrides), self.config.parent
        check_replaceable(config.output.directory)
        check_modules(config.rules, folder)
        scene = read_scene(config, folder) if isinstance(config, SceneCompareConfig) else None
        prepare_jax()
        own = own_rules(config.rules, folder)
        from .run import run_compare

        return run_compare(config, own, scene)

"""The arguments of `warpopt frames`."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax


@dataclasses.dataclass(frozen=True)
class Frames(Configured):
    """Render frames with the shadows of each warp, and count the pixels that are wrong; needs the extra `frames`."""

    @staticmethod
    def model() -> Any:
        from .settings import FramesConfig

        return FramesConfig

    def answer(self, overrides: list[str]) -> int:
        from ..inputs.scene_files import read_scene
        from .settings import check_casts, check_ray_caster

        config = self.read(overrides)
        check_ray_caster()
        scene = read_scene(config, self.config.parent, images=False)
        check_casts(scene)
        prepare_jax()
        from .run import run_frames

        return run_frames(config, scene)

"""Several shadow maps of one frame, each for a range of view depths, read as one."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..scene_files.scene_camera import SceneCamera
from .seen import Frame
from .shadow_map import Reading, ShadowMap, blurred


@dataclasses.dataclass(frozen=True, eq=False)
class CascadedMap:
    """Shadow maps from the nearest to the farthest; a receiver reads the one that holds its view depth.

    Args:
        camera: whose view depths are meant.
        maps: of one scene; None for a cascade that holds nothing and needs no map.
        ends: the view depth at which each ends; a receiver at an end is the nearer one's, one beyond all the last's.

    Raises:
        ValueError: not as many ends as maps, ends that fall, or no map at all.
    """

    camera: SceneCamera
    maps: tuple[ShadowMap | None, ...]
    ends: tuple[float, ...]

    def __post_init__(self):
        if len(self.ends) != len(self.maps) or not (np.diff(self.ends) >= 0).all():
            raise ValueError(f"ends: got {self.ends}, expected {len(self.maps)} non-decreasing depths")
        if not any(self.maps):
            raise ValueError("maps: got none, expected at least one that holds a receiver")

    def which(self, frame: Frame) -> Int[np.ndarray, " P"]:
        """The map that each judged receiver reads."""
        scene = next(each.scene for each in self.maps if each is not None)
        points = scene.world(np.column_stack([frame.places, frame.heights]))
        depth = self.camera.to_eye(points)[:, 2]
        there = np.array([k for k, each in enumerate(self.maps) if each is not None])
        # Depths are computed anew: rounding must not send a receiver to a cascade without a map.
        return there[np.minimum(np.searchsorted(np.array(self.ends)[there], depth), len(there) - 1)]

    def visibility(
        self, frame: Frame, reading: Reading, shift: Float[np.ndarray, "P 2"] | None = None
    ) -> Float[np.ndarray, " P"]:
        """The lit share that each judged pixel reads, as `ShadowMap.visibility`; shifts are in each map's texels."""
        if reading.blurs:
            return blurred(frame, self.visibility(frame, reading.sharp, shift), reading)
        which, shown = self.which(frame), np.empty(len(frame.places))
        for k, each in enumerate(self.maps):
            mine = which == k
            if each is not None and mine.any():
                shown[mine] = each.visibility(frame.only(mine), reading, None if shift is None else shift[mine])
        return shown

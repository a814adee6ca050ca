"""Light directions of a scene: one, a list, or the sun over a day; duplicates are merged."""

import dataclasses

import numpy as np

from ...scene_files.scene_camera import unit
from .scene_settings import SceneLight, SunPath


@dataclasses.dataclass(frozen=True)
class Step:
    """One step of a light's path.

    Attributes:
        index: of the step.
        hour: solar time, for the sun.
        elevation_deg: of the sun above the horizon.
        light: index among the distinct directions; None below the horizon.
    """

    index: int
    hour: float | None
    elevation_deg: float | None
    light: int | None


def light_path(light: SceneLight, handedness: str) -> tuple[list[Step], list[tuple[float, float, float]]]:
    """(the steps, the distinct directions in which the light travels, in the order of their first use).

    Directions that differ only in length are equal.
    """
    if isinstance(light.path, SunPath):
        hours, elevations, directions = _sun(light.path, handedness)
    else:
        directions = [light.direction] if light.path is None else light.path
        hours = elevations = [None] * len(directions)
    known: dict[tuple[float, ...], int] = {}
    steps, distinct = [], []
    for index, (hour, elevation, direction) in enumerate(zip(hours, elevations, directions, strict=True)):
        which = None
        if direction is not None:
            scaled = np.asarray(direction, float)
            key = tuple((scaled / np.abs(scaled).max() + 0.0).tolist())  # -0.0 is 0.0
            which = known.setdefault(key, len(known))
            if which == len(distinct):
                distinct.append(tuple((unit(scaled) + 0.0).tolist()))
        steps.append(Step(index, hour, elevation, which))
    return steps, distinct


def _sun(path: SunPath, handedness: str) -> tuple[list, list, list]:
    """Hours, elevations in degrees, and directions; None where the sun is not above the horizon."""
    latitude, declination = np.deg2rad(path.latitude_deg), np.deg2rad(path.declination())
    hours = np.linspace(path.start_hour, path.stop_hour, path.count)
    angle = np.deg2rad(15 * (hours - 12))
    east = -np.cos(declination) * np.sin(angle)
    north = np.cos(latitude) * np.sin(declination) - np.sin(latitude) * np.cos(declination) * np.cos(angle)
    high = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * np.cos(declination) * np.cos(angle)
    up_axis = unit(np.array(path.up))
    north_axis = np.array(path.north) - up_axis * (np.array(path.north) @ up_axis)
    north_axis = unit(north_axis)
    east_axis = np.cross(north_axis, up_axis) * (1 if handedness == "right" else -1)
    to_sun = east[:, None] * east_axis + north[:, None] * north_axis + high[:, None] * up_axis
    # At the horizon up to rounding counts as below.
    directions = [tuple(-v) if h > 1e-9 else None for v, h in zip(to_sun, high, strict=True)]
    elevations = np.rad2deg(np.arcsin(np.clip(high, -1, 1)))
    return hours.tolist(), elevations.tolist(), directions

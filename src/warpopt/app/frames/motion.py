"""A path of `warpopt frames`: each method's static error and false flicker, and a corner of its picture in motion."""

import dataclasses
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from warpopt.frames import LitScene, judge, see
from warpopt.frames.methods import method_of, method_title, refitted
from warpopt.frames.names import WINDOW
from warpopt.frames.paths import Moment, flips
from warpopt.frames.pictures import enlarged, painted, worst_places, wrong_pixels

from ...scene_files.scene_camera import SceneCamera
from .settings import FramesConfig

_ENLARGED = 3


@dataclasses.dataclass
class Course:
    """What one method adds up over a path."""

    wrong: list[float]
    flipped: int = 0
    compared: int = 0
    pops: list[float] = dataclasses.field(default_factory=list)  # the share of points that each refit flips


def measured_path(
    config: FramesConfig, triangles: np.ndarray, steps: list[tuple[SceneCamera, np.ndarray]], folder: Path,
    progress: Callable[[str], None],
) -> dict[str, Any]:  # fmt: skip
    """A row for each method, and the names of the animations that were written into the folder."""
    asked, frames, reading = config.frames.path, config.frames, config.frames.reading()
    assert asked is not None  # only called with a path
    width, height = frames.screen
    texels = frames.shadow_map[0]
    methods = {name: method_of(name, texels) for name in asked.methods}
    courses = {name: Course([]) for name in asked.methods}
    previous: dict[str, Moment] = {}
    strips: dict[str, list[np.ndarray]] = {name: [] for name in asked.methods}
    place, scene, last = None, None, None
    for number, (each, sun) in enumerate(steps):
        if scene is None or last is None or not np.array_equal(sun, last):
            scene, last = LitScene(triangles, sun), sun
        frame = see(scene, each, height, width)
        if not frame.judged.any():
            continue
        shown = {}
        for name, method in methods.items():
            moment = Moment(scene, frame, method(number, scene, frame))
            shown[name] = moment.shadow_map.visibility(frame, reading)
            courses[name].wrong.append(judge(frame, shown[name]).wrong)
            if name in previous:
                flipped, compared = flips(previous[name], moment, reading)
                courses[name].flipped += flipped
                courses[name].compared += compared
                if refitted(method):
                    courses[name].pops.append(flipped / max(1, compared))
            previous[name] = moment
        if place is None:
            size = max(height // 3, 8)
            wrong = np.sum([wrong_pixels(frame, one) for one in shown.values()], 0)
            ((top, left), *_) = worst_places(wrong, (size, size), 1)
            place = slice(top, top + size), slice(left, left + size)
        for name, one in shown.items():
            strips[name].append(painted(scene, frame, one, mark=False)[place])
        progress(f"path, frame {number + 1} of {len(steps)}")
    files = []
    for name in methods if config.output.figures else ():
        (folder / f"path_{name}.gif").write_bytes(animation(strips[name], asked.rate))
        files.append((f"path_{name}.gif", f"A corner of the picture in motion: {method_title(name)}."))
    rows = [
        {
            "method": name, "static": float(np.nanmean(course.wrong)) if course.wrong else None,
            "flicker": course.flipped / course.compared if course.compared else None,
            "frames": len(course.wrong), "compared": course.compared,
            "refits": len(course.pops) if name.startswith(WINDOW) else None,
            "worst_pop": max(course.pops) if course.pops else None,
        }
        for name, course in courses.items()
    ]  # fmt: skip
    return {"rows": rows, "files": [name for name, _ in files], "pictures": files}


def animation(strip: list[np.ndarray], rate: float) -> bytes:
    """An animated GIF at the path's own speed, or 50 frames a second, the most that viewers show."""
    images = [Image.fromarray((enlarged(one, _ENLARGED).clip(0, 1) * 255).round().astype(np.uint8)) for one in strip]
    content = io.BytesIO()
    pause = max(20, 10 * round(100 / rate))  # in hundredths of a second
    images[0].save(content, "GIF", save_all=True, append_images=images[1:], duration=pause, loop=0)
    return content.getvalue()

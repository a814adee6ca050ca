"""A CSV file of camera poses."""

import csv
import dataclasses
from pathlib import Path

import numpy as np

from ..scene_camera import SceneCamera, orientation

_PLACE = ("x", "y", "z")
_FORWARD = ("forward_x", "forward_y", "forward_z")
_UP = ("up_x", "up_y", "up_z")
MOST = 100_000


def read_poses(path: Path, lens: SceneCamera, handedness: str) -> list[SceneCamera]:
    """A camera for each row, of the lens's planes and window.

    Args:
        path: with a line of heads: x, y, z; forward_x, forward_y, forward_z, the direction of view; and, if the camera
            rolls, up_x, up_y, up_z. Others, such as a time, are not read.
        lens: near, far and window; and up where the file has none.
        handedness: of the world's axes.

    Raises:
        ValueError: one sentence that names the file, the line and what is wrong.
        OSError: a file that cannot be read.

    Example:
        >>> import tempfile
        >>> from ..scene_camera import centred_window
        >>> lens = SceneCamera(np.zeros(3), orientation(np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), "right"), 0.1,
        ...     50.0, centred_window(0.4, 1.0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = Path(folder) / "walk.csv"
        ...     _ = file.write_text("x,y,z,forward_x,forward_y,forward_z\\n0,2,0,0,0,-1\\n1,2,0,1,0,-1\\n")
        ...     [camera.position.tolist() for camera in read_poses(file, lens, "right")]
        [[0.0, 2.0, 0.0], [1.0, 2.0, 0.0]]
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        try:
            rows = list(csv.DictReader(file, restkey="more"))
        except (csv.Error, UnicodeDecodeError) as error:
            raise ValueError(f"{path}: cannot be read as CSV: {error}") from None
    heads = list(rows[0]) if rows else []
    missing = [head for head in (*_PLACE, *_FORWARD) if head not in heads]
    if not rows or missing:
        what = f"no {missing[0]}" if rows else "no row"
        raise ValueError(f"{path}: got {what}, expected columns {', '.join((*_PLACE, *_FORWARD))} and a row for a pose")
    if len(rows) > MOST:
        raise ValueError(f"{path}: got {len(rows):,} poses, expected at most {MOST:,}")
    return [_camera(path, line, row, lens, handedness) for line, row in enumerate(rows, start=2)]


def _camera(path: Path, line: int, row: dict[str, str], lens: SceneCamera, handedness: str) -> SceneCamera:
    def vector(heads: tuple[str, ...]) -> np.ndarray:
        try:
            made = np.array([float(row[head]) for head in heads])
        except (TypeError, ValueError):
            made = np.full(3, np.nan)
        if not np.isfinite(made).all():
            got = ", ".join(repr(row[head]) for head in heads)
            raise ValueError(f"{path}, line {line}: got {got} for {', '.join(heads)}, expected finite numbers")
        return made

    place, forward = vector(_PLACE), vector(_FORWARD)
    up = vector(_UP) if all(head in row for head in _UP) else np.asarray(lens.rotation[1])
    if not forward.any():
        raise ValueError(f"{path}, line {line}: got a forward of length 0, expected a direction")
    try:
        turn = orientation(forward, up, handedness)
    except ValueError:
        raise ValueError(f"{path}, line {line}: got an up that is parallel to forward, expected another") from None
    return dataclasses.replace(lens, position=place, rotation=turn)

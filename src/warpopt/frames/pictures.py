"""Pictures of frames as arrays of colours: shaded, with a map's shadows and where they are wrong."""

import numpy as np
from jaxtyping import Bool, Float

from .light_rays import LitScene
from .seen import Frame
from .shadow_map import ShadowMap

FALSE = (0.84, 0.15, 0.12)
"""Colour of false shadow."""
MISSING = (0.05, 0.38, 0.85)
"""Colour of missing shadow."""
_SKY, _SHADE, _SUN = np.array([0.80, 0.87, 0.93]), np.array([0.27, 0.29, 0.36]), np.array([1.0, 0.96, 0.88])
_LEAST = 0.42  # brightness of a surface that the light grazes


def painted(
    scene: LitScene, frame: Frame, shown: Float[np.ndarray, " P"], mark: bool = True
) -> Float[np.ndarray, "H W 3"]:
    """The frame in the light of a map: shading in it, and colour where it is wrong.

    Args:
        scene, frame: as they were read.
        shown: (P,) lit share of each judged pixel; `frame.lit` gives the truth.
        mark: paint false shadow red and missing shadow blue.

    Example:
        >>> import numpy as np
        >>> from warpopt.frames import LitScene, see
        >>> from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation
        >>> floor = np.array([[[-9, 0, -9], [-9, 0, 9], [9, 0, 9]]], float)
        >>> turn = orientation(np.array([0, -1.0, 0]), np.array([0, 0, -1.0]), "right")
        >>> scene = LitScene(floor, np.array([0, -1.0, 0]))
        >>> frame = see(scene, SceneCamera(np.array([0, 4.0, 0]), turn, 0.1, 50.0, centred_window(0.4, 1.0)), 4, 4)
        >>> painted(scene, frame, np.zeros(len(frame.lit))).shape   # all that is seen is in false shadow: red
        (4, 4, 3)
    """
    height, width = frame.judged.shape
    image = np.broadcast_to(_SKY, (height, width, 3)).copy()
    image[np.isfinite(frame.depth)] = _SHADE
    cosine = -scene.normals[frame.triangles, 2]
    sun = _SUN * (_LEAST + (1 - _LEAST) * cosine[:, None])
    share = np.asarray(shown, float)[:, None]
    ambient = _SHADE * (1 + 0.25 * cosine[:, None])
    image[frame.judged] = share * sun + (1 - share) * ambient
    if mark:
        says = np.asarray(shown) >= 0.5
        image[frame.image(frame.lit & ~says, False)] = FALSE
        image[frame.image(~frame.lit & says, False)] = MISSING
    return image


def wrong_pixels(frame: Frame, shown: Float[np.ndarray, " P"]) -> Bool[np.ndarray, "H W"]:
    """Judged pixels whose verdict is not the truth."""
    return frame.image((np.asarray(shown) >= 0.5) != frame.lit, False)


def worst_places(wrong: Float[np.ndarray, "H W"], size: tuple[int, int], count: int) -> list[tuple[int, int]]:
    """(row, column) of the upper left corners of windows with the most wrong pixels, not overlapping.

    Args:
        wrong: counts at each pixel; summed over warps, all warps are shown at the same place.
        size: (rows, columns) of a window.
        count: at most so many windows.
    """
    rows, columns = (min(one, whole) for one, whole in zip(size, wrong.shape, strict=True))
    # Sums over windows by their upper left corner, exactly: integral images.
    table = np.pad(wrong.astype(float).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    sums = table[rows:, columns:] - table[:-rows, columns:] - table[rows:, :-columns] + table[:-rows, :-columns]
    found = []
    for _ in range(count):
        row, column = (int(i) for i in np.unravel_index(sums.argmax(), sums.shape))
        if sums[row, column] <= 0 and found:
            break
        found.append((row, column))
        sums[max(row - rows + 1, 0) : row + rows, max(column - columns + 1, 0) : column + columns] = -1
    return found


def map_picture(shadow_map: ShadowMap, side: int) -> Float[np.ndarray, "side side"]:
    """The map's depth at side x side places, s upwards, 0 nearest to the light and 1 farthest; NaN where it is empty.

    At most the map's own texels: a larger map is sampled.
    """
    columns, rows = np.minimum(side, shadow_map.size).astype(int).tolist()
    t, s = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows)[::-1] + 0.5) / rows)
    first, _ = shadow_map.scene.first_hits(shadow_map.place(np.stack([t.ravel(), s.ravel()], 1)))
    hit = np.isfinite(first)
    least, most = (first[hit].min(), first[hit].max()) if hit.any() else (0.0, 1.0)
    return np.where(hit, (first - least) / ((most - least) or 1.0), np.nan).reshape(rows, columns)


def enlarged(image: Float[np.ndarray, "h w 3"], times: int) -> Float[np.ndarray, "H W 3"]:
    """Each pixel as a square."""
    return image.repeat(times, 0).repeat(times, 1)

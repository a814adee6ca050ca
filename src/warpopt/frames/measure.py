"""How wrong a shadow map's picture is: misread pixels, and how many the size of its texels predicts."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from .cascaded_map import CascadedMap
from .seen import Frame
from .shadow_map import Reading, ShadowMap, screen_steps

GROUPS = 8
"""Groups of pixels whose grids are shifted independently; interleaved, so that each samples the whole frame."""
BLUR_SHIFTS = 4
"""Shifts of whole frames for filters that read neighbouring pixels."""
FAR_PIXELS = 2.5
"""Beyond this distance from the true edge a wrong pixel is not the edge's roughness but another shadow."""


@dataclasses.dataclass(frozen=True, eq=False)
class Verdict:
    """The error of one frame under one map. Shares are of the judged pixels; NaN where the truth has no edge.

    Attributes:
        wrong: share whose verdict differs from the truth: `false` and `missing` together.
        false: lit in truth, in shadow by the map.
        missing: in shadow in truth, lit by the map.
        filtered: mean difference of the lit share from the truth, equal to `wrong` for "nearest".
        far: share that is wrong and more than `FAR_PIXELS` from the true edge.
        shown: (P,) the lit share that each judged pixel read.
    """

    wrong: float
    false: float
    missing: float
    filtered: float
    far: float
    shown: Float[np.ndarray, " P"]


def shifts(frame: Frame, seed: int, groups: int = GROUPS) -> Float[np.ndarray, "P 2"]:
    """For each judged pixel the shift of the map's grid, in texels: one for each group, evenly spread.

    What a frame loses depends on where texels happen to lie: one grid makes neighbouring warps differ by 10 %.
    """
    rows, columns = np.nonzero(frame.judged)
    return _even_shifts(seed, groups)[(columns + 3 * rows) % groups]


def _even_shifts(seed: int, count: int) -> np.ndarray:
    """(count, 2) in [0, 1): one in each row and each column of a grid, so that few represent all."""
    random = np.random.default_rng(seed)
    return np.stack([(random.permutation(count) + random.random(count)) / count for _ in range(2)], 1)


def judge(frame: Frame, shown: Float[np.ndarray, " P"]) -> Verdict:
    """The error of what the judged pixels read.

    Args:
        frame: with its truth.
        shown: lit shares, as `ShadowMap.visibility` gives them.

    Returns:
        A `Verdict`; of NaN where the frame has no lit or no shadowed pixel.

    Raises:
        ValueError: not one number for each judged pixel.
    """
    if shown.shape != frame.lit.shape:
        raise ValueError(f"shown: got shape {shown.shape}, expected {frame.lit.shape}, one for each judged pixel")
    if not frame.defined:
        none = float("nan")
        return Verdict(none, none, none, none, none, shown)
    says_lit = shown >= 0.5
    false, missing = frame.lit & ~says_lit, ~frame.lit & says_lit
    far = (false | missing) & (frame.edge_distance[frame.judged] > FAR_PIXELS)
    return Verdict(
        float((false | missing).mean()), float(false.mean()), float(missing.mean()),
        float(np.abs(shown - frame.lit).mean()), float(far.mean()), shown,
    )  # fmt: skip


def measured(
    frame: Frame,
    shadow_map: ShadowMap | CascadedMap,
    reading: Reading | None = None,
    seed: int = 0,
    groups: int = GROUPS,
) -> Verdict:
    """The error of a frame under a map, over grid shifts; `groups` = 1 reads the map as it lies.

    Args:
        frame, shadow_map: of the same scene.
        reading: filter and bias; nearest with one texel of slope by default.
        seed: of the shifts.
        groups: see `shifts`.

    Returns:
        A `Verdict`, as `judge`; `shown` is of one shift for filters that blur.
    """
    reading = reading or Reading()
    if groups > 1 and reading.blurs:
        # Interleaved groups would be blurred with each other: whole frames, one for each shift.
        each = [np.broadcast_to(shift, frame.places.shape) for shift in _even_shifts(seed, BLUR_SHIFTS)]
        made = [judge(frame, shadow_map.visibility(frame, reading, shift)) for shift in each]

        def mean(name: str) -> float:
            return float(np.mean([getattr(one, name) for one in made]))

        return Verdict(mean("wrong"), mean("false"), mean("missing"), mean("filtered"), mean("far"), made[0].shown)
    shift = shifts(frame, seed, groups) if groups > 1 else None
    return judge(frame, shadow_map.visibility(frame, reading, shift))


def texel_footprints(frame: Frame, shadow_map: ShadowMap) -> Float[np.ndarray, "P 2 2"]:
    """d(column, row)/d(texel) on each receiver: the edges of its texel on the screen, in pixels, the last index's t, s.

    By differences through the matrix's own projection, on the receivers' planes: perspective and projection error.

    Args:
        frame, shadow_map: of the same scene.

    Returns:
        (P, 2, 2), a texel's edge in each column.
    """
    steps = screen_steps(shadow_map, frame, shadow_map.texture(frame.places))
    return np.linalg.inv(steps * shadow_map.size[:, None])


def predicted_wrong(frame: Frame, shadow_map: ShadowMap) -> float:
    """The number of wrong pixels that edge length times offset predicts.

    A texel that is a parallelogram on the screen, with extents a and b across an edge, moves the edge by |u a + v b|, u
    and v uniform in [-1/2, 1/2]: in the mean max/4 + min^2/(12 max) of |a|, |b|. Its length is the total variation of
    the truth, from differences over three pixels, with edges at silhouettes counted like the others.

    Args:
        frame, shadow_map: of the same scene.

    Returns:
        Judged pixels, not a share.
    """
    lit = frame.image(frame.lit.astype(float), 0.0)
    whole = ndimage.minimum_filter(frame.judged.astype(np.uint8), 3).astype(bool)
    # Differences of a mean over three rows (columns): their length is that of a smooth edge to 5 %, in any direction.
    weights = np.array([1.0, 2.0, 1.0]) / 4
    across = ndimage.correlate1d(ndimage.correlate1d(lit, np.array([-0.5, 0, 0.5]), 1), weights, 0)
    down = ndimage.correlate1d(ndimage.correlate1d(lit, np.array([-0.5, 0, 0.5]), 0), weights, 1)
    size = np.where(whole, np.hypot(across, down), 0)
    on = size > 0
    normal = np.stack([across[on], down[on]], 1) / size[on][:, None]
    feet = texel_footprints(frame, shadow_map)[on[frame.judged]]
    extents = np.abs(np.einsum("ij,ijk->ik", normal, feet))
    most, least = extents.max(1), extents.min(1)
    offset = most / 4 + least**2 / (12 * np.where(most > 0, most, 1))
    # Edges beside pixels that are not judged have no such difference: as many in proportion as there are elsewhere.
    edges = frame.true_edges
    return float((size[on] * offset).sum() * edges.sum() / max(1, (edges & whole).sum()))

"""Code for cascades of a whole frustum: where to split it, and the optimal warp in each map.

Equal ratios, in the form of `cascades.splits.even_in_the_logarithm`; with bands those of docs/cascades.md. The pieces
are similar about the eye, so that the closed form of `closed_form` serves each.
"""

from .closed_form import closed_form
from .languages import Language
from .program import HOW_TO, Function, Program, text_of

_MOST = 16  # cascades, as in `cascades.splits`
# Shading languages have no log1p: log(1 + x) over what 1 + x was rounded to, so that its rounding does not count.
_LOG_OF_ONE_AND = """
float sum = 1.0f + x;
float rest = sum - 1.0f;
float found = x;
if (rest != 0.0f) { found = log(sum) * (x / rest); }
return found;
"""
# notation: band = log(1 - overlap), as long in the logarithm as each band; whole and piece likewise
_SPLIT = """
float found = 0.0f;
if (z_near > 0.0f && z_far > z_near && z_far <= $LARGEST && overlap >= 0.0f && overlap < 1.0f) {
    float reach = (z_far - z_near) / z_near;
    if (reach <= $LARGEST && count >= 1.0f && count <= $MOST_MAPS && count == floor(count)) {
        float band = $log_of_one_and(0.0f - overlap);
        float whole = $log_of_one_and(reach);
        if (whole + band > 0.0f || count < 1.5f) {
            float piece = (whole - (count - 1.0f) * band) / count;
            float after = k - 1.0f;
            if (after < 0.0f) { after = 0.0f; }
            found = z_near * exp(k * piece + after * band);
            if (k <= 0.0f) { found = z_near; }
            if (k >= count) { found = z_far; }
        }
    }
}
return found;
"""
_START = """
float found = $split(z_near, z_far, count, overlap, k);
if (found > 0.0f && k > 0.0f && k < count) { found = found * (1.0f - overlap); }
return found;
"""
_SPLITS = """
int i = 0;
float k = 0.0f;
while (i <= $MOST) {
    splits[i] = $split(z_near, z_far, count, 0.0f, k);
    i = i + 1;
    k = k + 1.0f;
}
"""
_CASCADES = """
int i = 0;
float k = 0.0f;
float end = $split(z_near, z_far, count, overlap, 0.0f);
splits[0] = end;
while (i < $MOST) {
    float start = $start(z_near, z_far, count, overlap, k);
    k = k + 1.0f;
    end = $split(z_near, z_far, count, overlap, k);
    starts[i] = start;
    etas[i] = $eta(theta, start, end, half_fov);
    i = i + 1;
    splits[i] = end;
}
"""
_RANGE = ("z_near", "z_far", "count")
_NOTES = (
    "",
    "For a whole view frustum seen by 1 to 16 maps: z_near is where the nearest receiver may be, which is what matters",
    "most, and seldom the camera's near plane. Equal ratios, of which no split has a smaller largest error, for every",
    "theta, every metric, with a warp in each map and without.",
    "",
    "count and k are whole numbers. overlap, in [0, 1): each map but the first begins at (1 - overlap) of its split.",
    "Arrays have a fixed length; what lies beyond count + 1 splits is z_far, beyond count starts z_far, beyond count",
    "etas 1. All etas of one frustum are equal up to rounding; for splits of your own call eta with each map's ends.",
    "Splits and starts are 0, and etas 1, where there are no such cascades: z_near <= 0, z_far <= z_near, infinite,",
    "or 3.4e38 times z_near, count that is not 1 to 16, overlap outside of [0, 1), z_far / z_near (1 - overlap) <= 1",
    "with more than one map, NaN. An invalid theta or half_fov changes no split; etas are then 1.",
    "",
)


def splits_source(metric: str, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: `warpopt_split`, `_start`, `_splits` and `_cascades`, and the closed form of each map's warp.

    `warpopt_splits` (z_near, z_far, count, splits) fills 17 depths; `warpopt_cascades` (theta, z_near, z_far, half_fov,
    count, overlap, splits, starts, etas) 17, 16 and 16; `warpopt_eta` and `_lambda` are those of `closed_form_source`.

    Args:
        metric: "p", "q" or "pxq", of the warps; splits do not depend on it.
        language: one of `languages.LANGUAGES`.
        prefix: prefix of all names in the file.

    Raises:
        ValueError: another metric, or an invalid prefix (see `program.checked_prefix`).

    Example:
        >>> from warpopt.export.languages import C
        >>> "warpopt_splits(float z_near, float z_far, float count, float splits[17])" in splits_source("p", C)
        True
    """
    from .. import __version__

    constants, warp = closed_form(metric)
    whole = ("theta", "z_near", "z_far", "half_fov", "count", "overlap")
    functions = (
        *warp,
        Function("log_of_one_and", "log(1 + x), also for small x.", ("x",), _LOG_OF_ONE_AND),
        Function("split", "The depth at which map k - 1 ends and map k follows.", (*_RANGE, "overlap", "k"), _SPLIT),
        Function("start", "The depth at which map k begins, k from 0.", (*_RANGE, "overlap", "k"), _START),
        Function(
            "splits", "Depths from z_near to z_far at which maps meet, without overlaps.", _RANGE, _SPLITS,
            {"splits": _MOST + 1},
        ),
        Function(
            "cascades", "Where maps meet, where each begins, and each one's eta.", whole, _CASCADES,
            {"splits": _MOST + 1, "starts": _MOST, "etas": _MOST},
        ),
    )  # fmt: skip
    notes = [
        f"Cascades and their warps, warpopt {__version__}. Generated; do not edit.",
        f"Splits: exact, largest error over the whole view frustum. Warps: E_{metric}, norm inf, the closed form.",
        *_NOTES,
        *HOW_TO[1:],
    ]
    return text_of(
        Program(notes, constants | {"MOST": _MOST, "MOST_MAPS": float(_MOST)}, {}, functions), language, prefix
    )

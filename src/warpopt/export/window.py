"""Code for a map that stays where it is: the whole texels by which it moves, and the matrix there.

The arithmetic of `stable.pencil.offset_for`, in single precision: an axis at a time, an entry at a time.
"""

from .languages import Language
from .program import Function, Program, text_of

_REFIT = 1e9
_HORIZON = """
float rest = 1.0f - eta;
float last = $REFIT;
if (rest > 0.0f) { last = (1.0f - eta / 8.0f) / rest; }
return last;
"""
# notation: low and high, the offsets between which the square holds all
_UPDATE = """
float low = ceil(largest * texels + padding - texels - 0.001f);
float high = floor(least * texels - padding + 0.001f);
float limit = floor((last - 1.0f) * texels);
if (high > limit) { high = limit; }
float found = offset;
if (offset < low) { found = low + floor(ahead * (high - low) + 0.5f); }
if (offset > high) { found = high - floor(ahead * (high - low) + 0.5f); }
if (!(low <= high)) { found = $REFIT; }
return found;
"""
_ENTRY = """
return entry - 2.0f * offset / texels * w_entry;
"""
_NOTES = (
    "",
    "Fit a map to the receivers with a margin, and keep its matrix. In each frame, take the receivers' extents in the",
    "(t, s) of that very matrix, from 0 to 1 where it was fitted, and for t and for s",
    "    offset = window_update(least, largest, texels, padding, ahead, offset, last)",
    "If it is REFIT along t or s, fit a new map, with offsets of 0. Else subtract the offsets from the matrix:",
    "    first row  = window_entry(first row, last row, offset_t, texels)    and the second row with offset_s.",
    "Rows of a matrix for column vectors whose x/w and y/w go from -1 to 1; columns for row vectors. Every texel then",
    "stays where it is in the world, at every depth. While no offset changes, nothing does.",
    "",
    "last: 1e9 along t and for maps without a warp; along s window_horizon(eta), eta of the map as it was fitted.",
    "With y down (Vulkan), take s from the top of the map, or pass the extents and the offset with the other sign.",
    "In single precision keep offsets within a few maps: beyond, fit the same map anew there, with offsets of 0.",
    "padding: texels that are to stay free at each edge. ahead: the share of the free texels that lies on the side to",
    "which the map moves; 0.5 for the middle. Offsets are whole numbers, exact up to 2^24.",
    "When to fit anew for the error alone is the engine's choice: every so often compare with a fresh optimum.",
    "",
)


def window_source(language: Language, prefix: str = "warpopt") -> str:
    """The whole file: `warpopt_window_update`, `_horizon` and `_entry`.

    Args:
        language: one of `languages.LANGUAGES`.
        prefix: prefix of all names in the file.

    Raises:
        ValueError: an invalid prefix (see `program.checked_prefix`).

    Example:
        >>> from warpopt.export.languages import C
        >>> "static inline float warpopt_window_update(" in window_source(C)
        True
    """
    from .. import __version__

    functions = (
        Function("window_horizon", "The largest s that a map of this eta may move to.", ("eta",), _HORIZON),
        Function(
            "window_update", "Where the map is to lie along one axis, in whole texels; REFIT: nowhere holds all.",
            ("least", "largest", "texels", "padding", "ahead", "offset", "last"), _UPDATE,
        ),
        Function(
            "window_entry", "An entry of the matrix's first or second row, moved by whole texels.",
            ("entry", "w_entry", "offset", "texels"), _ENTRY,
        ),
    )  # fmt: skip
    notes = [f"A shadow map that stays where it is, warpopt {__version__}. Generated; do not edit.", *_NOTES]
    return text_of(Program(notes, {"REFIT": _REFIT}, {}, functions), language, prefix)

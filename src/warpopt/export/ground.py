"""Code for the optimal map of level ground: direction, eta and matrix from a camera's height, pitch and the sun.

(T61) of docs/theory.md in single precision (`theory.ground`), with the free lateral fit of (T62), which is closed
there: the chord at depth z is proportional to z, so the map's sides are straight.
"""

from typing import Literal, get_args

from .._words import one_of
from .languages import Language
from .program import Function, Program, text_of

GroundMetric = Literal["p", "pxq", "storage"]

_CAMERA = ("height", "pitch", "z_near", "z_far", "half_fov")
_SUN = ("sun_x", "sun_y", "sun_z")
# The lower edge of the screen; the upper one where it is below the horizon.
_NEAREST = """
float low = sin(pitch + half_fov);
float nearest = z_far;
if (low > 0.0f && height > 0.0f) { nearest = height * cos(half_fov) / low; }
if (nearest < z_near) { nearest = z_near; }
if (!(nearest < z_far)) { nearest = z_far; }
return nearest;
"""
_FARTHEST = """
float high = sin(pitch - half_fov);
float farthest = z_far;
if (high > 0.0f && height > 0.0f) { farthest = height * cos(half_fov) / high; }
if (!(farthest < z_far)) { farthest = z_far; }
return farthest;
"""
_ETA = """
float first = $nearest(height, pitch, z_near, z_far, half_fov);
float last = $farthest(height, pitch, z_near, z_far, half_fov);
float eta = 1.0f;
if (sun_y < 0.0f && cos(pitch) > 0.0f && first > 0.0f && last > first) {
    eta = POWER;
}
return eta;
"""
_POWERS = {"p": "sqrt(first / last)", "storage": "sqrt(first / last)", "pxq": "exp(log(first / last) * (2.0f / 3.0f))"}
# W's axis is across the sun and the screen's horizontal: (0, -sun_z, sun_y).
_DIRECTION = """
float length = sqrt(sun_y * sun_y + sun_z * sun_z);
float found = 0.0f;
if (length > 0.0f) {
    if (axis > 0.5f && axis < 1.5f) { found = 0.0f - sun_z / length; }
    if (axis > 1.5f) { found = sun_y / length; }
}
return found;
"""
# notation: a, b, c the sun's direction of unit length; q that of (b, c); d and x along W's axes from the eye
_MATRIX = """
float largest = abs(sun_x);
if (abs(sun_y) > largest) { largest = abs(sun_y); }
if (abs(sun_z) > largest) { largest = abs(sun_z); }
float size = 0.0f;
if (largest > 0.0f) {
    size = largest * sqrt(sun_x / largest * (sun_x / largest) + sun_y / largest * (sun_y / largest)
        + sun_z / largest * (sun_z / largest));
}
float span = caster_height + relief;
if (!(span > 0.0f)) { span = 1.0f; }
float first = $nearest(height, pitch, z_near, z_far, half_fov);
float last = $farthest(height, pitch, z_near, z_far, half_fov);
float eta = $eta(height, pitch, z_near, z_far, half_fov, sun_x, sun_y, sun_z);
float found = 0.0f;
if (sun_y < 0.0f && cos(pitch) > 0.0f && first > 0.0f && last > first && size > 0.0f) {
    float a = sun_x / size;
    float b = sun_y / size;
    float c = sun_z / size;
    float q = sqrt(b * b + c * c);
    float ahead = (height * sin(pitch) - first) / cos(pitch);
    float begin = (c * height + b * ahead) / q;
    float mu = (last - first) / cos(pitch) * (0.0f - b) / q;
    float middle = a * (b * height - c * ahead) / q;
    float middle_last = middle + a * c * (last - first) / cos(pitch) / q;
    float half_last = q * last * tan(half_fov) * aspect;
    float room = half_last * (eta - first / last);
    float start = middle_last;
    if (start < middle - room) { start = middle - room; }
    if (start > middle + room) { start = middle + room; }
    float z = 0.0f;
    float x = q;
    float y = 0.0f;
    float one = 0.0f;
    if (column > 0.5f) { z = 0.0f - c / q; x = 0.0f - a * b / q; y = 1.0f; }
    if (column > 1.5f) { z = b / q; x = 0.0f - a * c / q; y = 0.0f; }
    if (column > 2.5f) {
        z = c * height / q - begin;
        x = a * b * height / q;
        y = relief;
        one = 1.0f;
    }
    float delta = z / mu;
    float blend = (1.0f - eta) * delta + eta * one;
    found = (x - start * one - (middle_last - start) * delta) / half_last;
    if (row > 0.5f) { found = 2.0f * delta - blend; }
    if (row > 1.5f) { found = blend - 2.0f * eta * y / span; }
    if (row > 2.5f) { found = blend; }
}
return found;
"""
_NOTES = (
    "World: x right, y up, z back, as seen along the camera's heading; the ground is y = 0, the eye at (0, height, 0).",
    "pitch: how far the camera looks down, in (-pi/2, pi/2); half_fov: half the vertical field of view; radians.",
    "sun: the direction in which the light travels, of any length; sun_y < 0. aspect: width over height of the screen.",
    "axis, row, column: 0, 1, 2 and 3. The matrix is for column vectors and OpenGL's clip space, z/w in [-1, 1]:",
    "ground at the far end, casters up to caster_height above it, ground down to relief below it. All entries are 0",
    "where there is nothing to map: no ground in sight, the sun below it, or a camera that looks straight down.",
    "z_far must be finite: where the ground is to end. Casters and relief of height 0 span a depth of 1.",
    "",
)


def ground_source(metric: str, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: `warpopt_nearest` and `_farthest` ground, `_eta`, `_direction` and `_matrix`, entry by entry.

    Args:
        metric: "p" and "storage" have the same warp on level ground, R^(-1/2); "pxq" has R^(-2/3).
        language: one of `languages.LANGUAGES`.
        prefix: prefix of all names in the file.

    Raises:
        ValueError: another metric, or an invalid prefix (see `program.checked_prefix`).

    Example:
        >>> from warpopt.export.languages import C
        >>> "static inline float warpopt_matrix(" in ground_source("storage", C)
        True
    """
    from .. import __version__

    one_of("metric", metric, get_args(GroundMetric))
    whole, eta = (*_CAMERA, *_SUN), _ETA.replace("POWER", _POWERS[metric])
    functions = (
        Function("nearest", "Least eye depth of the ground in sight; z_far: none is.", _CAMERA, _NEAREST),
        Function("farthest", "Largest eye depth of the ground in sight.", _CAMERA, _FARTHEST),
        Function("eta", "eta in (0, 1] of the optimal warp; 1: no warp.", whole, eta),
        Function("direction", "An entry of W's axis, the direction of the warp.", ("axis", *_SUN), _DIRECTION),
        Function(
            "matrix", "An entry of the matrix from the world to the map's clip space.",
            ("row", "column", *whole, "aspect", "caster_height", "relief"), _MATRIX,
        ),
    )  # fmt: skip
    notes = [
        f"Optimal shadow-map warp of level ground, warpopt {__version__}. Generated; do not edit.",
        f"{'E_' * (metric != 'storage')}{metric}, norm inf over the ground in sight: the exact closed form.",
        *_NOTES,
    ]
    return text_of(Program(notes, {}, {}, functions), language, prefix)

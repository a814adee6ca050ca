"""Code for the exact L-inf optimum over the whole frustum: no table, any frustum, any theta.

`solve.closed_form` in single precision, with terms simplified for each metric. All compute lambda/mu, from 0 to the
largest float (no warp); eta and lambda follow without a difference.
"""

from typing import Literal, get_args

import numpy as np

from .._words import one_of
from .languages import Language
from .program import ETA_NOTE, HOW_TO, LAMBDA_NOTE, LARGEST, NO_WARP, Function, Program, text_of

Metric = Literal["p", "q", "pxq"]

_SLOPE = """
float s = abs(sin(theta));
float t = tan(half_fov) * abs(cos(theta));
float a = s - t;
if (t > 0.5f * s && t < 2.0f * s && theta >= 0.0f && theta <= $PI) {
    float angle = theta - half_fov;
    if (theta > $HALF_PI) { angle = (($PI - theta) - half_fov) + $PI_REST; }
    float square = angle * angle;
    float series = square * (-1.0f / 6.0f + square * (1.0f / 120.0f - square / 5040.0f));
    a = (angle + angle * series) / cos(half_fov);
}
return a;
"""
# notation: s, t, a, b as T, a, b of `LightSpace`; up, down: a's positive and negative part; ratio, share: n/f and
# 1 - n/f, at whose limits, 0 and 1, the functions have theirs; mu over z_far; g, h, m over mu
_SPACE = """
float found = -1.0f;
if (z_near > 0.0f && z_far > z_near && half_fov > 0.0f && half_fov < $HALF_PI) {
    float ratio = 0.0f;
    float share = 1.0f;
    if (z_far <= $LARGEST) {
        ratio = z_near / z_far;
        share = (z_far - z_near) / z_far;
    }
    float t = tan(half_fov) * abs(cos(theta));
    float a = $upper_slope(theta, half_fov);
    float up = 0.0f;
    if (a > 0.0f) { up = a; }
    float mu = share * up + 2.0f * t;
"""
# The larger of root, g/h, and tie; no warp where the lower near corner lies deeper than half of mu.
_P = """
    float s = abs(sin(theta));
    float down = up - a;
    float g = share * down + 2.0f * ratio * t;
    float excess = 2.0f * (share * s - ratio * t);
    if (a > 0.0f) { excess = share * s + (share - 2.0f * ratio) * t; }
    if (excess > 0.0f) {
        float c = 0.0f;
        if (z_far <= $LARGEST) { c = sqrt(z_near) / sqrt(z_far); }
        float tie = (c * (1.0f + c) * up + 2.0f * c * t - (1.0f + c) * down) / mu;
        found = g / excess;
        if (tie > found) { found = tie; }
    }
"""
# The apex at the eye: lambda = n a.
_Q = """
    if (share * a > 2.0f * ratio * t) { found = ratio * a / mu; }
"""
_PXQ = """
    float s = abs(sin(theta));
    float down = up - a;
    float g = (share * down + 2.0f * ratio * t) / mu;
    float h = share * (s + t) / mu;
    float m = share * up / mu - g;
    float excess = 2.0f * (share * s - ratio * t) / mu;
    if (a > 0.0f) { excess = (share * s + (share - 2.0f * ratio) * t) / mu; }
    float c2 = excess + m;
    if (c2 > 0.0f) {
        float c = 0.0f;
        if (z_far <= $LARGEST) { c = $cube_root(z_near) / $cube_root(z_far); }
        float square = c * c;
        float sum = 1.0f + c + square;
        float tie = ((square * up - down) * sum + 2.0f * square * t) / ((1.0f + c) * mu);
        float c1 = 2.0f * (m * excess - g * h);
        float c0 = 3.0f * g * h * m;
        float near_part = m * m * (excess * excess + 3.0f * g * h);
        float far_part = g * h * (share * up / mu * excess + g * g);
        float spread = 2.0f * sqrt(near_part + far_part);
        float y = 0.0f;
        if (c1 <= 0.0f) { y = (spread - c1) / (2.0f * c2); } else { y = 2.0f * c0 / (c1 + spread); }
        found = y - g;
        if (tie > found) { found = tie; }
        if (found < 0.0f) { found = 0.0f; }
    }
"""
# Roots of each: n/f itself may underflow.
_CUBE_ROOT = """
float root = exp(log(x) / 3.0f);
return root - (root - x / (root * root)) / 3.0f;
"""
_END = """
}
float result = $NO_WARP;
if (found >= 0.0f && found < $NO_WARP) { result = found; }
return result;
"""
_ETA = """
float weight = $lambda_over_mu(theta, z_near, z_far, half_fov);
return weight / (1.0f + weight);
"""
# In this order, mu over z_far first: z_far times a slope may overflow. Without a far plane, mu is endless.
_LAMBDA = """
float weight = $lambda_over_mu(theta, z_near, z_far, half_fov);
float t = tan(half_fov) * abs(cos(theta));
float above = $upper_slope(theta, half_fov);
if (above < 0.0f) { above = 0.0f; }
float lambda = $NO_WARP;
if (weight < $NO_WARP && z_far <= $LARGEST) {
    float share = (z_far - z_near) / z_far;
    lambda = (share * above + 2.0f * t) * weight * z_far;
    if (!(lambda < $NO_WARP)) { lambda = $NO_WARP; }
}
return lambda;
"""
# n a, which does not depend on the far plane.
_LAMBDA_Q = """
float weight = $lambda_over_mu(theta, z_near, z_far, half_fov);
float lambda = $NO_WARP;
if (weight < $NO_WARP) { lambda = z_near * $upper_slope(theta, half_fov); }
return lambda;
"""
_PARAMETERS = ("theta", "z_near", "z_far", "half_fov")


def closed_form_source(metric: str, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: `warpopt_lambda_over_mu`, `warpopt_eta` and `warpopt_lambda` of (theta, z_near, z_far, half_fov).

    Optimal for the largest E_p, E_q or E_pxq over the view frustum (derived for this project; `solve.closed_form`).
    NaN, and inputs that are not a frustum, give no warp (eta = 1). An infinite z_far gives the limit, (T63): eta = 0
    where a warp helps; lambda is then the largest float, but for E_q n a.

    Args:
        language: one of `languages.LANGUAGES`.
        prefix: prefix of all names in the file.

    Raises:
        ValueError: another metric, or an invalid prefix (see `program.checked_prefix`).

    Example:
        >>> from warpopt.export.languages import C
        >>> "static inline float warpopt_lambda(" in closed_form_source("p", C)
        True
    """
    constants, functions = closed_form(metric)
    return text_of(Program([*_notes(metric), *HOW_TO], constants, {}, functions), language, prefix)


def closed_form(metric: str) -> tuple[dict[str, int | float], tuple[Function, ...]]:
    """(constants, functions) of the closed form, for files that need more than these.

    Raises:
        ValueError: another metric.
    """
    one_of("metric", metric, get_args(Metric))
    pi = np.float32(np.pi)
    constants = {"PI": float(pi), "PI_REST": np.pi - float(pi), "HALF_PI": np.pi / 2}
    constants |= {"NO_WARP": NO_WARP, "LARGEST": LARGEST}
    case = {"p": _P, "q": _Q, "pxq": _PXQ}[metric]
    body = "\n".join(part.strip("\n") for part in (_SPACE, case, _END))
    roots = () if metric != "pxq" else (Function("cube_root", "Of x > 0.", ("x",), _CUBE_ROOT),)
    return constants, (
        *roots,
        Function("upper_slope", "Slope of the upper side plane along the warp.", ("theta", "half_fov"), _SLOPE),
        Function("lambda_over_mu", "lambda over the depth range mu; 3.4e38: no warp.", _PARAMETERS, body),
        Function("eta", ETA_NOTE, _PARAMETERS, _ETA),
        Function("lambda", LAMBDA_NOTE, _PARAMETERS, _LAMBDA_Q if metric == "q" else _LAMBDA),
    )


def _notes(metric: str) -> list[str]:
    from .. import __version__

    return [
        f"Optimal shadow-map warp, warpopt {__version__}. Generated; do not edit.",
        f"E_{metric}, norm inf over the whole view frustum: the exact closed form.",
        "Regret promised 0, achieved that of single precision. theta in [0, pi], half_fov in (0, pi/2), in radians.",
        "eta = 0: below the least number, or the limit for an infinite z_far, which no map has: give the farthest",
        "receiver's depth.",
    ]

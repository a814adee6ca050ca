"""Code for the exact L-inf optimum over the whole frustum: no table, any frustum, any theta.

`solve.closed_form` in single precision, with terms simplified for each metric. All compute lambda/mu, from 0 to the
largest float (no warp); eta and lambda follow without a difference.
"""

from typing import Literal, get_args

import numpy as np

from .._words import one_of
from .languages import Language
from .program import ETA_NOTE, HOW_TO, LAMBDA_NOTE, NO_WARP, Function, Program, text_of

Metric = Literal["p", "q", "pxq"]

# notation: s, t, x, a, b as T, x, a, b of `LightSpace`; up, down: a's positive and negative part; g, h, m over z_near
_SPACE = """
float found = $NO_WARP;
if (z_near > 0.0f && z_far > z_near && half_fov > 0.0f && half_fov < $HALF_PI) {
    float x = (z_far - z_near) / z_near;
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
    float up = 0.0f;
    if (a > 0.0f) { up = a; }
    float mu = x * up + 2.0f * (1.0f + x) * t;
"""
# The larger of root, g/h, and tie; no warp where the lower near corner lies deeper than half of mu.
_P = """
    float down = up - a;
    float g = x * down + 2.0f * t;
    float excess = 2.0f * (x * s - t);
    if (a > 0.0f) { excess = x * s + (x - 2.0f) * t; }
    if (excess > 0.0f) {
        float growth = x / (1.0f + sqrt(1.0f + x));
        float tie = (x * up + (1.0f + growth) * (2.0f * t * growth - x * down)) / (growth * mu);
        found = g / excess;
        if (tie > found) { found = tie; }
    }
"""
# The apex at the eye: lambda = n a.
_Q = """
    if (x * a > 2.0f * t) { found = a / mu; }
"""
_PXQ = """
    float down = up - a;
    float g = (x * down + 2.0f * t) / mu;
    float h = x * (s + t) / mu;
    float m = x * up / mu - g;
    float excess = 2.0f * (x * s - t) / mu;
    if (a > 0.0f) { excess = (x * s + (x - 2.0f) * t) / mu; }
    float c2 = excess + m;
    if (c2 > 0.0f) {
        float r = 1.0f + x;
        float c = exp(log(r) / 3.0f);
        c = c - (c - r / (c * c)) / 3.0f;
        float third = x / (c * c + c + 1.0f);
        float growth = third * (c + 1.0f);
        float tie = (x * up + (1.0f + growth) * (2.0f * t * third - x * down)) / (growth * mu);
        float c1 = 2.0f * (m * excess - g * h);
        float c0 = 3.0f * g * h * m;
        float near_part = m * m * (excess * excess + 3.0f * g * h);
        float far_part = g * h * (x * up / mu * excess + g * g);
        float spread = 2.0f * sqrt(near_part + far_part);
        float y = 0.0f;
        if (c1 <= 0.0f) { y = (spread - c1) / (2.0f * c2); } else { y = 2.0f * c0 / (c1 + spread); }
        found = y - g;
        if (tie > found) { found = tie; }
    }
"""
_END = """
}
float result = $NO_WARP;
if (found > 0.0f && found < $NO_WARP) { result = found; }
return result;
"""
_ETA = """
float weight = $lambda_over_mu(theta, z_near, z_far, half_fov);
return weight / (1.0f + weight);
"""
_LAMBDA = """
float weight = $lambda_over_mu(theta, z_near, z_far, half_fov);
float s = abs(sin(theta));
float t = tan(half_fov) * abs(cos(theta));
float above = s - t;
if (above < 0.0f) { above = 0.0f; }
float mu = (z_far - z_near) * above + 2.0f * z_far * t;
float lambda = $NO_WARP;
if (weight < $NO_WARP) { lambda = mu * weight; }
return lambda;
"""
_PARAMETERS = ("theta", "z_near", "z_far", "half_fov")


def closed_form_source(metric: str, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: `warpopt_lambda_over_mu`, `warpopt_eta` and `warpopt_lambda` of (theta, z_near, z_far, half_fov).

    Optimal for the largest E_p, E_q or E_pxq over the view frustum (derived for this project; `solve.closed_form`).
    NaN, and inputs that are not a frustum, give no warp (eta = 1).

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
    one_of("metric", metric, get_args(Metric))
    pi = np.float32(np.pi)
    constants = {"PI": float(pi), "PI_REST": np.pi - float(pi), "HALF_PI": np.pi / 2, "NO_WARP": NO_WARP}
    case = {"p": _P, "q": _Q, "pxq": _PXQ}[metric]
    body = "\n".join(part.strip("\n") for part in (_SPACE, case, _END))
    functions = (
        Function("lambda_over_mu", "lambda over the depth range mu; 3.4e38: no warp.", _PARAMETERS, body),
        Function("eta", ETA_NOTE, _PARAMETERS, _ETA),
        Function("lambda", LAMBDA_NOTE, _PARAMETERS, _LAMBDA),
    )
    return text_of(Program([*_notes(metric), *HOW_TO], constants, {}, functions), language, prefix)


def _notes(metric: str) -> list[str]:
    from .. import __version__

    return [
        f"Optimal shadow-map warp, warpopt {__version__}. Generated; do not edit.",
        f"E_{metric}, norm inf over the whole view frustum: the exact closed form.",
        "Regret promised 0, achieved that of single precision. theta in [0, pi], half_fov in (0, pi/2), in radians.",
    ]

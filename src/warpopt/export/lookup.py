"""One look-up for all languages, written once and spelt in each."""

import dataclasses
import math
import re
from collections.abc import Callable

import numpy as np

from ..table.lambda_table import LambdaTable

# The neutral form: C's expressions, with declarations as `float x = ...;`, `int i = ...;`, and TABLE names, which each
# language spells in its own way. Kept to what all five languages have: no ternary, no libm beyond exp.
_ETA = """
float x = theta;
float eta = 1.0f;
if (x > HALF_PI) { x = PI - x; }
if (x == x) {
    int i = 0;
    for (int k = 1; k < KNOTS - 1; k++) { if (x > THETA[k]) { i = k; } }
    float share = (x - THETA[i]) / (THETA[i + 1] - THETA[i]);
    if (!(share > 0.0f)) { share = 0.0f; }
    if (share > 1.0f) { share = 1.0f; }
    float height = LOG_ETA[i] + share * (LOG_ETA[i + 1] - LOG_ETA[i]);
    if (height < 0.0f) { eta = exp(height); }
}
return eta;
"""
_LAMBDA = """
float eta = warpopt_eta(theta, z_near, z_far);
float s = abs(sin(theta));
float t = TAN_PHI * abs(cos(theta));
float above = s - t;
if (above < 0.0f) { above = 0.0f; }
float mu = (z_far - z_near) * above + 2.0f * z_far * t;
float lambda = NO_WARP;
if (eta < 1.0f) { lambda = mu * eta / (1.0f - eta); }
return lambda;
"""


@dataclasses.dataclass(frozen=True)
class Language:
    """How a language spells what the look-up needs.

    Attributes:
        name, suffix: for people and for files.
        comment: the start of a comment line.
        before, after: what stands around the whole.
        array: (name, numbers) to a constant array.
        constant: (name, number text) to a named constant.
        function: (name, body) to a function of (theta, z_near, z_far).
        declare: a `float` or `int` declaration to the language's.
        replace: spellings of functions and literals.
    """

    name: str
    suffix: str
    comment: str
    before: str
    after: str
    array: Callable[[str, list[str]], str]
    constant: Callable[[str, str], str]
    function: Callable[[str, str], str]
    declare: Callable[[str, str], str] = lambda kind, name: f"{kind} {name}"
    replace: tuple[tuple[str, str], ...] = ()


def _c_like_function(lead: str, tail: str = ""):
    def function(name: str, body: str) -> str:
        unused = "    (void)z_near;\n    (void)z_far;\n" if name.endswith("eta") and "static" in lead + tail else ""
        return f"{lead}float {name}(float theta, float z_near, float z_far){tail} {{\n{unused}{body}}}\n"

    return function


_LIBM = (("exp(", "expf("), ("abs(", "fabsf("), ("sin(", "sinf("), ("cos(", "cosf("))
_STD = (("exp(", "std::exp("), ("abs(", "std::fabs("), ("sin(", "std::sin("), ("cos(", "std::cos("))
_NO_SUFFIX = ((r"(\d)f\b", r"\1"),)

C = Language(
    "C99", ".h", "//",
    "#ifndef WARPOPT_TABLE_H\n#define WARPOPT_TABLE_H\n\n#include <math.h>\n", "\n#endif\n",
    lambda name, values: f"static const float {name}[{len(values)}] = {{\n    {_lines(values, 'f')}\n}};\n",
    lambda name, value: f"#define {name} {value}",
    _c_like_function("static inline "), replace=_LIBM,
)  # fmt: skip
CPP = Language(
    "C++17", ".hpp", "//",
    "#ifndef WARPOPT_TABLE_HPP\n#define WARPOPT_TABLE_HPP\n\n#include <cmath>\n\nnamespace warpopt_table {\n",
    "\n}  // namespace warpopt_table\n\n"
    "using warpopt_table::warpopt_eta;\nusing warpopt_table::warpopt_lambda;\n\n#endif\n",
    lambda name, values: f"inline constexpr float {name}[{len(values)}] = {{\n    {_lines(values, 'f')}\n}};\n",
    lambda name, value: f"inline constexpr {'int' if value.isdigit() else 'float'} {name} = {value};",
    lambda name, body: (
        f"inline float {name}(float theta, {'[[maybe_unused]] ' * name.endswith('eta')}float z_near, "
        f"{'[[maybe_unused]] ' * name.endswith('eta')}float z_far) noexcept {{\n{body}}}\n"
    ),
    replace=_STD,
)  # fmt: skip


def _glsl(version: int) -> Language:
    return Language(
        f"GLSL {version}", f".{version}.glsl", "//", f"// For #version {version} and later.\n", "",
        lambda name, values: f"const float {name}[{len(values)}] = float[](\n    {_lines(values, '')}\n);\n",
        lambda name, value: f"const {'int' if value.isdigit() else 'float'} {name} = {value};",
        lambda name, body: f"float {name}(float theta, float z_near, float z_far) {{\n{body}}}\n",
        replace=_NO_SUFFIX,
    )  # fmt: skip


GLSL_330, GLSL_450 = _glsl(330), _glsl(450)
HLSL = Language(
    "HLSL", ".hlsl", "//", "", "",
    lambda name, values: f"static const float {name}[{len(values)}] = {{\n    {_lines(values, '')}\n}};\n",
    lambda name, value: f"static const {'int' if value.isdigit() else 'float'} {name} = {value};",
    lambda name, body: f"float {name}(float theta, float z_near, float z_far) {{\n{body}}}\n",
    replace=_NO_SUFFIX,
)  # fmt: skip
WGSL = Language(
    "WGSL", ".wgsl", "//", "", "",
    lambda name, values: f"const {name} = array<f32, {len(values)}>(\n    {_lines(values, '')}\n);\n",
    lambda name, value: f"const {name}: {'i32' if value.isdigit() else 'f32'} = {value};",
    lambda name, body: f"fn {name}(theta: f32, z_near: f32, z_far: f32) -> f32 {{\n{body}}}\n",
    lambda kind, name: f"var {name}: {'f32' if kind == 'float' else 'i32'}", _NO_SUFFIX,
)  # fmt: skip

LANGUAGES = {"c": (C,), "cpp": (CPP,), "glsl": (GLSL_330, GLSL_450), "hlsl": (HLSL,), "wgsl": (WGSL,)}


def source(table: LambdaTable, language: Language, config: str = "") -> str:
    """The whole file: provenance, data, `warpopt_eta`, `warpopt_lambda`, and what to do with them.

    Byte for byte the same for the same table.
    """
    constants = {
        "WARPOPT_KNOTS": str(len(table.theta)),
        "WARPOPT_PI": _literal(_single(math.pi), language),
        "WARPOPT_HALF_PI": _literal(_single(math.pi / 2), language),
        "WARPOPT_TAN_PHI": _literal(_single(math.tan(table.half_fov)), language),
        "WARPOPT_NO_WARP": _literal("3.4028234e38", language),
    }
    comment = "\n".join(f"{language.comment} {line}".rstrip() for line in _notes(table, config))
    arrays = [
        language.array("WARPOPT_THETA", [_single(v) for v in table.theta]),
        language.array("WARPOPT_LOG_ETA", [_single(v) for v in table.log_eta]),
    ]
    named = "\n".join(language.constant(name, value) for name, value in constants.items())
    functions = [
        f"{language.comment} {words}\n{language.function(name, _spelt(body, language))}"
        for name, words, body in (
            ("warpopt_eta", "eta in (0, 1] of the angle theta (radians) between light and view; 1: no warp.", _ETA),
            ("warpopt_lambda", "lambda, the warp's near-plane distance, in units of z_near; 3.4e38: no warp.", _LAMBDA),
        )
    ]
    return "\n".join([comment, language.before, named, "", *arrays, *functions]).rstrip("\n") + "\n" + language.after


def _notes(table: LambdaTable, config: str) -> list[str]:
    degrees = table.half_fov * 57.29577951308232
    return [
        f"Optimal shadow-map warp, warpopt {table.version}. Generated; do not edit.",
        f"E_{table.metric}, norm {table.norm}, measure {table.measure}; far/near = {table.depth_ratio:.9g},"
        f" half field of view {degrees:.9g} degrees.",
        f"Regret promised {table.promised:g}, achieved {table.achieved:.6g} (at theta = {table.worst_theta:.9g}).",
        *([f"Configuration: {config}"] if config else []),
        "",
        "To warp: d in [0, mu] is the depth along the view made perpendicular to the light, x lies across it.",
        "With delta = d/mu and A = (1 - delta) eta + delta the shadow map has s = delta/A and t = 1/2 + x/(2 xmax A),",
        "xmax the largest |x|/A of the frustum's corners. As a matrix: w = A, row s = delta, row t = x/(2 xmax) + A/2.",
        "Or: a perspective frustum along that direction whose apex lies lambda = mu eta/(1 - eta) before the body and",
        "that reaches from lambda to lambda + mu.",
        "",
    ]


def _spelt(body: str, language: Language) -> str:
    body = body.strip("\n")
    for name in ("HALF_PI", "TAN_PHI", "NO_WARP", "KNOTS", "LOG_ETA", "THETA"):
        body = re.sub(rf"\b{name}\b", f"WARPOPT_{name}", body)
    body = re.sub(r"\bPI\b", "WARPOPT_PI", body)
    for old, new in language.replace:
        body = re.sub(re.escape(old), new, body) if old.endswith("(") else re.sub(old, new, body)
    body = re.sub(r"\b(float|int) (\w+)(?= =)", lambda m: language.declare(m[1], m[2]), body)
    return "".join(f"    {line}\n" for line in body.split("\n"))


def _literal(text: str, language: Language) -> str:
    return text + ("f" if language.suffix in (".h", ".hpp") else "")


def _single(value: float) -> str:
    """The shortest text that is this number in single precision, with a point."""
    text = str(np.float32(value))
    return text if "." in text or "e" in text else text + ".0"


def _lines(values: list[str], suffix: str) -> str:
    words = [value + suffix for value in values]
    return ",\n    ".join(", ".join(words[i : i + 6]) for i in range(0, len(words), 6))

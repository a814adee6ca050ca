"""The lookup in a table, written once and exported to all languages."""

import hashlib
import math
from collections.abc import Callable

import numpy as np

from ..table.lambda_table import LambdaTable
from .languages import Language
from .program import ETA_NOTE, HOW_TO, LAMBDA_NOTE, LARGEST, NO_WARP, Function, Program, text_of

# The position of a value on an axis of several rows: the row, and the fraction of the way to the next row.
_RATIO = """
float low = $ROOT_RATIO[ratio];
float high = $ROOT_RATIO[ratio + 1];
float along = high * (v - low * low) / ((high - low) * (v + low * high));
if (!(along > 0.0f)) { along = 0.0f; }
if (along > 1.0f) { along = 1.0f; }
if (v > high * high) { along = 1.0f; }
"""
_FOV = """
float across = (half_fov - $HALF_FOV[fov]) / ($HALF_FOV[fov + 1] - $HALF_FOV[fov]);
if (!(across > 0.0f)) { across = 0.0f; }
if (across > 1.0f) { across = 1.0f; }
"""
_KNOT = """
if (i + {step} < $KNOTS - 1) {{
{at}    i = i + {step} * one(x > here);
}}
"""
_SHARES = {"ratio": "along", "fov": "across"}
_FOLD = """
float x = theta;
float eta = 1.0f;
if (x > $HALF_PI) { x = ($PI - x) + $PI_REST; }
"""


def _mixed(axes: list[str], of: Callable[[str], str], name: str, row: str = "") -> tuple[str, str]:
    """(statements, expression): linear between the rows' values, axis by axis, nested as in `lookup`.

    Args:
        of: maps the start of an index (the row's first knot) to a value's expression.
        name: of local variables.
    """
    if not axes:
        return "", of(f"({row}) * $KNOTS + " if row else "")
    axis, rest = axes[0], axes[1:]
    rows = [f"({row}) * $FOVS + {axis} + {k}" if row else f"{axis} + {k}" for k in (0, 1)]
    (low_text, low), (high_text, high) = (
        _mixed(rest, of, f"{name}_{side}", r) for side, r in zip(("low", "high"), rows, strict=True)
    )
    text = f"{low_text}{high_text}float {name}_low = {low};\nfloat {name}_high = {high};\n"
    return text, f"{name}_low + {_SHARES[axis]} * ({name}_high - {name}_low)"


def _steps(count: int) -> list[int]:
    """Step sizes of a bisection among `count` entries; the last result is count - 2."""
    return [2**k for k in reversed(range(max(1, count - 2).bit_length()))] if count > 2 else []


def _search(name: str, size: str, count: int, beyond: str) -> str:
    """Statements that find the last entry, among those that begin a piece, that a value is beyond."""
    lines = [f"int {name} = 0;\n"]
    for step in _steps(count):
        test = beyond.format(at=f"{name} + {step}")
        lines.append(f"if ({name} + {step} < {size} - 1) {{ if ({test}) {{ {name} = {name} + {step}; }} }}\n")
    return "".join(lines)


def _eta_body(axes: list[str], ratios: int, fovs: int, knots: int) -> str:
    """The lookup over a table's axes: "ratio" (far/near), "fov" (half field of view), both or none."""

    def knot(index: str, name: str) -> tuple[str, str]:
        return _mixed(axes, lambda row: f"$THETA[{row}{index}]", name)

    def height(row: str) -> str:
        return f"$ETA[{row}i] + share * ($ETA[{row}i + 1] - $ETA[{row}i])"

    def log_of(row: str) -> str:
        return "0.0f" if row == least else f"log(({height(row)}) / value)"

    least = {(): "", ("ratio",): "(ratio + 0) * $KNOTS + ", ("fov",): "(fov + 0) * $KNOTS + "}.get(
        tuple(axes), "((ratio + 0) * $FOVS + fov + 0) * $KNOTS + "
    )
    lines = []
    valid = "x == x"
    if "ratio" in axes:
        lines.append("float v = z_far / z_near;\n")
        valid += " && v > 0.0f"
    if "fov" in axes:
        valid += " && half_fov == half_fov"
    body = ""
    if "ratio" in axes:
        body += _search("ratio", "$RATIOS", ratios, "v > $ROOT_RATIO[{at}] * $ROOT_RATIO[{at}]") + _RATIO
    if "fov" in axes:
        body += _search("fov", "$FOVS", fovs, "half_fov > $HALF_FOV[{at}]") + _FOV
    body += "int i = 0;\n"
    for step in _steps(knots):
        text, here = knot(f"i + {step}", "at")
        at = "".join(f"    {line}\n" for line in f"{text}float here = {here};".split("\n"))
        body += _KNOT.format(step=step, at=at).lstrip("\n")
    for name, index in (("start", "i"), ("end", "i + 1")):
        text, found = knot(index, name)
        body += f"{text}float {name} = {found};\n"
    body += "float share = 0.0f;\nif (end > start) { share = (x - start) / (end - start); }\n"
    body += "if (!(share > 0.0f)) { share = 0.0f; }\nif (share > 1.0f) { share = 1.0f; }\n"
    body += f"float value = {height(least)};\n"
    if axes:
        text, exponent = _mixed(axes, log_of, "height")
        body += f"{text}value = value * exp({exponent});\n"
    body += "if (value < 1.0f) { eta = value; }"
    indented = "".join(f"    {line}\n" for line in body.split("\n") if line)
    return f"{_FOLD}{''.join(lines)}if ({valid}) {{\n{indented}}}\nreturn eta;\n"


_LAMBDA = """
float eta = $eta({parameters});
float angle = theta;
if (!(angle > 0.0f)) {{ angle = 0.0f; }}
if (angle > $PI) {{ angle = $PI; }}
float s = abs(sin(angle));
float t = {tangent} * abs(cos(angle));
float above = s - t;
if (above < 0.0f) {{ above = 0.0f; }}
float lambda = $NO_WARP;
if (eta < 1.0f && z_near > 0.0f && z_far > z_near && z_far <= $LARGEST) {{
    float mu = (z_far - z_near) / z_far * above + 2.0f * t;
    if (mu > 0.0f) {{ lambda = mu * (eta / (1.0f - eta)) * z_far; }}
}}
if (!(lambda < $NO_WARP)) {{ lambda = $NO_WARP; }}
return lambda;
"""


def source(table: LambdaTable, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: provenance, data, `warpopt_eta`, `warpopt_lambda`, and notes for use.

    Equal tables give identical bytes. If the table covers the field of view, its functions take half of it, in radians,
    as their last argument.

    Args:
        language: one of `languages.LANGUAGES`.
        prefix: prefix of all names in the file.

    Raises:
        ValueError: an invalid prefix (see `program.checked_prefix`).

    Example:
        >>> import warpopt
        >>> from warpopt.export.languages import C
        >>> table = warpopt.build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> "static inline float warpopt_eta(float theta, float z_near, float z_far)" in source(table, C)
        True
    """
    rows = table.rows
    axes = [name for name, axis in (("ratio", rows.depth_ratio), ("fov", rows.half_fov)) if len(axis) > 1]
    pi = float(np.float32(np.pi))
    constants = {"KNOTS": table.theta.shape[-1], "PI": pi, "PI_REST": np.pi - pi, "HALF_PI": np.pi / 2}
    constants |= {"NO_WARP": NO_WARP, "LARGEST": LARGEST}
    arrays, parameters, tangent = {}, ("theta", "z_near", "z_far"), "$TAN_PHI"
    if "ratio" in axes:
        constants["RATIOS"], arrays["ROOT_RATIO"] = len(rows.depth_ratio), np.sqrt(rows.depth_ratio)
    if "fov" in axes:
        constants["FOVS"], arrays["HALF_FOV"] = len(rows.half_fov), rows.half_fov
        parameters, tangent = (*parameters, "half_fov"), "tan(half_fov)"
    else:
        constants["TAN_PHI"] = math.tan(rows.half_fov[0])
    arrays |= {"THETA": rows.theta.ravel(), "ETA": rows.eta.ravel()}
    single = [
        words
        for name, words in (("ratio", f"far/near = {rows.depth_ratio[0]:.9g}"),
                            ("fov", f"half field of view {math.degrees(rows.half_fov[0]):.9g} degrees"))
        if name not in axes
    ]  # fmt: skip
    note = ETA_NOTE + (f" For {' and '.join(single)}, whatever is given." if single else "")
    functions = (
        Function("eta", note, parameters, _eta_body(axes, *table.theta.shape)),
        Function("lambda", LAMBDA_NOTE, parameters, _LAMBDA.format(parameters=", ".join(parameters), tangent=tangent)),
    )
    return text_of(Program([*_notes(table), *HOW_TO], constants, arrays, functions), language, prefix)


def _notes(table: LambdaTable) -> list[str]:
    # The configuration that made the table, in its own terms, and its digest; no file name, as that may change.
    first, last = (math.degrees(table.theta[0, 0, k]) for k in (0, -1))
    digest = hashlib.sha256(table.encoded("table.json")).hexdigest()
    ratio, half_fov = (
        f"{axis[0]:.9g}" + (f" to {axis[-1]:.9g} ({len(axis)} rows)" if len(axis) > 1 else "")
        for axis in (table.depth_ratio, table.half_fov * (180 / math.pi))
    )
    theta, worst_ratio, worst_fov = table.worst
    bound = "" if math.isinf(table.max_slope) else f" |d log(eta) / d theta| <= {table.max_slope:.9g}."
    return [
        f"Optimal shadow-map warp, warpopt {table.version}. Generated; do not edit.",
        f"{table.objective.title}, measure {table.objective.measure}; far/near = {ratio},"
        f" half field of view {half_fov} degrees.{bound}",
        f"Regret promised {table.promised:g}, achieved {table.achieved:.6g} (at theta = {theta:.9g}, far/near ="
        f" {worst_ratio:.6g}, half field of view {math.degrees(worst_fov):.6g} degrees).",
        f"{table.theta.shape[-1]} knots a row from {first:.6g} to {last:.6g} degrees; table {digest[:16]}.",
    ]

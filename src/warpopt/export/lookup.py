"""A table's look-up: one for all languages, written once and spelt in each."""

import hashlib
import math

from ..table.files import encoded
from ..table.lambda_table import LambdaTable
from .languages import Language
from .program import ETA_NOTE, HOW_TO, LAMBDA_NOTE, NO_WARP, Function, Program, text_of

_ETA = """
float x = theta;
float eta = 1.0f;
if (x > $HALF_PI) { x = $PI - x; }
if (x == x) {
    int i = 0;
    for (int k = 1; k < $KNOTS - 1; k++) { if (x > $THETA[k]) { i = k; } }
    float share = (x - $THETA[i]) / ($THETA[i + 1] - $THETA[i]);
    if (!(share > 0.0f)) { share = 0.0f; }
    if (share > 1.0f) { share = 1.0f; }
    float height = $LOG_ETA[i] + share * ($LOG_ETA[i + 1] - $LOG_ETA[i]);
    if (height < 0.0f) { eta = exp(height); }
}
return eta;
"""
_LAMBDA = """
float eta = $eta(theta, z_near, z_far);
float s = abs(sin(theta));
float t = $TAN_PHI * abs(cos(theta));
float above = s - t;
if (above < 0.0f) { above = 0.0f; }
float mu = (z_far - z_near) * above + 2.0f * z_far * t;
float lambda = $NO_WARP;
if (eta < 1.0f) { lambda = mu * eta / (1.0f - eta); }
return lambda;
"""
_PARAMETERS = ("theta", "z_near", "z_far")
_FUNCTIONS = (
    Function("eta", ETA_NOTE, _PARAMETERS, _ETA),
    Function("lambda", LAMBDA_NOTE, _PARAMETERS, _LAMBDA),
)


def source(table: LambdaTable, language: Language, prefix: str = "warpopt") -> str:
    """The whole file: provenance, data, `warpopt_eta`, `warpopt_lambda`, and what to do with them.

    Byte for byte the same for the same table.

    Args:
        language: one of `languages.LANGUAGES`.
        prefix: of all names that the file defines.

    Raises:
        ValueError: a prefix that is no name (see `program.checked_prefix`).

    Example:
        >>> import warpopt
        >>> from warpopt.export.languages import C
        >>> table = warpopt.build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> "static inline float warpopt_eta(float theta, float z_near, float z_far)" in source(table, C)
        True
    """
    constants = {
        "KNOTS": len(table.theta), "PI": math.pi, "HALF_PI": math.pi / 2, "TAN_PHI": math.tan(table.half_fov),
        "NO_WARP": NO_WARP,
    }  # fmt: skip
    arrays = {"THETA": table.theta, "LOG_ETA": table.log_eta}
    return text_of(Program([*_notes(table), *HOW_TO], constants, arrays, _FUNCTIONS), language, prefix)


def _notes(table: LambdaTable) -> list[str]:
    # All that made the table, in the words of its configuration, and its identity: no file name, which may change.
    first, last = (math.degrees(v) for v in (table.theta[0], table.theta[-1]))
    digest = hashlib.sha256(encoded(table, "table.json")).hexdigest()
    return [
        f"Optimal shadow-map warp, warpopt {table.version}. Generated; do not edit.",
        f"E_{table.metric}, norm {table.norm}, measure {table.measure}; far/near = {table.depth_ratio:.9g},"
        f" half field of view {math.degrees(table.half_fov):.9g} degrees.",
        f"Regret promised {table.promised:g}, achieved {table.achieved:.6g} (at theta = {table.worst_theta:.9g}).",
        f"{len(table.theta)} knots from {first:.6g} to {last:.6g} degrees; table {digest[:16]}.",
    ]

"""Exporters by language name: their public interface."""

from .._checks import instance
from .._words import one_of
from ..table.lambda_table import LambdaTable
from .closed_form import closed_form_source
from .languages import LANGUAGES, Language
from .lookup import source

# For a language with several versions, the first serves all: GLSL 330 code compiles as 450 too.
_BY_NAME = {
    **{name: forms[0] for name, forms in LANGUAGES.items()},
    **{f"glsl{form.suffix.split('.')[1]}": form for form in LANGUAGES["glsl"]},
}


def export_source(table: LambdaTable, language: str, prefix: str = "warpopt") -> str:
    """Source code for a table lookup: the data, `warpopt_eta` and `warpopt_lambda`. Equal for equal tables.

    Args:
        table: from `build_table` or loaded.
        language: "c", "cpp", "glsl", "glsl330", "glsl450", "hlsl" or "wgsl".
        prefix: prefix of all names in the code.

    Returns:
        The whole file.

    Raises:
        ValueError: not a table, another language, or an invalid prefix.

    Example:
        >>> import warpopt
        >>> table = warpopt.build_table(warpopt.ViewFrustum(1.0, 100.0, 0.5236), max_regret=1e-2)
        >>> "static inline float warpopt_eta(float theta, float z_near, float z_far)" in export_source(table, "c")
        True
    """
    instance("table", table, LambdaTable)
    return source(table, _language(language), prefix)


def export_closed_form(metric: str, language: str, prefix: str = "warpopt") -> str:
    """The code of the exact optimum in L-inf over any view frustum.

    Args:
        metric: "p", "q" or "pxq".
        language, prefix: as for `export_source`.

    Returns:
        The whole file.

    Raises:
        ValueError: another metric or language, or an invalid prefix.

    Example:
        >>> "warpopt_lambda(" in export_closed_form("p", "hlsl")
        True
    """
    return closed_form_source(metric, _language(language), prefix)


def _language(name: str) -> Language:
    one_of("language", name, _BY_NAME)
    return _BY_NAME[name]

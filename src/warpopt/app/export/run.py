"""`warpopt export`: writes all files for engines, or none."""

from pathlib import Path

from warpopt._data_files import DataFileError
from warpopt.export.closed_form import closed_form_source
from warpopt.export.ground import ground_source
from warpopt.export.languages import LANGUAGES, Language
from warpopt.export.lookup import source
from warpopt.export.splits import splits_source
from warpopt.export.window import window_source
from warpopt.table.lambda_table import LambdaTable

from ..common.output import whole_files
from ..common.settings import ConfigError
from .request import SPLITS, WINDOW, ExportRequest


def export(request: ExportRequest) -> int:
    """Write the files and print their names; returns 0.

    Raises:
        ConfigError: a table that cannot be read, or a target that warpopt did not write.
        OSError: a file cannot be written; all are left unchanged.
    """
    directory, languages = request.directory, [form for name in request.code for form in LANGUAGES[name]]
    contents: dict[Path, bytes] = {}
    if request.table is None:
        for form in languages:
            name, text = _without_a_table(request, form)
            contents[directory / f"{name}{form.suffix}"] = text.encode()
    else:
        try:
            table = LambdaTable.load(request.table)
        except DataFileError as error:
            raise ConfigError(str(error)) from None
        stem = request.table.stem
        for form in languages:
            contents[directory / f"{stem}{form.suffix}"] = source(table, form, request.prefix).encode()
        for name in request.data:
            path = directory / f"{stem}.{name}"
            contents[path] = table.encoded(path)
    whole_files(contents)
    for path in contents:
        print(f"Written: {path}")
    return 0


def _without_a_table(request: ExportRequest, language: Language) -> tuple[str, str]:
    """(the file's name without its ending, its text)."""
    if request.form == WINDOW:
        return "window", window_source(language, request.prefix)
    if request.form == SPLITS:
        made, name = splits_source, "splits"
    elif request.receivers == "ground":
        made, name = ground_source, "ground"
    else:
        made, name = closed_form_source, "closed_form"
    return f"{name}_{request.metric}", made(request.metric, language, request.prefix)

"""`warpopt export`: writes all files for engines, or none."""

from pathlib import Path

from warpopt._data_files import DataFileError
from warpopt.export.closed_form import closed_form_source
from warpopt.export.ground import ground_source
from warpopt.export.languages import LANGUAGES
from warpopt.export.lookup import source
from warpopt.export.window import window_source
from warpopt.table.lambda_table import LambdaTable

from ..common.output import whole_files
from ..common.settings import ConfigError
from .request import ExportRequest


def export(request: ExportRequest) -> int:
    """Write the files and print their names; returns 0.

    Raises:
        ConfigError: a table that cannot be read, or a target that warpopt did not write.
        OSError: a file cannot be written; all are left unchanged.
    """
    directory, languages = request.directory, [form for name in request.code for form in LANGUAGES[name]]
    contents: dict[Path, bytes] = {}
    if request.window:
        for form in languages:
            contents[directory / f"window{form.suffix}"] = window_source(form, request.prefix).encode()
    elif request.table is None:
        for form in languages:
            made, name = (
                (ground_source, "ground_") if request.receivers == "ground" else (closed_form_source, "closed_form_")
            )
            text = made(request.metric, form, request.prefix)
            contents[directory / f"{name}{request.metric}{form.suffix}"] = text.encode()
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

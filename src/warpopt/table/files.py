"""Tables on disk: npz, csv and json, written whole, read back with every flaw named."""

import csv
import io
import json
import math
import os
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from .lambda_table import LambdaTable

FORMAT = "warpopt.LambdaTable 1"
_TEXT = ("metric", "norm", "measure", "version")
_NUMBERS = ("depth_ratio", "half_fov", "promised", "achieved", "worst_theta")


class TableFileError(ValueError):
    """A file that is no table, or not whole."""


def save(table: LambdaTable, path: str | Path) -> None:
    """Write a table as .npz, .csv or .json, by the path's ending; byte for byte the same for the same table.

    Raises:
        ValueError: another ending.
        OSError: the file cannot be written; an earlier one is then as it was.
    """
    write_table(path, _fields(table), {"theta": table.theta, "log_eta": table.log_eta})


def write_table(path: str | Path, fields: dict, knots: dict[str, np.ndarray]) -> None:
    """Write scalars and columns of equal length as .npz, .csv or .json, by the path's ending; raises as `save`."""
    path = Path(path)
    content = _encoded(fields, knots, path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def encoded(table: LambdaTable, path: str | Path) -> bytes:
    """What `save` writes to the path.

    Raises:
        ValueError: an ending other than .npz, .csv and .json.
    """
    return _encoded(_fields(table), {"theta": table.theta, "log_eta": table.log_eta}, Path(path))


def _encoded(fields: dict, knots: dict[str, np.ndarray], path: Path) -> bytes:
    make = {".npz": _npz, ".csv": _csv, ".json": _json}.get(path.suffix)
    if make is None:
        raise ValueError(f"path: got {path.name!r}, expected an ending of .npz, .csv or .json")
    return make(fields, knots)


def load(path: str | Path) -> LambdaTable:
    """Read what `save` wrote.

    Raises:
        TableFileError: a file that is missing, truncated, edited into nonsense, of another format or a later version.
    """
    path = Path(path)
    read = {".npz": _from_npz, ".csv": _from_csv, ".json": _from_json}.get(path.suffix)
    if read is None:
        raise TableFileError(f"{path}: got the ending {path.suffix!r}, expected .npz, .csv or .json")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TableFileError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        fields = read(content)
    except (ValueError, KeyError, TypeError, UnicodeDecodeError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise TableFileError(f"{path}: not a whole {path.suffix[1:]} table: {error}") from None
    return _checked(path, fields)


def _fields(table: LambdaTable) -> dict:
    return {"format": FORMAT} | {name: getattr(table, name) for name in (*_TEXT, *_NUMBERS)}


def _npz(fields: dict, knots: dict[str, np.ndarray]) -> bytes:
    # numpy.savez stamps the time; the archive is made by hand so that equal tables are equal files.
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, value in {**fields, **knots}.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, np.asarray(value), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), array.getvalue())
    return buffer.getvalue()


def _json(fields: dict, knots: dict[str, np.ndarray]) -> bytes:
    columns = {name: list(map(float, column)) for name, column in knots.items()}
    return (json.dumps({**fields, **columns}, indent=1, allow_nan=False) + "\n").encode()


def _csv(fields: dict, knots: dict[str, np.ndarray]) -> bytes:
    out = io.StringIO(newline="")
    writer = csv.writer(out)
    writer.writerows((f"# {name}", value) for name, value in fields.items())
    columns = list(knots.values())
    writer.writerow(["# knots", len(columns[0])])
    writer.writerow(list(knots))
    writer.writerows(map(repr, map(float, row)) for row in zip(*columns, strict=True))
    return out.getvalue().encode()


def _from_npz(content: bytes) -> dict:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] if archive[name].shape else archive[name].item() for name in archive.files}


def _from_json(content: bytes) -> dict:
    fields = json.loads(content.decode())
    if not isinstance(fields, dict):
        raise ValueError("got no object of fields")
    return fields


def _from_csv(content: bytes) -> dict:
    rows = list(csv.reader(io.StringIO(content.decode(), newline="")))
    fields: dict = {row[0][2:]: row[1] for row in rows if row and row[0].startswith("# ")}
    fields |= {name: float(fields[name]) for name in _NUMBERS if name in fields}
    start = rows.index(["theta", "log_eta"]) + 1
    knots = np.array([[float(v) for v in row] for row in rows[start:]])
    if len(knots) != int(fields.pop("knots")):
        raise ValueError(f"got {len(knots)} knots, expected as many as the file says")
    return fields | {"theta": knots[:, 0], "log_eta": knots[:, 1]}


def _checked(path: Path, fields: dict) -> LambdaTable:
    found = fields.pop("format", None)
    if found != FORMAT:
        raise TableFileError(f"{path}: got format {found!r}, expected {FORMAT!r}")
    expected = {*_TEXT, *_NUMBERS, "theta", "log_eta"}
    if fields.keys() != expected:
        raise TableFileError(f"{path}: got fields {sorted(fields)}, expected {sorted(expected)}")
    try:
        theta, log_eta = (np.asarray(fields[name], np.float64) for name in ("theta", "log_eta"))
        numbers = {name: float(fields[name]) for name in _NUMBERS}
    except (TypeError, ValueError):
        raise TableFileError(f"{path}: got a field that is no number, expected numbers") from None
    rising = theta.ndim == 1 and len(theta) >= 2 and (np.diff(theta) > 0).all()
    if not (rising and theta.shape == log_eta.shape and np.isfinite(theta).all() and np.isfinite(log_eta).all()):
        raise TableFileError(f"{path}: got knots that do not increase or are not finite, expected two or more that do")
    if not all(math.isfinite(v) and v >= 0 for v in numbers.values()):
        raise TableFileError(
            f"{path}: got a number that is negative or not finite, expected {', '.join(_NUMBERS)} >= 0"
        )
    metric, norm, measure, version = (str(fields[name]) for name in _TEXT)
    ratio, half_fov, promised, achieved, worst = (numbers[name] for name in _NUMBERS)
    return LambdaTable(theta, log_eta, ratio, half_fov, metric, norm, measure, promised, achieved, worst, version)

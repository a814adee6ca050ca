"""Tables on disk: npz, csv and json, written whole, read back with every flaw named."""

import csv
import hashlib
import io
import json
import math
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from ..theory.error_norm import ErrorNorm
from .lambda_table import LambdaTable
from .look_up import Rows

FORMAT = "warpopt.LambdaTable 2"
_TEXT = ("metric", "norm", "measure", "version", "max_slope")
_NUMBERS = ("promised", "achieved", "worst_theta", "worst_depth_ratio", "worst_half_fov")
_COLUMNS = ("depth_ratio", "half_fov", "theta", "eta")  # one entry for each knot of each row


class TableFileError(ValueError):
    """A file that is no table, or not whole."""


def save(table: LambdaTable, path: str | Path) -> None:
    """Write a table as .npz, .csv or .json, by the path's ending; byte for byte the same for the same table.

    Raises:
        ValueError: another ending.
        OSError: the file cannot be written; an earlier one is then as it was.
    """
    write_table(path, _fields(table), _columns(table))


def write_table(path: str | Path, fields: dict, knots: dict[str, np.ndarray]) -> None:
    """Write scalars and columns of equal length as .npz, .csv or .json, by the path's ending; raises as `save`."""
    path = Path(path)
    content = encoded_fields(fields, knots, path)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        whole = Path(folder) / path.name
        whole.write_bytes(content)
        whole.replace(path)


def encoded(table: LambdaTable, path: str | Path) -> bytes:
    """What `save` writes to the path.

    Raises:
        ValueError: an ending other than .npz, .csv and .json.
    """
    return encoded_fields(_fields(table), _columns(table), Path(path))


def encoded_fields(fields: dict, knots: dict[str, np.ndarray], path: Path) -> bytes:
    """What `write_table` writes; raises as it does for the ending."""
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
    read = {**READERS, ".csv": _from_csv}.get(path.suffix)
    if read is None:
        raise TableFileError(f"{path}: got the ending {path.suffix!r}, expected .npz, .csv or .json")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TableFileError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        fields = read(content)
    except Exception as error:  # whatever a damaged archive, number or nesting makes its reader raise
        raise TableFileError(f"{path}: not a whole {path.suffix[1:]} table: {error}") from None
    return _checked(path, fields)


def _fields(table: LambdaTable) -> dict:
    slope = "none" if math.isinf(table.max_slope) else repr(table.max_slope)
    text = {name: getattr(table, name) for name in _TEXT} | {"max_slope": slope}
    numbers = dict(zip(_NUMBERS, (table.promised, table.achieved, *table.worst), strict=True))
    fields = {"format": FORMAT, **text, **numbers}
    return {**fields, "digest": digest_of(fields, _columns(table))}


def digest_of(fields: dict, columns: dict[str, np.ndarray]) -> str:
    """Of all that a file says: with it a file that was cut or edited is known."""
    text = [f"{name}={value if isinstance(value, str) else repr(float(value))}" for name, value in fields.items()]
    text += [f"{name}={[float(v) for v in column]}" for name, column in columns.items()]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:32]


def _columns(table: LambdaTable) -> dict[str, np.ndarray]:
    axes = table.depth_ratio[:, None, None], table.half_fov[:, None]
    columns = (*(np.broadcast_to(axis, table.theta.shape) for axis in axes), table.theta, table.knot_eta)
    return {name: column.ravel() for name, column in zip(_COLUMNS, columns, strict=True)}


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
    rows = [row for row in csv.reader(io.StringIO(content.decode("utf-8-sig"), newline="")) if row]
    fields: dict = {row[0][2:]: row[1] for row in rows if row and row[0].startswith("# ")}
    fields |= {name: float(fields[name]) for name in _NUMBERS if name in fields}
    start = rows.index(list(_COLUMNS)) + 1
    knots = np.array([[float(v) for v in row] for row in rows[start:]])
    if knots.shape != (int(fields.pop("knots")), len(_COLUMNS)):
        raise ValueError(f"got {len(knots)} knots, expected as many as the file says")
    return fields | dict(zip(_COLUMNS, knots.T, strict=True))


READERS = {".npz": _from_npz, ".json": _from_json}  # of any table's fields; columns of csv are each table's own


def _checked(path: Path, fields: dict) -> LambdaTable:
    try:
        return _table(fields)
    except ValueError as error:
        raise TableFileError(f"{path}: {error}") from None


def _table(fields: dict) -> LambdaTable:
    """The table of a file's fields; ValueErrors say what is wrong with them."""
    found, digest = fields.pop("format", None), fields.pop("digest", None)
    if found != FORMAT:
        raise ValueError(f"got format {found!r}, expected {FORMAT!r}")
    expected = {*_TEXT, *_NUMBERS, *_COLUMNS}
    if fields.keys() != expected:
        raise ValueError(f"got fields {sorted(fields)}, expected {sorted(expected)}")
    try:
        columns = [np.asarray(fields[name], np.float64) for name in _COLUMNS]
        numbers = [float(fields[name]) for name in _NUMBERS]
        slope = math.inf if str(fields["max_slope"]) == "none" else float(fields["max_slope"])
    except (TypeError, ValueError, OverflowError):
        raise ValueError("got a field that is no number, expected numbers") from None
    rows = _rows(columns)
    if not (all(math.isfinite(v) and v >= 0 for v in numbers) and slope > 0):
        raise ValueError(
            "got a number that is negative, not finite or out of range, expected max_slope > 0 and "
            f"{', '.join(_NUMBERS)} >= 0"
        )
    metric, norm, measure, version = (str(fields[name]) for name in ("metric", "norm", "measure", "version"))
    ErrorNorm.of(metric, norm if norm in ("inf", "l1", "l2") else float(norm), measure)
    promised, achieved, *worst = numbers
    table = LambdaTable(
        *rows, metric, norm, measure,
        max_slope=slope, promised=promised, achieved=achieved, worst=tuple(worst), version=version,
    )  # fmt: skip
    if digest != _fields(table)["digest"]:
        raise ValueError("got contents that its digest does not fit, expected a table as it was written")
    return table


def _rows(columns: list[np.ndarray]) -> Rows:
    """The polylines that the columns hold, knot after knot and row after row."""
    if not all(c.ndim == 1 and c.shape == columns[0].shape and np.isfinite(c).all() for c in columns):
        raise ValueError(f"got knots that are not finite or not as many of each, expected {_COLUMNS}")
    ratios, fovs = (np.unique(c) for c in columns[:2])
    count, rest = divmod(len(columns[0]), max(1, len(ratios) * len(fovs)))
    if count < 2 or rest:
        raise ValueError("got knots that are no grid, expected each row of depth_ratio and half_fov whole")
    of_knots = [c.reshape(len(ratios), len(fovs), count) for c in columns]
    if not all((c == axis).all() for c, axis in zip(of_knots, (ratios[:, None, None], fovs[:, None]), strict=False)):
        raise ValueError("got knots that are no grid, expected each row of depth_ratio and half_fov whole")
    theta, eta = of_knots[2:]
    if not (np.diff(theta) >= 0).all() or not (theta[..., 0] < theta[..., -1]).all():
        raise ValueError("got knots whose theta does not increase, expected knots that do")
    if not min(eta.min(), ratios[0] - 1, fovs[0]) > 0:
        raise ValueError("got knots with a negative number, expected eta > 0, half_fov > 0 and depth_ratio > 1")
    return Rows(ratios, fovs, theta, eta)

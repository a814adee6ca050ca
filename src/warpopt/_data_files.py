"""Files of scalars and columns of equal length: npz, csv or json, written atomically, with a digest of the contents."""

import csv
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ._words import shown

Fields = Mapping[str, str | float]
Columns = Mapping[str, np.ndarray]


class DataFileError(ValueError):
    """A file with wrong, incomplete or unreadable contents."""


def path_of(path: str | Path) -> Path:
    """The path.

    Raises:
        ValueError: not text and not a path.
    """
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path: got {shown(path)}, expected the name of a file")
    return Path(path)


def write_whole(path: str | Path, fields: Fields, columns: Columns) -> None:
    """Write a file in the format of its extension; equal contents give identical bytes.

    Raises:
        ValueError: an ending other than .npz, .csv and .json.
        OSError: the file cannot be written; an existing one is left unchanged.
    """
    path = path_of(path)
    content = encoded(path, fields, columns)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        whole = Path(folder) / path.name
        whole.write_bytes(content)
        whole.replace(path)


def encoded(path: str | Path, fields: Fields, columns: Columns) -> bytes:
    """The bytes that `write_whole` writes.

    Raises:
        ValueError: an ending other than .npz, .csv and .json.
    """
    path = path_of(path)
    make = {".npz": _npz, ".csv": _csv, ".json": _json}.get(path.suffix)
    if make is None:
        raise ValueError(f"path: got {path.name!r}, expected an ending of .npz, .csv or .json")
    return make(fields, columns)


def read_fields(path: Path, what: str, columns: tuple[str, ...]) -> dict:
    """Scalars and columns by name; in csv, scalars are returned as text.

    Args:
        what: kind of file, for messages.
        columns: their names.

    Raises:
        DataFileError: a file that is missing, truncated or of another format.
    """
    readers = {".npz": _from_npz, ".json": _from_json, ".csv": lambda content: _from_csv(content, columns)}
    read = readers.get(path.suffix)
    if read is None:
        raise DataFileError(f"{path}: got the ending {path.suffix!r}, expected .npz, .csv or .json")
    try:
        return read(path.read_bytes())
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # a damaged file can make its reader raise anything
        raise DataFileError(f"{path}: not a whole {path.suffix[1:]} {what}: {error}") from None


def digest_of(fields: Fields, columns: Columns) -> str:
    """Digest of all contents; it detects files that were cut or edited."""
    text = [f"{name}={value if isinstance(value, str) else repr(float(value))}" for name, value in fields.items()]
    text += [f"{name}={[float(v) for v in column]}" for name, column in columns.items()]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:32]


def _npz(fields: Fields, columns: Columns) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **fields, **columns)
    return buffer.getvalue()


def _json(fields: Fields, columns: Columns) -> bytes:
    listed = {name: list(map(float, column)) for name, column in columns.items()}
    return (json.dumps({**fields, **listed}, indent=1, allow_nan=False) + "\n").encode()


def _csv(fields: Fields, columns: Columns) -> bytes:
    out = io.StringIO(newline="")
    writer = csv.writer(out)
    writer.writerows((f"# {name}", value) for name, value in fields.items())
    values = list(columns.values())
    writer.writerow(["# knots", len(values[0])])
    writer.writerow(list(columns))
    writer.writerows(map(repr, map(float, row)) for row in zip(*values, strict=True))
    return out.getvalue().encode()


def _from_npz(content: bytes) -> dict:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] if archive[name].shape else archive[name].item() for name in archive.files}


def _from_json(content: bytes) -> dict:
    fields = json.loads(content.decode())
    if not isinstance(fields, dict):
        raise ValueError("got no object of fields")
    return fields


def _from_csv(content: bytes, columns: tuple[str, ...]) -> dict:
    rows = [row for row in csv.reader(io.StringIO(content.decode("utf-8-sig"), newline="")) if row]
    fields: dict = {row[0][2:]: row[1] for row in rows if row and row[0].startswith("# ")}
    start = rows.index(list(columns)) + 1
    values = np.array([[float(v) for v in row] for row in rows[start:]])
    if values.shape != (int(fields.pop("knots")), len(columns)):
        raise ValueError(f"got {len(values)} knots, expected as many as the file says")
    return fields | dict(zip(columns, values.T, strict=True))

"""Table files: npz, csv and json, written atomically; reading reports every defect."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._data_files import DataFileError, digest_of, encoded, path_of, read_fields, write_whole
from ..objective import Objective
from .lookup import Rows

if TYPE_CHECKING:
    from .lambda_table import LambdaTable

FORMAT = "warpopt.LambdaTable 2"
_TEXT = ("metric", "norm", "measure", "version", "max_slope")
_NUMBERS = ("promised", "achieved", "worst_theta", "worst_depth_ratio", "worst_half_fov")
_COLUMNS = ("depth_ratio", "half_fov", "theta", "eta")  # one entry for each knot of each row


def save(table: "LambdaTable", path: str | Path) -> None:
    """Write a table as .npz, .csv or .json, by the file extension; equal tables give identical bytes.

    Raises:
        ValueError: another ending.
        OSError: the file cannot be written; an existing one is left unchanged.
    """
    write_whole(path, _fields(table), _columns(table))


def encoded_table(table: "LambdaTable", path: str | Path) -> bytes:
    """The bytes that `save` writes to the path.

    Raises:
        ValueError: an ending other than .npz, .csv and .json.
    """
    return encoded(path, _fields(table), _columns(table))


def load(path: str | Path, kind: type["LambdaTable"]) -> "LambdaTable":
    """Read what `save` wrote; `kind` is the class.

    Raises:
        DataFileError: a file that is missing, truncated, edited, of another format or a later version.
    """
    path = path_of(path)
    fields = read_fields(path, "table", _COLUMNS)
    try:
        return _table(fields, kind)
    except ValueError as error:
        raise DataFileError(f"{path}: {error}") from None


def _fields(table: "LambdaTable") -> dict:
    slope = "none" if math.isinf(table.max_slope) else repr(table.max_slope)
    objective = table.objective
    text = dict(
        zip(_TEXT, (objective.name, objective.norm, objective.measure, table.version, slope), strict=True)
    )  # fmt: skip
    numbers = dict(zip(_NUMBERS, (table.promised, table.achieved, *table.worst), strict=True))
    fields = {"format": FORMAT, **text, **numbers}
    return {**fields, "digest": digest_of(fields, _columns(table))}


def _columns(table: "LambdaTable") -> dict[str, np.ndarray]:
    axes = table.depth_ratio[:, None, None], table.half_fov[:, None]
    columns = (*(np.broadcast_to(axis, table.theta.shape) for axis in axes), table.theta, table.knot_eta)
    return {name: column.ravel() for name, column in zip(_COLUMNS, columns, strict=True)}


def _table(fields: dict, kind: type["LambdaTable"]) -> "LambdaTable":
    """The table of a file's fields; a ValueError names the defect."""
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
        raise ValueError("got a field that is not a number, expected numbers") from None
    rows = _rows(columns)
    if not (all(math.isfinite(v) and v >= 0 for v in numbers) and slope > 0):
        raise ValueError(
            "got a number that is negative, not finite or out of range, expected max_slope > 0 and "
            f"{', '.join(_NUMBERS)} >= 0"
        )
    metric, norm, measure, version = (str(fields[name]) for name in ("metric", "norm", "measure", "version"))
    promised, achieved, at_theta, at_ratio, at_fov = numbers
    table = kind(
        *rows, Objective(metric, norm, measure),
        max_slope=slope, promised=promised, achieved=achieved, worst=(at_theta, at_ratio, at_fov), version=version,
    )  # fmt: skip
    if digest != _fields(table)["digest"]:
        raise ValueError("got contents that do not match the digest, expected an unedited table")
    return table


def _rows(columns: list[np.ndarray]) -> Rows:
    """The polylines in the columns, ordered by row, then by knot."""
    if not all(c.ndim == 1 and c.shape == columns[0].shape and np.isfinite(c).all() for c in columns):
        raise ValueError(f"got knots that are not finite or not as many of each, expected {_COLUMNS}")
    ratios, fovs = (np.unique(c) for c in columns[:2])
    count, rest = divmod(len(columns[0]), max(1, len(ratios) * len(fovs)))
    if count < 2 or rest:
        raise ValueError("got knots that do not form a grid, expected complete rows of depth_ratio and half_fov")
    of_knots = [c.reshape(len(ratios), len(fovs), count) for c in columns]
    if not all((c == axis).all() for c, axis in zip(of_knots, (ratios[:, None, None], fovs[:, None]), strict=False)):
        raise ValueError("got knots that do not form a grid, expected complete rows of depth_ratio and half_fov")
    theta, eta = of_knots[2:]
    if not (np.diff(theta) >= 0).all() or not (theta[..., 0] < theta[..., -1]).all():
        raise ValueError("got knots whose theta does not increase, expected knots that do")
    if not min(eta.min(), ratios[0] - 1, fovs[0]) > 0:
        raise ValueError("got knots with a negative number, expected eta > 0, half_fov > 0 and depth_ratio > 1")
    return Rows(ratios, fovs, theta, eta)

"""The request of `warpopt export`. Does not import JAX."""

import dataclasses
from pathlib import Path
from typing import get_args

from warpopt.export.ground import GroundMetric
from warpopt.export.program import checked_prefix

from ..common.output import TABLE_ENDINGS
from ..common.settings import ConfigError, Metric

CLOSED_FORM, WINDOW = "closed-form", "window"
_CODE = ("c", "cpp", "glsl", "hlsl", "wgsl")
_METRICS = {"frustum": get_args(Metric), "ground": get_args(GroundMetric)}
_DATA = tuple(ending[1:] for ending in TABLE_ENDINGS)


@dataclasses.dataclass(frozen=True)
class ExportRequest:
    """What to export, to which languages and formats, and to which folder.

    Attributes:
        table: its file; None for the closed form of `metric` over `receivers`, and for the stable window.
        window: whether it is the stable window.
        code: languages; data: formats of tables; both in the requested order without duplicates.
        prefix: of the names in code.
    """

    table: Path | None
    window: bool
    metric: str
    receivers: str
    code: tuple[str, ...]
    data: tuple[str, ...]
    directory: Path
    prefix: str

    @classmethod
    def of(
        cls, table: str, to: str, directory: Path, metric: str | None, receivers: str, prefix: str
    ) -> "ExportRequest":
        """The request from the command line's arguments.

        Raises:
            ConfigError: lists every error, one per line.
        """
        closed, window = table == CLOSED_FORM, table == WINDOW
        possible = _CODE if closed or window else _CODE + _DATA
        names = dict.fromkeys(name.strip() for name in to.split(","))
        flaws = [f"  to: got {name!r}, expected {', '.join(possible)}" for name in names if name not in possible]
        if not (closed or window) and Path(table).suffix not in TABLE_ENDINGS:
            flaws.append(
                f"  table: got {table!r}, expected a file ending in {', '.join(TABLE_ENDINGS)}, or {CLOSED_FORM!r} or "
                f"{WINDOW!r}"
            )
        if not closed and metric is not None:
            why = "the window, which has none" if window else "a table, which has a metric"
            flaws.append(f"  metric: got {metric!r} with {why}")
        if receivers not in _METRICS:
            flaws.append(f"  receivers: got {receivers!r}, expected {', '.join(_METRICS)}")
        elif not closed and receivers != "frustum":
            why = "the window, which is for any" if window else "a table, which is for frusta"
            flaws.append(f"  receivers: got {receivers!r} with {why}")
        elif closed and metric is not None and metric not in _METRICS[receivers]:
            flaws.append(f"  metric: got {metric!r}, expected {', '.join(_METRICS[receivers])}")
        try:
            checked_prefix(prefix)
        except ValueError as flaw:
            flaws.append(f"  {flaw}")
        if flaws:
            raise ConfigError("\n".join([f"command line: {len(flaws)} error{'s' * (len(flaws) > 1)}", *flaws]))
        code, data = (tuple(name for name in names if name in kind) for kind in (_CODE, _DATA))
        path = None if closed or window else Path(table)
        return cls(path, window, metric or "p", receivers, code, data, directory, prefix)

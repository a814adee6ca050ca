"""The request of `warpopt export`. Does not import JAX."""

import dataclasses
from pathlib import Path
from typing import get_args

from warpopt.export.ground import GroundMetric
from warpopt.export.program import checked_prefix

from ..common.output import TABLE_ENDINGS
from ..common.settings import ConfigError, Metric

CLOSED_FORM, WINDOW, SPLITS = "closed-form", "window", "splits"
_FORMS = (CLOSED_FORM, WINDOW, SPLITS)
_CODE = ("c", "cpp", "glsl", "hlsl", "wgsl")
_METRICS = {"frustum": get_args(Metric), "ground": get_args(GroundMetric)}
_DATA = tuple(ending[1:] for ending in TABLE_ENDINGS)


@dataclasses.dataclass(frozen=True)
class ExportRequest:
    """What to export, to which languages and formats, and to which folder.

    Attributes:
        form: what is written without a table: "closed-form" (of `metric` over `receivers`), "window" or "splits" (with
            the warps of `metric`); None for a table.
        table: its file; None without one.
        code: languages; data: formats of tables; both in the requested order without duplicates.
        prefix: of the names in code.
    """

    form: str | None
    table: Path | None
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
        form = table if table in _FORMS else None
        possible = _CODE if form else _CODE + _DATA
        names = dict.fromkeys(name.strip() for name in to.split(","))
        flaws = [f"  to: got {name!r}, expected {', '.join(possible)}" for name in names if name not in possible]
        if not form and Path(table).suffix not in TABLE_ENDINGS:
            flaws.append(
                f"  table: got {table!r}, expected a file ending in {', '.join(TABLE_ENDINGS)}, or "
                f"{', '.join(map(repr, _FORMS[:-1]))} or {_FORMS[-1]!r}"
            )
        metrics = _METRICS.get(receivers, ()) if form == CLOSED_FORM else _METRICS["frustum"]
        if metric is not None and form not in (CLOSED_FORM, SPLITS):
            why = "the window, which has none" if form else "a table, which has a metric"
            flaws.append(f"  metric: got {metric!r} with {why}")
        elif metric is not None and metrics and metric not in metrics:
            flaws.append(f"  metric: got {metric!r}, expected {', '.join(metrics)}")
        if receivers not in _METRICS:
            flaws.append(f"  receivers: got {receivers!r}, expected {', '.join(_METRICS)}")
        elif form != CLOSED_FORM and receivers != "frustum":
            why = {
                WINDOW: "the window, which is for any", SPLITS: "splits, which are for frusta",
                None: "a table, which is for frusta",
            }[form]  # fmt: skip
            flaws.append(f"  receivers: got {receivers!r} with {why}")
        try:
            checked_prefix(prefix)
        except ValueError as flaw:
            flaws.append(f"  {flaw}")
        if flaws:
            raise ConfigError("\n".join([f"command line: {len(flaws)} error{'s' * (len(flaws) > 1)}", *flaws]))
        code, data = (tuple(name for name in names if name in kind) for kind in (_CODE, _DATA))
        return cls(form, None if form else Path(table), metric or "p", receivers, code, data, directory, prefix)

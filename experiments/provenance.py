"""Where a figure comes from: the machine, the date and the versions; and the pages that experiments write into."""

import datetime
import os
import platform
import sys
from collections.abc import Iterable
from pathlib import Path

import jax
import numpy as np
import scipy


def provenance() -> dict:
    return {
        "date": datetime.date.today().isoformat(),
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "device": str(jax.devices()[0])},
        "versions": {
            "jax": jax.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": sys.version.split()[0],
        },
    }


def sentence(summary: dict) -> str:
    machine, versions = summary["machine"], summary["versions"]
    device = "" if "cpu" in machine["device"].lower() else f", {machine['device']}"
    return f"{summary['date']}, {machine['cores']} cores of {machine['processor']}{device}, JAX {versions['jax']}"


def markdown_table(heads: Iterable[str], rows: Iterable[Iterable]) -> str:
    """A table; floats to three digits."""
    heads = list(heads)
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = (f"{v:.3g}" if isinstance(v, float) else str(v) for v in row)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def write_section(page: Path, name: str, text: str) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- end name -->` on the page.

    Raises:
        ValueError: if the page has no such place.
    """
    start, end = f"<!-- {name} -->", f"<!-- end {name} -->"
    whole = page.read_text(encoding="utf-8")
    if whole.count(start) != 1 or whole.count(end) != 1:
        raise ValueError(f"{page}: expected one {start} and one {end}")
    before, rest = whole.split(start)
    page.write_text(f"{before}{start}\n{text.strip()}\n{end}{rest.split(end)[1]}", encoding="utf-8")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()

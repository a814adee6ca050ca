"""The records in every command's result folder, and the progress bar."""

import contextlib
import csv
import importlib.metadata
import json
import math
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike
from pydantic import BaseModel
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

import warpopt

from .output import MARK

_PACKAGES = ("warpopt", "jax", "jaxlib", "optimistix", "equinox", "numpy", "matplotlib")


@contextlib.contextmanager
def progress_bar(console: Console, steps: int) -> Iterator[Callable[[str], None]]:
    """A bar that advances at each call, which names the finished step; silent without a terminal."""
    columns = (TextColumn("{task.description:<40}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=steps)
        yield lambda done: bar.update(task, advance=1, description=done)


def environment(config: BaseModel, dtype: Any, timings: dict[str, float], others: tuple[str, ...] = ()) -> dict:
    """The data needed to repeat a run: configuration, versions (also of `others`), device, seconds."""
    return {
        "config": _strict(config.model_dump(mode="json")),
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in (*_PACKAGES, *others)},
        },
        "dtype": str(dtype),
        "device": jax.devices()[0].platform,
        "timings": {key: round(value, 3) for key, value in timings.items()},
    }


def _strict(value: Any) -> Any:
    """Settings as strict JSON, with what TOML calls inf as text."""
    if isinstance(value, dict):
        return {key: _strict(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_strict(part) for part in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


@contextlib.contextmanager
def timed(timings: dict[str, float], name: str) -> Iterator[None]:
    """Record the seconds that the block took."""
    start = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - start


def outcome_counts(results: Any) -> dict[str, int]:
    """The number of problems with each outcome, by name."""
    values, counts = np.unique(np.asarray(results, int), return_counts=True)
    return {warpopt.Outcome(v).name: n for v, n in zip(values.tolist(), counts.tolist(), strict=True)}


def finite_or_none(value: ArrayLike) -> float | None:
    """A scalar as a float for strict JSON, which has no infinities."""
    number = float(np.asarray(value))
    return number if math.isfinite(number) else None


def write_json(path: Path, data: Any) -> None:
    """Strict JSON."""
    path.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def write_csv(path: Path, heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """A table; floats in Python's format, which reads back exactly; empty for None."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)


def write_mark(folder: Path, record: dict[str, Any]) -> None:
    """The record that marks a folder as a result; lists its files."""
    write_json(folder / MARK, record | {"files": sorted([*(path.name for path in folder.iterdir()), MARK])})

"""Objects of a glTF file's JSON; every value is checked on access."""

import contextlib
import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np


class GltfError(ValueError):
    """An error in a file; the message lacks the file's path."""


@contextlib.contextmanager
def told_of(path: Path) -> Iterator[None]:
    """Add the file's path to errors."""
    try:
        yield
    except GltfError as error:
        raise ValueError(f"{path}: cannot be read as glTF: {error}") from None


@dataclasses.dataclass(frozen=True)
class Item:
    """A JSON object of the file.

    Attributes:
        data: the JSON object.
        where: its name in messages.
    """

    data: dict[str, Any]
    where: str

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def refused(self, key: str, expected: str) -> GltfError:
        """The error for an unexpected value of `key`."""
        if key not in self.data:
            return GltfError(f"{self.where}: got no {key}, expected {expected}")
        return GltfError(f"{self.where}: got {key} {short(self.data[key])}, expected {expected}")

    def integer(self, key: str, default: int | None = None, least: int = 0) -> int:
        """An integer; `default` if it is missing, where None makes it required."""
        if key not in self.data and default is not None:
            return default
        value: Any = self.data.get(key)
        whole = isinstance(value, float) and value.is_integer()  # JSON has one kind of number
        if isinstance(value, bool) or not (isinstance(value, int) or whole) or not least <= value < 2**53:
            raise self.refused(key, f"an integer from {least}")
        return int(value)

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; `default` if it is missing, where None makes it required."""
        if key not in self.data and default is not None:
            return default
        value: Any = self.data.get(key)
        if not _is_finite(value):
            raise self.refused(key, "a finite number")
        return float(value)

    def numbers(self, key: str, default: list[float], count: int | None = None) -> np.ndarray:
        """A list of finite numbers, `count` if that is given; `default` if it is missing."""
        value = self.data.get(key, default)
        count = len(default) if count is None else count
        if not isinstance(value, list) or len(value) != count or not all(_is_finite(v) for v in value):
            raise self.refused(key, f"{count} finite numbers")
        return np.array(value, float)

    def text(self, key: str) -> str:
        """A text; empty if it is missing."""
        value = self.data.get(key, "")
        if not isinstance(value, str):
            raise self.refused(key, "a text")
        return value

    def texts(self, key: str) -> list[str]:
        """A list of texts; empty if it is missing."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.refused(key, "a list of names")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise self.refused(key, "true or false")
        return value

    def child(self, key: str) -> "Item | None":
        """The object of `key`; None if it is missing."""
        if key not in self.data:
            return None
        if not isinstance(self.data[key], dict):
            raise self.refused(key, "an object")
        return Item(self.data[key], f"{self.where}, {key}")

    def required(self, key: str) -> "Item":
        """The object of `key`."""
        found = self.child(key)
        if found is None:
            raise self.refused(key, "an object")
        return found

    def children(self, key: str, singular: str) -> "list[Item]":
        """The objects of the list `key`; empty if it is missing."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.refused(key, "a list of objects")
        return [Item(v, f"{self.where}, {singular} {i}") for i, v in enumerate(value)]

    def extension(self, name: str) -> "Item | None":
        """The object of an extension; None if there is none."""
        extensions = self.child("extensions")
        found = extensions.child(name) if extensions is not None else None
        return Item(found.data, f"{self.where}, {name}") if found is not None else None


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def short(value: Any) -> str:
    """A value for a message, shortened."""
    text = json.dumps(value, ensure_ascii=False) if not isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

"""The rows of reference.md: where each name is written, and the first line of its docstring.

python docs/write_reference.py

A new public name needs a row with nothing but the name, "| `theory.name` | |", in the table where it belongs.
"""

import functools
import importlib
import inspect
import re
from pathlib import Path

PAGE = Path(__file__).parent / "reference.md"
ROW = re.compile(r"^\| \[?`([\w.]+)`(?:\]\(\S+\))? \|.*\|$", re.M)


def described(page: str) -> str:
    """The page with every name's place and description as the package has them."""

    def row(found: re.Match) -> str:
        subject = functools.reduce(getattr, found[1].split("."), importlib.import_module("warpopt"))
        words = inspect.getdoc(subject).splitlines()[0].removesuffix(".").replace("|", r"\|")
        return f"| [`{found[1]}`](../src/{subject.__module__.replace('.', '/')}.py) | {words} |"

    return ROW.sub(row, page)


if __name__ == "__main__":
    PAGE.write_text(described(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

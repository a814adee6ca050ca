"""The second column of reference.md: the first line of each name's docstring.

python docs/write_reference.py
"""

import importlib
import inspect
import re
from pathlib import Path

PAGE = Path(__file__).parent / "reference.md"
ROW = re.compile(r"^(\| \[`([\w.]+)`\]\(\.\./src/(warpopt/[\w/]+)\.py\) \| ).* \|$", re.M)


def described(page: str) -> str:
    """The page with every name's description as its docstring has it."""

    def row(found: re.Match) -> str:
        start, name, module = found.groups()
        subject = getattr(importlib.import_module(module.replace("/", ".")), name.split(".")[-1])
        words = inspect.getdoc(subject).splitlines()[0].removesuffix(".").replace("|", r"\|")
        return f"{start}{words} |"

    return ROW.sub(row, page)


if __name__ == "__main__":
    PAGE.write_text(described(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

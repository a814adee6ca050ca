"""Text helpers for reports: tables, pictures and phrases."""

from collections.abc import Iterable, Sequence


def markdown_table(heads: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(cells) + " |\n" for cells in (heads, *rows)]
    return "".join([lines[0], "|" + "---|" * len(heads) + "\n", *lines[1:]])


def markdown_pictures(figures: Iterable[tuple[str, str]], ending: str = ".png") -> list[str]:
    """Each (file stem, caption) as a picture in Markdown."""
    return [f"![{stem}]({stem}{ending})\n\n*{caption}*\n" for stem, caption in figures]


def phrase(items: Sequence[str]) -> str:
    """Items as a phrase: a, b and c."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))

"""The site: the same pages as on the forge, the reference filled in from docstrings, formulas as MathML.

    sphinx-build -W -q -c docs . build/site

reads the repository's root, so that links between pages and into the source hold as they stand. It needs no network,
and neither do its readers.
"""

import functools
import inspect
import re
from pathlib import Path

project = "warpopt"
author = "The warpopt founders"
html_title = "warpopt"
html_theme = "furo"
html_show_copyright = html_copy_source = html_show_sourcelink = False

root_doc = "README"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/*.md"]
PAGES = [
    "objectives", "direction", "pixels", "stability", "cascades", "scenes", "support", "comparing", "gallery",
    "engines", "theory", "corrections", "claims", "performance", "scaling", "glossary",
]  # fmt: skip
PAGES += ["reference"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = {"math"}
myst_heading_anchors = 3
html_math_renderer = "mathml"

default_role = "py:obj"  # what stands in `backticks`
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_class_signature = "separated"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 90
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
napoleon_use_ivar = True  # attributes are listed where the docstring lists them, and once
suppress_warnings = ["ref.python"]  # of a name that several classes have, such as `start`, any will do

ARRAY = "jaxlib._jax.Array"
ARRAY_LIKE = f"~jax.{ARRAY} | ~numpy.ndarray | ~numpy.bool | ~numpy.number | bool | int | float | complex"
NUMBERS = re.compile(r"ArrayLike \| ~?[\w.]*Sequence\[ArrayLike\] \| ~?[\w.]*Sequence\[~?[\w.]*Sequence\[ArrayLike\]\]")
NAMED = re.compile(r"^\| \[`([\w.]+)`\]\(\.\./src/warpopt/[\w/]+\.py\) \|.*\n", re.M)


def directive(name: str) -> str:
    """What makes autodoc describe warpopt.<name>."""
    import warpopt

    found = functools.reduce(getattr, name.split("."), warpopt)
    kind, options = ("class", "   :members:\n") if inspect.isclass(found) else ("function", "")
    return f"```{{eval-rst}}\n.. auto{kind}:: warpopt.{name}\n{options}```\n\n"


def filled(app, page: str, source: list[str]) -> None:
    """README gets its table of contents; the reference's tables of names become descriptions."""
    if page == root_doc:
        pages = "\n".join([f"docs/{name}" for name in PAGES] + ["CONTRIBUTING", "CHANGELOG"])
        source[0] += f"\n```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    if page == "docs/reference":
        text = re.sub(r"^\| *\| *\|\n\|---\|---\|\n", "", source[0], flags=re.M)
        source[0] = NAMED.sub(lambda row: directive(row[1]), text)


def as_written(app, what, name, subject, options, lines: list[str]) -> None:
    """Docstrings are plain text with `names` in it: |x| and a * b are no markup."""
    example = False
    for i, line in enumerate(lines):
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        if not example:
            lines[i] = re.sub(r"`[^`]*`|[|*]", lambda found: found[0] if found[0][0] == "`" else f"\\{found[0]}", line)


def short_types(app, what, name, subject, options, signature, returned):
    """The names that the source has, not what they stand for."""

    def short(text: str | None) -> str | None:
        if text is None:
            return None
        text = text.replace(ARRAY_LIKE, "ArrayLike").replace(f"~jax.{ARRAY}", "Array").replace(ARRAY, "Array")
        return NUMBERS.sub("ArrayLike | list", text)

    return short(signature), short(returned)


def mathml(display: str, tag: str):
    """A writer of formulas that browsers draw by themselves."""
    from docutils import nodes
    from latex2mathml.converter import convert
    from sphinx.util import logging

    def visit(writer, node) -> None:
        writer.body.append(writer.starttag(node, tag, "", CLASS="math"))
        formula = convert(node.astext().strip(), display=display)
        if "\\" in formula or "<mi>&<" in formula:  # a command or an environment that is not drawn
            logging.getLogger(__name__).warning("not known to latex2mathml: %s", node.astext())
        writer.body.append(f"{formula}</{tag}>")
        raise nodes.SkipNode

    return visit, None


def start_page(app, error) -> None:
    """A way in under the usual name."""
    if error is None:
        start = '<!doctype html><meta http-equiv="refresh" content="0; url=README.html"><title>warpopt</title>\n'
        (Path(app.outdir) / "index.html").write_text(start, encoding="utf-8")


def setup(app) -> dict:
    app.add_html_math_renderer("mathml", mathml("inline", "span"), mathml("block", "div"))
    app.connect("source-read", filled)
    app.connect("autodoc-process-docstring", as_written, priority=100)  # before sections become markup
    app.connect("autodoc-process-signature", short_types)
    app.connect("build-finished", start_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

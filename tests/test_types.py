"""Signatures: read by a static checker, no array of unknown shape, every parameter explained. A lane checks them at run
time."""

import enum
import importlib
import inspect
import json
import pkgutil
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest
from jax.typing import ArrayLike

import warpopt
from warpopt.cascades import splits

ROOT = Path(__file__).parents[1]
PACKAGES = ["warpopt", *(m.name for m in pkgutil.iter_modules(warpopt.__path__, "warpopt.") if m.ispkg)]


def test_the_static_checker_finds_nothing():
    """basedpyright over src, as pyproject asks for it; an installed warpopt brings its types along."""
    found = subprocess.run(
        [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable],
        cwd=ROOT, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    answer = json.loads(found.stdout)
    told = [f"{d['file']}:{d['range']['start']['line'] + 1}: {d['message']}" for d in answer["generalDiagnostics"]]
    assert answer["summary"]["filesAnalyzed"] > 100
    assert not told, "\n".join(told)
    assert (ROOT / "src/warpopt/py.typed").exists()


def is_bare(annotation: object) -> bool:
    """Whether it has an Array without a shape; ArrayLike is what users give, of whatever shape the text says."""
    if annotation is jax.Array:
        return True
    if annotation == ArrayLike:
        return False
    parts = [part for arg in typing.get_args(annotation) for part in (arg if isinstance(arg, list) else [arg])]
    given = set(typing.get_args(ArrayLike))
    return any(is_bare(part) for part in parts if not (given <= set(parts) and part in given))


def public_callables() -> Iterator[tuple[str, typing.Any]]:
    """Of every room: functions, classes, their public methods and properties."""
    for package in PACKAGES:
        if package == "warpopt.app":
            continue
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", [n for n in dir(module) if not n.startswith("_")]):
            found = getattr(module, name)
            if not callable(found):
                continue
            yield f"{package}.{name}", found
            for key, member in vars(found).items() if inspect.isclass(found) else ():
                member = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
                member = inspect.unwrap(member) if callable(member) else member  # what is compiled
                if not key.startswith("_") and inspect.isfunction(member):
                    yield f"{package}.{name}.{key}", member


def test_no_public_signature_has_an_array_of_unknown_shape():
    signatures = {}
    for name, found in public_callables():
        try:
            signatures[name] = inspect.signature(found)
        except ValueError:  # a Literal, an enum
            continue
    assert len(signatures) > 100
    bare = [
        (name, key)
        for name, signature in signatures.items()
        for key, annotation in [
            *((k, p.annotation) for k, p in signature.parameters.items()), ("return", signature.return_annotation)
        ]
        if is_bare(annotation)
    ]  # fmt: skip
    assert not bare


@pytest.mark.parametrize(("annotation", "bare"), [
    (jax.Array, True), (tuple[jax.Array, float], True), (jax.Array | None, True), (ArrayLike, False),
    (ArrayLike | None, False), (typing.Any, False),
])  # fmt: skip
def test_what_is_bare(annotation, bare):
    assert is_bare(annotation) is bare


def docstrings(found: typing.Any) -> str:
    """A callable's, and those of the methods that it overrides; a class's with its constructor's."""
    owner, _, key = getattr(found, "__qualname__", "").rpartition(".")
    if inspect.isclass(found):
        each = [found, found.__init__]
    elif owner and "<" not in owner:
        bases = inspect.getmro(getattr(sys.modules[found.__module__], owner))
        each = [getattr(base, key) for base in bases if key in vars(base)]
    else:
        each = [found]
    return "\n\n".join(filter(None, map(inspect.getdoc, each)))


def unexplained(found: typing.Any) -> list[str]:
    """What a docstring lacks: parameters, by name, in its `Args:` or, without one, anywhere; a function's `Returns:`.

    The attributes of a class that is a record are its parameters. A function whose docstring has no `Args:` says in its
    first line what it returns.
    """
    text = docstrings(found)
    sections = re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?)+)", text, re.M)
    entries = re.findall(r"^    (\w+(?:, \w+)*): ", "".join(sections), re.M)
    named = {name for entry in entries for name in entry.split(", ")} if sections else set(re.findall(r"\w+", text))
    lacks = [name for name in inspect.signature(found).parameters if name not in {*named, "self", "cls"}]
    alone = inspect.isfunction(found) and "." not in found.__qualname__
    return [*lacks, "Returns:"] if alone and "Args:" in text and "Returns:" not in text else lacks


def test_every_parameter_is_explained():
    """Of functions, methods and constructors; an override may leave it to what it overrides."""
    schemes = {**splits.SCHEMES, **splits.ENGINES, "fractions": splits.fractions, "stepped": splits.stepped}
    told = dict(public_callables()) | {f"warpopt.cascades.splits.{name}": found for name, found in schemes.items()}
    functions = {}
    for name, found in told.items():
        try:
            inspect.signature(found)
        except ValueError:  # a Literal
            continue
        if not (inspect.isclass(found) and issubclass(found, enum.Enum)):
            functions[name] = found
    assert len(functions) > 200
    assert {name: lacks for name, found in functions.items() if (lacks := unexplained(found))} == {}


def test_what_is_unexplained():
    def scaled(x: float, factor: float) -> float:
        """x times a factor.

        Args:
            x: of any sign.
        """
        return x * factor

    scaled.__qualname__ = "scaled"
    assert unexplained(scaled) == ["factor", "Returns:"]
    scaled.__doc__ = "x times the factor."
    assert unexplained(scaled) == []
    scaled.__doc__ = "The product."
    assert unexplained(scaled) == ["x", "factor"]

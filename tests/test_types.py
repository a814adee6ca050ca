"""Signatures: read by a static checker, and no array of unknown shape in them. A lane checks them at run time."""

import importlib
import inspect
import json
import pkgutil
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest
from jax.typing import ArrayLike

import warpopt

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

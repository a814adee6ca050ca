"""The user's rules: functions in their modules, which are located first and imported later."""

import contextlib
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from ..common.settings import ConfigError
from .settings import RulesConfig


def check_modules(rules: RulesConfig, folder: Path) -> None:
    """Refuse, before any work, modules that do not exist; their contents are checked on import.

    Raises:
        ConfigError: names the rule and the module.
    """
    with _beside(folder):
        for name, place in rules.own.items():
            module = place.partition(":")[0]
            package = module.partition(".")[0]  # searching for a submodule would import its package
            if importlib.util.find_spec(package) is None:
                raise ConfigError(
                    f"rules.own.{name}: got module {package!r}, which is neither installed nor in {folder}"
                )


def own_rules(rules: RulesConfig, folder: Path) -> dict[str, Callable]:
    """The user's functions. Imports their modules, which may import JAX.

    Raises:
        ConfigError: a module that cannot be imported, or that has no such function.
    """
    found = {}
    with _beside(folder):
        for name, place in rules.own.items():
            module_name, _, function = place.partition(":")
            try:
                module = importlib.import_module(module_name)
            except Exception as error:  # a user's module may raise anything
                words = f"{type(error).__name__}: {error}".splitlines()[0]
                raise ConfigError(f"rules.own.{name}: module {module_name!r} cannot be imported: {words}") from error
            rule = getattr(module, function, None)
            if rule is None:
                raise ConfigError(f"rules.own.{name}: got {function!r}, which module {module_name!r} does not have")
            if not callable(rule):
                expected = "expected a callable (frustum, theta) -> warpopt.Warp"
                raise ConfigError(f"rules.own.{name}: got {place}, of type {type(rule).__name__}; {expected}")
            found[name] = rule
    return found


@contextlib.contextmanager
def _beside(folder: Path) -> Iterator[None]:
    """Put the folder first on the module search path."""
    entry = str(folder.resolve())
    sys.path.insert(0, entry)
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(entry)

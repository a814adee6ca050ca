"""Rules for lambda from the literature and from engines, for comparison with the optimum.

`registry` lists them; a function is loaded on first use, as in `warpopt` itself.
"""

import importlib
from typing import TYPE_CHECKING

from .registry import ENGINES, EVERY, PUBLISHED, Rule

__all__ = ["ENGINES", "PUBLISHED", "Body", "Rule", *EVERY]  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from .body import Body
    from .engines import *  # noqa: F403
    from .published import *  # noqa: F403


def __getattr__(name: str):
    if name in EVERY:
        return EVERY[name].function
    if name == "Body":
        return importlib.import_module(".body", __name__).Body
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)

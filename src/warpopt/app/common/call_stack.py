"""Where CPython keeps the frames of calls."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")

_SLOTS = 2**17  # of a frame: 1 MiB, of which nothing is written


def with_room_for_calls(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The function, with room for the frames of the calls within it.

    CPython keeps frames in chunks of 16 KiB. It maps one as a call crosses the end of the last, and unmaps it when that
    call returns: again and again for calls in a loop near such an end, which takes a twentieth of the time of tracing.
    A frame of 1 MiB gets a chunk of 2 MiB, and the calls within it have the rest.
    """

    def large(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        return function(*args, **kwargs)

    large.__code__ = large.__code__.replace(co_stacksize=_SLOTS)
    return functools.wraps(function)(large)

"""The names of warps: "none", a rule, "edge", "band", METRIC-NORM such as "p-inf", and "best". Does not import JAX.

"turned-" before an objective that compares directions warps along the best direction; "shaped-" also gives the map the
best aspect.
"""

import difflib

from .._words import shown
from ..objective import METRICS, MOST_MOMENTS, Objective
from ..rules.registry import EVERY

STABLE = ("sphere", "sphere-receivers")
"""Engines' fits without a warp whose texels stay where they are."""
DEFAULT = ("none", "lispsm", "tsm", "filament", "p-inf", "edge", "band", "turned-edge", "turned-band", "best")
PREFIXES = ("turned-", "shaped-")
WINDOW = "window-"
"""Before a warp's name: fitted once with a margin, then kept or scrolled."""


def turn_of(name: str) -> tuple[str, str]:
    """(the prefix of a turned warp, or nothing; the rest of its name).

    Example:
        >>> turn_of("turned-edge"), turn_of("edge")
        (('turned-', 'edge'), ('', 'edge'))
    """
    prefix = next((p for p in PREFIXES if isinstance(name, str) and name.startswith(p)), "")
    return prefix, name.removeprefix(prefix) if prefix else name


def objective_of(name: str) -> Objective | None:
    """The objective that a name asks to minimise; None for "none", a rule and "best".

    Raises:
        ValueError: an unknown name.

    Example:
        >>> objective_of("pxq-l2").title, objective_of("lispsm")
        ('E_pxq, norm l2', None)
    """
    prefix, rest = turn_of(name)
    if prefix:
        objective = objective_of(rest)
        if objective is None or not objective.in_any_direction:
            raise ValueError(f"got {shown(name)}, expected 'edge', 'band', 'storage-inf' or pxq's after {prefix!r}")
        return objective
    if name in ("none", "best") or (name in EVERY and name != "ssm"):
        return None
    metric, _, norm = name.partition("-") if isinstance(name, str) else ("", "", "")
    if metric in METRICS and bool(norm) != (metric in ("edge", "band")):
        objective = Objective(metric, norm or None)
        if not objective.over_receivers:
            raise ValueError(
                f"got {shown(name)}, expected an order that makes (2 alpha + beta) times it an integer, at most "
                f"{MOST_MOMENTS}"
            )
        return objective
    known = [*DEFAULT, *(rule for rule in EVERY if rule not in (*DEFAULT, "ssm"))]
    near = difflib.get_close_matches(str(name), known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(
        f"got {shown(name)}, expected 'none', 'best', a rule ({', '.join(r for r in EVERY if r != 'ssm')}), 'edge', "
        f"'band' or a metric and a norm such as 'p-inf'{hint}"
    )


def warp_of_method(name: str) -> str | None:
    """The warp that a path's method fits: of its name, without "held-"; None for a snapped sphere.

    Raises:
        ValueError: an unknown name, or "best", which no engine could search.

    Example:
        >>> warp_of_method("held-p-inf"), warp_of_method("sphere")
        ('p-inf', None)
    """
    if name in STABLE:
        return None
    warp = name.removeprefix("held-").removeprefix(WINDOW) if isinstance(name, str) else ""
    try:
        objective = objective_of(warp)
        # A stable window minimises an objective, or has no warp: a rule has no error that could pass a tolerance.
        known = warp != "best" and not (name.startswith(WINDOW) and objective is None and warp != "none")
    except ValueError:
        known = False
    if not known:
        raise ValueError(
            f"got {shown(name)}, expected {' or '.join(map(repr, STABLE))}, or a warp that does not need the truth "
            "('none', a rule, 'edge', 'band' or a metric and a norm such as 'p-inf'), with or without 'held-' before "
            "it, or 'window-' before 'none' or an objective"
        )
    return warp


def title_of(name: str) -> str:
    """A warp's name for figures and reports.

    Example:
        >>> title_of("p-inf"), title_of("lispsm")
        ('E_p, norm inf', 'LiSPSM')
    """
    if name in EVERY:
        return EVERY[name].title
    prefix, rest = turn_of(name)
    if prefix:
        return f"{title_of(rest)}, turned" + (", best aspect" if prefix == "shaped-" else "")
    plain = {"none": "no warp", "best": "best eta of a scan", "edge": "edge-weighted", "band": "band"}
    objective = None if name in plain else objective_of(name)
    return plain[name] if objective is None else objective.title

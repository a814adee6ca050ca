"""The names of warps: "none", a rule, "edge", "band", METRIC-NORM such as "p-inf", and "best". Does not import JAX.

"turned-" before an objective that compares directions warps along the best direction; "shaped-" also gives the map the
best aspect. COUNT-SPLITS-WARP, such as "4-logarithmic-turned-edge", is so many cascades of together as many texels.
"""

import dataclasses
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
SCHEMES = ("uniform", "logarithmic", "practical")
"""Splits of the range of depths that receivers have."""
ENGINES = ("godot", "unity", "unreal", "bevy", "three", "filament")
"""Splits of the camera's range, by engines' defaults."""
MOST = 16
"""The largest number of cascades."""


@dataclasses.dataclass(frozen=True)
class Cascades:
    """What the name of several maps says.

    Attributes:
        count: of the maps; each has 1/count of the texels of one.
        splits: one of `SCHEMES` or `ENGINES`, or an objective whose best splits they are.
        warp: "none", "sphere", or an objective that warps each, with "turned-" or "shaped-" before it.
    """

    count: int
    splits: str
    warp: str

    @property
    def name(self) -> str:
        return f"{self.count}-{self.splits}-{self.warp}"

    @property
    def title(self) -> str:
        """Of figures and reports."""
        by = self.splits if self.splits in (*SCHEMES, *ENGINES) else f"best {title_of(self.splits)}"
        fit = "snapped spheres" if self.warp == "sphere" else title_of(self.warp)
        return f"{self.count} cascades, {by} splits, {fit}"


def cascades_of(name: str) -> Cascades | None:
    """The cascades that a name asks for; None for a single map's.

    Raises:
        ValueError: a name that begins with a number and is not COUNT-SPLITS-WARP.

    Example:
        >>> cascades_of("4-p-inf-turned-edge"), cascades_of("p-inf")
        (Cascades(count=4, splits='p-inf', warp='turned-edge'), None)
    """
    number, _, rest = name.partition("-") if isinstance(name, str) else ("", "", "")
    if not number.isdecimal():
        return None
    words = rest.split("-")
    for k in range(1, len(words)):
        splits, warp = "-".join(words[:k]), "-".join(words[k:])
        if _is_split(splits) and (warp in ("none", "sphere") or _is_objective(warp)) and 1 <= int(number) <= MOST:
            return Cascades(int(number), splits, warp)
    raise ValueError(
        f"got {shown(name)}, expected COUNT-SPLITS-WARP: a count from 1 to {MOST}, splits by "
        f"{', '.join(map(repr, (*SCHEMES, *ENGINES)))} or an objective, and 'none', 'sphere' or an objective, such as "
        "'4-logarithmic-turned-edge'"
    )


def _is_split(name: str) -> bool:
    return name in (*SCHEMES, *ENGINES) or (not turn_of(name)[0] and _is_objective(name))


def _is_objective(name: str) -> bool:
    try:
        return objective_of(name) is not None
    except ValueError:
        return False


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


def refuse_unknown(name: str) -> None:
    """Refuse what names neither a warp nor cascades.

    Raises:
        ValueError: as `objective_of` and `cascades_of`.
    """
    if cascades_of(name) is None:
        objective_of(name)


def warp_of_method(name: str) -> str | None:
    """The warp or the cascades that a path's method fits: its name without "held-" and "window-"; None for a sphere.

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
        cascades = cascades_of(warp)
        objective = None if cascades is not None else objective_of(warp)
        # A stable window minimises an objective, or has no warp: a rule has no error that could pass a tolerance.
        known = warp != "best" and not (name.startswith(WINDOW) and objective is None and warp != "none")
        if cascades is not None:  # splits in windows move in steps, and are not planned anew for each frame
            alone = cascades.splits in (*SCHEMES, *ENGINES) and cascades.warp != "sphere"
            known = warp == name or (alone and name == WINDOW + warp)
    except ValueError:
        known = False
    if not known:
        raise ValueError(
            f"got {shown(name)}, expected {' or '.join(map(repr, STABLE))}, or a warp that does not need the truth "
            "('none', a rule, 'edge', 'band' or a metric and a norm such as 'p-inf'), with or without 'held-' before "
            "it, or 'window-' before 'none' or an objective; or COUNT-SPLITS-WARP, with 'window-' before it if the "
            "splits are a scheme's or an engine's and the warp is not 'sphere'"
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
    cascades = cascades_of(name)
    if cascades is not None:
        return cascades.title
    prefix, rest = turn_of(name)
    if prefix:
        return f"{title_of(rest)}, turned" + (", best aspect" if prefix == "shaped-" else "")
    plain = {"none": "no warp", "best": "best eta of a scan", "edge": "edge-weighted", "band": "band"}
    objective = None if name in plain else objective_of(name)
    return plain[name] if objective is None else objective.title

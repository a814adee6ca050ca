"""What is minimised, as one static value: a metric, the order of a norm, and the measure of the norm.

Does not import JAX, so that settings can be checked before JAX is loaded.
"""

import contextlib
import dataclasses
import math
import numbers
from typing import Any, Literal, get_args

from ._words import one_of, shown

Measure = Literal["volume", "screen", "log_depth", "ground", "axis"]
# dm = z^-m dx dy dz. volume: uniform over V; screen: uniform over screen and depth; log_depth: over screen and log
# depth; ground: the density of a level ground plane. axis: x = y = 0, dz.
DENSITY_EXPONENT = {"volume": 0.0, "screen": 2.0, "log_depth": 3.0, "ground": 4.0}

MOST_MOMENTS = 66
"""The largest degree (2 alpha + beta) order over receivers: its binomial coefficients are 64-bit integers. Beyond it,
compiling takes minutes."""

_ORDERS = {"inf": math.inf, "l1": 1.0, "l2": 2.0}


def _number(value: Any, kind: Any = numbers.Real) -> float:
    """The number, NaN for what is none."""
    if isinstance(value, kind) and not isinstance(value, bool):
        with contextlib.suppress(ValueError, OverflowError):  # of Python's integers
            return float(value)
    return math.nan


@dataclasses.dataclass(frozen=True)
class Metric:
    """E_p^alpha E_q^beta, an aggregate of the aliasing errors of AT09 (13), (14).

    Args:
        alpha: exponent of E_p, the error along the screen's p (vertical) axis, >= 0.
        beta: exponent of E_q, the horizontal one, >= 0; not both zero.

    Raises:
        ValueError: for a negative, infinite or NaN exponent, or two zeros.

    Example:
        >>> Metric(1, 1).depth_power
        2.0
    """

    alpha: float
    beta: float

    def __post_init__(self):
        for name in ("alpha", "beta"):
            value = getattr(self, name)
            if not 0 <= _number(value) < math.inf:
                raise ValueError(f"metric: got {name} = {shown(value)}, expected a finite number >= 0")
            object.__setattr__(self, name, float(value))
        if self.alpha == self.beta == 0:
            raise ValueError("metric: got alpha = beta = 0, expected at least one positive exponent")
        if not math.isfinite(self.blend_power):
            raise ValueError(f"metric: got {self}, expected a finite 2 alpha + beta")

    @property
    def blend_power(self) -> float:
        """k = 2 alpha + beta, the power of A in E_p^alpha E_q^beta."""
        return 2 * self.alpha + self.beta

    @property
    def depth_power(self) -> float:
        """r = alpha + beta, the power of 1/z."""
        return self.alpha + self.beta


# Every named metric: the products of E_p and E_q whose maximum it is, or the product of whose maxima ("storage").
METRICS: dict[str, tuple[Metric, ...]] = {
    "p": (Metric(1, 0),),
    "q": (Metric(0, 1),),
    "pxq": (Metric(1, 1),),
    "max": (Metric(1, 0), Metric(0, 1)),
    "storage": (Metric(1, 0), Metric(0, 1)),
    "edge": (),
    "band": (),
}


PRODUCTS = tuple(name for name, terms in METRICS.items() if len(terms) == 1)
"""The metrics that a view frustum accepts: a single product of E_p and E_q."""


@dataclasses.dataclass(frozen=True, init=False)
class Objective:
    """A norm of an aliasing error; hashable, so that a compiled solver can be specialised to it.

    Attributes:
        terms: the metrics whose maximum is taken; a single one, except for "max" and "storage"; none for "edge" and
            "band".
        storage: whether each term's maximum is taken for itself, and their product is the norm.
        kernel: the size of a texel (a name in `theory.KERNELS`) whose mean over weighted receivers this is: "edge",
            "band", or "max" in an L_P norm; None for all others, which need only extents or moments.
        order: P of the norm, inf for the maximum over the receivers.
        measure: name of the measure of an L_P norm (see `Measure`). Receivers that are a set (points, pixels, a
            histogram) are weighted by their weights and accept only the default.

    Example:
        >>> objective = Objective("pxq", "l2", "ground")
        >>> objective.name, objective.norm, objective.blend_degree
        ('pxq', 'l2', 6.0)
    """

    terms: tuple[Metric, ...]
    storage: bool
    kernel: str | None
    order: float
    measure: Measure

    def __init__(self, metric: str | Metric = "p", norm: str | float | None = None, measure: str = "screen"):
        """The objective by names.

        Args:
            metric: "p", "q", "pxq" or `Metric(alpha, beta)`; "max", the larger of E_p and E_q; "edge", the longer edge
                of a texel, max(E_p sqrt(1 + sigma^2), E_q); "band", the expected offset of a shadow edge. The last
                three compare E_p with E_q, which is meaningful in pixels per texel: give the view `screen` and
                `shadow_map`, without which pixels are square and so is the map. "storage", in norm inf, is (max E_p)
                (max E_q): by what factor a map's texels must grow, at its best aspect, for one per pixel.
            norm: "inf", "l1", "l2" or any real order >= 1. None means "inf"; for "edge" and "band", which are means,
                "l1".
            measure: "volume", "screen", "log_depth", "ground" or "axis".

        Raises:
            ValueError: for an unknown word, an order below 1, or a norm whose minimum could not be certified.
        """
        terms = _terms(metric)
        averaged = not terms
        object.__setattr__(self, "storage", metric == "storage")
        if norm is None:
            norm = "l1" if averaged else "inf"
        object.__setattr__(self, "terms", terms)
        object.__setattr__(self, "order", order_of(norm))
        mean = averaged or (metric == "max" and not self.supremum)
        object.__setattr__(self, "kernel", metric if mean else None)
        one_of("measure", measure, get_args(Measure))
        object.__setattr__(self, "measure", measure)
        if self.storage and not self.supremum:
            raise ValueError(f"norm: got {norm!r}, expected 'inf' with metric 'storage', a product of two maxima")
        if averaged and self.supremum:
            raise ValueError(f"norm: got {norm!r}, expected 'l1', 'l2' or another finite order with metric {metric!r}")
        for term in terms if self.kernel is None else ():
            if not self.supremum and not math.isfinite(term.blend_power * self.order):
                raise ValueError(
                    f"norm: got order {self.order:g} with {term}, expected a finite (2 alpha + beta) order"
                )
            if term.beta > 0 and term.blend_power * self.order < 1:
                raise ValueError(
                    f"norm: got order {self.order} with {term}, expected (2 alpha + beta) order >= 1: below that the "
                    "objective may have several local minima and the optimum could not be certified"
                )

    @property
    def name(self) -> str:
        """The metric's name, as in files; "p^2 q^0.5" for exponents without a name."""
        named = "storage" if self.storage else self.kernel
        named = named or next((name for name, terms in METRICS.items() if terms == self.terms), None)
        return named or " ".join(
            f"{letter}^{power:g}"
            for letter, power in (("p", self.metric.alpha), ("q", self.metric.beta))
            if power
        )  # fmt: skip

    @property
    def norm(self) -> str:
        """The norm's name, as in files: "inf", "l1", "l2", or the order's digits."""
        return norm_name(self.order)

    @property
    def title(self) -> str:
        """Text for messages and figures: "E_pxq, norm l2"; "edge, norm l1" for what is no maximum of products."""
        if self.storage:
            return "storage"
        return f"{'E_' + self.name if self.terms else self.name}, norm {self.norm}"

    @property
    def in_any_direction(self) -> bool:
        """Whether it compares maps of different directions: areas and lengths of texels do, not E_p or E_q alone."""
        return self.storage or self.kernel in ("edge", "band") or self._area

    @property
    def in_any_aspect(self) -> bool:
        """Whether it compares maps of different aspects: what only grows as texels turn into slivers does not."""
        return self.storage or self.name == "max" or self.kernel is not None or self._area

    @property
    def _area(self) -> bool:
        return len(self.terms) == 1 and self.metric.alpha == self.metric.beta

    @property
    def metric(self) -> Metric:
        """The only term.

        Raises:
            ValueError: there are several terms.
        """
        term, *others = self.terms or (None,)
        if others or term is None:
            raise ValueError(f"metric: got {self.name!r}, expected one product of E_p and E_q")
        return term

    @property
    def supremum(self) -> bool:
        return math.isinf(self.order)

    @property
    def over_receivers(self) -> bool:
        """Whether receivers have it: a maximum, a mean of a size, or an order whose moments are few and exact."""
        degree = 0 if self.supremum or self.kernel is not None else self.blend_degree
        return degree == round(degree) and degree <= MOST_MOMENTS

    @property
    def resolution_power(self) -> float:
        """The error falls with this power of a map's linear resolution: r of its terms, 2 of "storage", 1 of a size."""
        if self.storage:
            return 2.0
        return self.terms[0].depth_power if self.terms else 1.0

    @property
    def has_alpha(self) -> bool:
        """Whether some term grows as eta falls, so that only the dtype limits eta from below."""
        return any(term.alpha for term in self.terms)

    @property
    def has_beta(self) -> bool:
        """Whether the error depends on the map's width."""
        return any(term.beta for term in self.terms)

    @property
    def blend_degree(self) -> float:
        """M = k P: the integrand's degree in A, hence in eta."""
        return self.metric.blend_power * self.order

    @property
    def volume_exponent(self) -> float:
        """q0 such that the measure's weight in (u, z) is z^-q0: the cross-section of V grows as z^2."""
        return 0.0 if self.measure == "axis" else DENSITY_EXPONENT[self.measure] - 2

    @property
    def depth_exponent(self) -> float:
        """Q such that the integrand is A^M z^-Q in (u, z)."""
        return self.metric.depth_power * self.order + self.volume_exponent

    @property
    def no_bound_because(self) -> str | None:
        """Why `lower_bound` has no bound, as text; None for E_p in any norm, E_q in L-inf, and their maximum."""
        if self.storage:
            return None
        if self.kernel is not None:
            return f"No lower bound is known for a mean of {self.name!r}."
        for term in self.terms:
            if term.beta and (term.alpha or not self.supremum):
                kind = "a product of E_p and E_q" if term.alpha else f"E_q in L_{self.order:g}"
                return f"No lower bound is known for {kind}."
        return None

    def single(self, term: Metric) -> "Objective":
        """The same norm of one term.

        Args:
            term: the only one.
        """
        return Objective(term, self.order, self.measure)


def objective_or_default(objective: Objective | None) -> Objective:
    """The objective, or E_p in L-inf for None.

    Raises:
        ValueError: anything else that is not an `Objective`.
    """
    if objective is None:
        return Objective()
    if not isinstance(objective, Objective):
        plain = isinstance(objective, str | numbers.Real | Metric)
        got = shown(objective) if plain else type(objective).__name__
        raise ValueError(f"objective: got {got}, expected a warpopt.Objective, such as Objective('pxq', 'l2')")
    return objective


def order_of(norm: str | float) -> float:
    """The order of a norm by its name or number.

    Raises:
        ValueError: not "inf", "l1", "l2" or a real number >= 1 (as a number or text).

    Example:
        >>> order_of("l2"), order_of(3), order_of("1.5")
        (2.0, 3.0, 1.5)
    """
    order = _ORDERS[norm] if isinstance(norm, str) and norm in _ORDERS else _number(norm, str | numbers.Real)
    if not order >= 1:
        raise ValueError(f"norm: got {shown(norm)}, expected 'inf', 'l1', 'l2' or a real order >= 1")
    return order


def norm_name(order: float) -> str:
    """The name of a norm, which `order_of` maps back to the order."""
    return next((name for name, value in _ORDERS.items() if value == order), repr(float(order)))


def _terms(metric: str | Metric) -> tuple[Metric, ...]:
    if isinstance(metric, Metric):
        return (metric,)
    if not isinstance(metric, str) or metric not in METRICS:
        names = ", ".join(map(repr, METRICS))
        raise ValueError(f"metric: got {shown(metric)}, expected {names} or warpopt.Metric(alpha, beta)")
    return METRICS[metric]

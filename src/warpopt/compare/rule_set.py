"""The rules to compare: by name, any callable (frustum, theta) -> Warp, or both; results are checked at each call."""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import trusted
from .._words import shown
from ..rules import registry
from ..solve.chunks import in_blocks, in_chunks
from ..theory.view_frustum import ViewFrustum
from ..theory.warp import Warp
from ..views import FrustumView

Rule = Callable[[Any, Float[Array, "..."]], Warp]  # takes a view frustum; warpopt's rules also take a `Body`
Rules = None | str | Rule | Sequence[str | Rule] | Mapping[str, str | Rule]
KNOWN: dict[str, Rule] = {name: rule.function for name, rule in registry.EVERY.items()}


class RuleError(ValueError):
    """An invalid rule, or a rule with an invalid result."""


def rule_set(rules: Rules) -> dict[str, Rule]:
    """The rules by name; None means every rule of `rules.PUBLISHED` and `rules.ENGINES`.

    Raises:
        RuleError: an unknown name, something that cannot be called, a name twice, or no rule.
    """
    if rules is None:
        return dict(KNOWN)
    if isinstance(rules, str) or callable(rules):
        rules = [rules]
    if not isinstance(rules, Iterable):
        raise RuleError(f"rules: got {shown(rules)}, expected a name, a callable, a list or a dict of these")
    if isinstance(rules, Mapping):
        found = [(name, _rule(rule)) for name, rule in rules.items()]
    else:
        found = [(rule if isinstance(rule, str) else _name(rule), _rule(rule)) for rule in rules]
    if not found:
        raise RuleError("rules: got none, expected at least one")
    names = [name for name, _ in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RuleError(f"rules: got {twice[0]!r} twice, expected distinct names; a dict gives callables theirs")
    return dict(found)


def _name(rule: Rule) -> str:
    if isinstance(rule, registry.Rule):
        return rule.name
    return getattr(rule, "__name__", type(rule).__name__)


def _rule(rule: str | Rule) -> Rule:
    if isinstance(rule, str):
        if rule not in KNOWN:
            raise RuleError(f"rules: got {rule!r}, expected a callable or one of {', '.join(KNOWN)}")
        return KNOWN[rule]
    if isinstance(rule, registry.Rule):
        return rule.function
    if not callable(rule):
        raise RuleError(f"rules: got {shown(rule)}, expected a name or a callable (frustum, theta) -> warpopt.Warp")
    return rule


def takes_body(name: str, rule: Rule) -> bool:
    """Whether a rule is one of warpopt's that accept a `Body` instead of a frustum."""
    return KNOWN.get(name) is rule and registry.EVERY[name].takes_body


def warps_of(rules: Mapping[str, Rule], view: FrustumView) -> tuple[list[Array], list[Array]]:
    """(each rule's eta over V, where it is defined), over all directions.

    warpopt's rules are one compiled call. Other rules are called uncompiled, on concrete arrays, so that they may
    branch, print, or use NumPy; those that do not accept an array (`math.sin`, an `if`) with one angle at a time.

    Raises:
        RuleError: a rule that raises, returns no `Warp`, one whose shape is not theta's, or an invalid eta.
    """
    own = tuple(name for name, rule in rules.items() if KNOWN.get(name) is rule)
    compiled = dict(zip(own, in_blocks(_own, (view,), own), strict=True))
    found = []
    for name, rule in rules.items():
        if name in compiled:
            found.append(compiled[name])
        else:
            warp = _called(name, rule, view).over(view)
            found.append((jnp.where(jnp.isnan(warp.eta), 1, warp.eta), warp.defined))
    return [eta for eta, _ in found], [defined for _, defined in found]


def warps_over(rules: Mapping[str, Rule], view: FrustumView) -> Warp:
    """The warps (rules,) of rules over V, for one direction; raises as `warps_of`."""
    every = eqx.tree_at(lambda v: v.theta, view, view.theta[None])
    return stacked([jax.tree.map(lambda v: jnp.asarray(v)[0], _called(*rule, every)) for rule in rules.items()])


def stacked(warps: Sequence[Warp]) -> Warp:
    """Warps of one shape, with a leading axis."""
    return jax.tree.map(lambda *fields: jnp.stack(fields), *warps)


@functools.partial(jax.jit, static_argnames=("names",))
def _own(view: FrustumView, names: tuple[str, ...]) -> list[tuple[Array, Array]]:
    return in_chunks(_own_chunk, (view,), names)


def _own_chunk(view: FrustumView, names: tuple[str, ...]) -> list[tuple[Array, Array]]:
    with trusted():  # the view is checked
        warps = [KNOWN[name](view.frustum, view.theta) for name in names]
    return [(warp.eta, warp.defined) for warp in warps]


def _called(name: str, rule: Rule, view: FrustumView) -> Warp:
    """The rule's warp, of theta's shape; eta = 1 where it is undefined."""
    try:
        return _checked(name, rule, view.frustum, view.theta)
    except RuleError as error:
        # raised by Python for an array instead of a number, by NumPy and JAX for an array as a truth value
        if not isinstance(error.__cause__, TypeError | ValueError):
            raise
    distinct, places = np.unique(np.asarray(view.theta), return_inverse=True)  # `at_points` pads by repetition
    each = stacked([_checked(name, rule, view.frustum, jnp.asarray(one)) for one in distinct])
    return jax.tree.map(lambda v: v[places], each)


def _checked(name: str, rule: Rule, frustum: ViewFrustum, theta: Array) -> Warp:
    try:
        warp = rule(frustum, theta)
    except Exception as error:  # a user's function may raise anything
        words = f"{type(error).__name__}: {error}".splitlines()[0]
        raise RuleError(
            f"rule {name}: it raised {words}; expected a function of arrays, called with theta of shape {theta.shape}"
        ) from error
    if not isinstance(warp, Warp):
        raise RuleError(f"rule {name}: got {type(warp).__name__} from it, expected a warpopt.Warp")
    fields = [np.asarray(v) for v in (warp.eta, warp.one_minus_eta, warp.start, warp.mu, warp.defined)]
    try:
        eta, rest, start, mu, defined = (np.broadcast_to(field, theta.shape) for field in fields)
    except ValueError:
        raise RuleError(
            f"rule {name}: got a warp of shape {np.broadcast_shapes(*(f.shape for f in fields))} from it, expected "
            f"theta's {theta.shape}"
        ) from None
    bad = defined & ~((eta > 0) & (eta <= 1))
    if bad.any():
        at = float(np.rad2deg(np.asarray(theta)[bad].flat[0]))
        raise RuleError(
            f"rule {name}: got eta = {eta[bad].flat[0]:g} from it at theta = {at:g} degrees, expected a number in (0, "
            "1] (or `Warp.defined` False)"
        )
    eta, rest = np.where(defined, eta, 1), np.where(defined, rest, 0)
    eta, rest, start, mu = (jnp.asarray(v, theta.dtype) for v in (eta, rest, start, mu))
    return Warp(eta, rest, start, mu, jnp.asarray(defined))

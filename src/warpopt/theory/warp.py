"""The warp: a bounded number eta in (0, 1] that replaces the near-plane distance lambda of the warping frustum."""

from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, checked, float_arrays, instance, is_traced
from .._numerics import compiled
from .._words import shown
from .view_frustum import ViewFrustum


@runtime_checkable
class Body(Protocol):
    """The body that a warp is made for: a light space, a view, a footprint, an `Extent`."""

    @property
    def start(self) -> Float[Array, "..."]:
        """Least Z_w . c, from the eye."""
        ...

    @property
    def mu(self) -> Float[Array, "..."]:
        """Depth range along Z_w, > 0."""
        ...


class Extent(NamedTuple):
    """Start (from the eye) and length of a body along Z_w.

    Attributes:
        start, mu: lengths, of shapes that broadcast.

    Example:
        >>> Extent(1.0, 99.0).mu
        99.0
    """

    start: Float[Array, "..."]
    mu: Float[Array, "..."]


class Warp(eqx.Module):
    """A perspective warp of a shadow map, eta = lambda / (lambda + mu); eta = 1 is no warp (lambda = inf).

    A warp stores the extent of the body it was made for: its apex lies at start - lambda along Z_w from the eye, and
    stays there when the warp is used over other receivers (`over`).

    Attributes:
        eta: warp parameter in (0, 1]; at theta = pi/2 LiSPSM has sqrt(n/f) and PSM n/f.
        one_minus_eta: 1 - eta, stored to keep a weak warp accurate.
        start: where the body begins along Z_w, a length from the eye.
        mu: depth range of the warping frustum, a length.
        defined: False where a published rule yields no lambda > 0; eta is then 1 (no warp).
        promised: of a table's warp, whether its inputs lie within the table's ranges, so that its promise holds; None
            of all others.

    Example:
        >>> warp = Warp.from_lam(11.0, Extent(start=1.0, mu=99.0))
        >>> round(float(warp.eta), 6), round(float(warp.lam), 4)
        (0.1, 11.0)
    """

    eta: Float[Array, "..."]
    one_minus_eta: Float[Array, "..."]
    start: Float[Array, "..."]
    mu: Float[Array, "..."]
    defined: Bool[Array, "..."]
    promised: Bool[Array, "..."] | None = None

    @classmethod
    def from_eta(cls, eta: Numbers, body: Body) -> "Warp":
        """The warp of a given eta over a body.

        Args:
            eta: in (0, 1], of a shape that broadcasts with the body's.
            body: an object with `start` and `mu`: a `FrustumView`, a footprint, an `Extent`.

        Raises:
            ValueError: eta outside (0, 1], mu <= 0, or NaN; a body without an extent.
        """
        eta, start, mu = _with_extent("eta", eta, body)
        eta = checked("eta", eta, lambda v: (v > 0) & (v <= 1), "a number in (0, 1]")
        return _of_eta(eta, start, mu)

    @classmethod
    def from_lam(cls, lam: Numbers, body: Body) -> "Warp":
        """The warp of a given near-plane distance lambda (inf for none), a length, over a body as in `from_eta`.

        Args:
            lam: > 0, of a shape that broadcasts with the body's.
            body: an object with `start` and `mu`.

        Raises:
            ValueError: lambda <= 0, mu <= 0, or NaN; a body without an extent.
        """
        lam, start, mu = _with_extent("lam", lam, body)
        lam = checked("lam", lam, lambda v: v > 0, "a number > 0, or inf")
        return cls.from_range_ratio(mu / lam, Extent(start, mu))

    @classmethod
    def from_range_ratio(cls, ratio: ArrayLike, body: Body, defined: ArrayLike = True) -> "Warp":
        """The warp of a given mu / lambda >= 0, a form without infinities; eta = 1 where not `defined`.

        Args:
            ratio: mu / lambda, of a shape that broadcasts with the body's.
            body: an object with `start` and `mu`.
            defined: booleans, broadcast too.

        Raises:
            ValueError: a ratio that is negative, infinite or NaN where it is defined (traced values are not checked);
                a `defined` that is not true or false; a body without an extent.
        """
        _refuse_no_extent(body)
        if not is_traced(defined) and np.asarray(defined).dtype != bool:
            raise ValueError(f"defined: got {shown(defined)}, expected true or false")
        ratio, start, mu = float_arrays(ratio=ratio, start=body.start, mu=body.mu)
        if not is_traced(ratio, defined):
            own = jnp.asarray(np.where(defined, ratio, 0))
            checked("ratio", own, lambda v: (v >= 0) & (v < np.inf), "a finite number >= 0")
        return _of_ratio(ratio, start, mu, defined)

    @property
    def no_warp(self) -> Bool[Array, "..."]:
        return self.one_minus_eta == 0

    @property
    def unwarped(self) -> "Warp":
        """No warp, over the same body."""
        return Warp(jnp.ones_like(self.eta), jnp.zeros_like(self.eta), self.start, self.mu, self.defined)

    @property
    @compiled
    def lam_over_mu(self) -> Float[Array, "..."]:
        """lambda / mu = eta / (1 - eta), what VN's Figure 6 plots; inf for no warp, with zero gradient there."""
        safe = jnp.where(self.no_warp, 1, self.one_minus_eta)
        return jnp.where(self.no_warp, jnp.inf, self.eta / safe)

    @property
    @compiled
    def lam(self) -> Float[Array, "..."]:
        """Near-plane distance of the warping frustum, a length; inf for no warp."""
        safe = jnp.where(self.no_warp, 1, self.one_minus_eta)
        return jnp.where(self.no_warp, jnp.inf, self.mu * self.eta / safe)

    def strength(self, frustum: ViewFrustum) -> Float[Array, "..."]:
        """log(eta) / log(n/f): at theta = pi/2, 0 for SSM, 1/2 for LiSPSM and 1 for PSM.

        Args:
            frustum: of a shape that broadcasts with eta's.

        Raises:
            ValueError: not a `ViewFrustum`.
        """
        instance("frustum", frustum, ViewFrustum)
        return -jnp.log(self.eta) / jnp.log1p((frustum.far - frustum.near) / frustum.near)

    def over(self, body: Body) -> "Warp":
        """The warp with the same apex for another body under the same light: lambda' = lambda + (start' - start).

        eta = 1 stays 1. Where the apex does not lie before the body, eta is NaN and `defined` False; functions that use
        such a warp raise an error, or return NaN when traced.

        Args:
            body: an object with `start` and `mu`, of shapes that broadcast with eta's.

        Raises:
            ValueError: a body without an extent.

        Example:
            >>> farther = Warp.from_lam(11.0, Extent(1.0, 99.0)).over(Extent(5.0, 95.0))
            >>> round(float(farther.lam), 4)   # the apex stays 10 behind the eye
            15.0
        """
        _refuse_no_extent(body)
        dtype = self.eta.dtype
        return _over(self, jnp.asarray(body.start, dtype), jnp.asarray(body.mu, dtype))

    def lost_over(self, own: "Warp") -> Bool[Array, "..."]:
        """Where this warp has an eta but `own`, the same warp over another body, has none (apex not before it).

        Args:
            own: from `over`.
        """
        return jnp.isnan(own.eta) & ~jnp.isnan(self.eta)


@compiled
def _of_eta(eta: Array, start: Array, mu: Array) -> Warp:
    return Warp(eta, 1 - eta, start, mu, jnp.ones(eta.shape, bool))


@compiled
def _of_ratio(ratio: Array, start: Array, mu: Array, defined: ArrayLike) -> Warp:
    ratio = jnp.where(defined, ratio, 0)
    return Warp(1 / (1 + ratio), ratio / (1 + ratio), start, mu, jnp.broadcast_to(defined, ratio.shape))


@compiled
def _over(warp: Warp, start: Array, mu: Array) -> Warp:
    # Starts that are equal up to rounding are treated as equal: their difference would be all rounding where mu is
    # much smaller.
    eps = jnp.finfo(warp.eta.dtype).eps
    shift = start - warp.start
    same = jnp.abs(shift) <= 16 * eps * jnp.abs(start) + 4 * eps * mu
    same = same & (jnp.abs(mu - warp.mu) <= 16 * eps * mu)
    # eta' : 1 - eta' = lambda' : mu', both times (1 - eta).
    lam = warp.mu * warp.eta + shift * warp.one_minus_eta
    span = mu * warp.one_minus_eta
    before = same | (lam > 0) | warp.no_warp
    kept = same | warp.no_warp
    safe = jnp.where(before & ~kept, lam + span, 1)
    eta, rest = (
        jnp.where(kept, own, jnp.where(before, part / safe, jnp.nan))
        for own, part in ((warp.eta, lam), (warp.one_minus_eta, span))
    )
    return Warp(eta, rest, start, mu, warp.defined & before, warp.promised)


def refuse_lost(lost: Bool[Array, "..."]) -> None:
    """Refuse warps that have no eta over other receivers, see `Warp.lost_over`. Traced values are not checked.

    Raises:
        ValueError: the apex is not before the receivers.
    """
    if not is_traced(lost) and np.asarray(lost).any():
        raise ValueError(
            "warp: got an apex that is not before these receivers (lambda would not be positive), expected a warp made "
            "for a body that starts no later"
        )


def _refuse_no_extent(body: Body) -> None:
    if not (hasattr(body, "start") and hasattr(body, "mu")):
        raise ValueError(
            f"body: got {type(body).__name__}, expected an object with start and mu, such as a FrustumView or an Extent"
        )


def _with_extent(name: str, value: Numbers, body: Body) -> tuple[Array, Array, Array]:
    _refuse_no_extent(body)
    value, start, mu = float_arrays(**{name: value, "start": body.start, "mu": body.mu})
    start = checked("start", start, lambda v: abs(v) < jnp.inf, "a finite length")
    return value, start, checked("mu", mu, lambda v: (v > 0) & (v < jnp.inf), "a finite length > 0")

"""The warp: one bounded number eta in (0, 1] for the near-plane distance lambda of the warping frustum."""

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import checked, float_arrays
from .frustum import ViewFrustum


class Warp(eqx.Module):
    """A perspective warp of a shadow map, eta = lambda / (lambda + mu); eta = 1 is no warp (lambda = inf).

    Attributes:
        eta: warp parameter in (0, 1]; at theta = pi/2 LiSPSM has sqrt(n/f) and PSM n/f.
        one_minus_eta: 1 - eta, carried so that a weak warp keeps its digits.
        mu: depth range of the warping frustum, a length.
        defined: False where a published rule yields no lambda > 0 and no warp was put in its place.

    Example:
        >>> warp = Warp.from_lam(11.0, mu=99.0)
        >>> round(float(warp.eta), 6), round(float(warp.lam), 4)
        (0.1, 11.0)
    """

    eta: Float[Array, "..."]
    one_minus_eta: Float[Array, "..."]
    mu: Float[Array, "..."]
    defined: Bool[Array, "..."]

    @classmethod
    def from_eta(cls, eta: ArrayLike, mu: ArrayLike) -> "Warp":
        """The warp of a given eta.

        Raises:
            ValueError: eta outside (0, 1], mu <= 0, or NaN.
        """
        eta, mu = float_arrays(eta=eta, mu=mu)
        mu = checked("mu", mu, lambda v: v > 0, "a length > 0")
        eta = checked("eta", eta, lambda v: (v > 0) & (v <= 1), "a number in (0, 1]")
        return cls(eta, 1 - eta, mu, jnp.ones(eta.shape, bool))

    @classmethod
    def from_lam(cls, lam: ArrayLike, mu: ArrayLike) -> "Warp":
        """The warp of a given near-plane distance lambda (inf for none), a length.

        Raises:
            ValueError: lambda <= 0, mu <= 0, or NaN.
        """
        lam, mu = float_arrays(lam=lam, mu=mu)
        mu = checked("mu", mu, lambda v: v > 0, "a length > 0")
        lam = checked("lam", lam, lambda v: v > 0, "a number > 0, or inf")
        return cls.from_range_ratio(mu / lam, mu)

    @classmethod
    def from_range_ratio(cls, ratio: ArrayLike, mu: ArrayLike, defined: ArrayLike = True) -> "Warp":
        """The warp of a given mu / lambda >= 0, the form without infinities; where not `defined`, no warp."""
        ratio = jnp.where(defined, ratio, 0)
        return cls(1 / (1 + ratio), ratio / (1 + ratio), jnp.asarray(mu), jnp.broadcast_to(defined, ratio.shape))

    @property
    def no_warp(self) -> Bool[Array, "..."]:
        return self.one_minus_eta == 0

    @property
    def lam_over_mu(self) -> Float[Array, "..."]:
        """lambda / mu = eta / (1 - eta), what VN's Figure 6 plots; inf for no warp, with zero gradient there."""
        safe = jnp.where(self.no_warp, 1, self.one_minus_eta)
        return jnp.where(self.no_warp, jnp.inf, self.eta / safe)

    @property
    def lam(self) -> Float[Array, "..."]:
        """Near-plane distance of the warping frustum, a length; inf for no warp."""
        safe = jnp.where(self.no_warp, 1, self.one_minus_eta)
        return jnp.where(self.no_warp, jnp.inf, self.mu * self.eta / safe)

    def strength(self, frustum: ViewFrustum) -> Float[Array, "..."]:
        """log(eta) / log(n/f): at theta = pi/2, 0 for SSM, 1/2 for LiSPSM and 1 for PSM."""
        return -jnp.log(self.eta) / jnp.log1p((frustum.far - frustum.near) / frustum.near)

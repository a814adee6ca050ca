"""The lower bound over the view frustum: the least norm that any monotone map of the depth along Z_w reaches.

A map s(delta) of [0, 1] onto itself gives E_p = mu / (z tan(phi) s'(delta)). Only the receivers at each delta matter.
L-inf: s' must be at least mu max(1/z) / (value tan(phi)) and integrates to 1, hence
    value = mu / tan(phi) * integral of max over the receivers at delta of 1/z.
L_P: the integral of W(delta) s'^-P, W the density of z^-P over delta, is convex in s'. Under the constraint it is
stationary where s' is proportional to W^(1/(P+1)); by Hoelder's inequality the least value of its P-th root is
    value = mu / tan(phi) * ((integral of W^(1/(P+1)))^(P+1) / mass)^(1/P):
(integral of sqrt W)^2 for L1, s' ~ W^(1/3) for L2. For P to infinity it becomes the L-inf formula.

On V, the receivers at one delta are a segment of eye depths with log length rho; W is (1/2T) times the integral of
z^-(Q+1) along it, Q the norm's depth exponent. Over delta, rho grows from 0 to a plateau and falls back to 0.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._numerics import horner, larger, power, unit_nodes
from ..objective import Objective
from ..receivers.bodies.depth_integrals import LARGEST_LOG_RATIO
from ..receivers.bodies.frustum_moments import measure_mass
from ..solve.chunks import in_chunks
from ..theory.light_space import LightSpace
from ..theory.view_frustum import ViewFrustum

_NODES = 200  # of the tabulated integrals: accurate to rounding for rho up to 32 and Q from -1 to 10
_DEGREE = 11


@functools.partial(jax.jit, static_argnames=("objective",))
def bound_frusta(frustum: ViewFrustum, theta: Array, objective: Objective) -> Array:
    """The lower bound for every frustum and direction, which broadcast."""
    return in_chunks(_bound_chunk, (frustum, theta), objective)


@jax.jit
def storage_of_frusta(frustum: ViewFrustum, theta: Array) -> Array:
    """The texels that any number of maps need for E_p E_q <= 1 over V, (T60).

    The near plane's |l.v| area, and log(f/n) times the side faces through which rays leave V towards the eye.
    """
    space = LightSpace(frustum, theta)
    cosine = space.slope / space.tan_phi
    # The lower face always; the upper one where a < 0; both sides of the screen.
    faces = 2 * (space.b + space.a_minus) + 4 * space.slope
    return 4 * cosine + faces / space.tan_phi * space.log_ratio


def _bound_chunk(frustum: ViewFrustum, theta: Array, objective: Objective) -> Array:
    space, metric = LightSpace(frustum, theta), objective.metric
    if metric.beta:
        return power(2 * _widest_segment(space, objective.measure == "axis"), metric.beta)
    order = objective.order * metric.alpha  # the norm of E_p^alpha is a power of a norm of E_p
    return power(_of_e_p(space, objective, order) / space.tan_phi, metric.alpha)


def _widest_segment(space: LightSpace, axis: bool) -> Array:
    """max over the receivers of z_max(delta) / z: from the near plane's lowest point to the segment's farthest."""
    lowest = space.sin_theta if axis else space.b
    cut = lowest >= (1 + space.depth_range) * space.a_plus  # the segment ends on the far plane
    return jnp.where(cut, 1 + space.depth_range, lowest / jnp.where(cut, 1, space.a_plus))


def _of_e_p(space: LightSpace, objective: Objective, order: float) -> Array:
    """tan(phi) times the lower bound for E_p in L_order."""
    L, x = space.log_ratio, space.depth_range
    if objective.measure == "axis":  # delta is linear in z: W is z^-P, and a gap without receivers gets no texels
        if math.isinf(order):
            return space.sin_theta * L
        part = (order + 1) * jnp.expm1(L / (order + 1))
        return space.sin_theta * part * power(part / x, 1 / order)
    if math.isinf(order):
        return (space.b + space.a_minus) * L + 2 * space.slope
    total = _root_of_density(space, Segments(space), objective.depth_exponent, 1 / (order + 1))
    return total * power(total / (x * measure_mass(objective.volume_exponent, x, L)), 1 / order)


class Segments:
    """The longest segments of V at one delta: rho, rho / (2 T), and whether both end planes cut them.

    From the near plane to z = n e^rho where a > 0, from n to f where a < 0 or both end planes cut; at either end of V's
    depth range, a segment is a point.
    """

    def __init__(self, space: LightSpace):
        T2, a = 2 * space.slope, space.a_plus
        self.cut = T2 > space.depth_range * a
        # rho / 2T without dividing by T: T = 0 for a light overhead, where each segment has one depth
        slim = log1p_over(jnp.where(self.cut, 0, T2) / jnp.where(self.cut, 1, a)) / jnp.where(self.cut, 1, a)
        self.per_slope = jnp.where(self.cut, space.log_ratio / jnp.where(self.cut, T2, 1), slim)
        self.rho = jnp.where(self.cut, space.log_ratio, slim * T2)


def _root_of_density(space: LightSpace, longest: Segments, Q: float, root: float) -> Array:
    """The integral of W^root over mu delta, for n = 1.

    Segments begin at the near plane (a > 0, slope a) or end at the far one (slope b, and -a where a < 0), in the same
    way on both sides.
    """
    at_near, at_far = _growing(Q, root, longest.rho)
    at_far = jnp.exp((1 - Q * root) * space.log_ratio) * at_far
    sides = longest.rho / root * (space.a_plus * at_near + (space.b + space.a_minus) * at_far)
    # The longest segments: from the lower to the upper plane, proportional to z; or between the end planes, all equal.
    excess = space.depth_range * space.a_plus - 2 * space.slope
    log_length = jnp.log1p(jnp.where(longest.cut, 0, excess) / space.b)
    middle = space.b * (log_length * decay((Q * root - 1) * log_length)) + larger(-excess, 0)
    return power(longest.per_slope, root) * (sides + power(decay(Q * longest.rho), root) * middle)


def _growing(Q: float, root: float, rho: Float[Array, "..."]) -> list[Float[Array, "..."]]:
    """The integrals over segments of log length 0 to rho, growing away from the near plane, and from the far one.

    They depend only on rho: as piecewise polynomials they cost a twentieth of 64 nodes for each problem, and less than
    the solve.
    """
    table, width = _growing_table(Q, root)
    position = jnp.where(rho < LARGEST_LOG_RATIO, rho / width, 0)
    panel = position.astype(jnp.int32)
    y = jnp.where(rho < LARGEST_LOG_RATIO, 2 * (position - panel) - 1, jnp.nan)
    found = [jnp.asarray(part, rho.dtype).at[panel].get(mode="promise_in_bounds") for part in table]
    return [horner(list(jnp.moveaxis(part, -1, 0)), y) for part in found]


@functools.lru_cache(maxsize=64)
def _growing_table(Q: float, root: float) -> tuple[np.ndarray, float]:
    """Coefficients (2, panels, _DEGREE + 1) in y in [-1, 1] on each panel, highest power first; the panels' width.

    The nearest singularities are at rho = +-2 pi i / Q: coefficients fall by 25 each on panels of half width 1 / (2 Q).
    """
    width = min(0.5, 1 / max(abs(Q), 1e-9))
    y = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    rho = width * (np.arange(math.ceil(LARGEST_LOG_RATIO / width))[:, None] + (1 + y) / 2)
    t, weights = unit_nodes(_NODES, np.float64)
    share = t ** (1 / root)  # of rho: W^root is then t times an analytic function, and d share / dt = share / (root t)
    part = rho[..., None] * share
    mean = np.divide(-np.expm1(-Q * part), Q * part, out=np.ones_like(part), where=Q * part != 0)
    density = mean**root * (weights * share)
    values = np.stack([(np.exp(rate * part) * density).sum(-1) for rate in (1, Q * root - 1)])
    return np.linalg.solve(np.vander(y), values[..., None])[..., 0], width


def log1p_over(y: Float[Array, "..."]) -> Float[Array, "..."]:
    """log(1 + y) / y for y >= 0; by its series where a quotient's derivative would cancel."""
    small = y < 0.1
    w = jnp.where(small, y, 0) / (2 + jnp.where(small, y, 0))  # log(1 + y) = 2 artanh(w)
    series = horner([jnp.full_like(w, 1 / (2 * k + 1)) for k in range(7, -1, -1)], w * w)
    large = jnp.where(small, 1, y)
    return jnp.where(small, series * (1 - w), jnp.log1p(large) / large)


def decay(y: Float[Array, "..."]) -> Float[Array, "..."]:
    """(1 - e^-y) / y, 1 at y = 0; by its series where a quotient's derivative would cancel."""
    small = jnp.abs(y) < 0.5
    h = jnp.where(small, y, 0) / 2
    series = horner([jnp.full_like(h, 1 / math.factorial(2 * k + 1)) for k in range(6, -1, -1)], h * h)
    large = jnp.where(small, 1, y)
    return jnp.where(small, jnp.exp(-h) * series, -jnp.expm1(-large) / large)

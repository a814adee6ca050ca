"""High-precision references for the experiments: the optimum and the norms of one problem, to 50 digits.

Inputs are taken as the exact numbers that the floats are. Lengths are in units of the near distance. The L_P norms use
Gauss-Legendre in log depth at working precision and exact polynomial algebra in eta; the tests' twin, which knows raw
geometry only, checks this file's formulas (tests/test_experiments.py).
"""

import functools
import math
from typing import NamedTuple

import mpmath as mp

DIGITS = 50
_EXPONENT = {"volume": 0, "screen": 2, "log_depth": 3, "ground": 4}
_POWERS = {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}


def horner(coefficients: list, at: mp.mpf) -> mp.mpf:
    """The polynomial of the coefficients, highest power first; mpmath's own `polyval` is changing their order."""
    return functools.reduce(lambda total, coefficient: total * at + coefficient, coefficients, mp.mpf(0))


class Reference(NamedTuple):
    """The global minimiser and what depends on it."""

    eta: mp.mpf
    value: mp.mpf
    outcome: str  # interior, tie, kink, no_warp


class Problem:
    """One frustum, light direction and objective (order 1, 2, 3, ... or inf)."""

    def __init__(self, near, far, half_fov, theta, metric: str, order: float, measure: str):
        # As many digits more as n/f has zeros: at theta = phi it is what a difference of sines leaves.
        mp.mp.dps = DIGITS + max(0, math.frexp(float(far) / float(near))[1] * 3 // 10)
        near, far, phi, theta = (mp.mpf(float(v)) for v in (near, far, half_fov, theta))
        self.alpha, self.beta = _POWERS[metric]
        self.k, self.r = 2 * self.alpha + self.beta, self.alpha + self.beta
        self.order, self.measure = order, measure
        self.x = far / near - 1
        self.log_ratio = mp.log(far / near)
        self.tan_phi = mp.tan(phi)
        s, c = abs(mp.sin(theta)), abs(mp.cos(theta))  # float32(pi) lies beyond pi
        self.s, self.slope = s, self.tan_phi * c
        a = s - self.slope
        self.a_plus, self.a_minus, self.b = max(a, mp.mpf(0)), max(-a, mp.mpf(0)), s + self.slope
        self.mu = self.x * self.a_plus + 2 * (1 + self.x) * self.slope

    def edge(self, u):
        """delta at the near and far end of the segment at height fraction u."""
        x, T = self.x, self.slope
        return (x * self.a_minus + 2 * T * u) / self.mu, (x * self.a_plus + 2 * (1 + x) * T * u) / self.mu

    def width(self, eta):
        """L = f tan(phi) / xhat."""
        (near, far) = self.edge(mp.mpf(0))
        return min((1 + self.x) * (near + (1 - near) * eta), far + (1 - far) * eta)

    def scale(self, eta):
        return (self.mu / (self.tan_phi * eta)) ** self.alpha * (2 * (1 + self.x) / self.width(eta)) ** self.beta

    def error(self, u, z_over_near, eta):
        """E at height fraction u and depth z."""
        near, far = self.edge(mp.mpf(u))
        p = (z_over_near - 1) / self.x
        delta = near * (1 - p) + far * p
        blend = delta + (1 - delta) * eta
        return self.scale(eta) * blend**self.k / z_over_near**self.r

    def condition_yz(self, u, z_over_near, eta):
        """Condition number of E at (y, z): |d log E / d log y| + |d log E / d log z|."""
        near, far = self.edge(u)
        p = (z_over_near - 1) / self.x
        delta = near * (1 - p) + far * p
        blend = delta + (1 - delta) * eta
        # mu delta = z s - y c - d0 in units of near: z s and y c are what is differenced
        slope = self.k * (1 - eta) / (self.mu * blend)
        y_c = self.slope * z_over_near * abs(1 - 2 * u)
        return slope * y_c + abs(slope * z_over_near * self.s - self.r)

    @property
    def kink(self):
        return self.a_plus / ((1 + self.x) * self.b)

    def norm(self, eta):
        """The norm of the warp eta."""
        eta = mp.mpf(eta)
        if math.isinf(self.order):
            u = mp.mpf("0.5") if self.measure == "axis" else mp.mpf(1)
            return max(self.error(u, mp.mpf(1), eta), self.error(u, 1 + self.x, eta))
        M = round(self.k * self.order)
        total = sum(b * eta ** (M - j) for j, b in enumerate(self.moments))
        return self.scale(eta) * (total / self.mass) ** (mp.mpf(1) / mp.mpf(self.order))

    @property
    def mass(self):
        q0 = 0 if self.measure == "axis" else _EXPONENT[self.measure] - 2
        growth = 1 - q0
        return (mp.expm1(growth * self.log_ratio) / growth if growth else self.log_ratio) / self.x

    @functools.cached_property
    def moments(self):
        """B_j, j = 0..M, over the unit square of depth fraction and height."""
        M, Q = round(self.k * self.order), self.r * self.order
        Q += 0 if self.measure == "axis" else _EXPONENT[self.measure] - 2
        heights = [(mp.mpf("0.5"), mp.mpf(1))] if self.measure == "axis" else _gauss(M // 2 + 1)
        total = [mp.mpf(0)] * (M + 1)
        L = self.log_ratio
        for t, w in _gauss(48 + int(2 * L)):
            z = mp.exp(t * L)
            p = mp.expm1(t * L) / self.x
            weight = w * L / self.x * mp.power(z, 1 - Q)
            for u, v in heights:
                near, far = self.edge(u)
                delta = near * (1 - p) + far * p
                rest = 1 - delta
                for j in range(M + 1):
                    total[j] += weight * v * rest ** (M - j) * delta**j
        return [mp.binomial(M, j) * b for j, b in enumerate(total)]

    def _condition(self, piece):
        """Coefficients of eta L dJ^P/d eta in eta, highest first, on L = c eta + d."""
        c, d = piece
        M, a, r, B = round(self.k * self.order), self.alpha * self.order, self.r * self.order, self.moments
        return [(c * B[j] * (a - j) if j <= M else 0) + (d * B[j - 1] * (r - j + 1) if j else 0) for j in range(M + 2)]

    def _quadratic(self, delta, piece):
        c, d = piece
        return [self.alpha * c * (1 - delta), self.r * (d * (1 - delta) - c * delta), -self.alpha * d * delta]

    def minimise(self) -> Reference:
        """By signs at every breakpoint, then bisection in log(eta) on the segment where the sign changes."""
        far = self.edge(mp.mpf(0))[1]
        top, low = ((1 - far, far), (mp.mpf(1), mp.mpf(0))) if self.beta else ((mp.mpf(0), mp.mpf(1)),) * 2
        kink = self.kink if self.beta else mp.mpf(0)
        if math.isinf(self.order):
            u = mp.mpf("0.5") if self.measure == "axis" else mp.mpf(1)
            near, distant = self.edge(u)
            growth = mp.expm1(mp.mpf(self.r) / self.k * self.log_ratio)
            tie = (distant - near - growth * near) / (distant - near + growth * (1 - near))
            breaks = sorted({b for b in (tie, kink) if b > 0}, reverse=True)

            def condition(eta, above):
                near_rules = eta > tie or (eta == tie and above)
                on_top = eta > kink or (eta == kink and above)
                polynomial = self._quadratic(near if near_rules else distant, top if on_top else low)
                return horner(polynomial, eta)
        else:
            breaks = [kink] if kink > 0 else []
            tie = mp.mpf(0)

            def condition(eta, above):
                return horner(self._condition(top if eta > kink or (eta == kink and above) else low), eta)

        if condition(mp.mpf(1), False) <= 0:
            return Reference(mp.mpf(1), self.norm(1), "no_warp")
        upper = mp.mpf(1)
        for point in breaks:
            if condition(point, True) < 0:
                return self._between(condition, point, upper)
            if condition(point, False) <= 0:
                return Reference(point, self.norm(point), "tie" if point == tie else "kink")
            upper = point
        return self._between(condition, mp.mpf(10) ** -40 / (1 + self.x) ** 2, upper)

    def _between(self, condition, lower, upper) -> Reference:
        lower, upper = mp.log(lower), mp.log(upper)
        for _ in range(140):  # to 1e-40
            u = (lower + upper) / 2
            lower, upper = (u, upper) if condition(mp.exp(u), True) < 0 else (lower, u)
        eta = mp.exp(u)
        return Reference(eta, self.norm(eta), "interior")


@functools.lru_cache(maxsize=256)
def _gauss(count: int):
    """Gauss-Legendre nodes and weights on [0, 1] at the working precision."""
    mp.mp.dps = DIGITS + 10
    out = []
    for i in range(1, count + 1):
        x = mp.cos(mp.pi * (i - mp.mpf("0.25")) / (count + mp.mpf("0.5")))
        for _ in range(8):
            p0, p1 = mp.mpf(1), x
            for n in range(2, count + 1):
                p0, p1 = p1, ((2 * n - 1) * x * p1 - (n - 1) * p0) / n
            slope = count * (x * p1 - p0) / (x * x - 1) if count > 1 else mp.mpf(1)
            step = p1 / slope
            x -= step
            if abs(step) < mp.mpf(10) ** (-DIGITS - 5):
                break
        out.append(((1 + x) / 2, 1 / ((1 - x * x) * slope * slope)))
    mp.mp.dps = DIGITS
    return out

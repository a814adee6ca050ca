"""An oracle that shares nothing with the package: raw geometry and a search, in 60-digit arithmetic.

It knows the eight corners of the view frustum, z_w = lambda + z sin(theta) - y cos(theta) - d0, the errors as AT09
prints them in lambda, mu and z_w, and the definition of a norm. Everything else (which corner wins, where the optimum
is, moments) it finds by taking minima and maxima, by quadrature, and by a golden-section search.
"""

import functools
import itertools

from mpmath import mp, mpf

mp.dps = 60
GOLDEN = (mp.sqrt(5) - 1) / 2


class Scene:
    """One frustum and one light; inputs are taken as the exact values of the given floats."""

    def __init__(self, near, far, half_fov, theta):
        self.near, self.far = mpf(float(near)), mpf(float(far))
        self.tan_phi = mp.tan(mpf(float(half_fov)))
        self.sin, self.cos = mp.sin(mpf(float(theta))), mp.cos(mpf(float(theta)))
        ends = [(z, z * self.tan_phi) for z in (self.near, self.far)]
        self.corners = [(i * h, j * h, z) for (z, h), i, j in itertools.product(ends, (-1, 1), (-1, 1))]
        heights = [z * self.sin - y * self.cos for _, y, z in self.corners]
        self.d0 = min(heights)
        self.mu = max(heights) - self.d0
        self._width = None

    def depth(self, y, z):
        return z * self.sin - y * self.cos - self.d0

    def lam(self, eta):
        return self.mu * eta / (1 - eta)

    def tan_phi_w(self, lam):
        """The narrowest lateral opening of W that contains V: the maximum over all corners."""
        if self._width is None or self._width[0] != lam:  # many points are asked for one lambda
            self._width = lam, max(abs(x) / (lam + self.depth(y, z)) for x, y, z in self.corners)
        return self._width[1]

    def e_p(self, lam, y, z):
        return self.mu / ((lam + self.mu) * lam * self.tan_phi) * (lam + self.depth(y, z)) ** 2 / z

    def e_q(self, lam, y, z):
        return 2 * self.tan_phi_w(lam) / self.tan_phi * (lam + self.depth(y, z)) / z

    def error(self, alpha, beta, lam, y, z):
        # nothing is computed that has the exponent 0
        along = self.e_p(lam, y, z) ** alpha if alpha else mpf(1)
        return along * self.e_q(lam, y, z) ** beta if beta else along

    def no_warp_error(self, alpha, beta, z):
        """The limit lambda -> inf, where neither error depends on y."""
        widest = max(abs(x) for x, _, _ in self.corners)
        return (self.mu / (z * self.tan_phi)) ** alpha * (2 * widest / (z * self.tan_phi)) ** beta

    def texture(self, lam, x, y, z):
        z_w = lam + self.depth(y, z)
        return x / (2 * self.tan_phi_w(lam) * z_w) + mpf(1) / 2, (lam + self.mu) / self.mu * (1 - lam / z_w)

    def supremum(self, alpha, beta, lam, axis=False):
        points = [(mpf(0), z) for z in (self.near, self.far)] if axis else {(y, z) for _, y, z in self.corners}
        return max(self.error(alpha, beta, lam, y, z) for y, z in points)


DENSITY = {"volume": 0, "screen": 2, "log_depth": 3, "ground": 4}


class PowerMean:
    """The L_P norm of E_p^alpha E_q^beta over a measure z^-m dx dy dz (or dz on the axis).

    The errors do not depend on x, so that dx gives 2 z tan(phi). z_w is linear in y: its power is integrated over y by
    the antiderivative; the integral over z is mpmath's Gauss-Legendre, in log z. For integer M = (2 alpha + beta) P
    the integrals of depth^j z^.. are found once, and the binomial theorem gives every lambda.
    """

    def __init__(self, scene, alpha, beta, order, measure):
        self.scene, self.alpha, self.beta = scene, mpf(alpha), mpf(beta)
        self.order = mpf(order)
        self.power = (2 * self.alpha + self.beta) * self.order
        self.axis = measure == "axis"
        self.decay = (self.alpha + self.beta) * self.order
        self.density = 0 if self.axis else DENSITY[measure]
        self.mass = self._over_depth(0, 0, mpf(1))

    def _over_heights(self, shift, z, power):
        """integral over the cross-section of (shift + depth)^power."""
        s = self.scene
        if self.axis:
            return (shift + s.depth(0, z)) ** power
        half = z * s.tan_phi
        low, high = (shift + s.depth(y, z) for y in (half, -half))
        return 2 * half * (high ** (power + 1) - low ** (power + 1)) / ((power + 1) * s.cos)

    def _over_depth(self, shift, decay, power):
        s = self.scene
        if power == 1 and decay == 0:  # the mass: the cross-section itself

            def at(z):
                return (1 if self.axis else (2 * z * s.tan_phi) ** 2) * z ** (1 - self.density)

        else:

            def at(z):
                return self._over_heights(shift, z, power) * z ** (1 - self.density - decay)

        return mp.quad(lambda t: at(s.near * mp.exp(t)), [0, mp.log(s.far / s.near)], method="gauss-legendre")

    @functools.cached_property
    def _moments(self):
        return [self._over_depth(0, self.decay, j) for j in map(mpf, range(int(self.power) + 1))]

    def integral(self, lam):
        """integral of z_w^M z^-rP over the measure."""
        if self.power != int(self.power):
            return self._over_depth(lam, self.decay, self.power)
        return self.integral_by_moments(lam)

    def integral_by_moments(self, lam):
        M = int(self.power)
        return sum(mp.binomial(M, j) * lam ** (M - j) * m for j, m in enumerate(self._moments))

    def __call__(self, lam):
        s = self.scene
        p = s.mu / ((lam + s.mu) * lam * s.tan_phi)
        q = 2 * s.tan_phi_w(lam) / s.tan_phi
        return p**self.alpha * q**self.beta * (self.integral(lam) / self.mass) ** (1 / self.order)


def golden(function, low, high, width):
    """The minimiser of a unimodal function on [low, high], to `width`."""
    a, b = mpf(low), mpf(high)
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_c, at_d = function(c), function(d)
    while b - a > width:
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - GOLDEN * (b - a)
            at_c = function(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + GOLDEN * (b - a)
            at_d = function(d)
    return (a + b) / 2


def search(scene, norm, lowest=1e-12, width=1e-20):
    """(eta, lambda, value) of the least norm(lambda), by a search over log(eta)."""
    u = golden(lambda v: norm(scene.lam(mp.exp(v))), mp.log(mpf(lowest)), 0, mpf(width))
    eta = mp.exp(u)
    lam = -scene.mu * eta / mp.expm1(u)
    return eta, lam, norm(lam)

"""What checking a claim takes: the row, AT09's setting from the corners of V, and the optimum of one shape."""

import dataclasses
import itertools
import math
import os
from collections.abc import Callable

os.environ.setdefault("JAX_ENABLE_X64", "1")

import numpy as np

import warpopt

NEAR, FAR, PHI = 1.0, 100.0, math.pi / 6
PAPER = warpopt.ViewFrustum(NEAR, FAR, PHI)
DEGREE = math.pi / 180
REPRODUCED, CONDITION, CONTRADICTED = "reproduced", "holds under a condition", "contradicted"
EXACT = 1e-9  # agreement of closed forms evaluated naively in float64, far below any misprint


@dataclasses.dataclass(frozen=True)
class Claim:
    """One checkable statement. `proof` says why, where it does not simply hold."""

    key: str
    source: str
    statement: str
    verdict: str
    number: str
    inputs: str = "n = 1, f = 100, phi = 30 deg"
    proof: str = ""

    @property
    def why(self) -> str:
        """Why not, or when; empty for what simply holds."""
        return "" if self.verdict == REPRODUCED else self.proof


def verdict(always: bool, under_condition: bool = False) -> str:
    return REPRODUCED if always else CONDITION if under_condition else CONTRADICTED


class Geometry:
    """AT09's setting for theta in [0, pi/2], from the corners of V."""

    def __init__(self, theta: float, near: float = NEAR, far: float = FAR, phi: float = PHI):
        self.near, self.far, self.tan, self.sin, self.cos = near, far, math.tan(phi), math.sin(theta), math.cos(theta)
        self.a, self.b = self.sin - self.tan * self.cos, self.sin + self.tan * self.cos
        heights = [z * k for z, k in itertools.product((near, far), (self.a, self.b))]
        self.d0 = min(heights)
        self.mu = max(heights) - self.d0
        grid = np.linspace(0, 1, 41)[:, None]
        self.z = np.geomspace(near, far, 401)
        self.y = self.z * self.tan * (1 - 2 * grid)  # rows from the upper plane to the lower

    def z_w(self, lam, y, z):
        return lam + z * self.sin - y * self.cos - self.d0

    def width(self, lam):
        """tan(phi_w): V's widest corner."""
        return max(z * self.tan / self.z_w(lam, z * self.tan, z) for z in (self.near, self.far))

    def error(self, metric: str, lam: float, y, z):
        if math.isinf(lam):
            p, q = self.mu / (z * self.tan), 2 * self.far / z
        else:
            z_w = self.z_w(lam, y, z)
            p = self.mu * z_w**2 / ((lam + self.mu) * lam * self.tan * z)
            q = 2 * self.width(lam) * z_w / (self.tan * z)
        return {"p": p, "q": q, "pxq": p * q}[metric] + 0 * y

    def map(self, metric: str, lam: float) -> np.ndarray:
        """Over the grid of V: rows by height, columns by depth."""
        return self.error(metric, lam, self.y, self.z)

    def worst(self, metric: str, lam: float) -> float:
        return float(self.map(metric, lam).max())


def lam_of(rule: Callable, theta: float, **options) -> float:
    return float(rule(PAPER, theta, **options).lam)


def scientific(value: float) -> str:
    """One digit and an exponent; 0 as such."""
    return f"{value:.0e}" if value else "0"


def relative(got, expected) -> float:
    return float(np.abs(np.asarray(got) / expected - 1).max())


def optimum(metric: str, theta, norm: str = "inf") -> warpopt.Solution:
    """Of one fixed shape, so that each objective is compiled once."""
    directions = np.resize(np.asarray(theta, float), 8)
    return warpopt.optimal_warp(warpopt.FrustumView(PAPER, directions), warpopt.Objective(metric, norm))

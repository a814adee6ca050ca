"""The scenes that many tests share: one fixed batch, so that nothing is compiled twice."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import twin

import warpopt

PHI = float(np.pi / 6)


class Case(NamedTuple):
    tag: str
    near: float
    far: float
    half_fov: float
    theta: float


CASES = (
    Case("overhead", 1.0, 100.0, PHI, np.pi / 2),
    Case("nearly overhead", 1.0, 100.0, PHI, np.pi / 2 - 1e-7),
    Case("paper, 60 degrees", 1.0, 100.0, PHI, np.pi / 3),
    Case("theta equals phi", 1.0, 100.0, PHI, PHI),
    Case("just above phi", 1.0, 100.0, PHI, PHI * (1 + 1e-9)),
    Case("below phi", 1.0, 100.0, PHI, np.pi / 18),
    Case("light along the view, nearly", 5.0, 50.0, 0.2, 0.02),
    Case("deep", 0.1, 1000.0, np.pi / 4, 1.4),
    Case("deep, theta equals phi", 0.1, 1000.0, np.pi / 4, float(np.pi / 4)),
    Case("thin", 2.0, 2.2, 0.3, 1.0),
    Case("thin, below phi", 2.0, 2.2, 0.3, 0.1),
    Case("wide", 1e3, 1e4, 1.3, 1.4),
    Case("narrow", 1.0, 1e4, 0.02, 1.2),
    Case("mirrored", 0.01, 30.0, 0.9, 2.5),
    Case("mirrored, near the top", 3.0, 7.0, 0.6, 1.8),
    Case("kink of E_q", 1.0, 20.0, 0.5, 0.7),
)
TAGS = [case.tag for case in CASES]


def batch(cases=CASES, dtype=np.float64) -> tuple[warpopt.ViewFrustum, jnp.ndarray]:
    """All scenes as one frustum and one theta, of shape (len(cases),)."""
    near, far, half_fov, theta = (jnp.asarray(column, dtype) for column in list(zip(*cases, strict=True))[1:])
    return warpopt.ViewFrustum(near, far, half_fov), theta


def twins(cases=CASES) -> list[twin.Scene]:
    return [twin.Scene(*case[1:]) for case in cases]


def turned(seed: int) -> tuple[jnp.ndarray, jnp.ndarray]:
    """(a random rotation matrix, a random shift): a pose that nothing is aligned with."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return jnp.asarray(q * np.sign(np.linalg.det(q))), jnp.asarray(rng.normal(size=3) * 20)


def norms_of_points(points, weights, direction, etas, metric, order, tan_phi):
    """Norms by raw geometry for a camera at the origin that looks along -z, all eta at once.

    World vectors; densities of a screen of slope tan_phi.
    """
    light = direction / np.linalg.norm(direction)
    view = np.array([0, 0, -1.0])
    z_axis = view - light * (light @ view)
    z_axis /= np.linalg.norm(z_axis)
    x_axis = np.cross(light, z_axis)
    d, x, z = points @ z_axis, points @ x_axis, points @ view
    mu, eta = np.ptp(d), np.array(etas)[:, None]
    x = x - np.clip(0, x.min(), x.max())
    lam = mu * eta / (1 - eta)
    z_w = lam + d - d.min()
    s_slope = lam * (lam + mu) / (mu * z_w**2)  # ds/dd of s = (lam + mu)(z_w - lam)/(mu z_w)
    t = x * (lam + mu) / z_w
    e_p, e_q = 1 / (s_slope * z * tan_phi), np.ptp(t, 1)[:, None] * z_w / (lam + mu) / (z * tan_phi)
    e = {"p": e_p, "q": e_q, "pxq": e_p * e_q, "max": np.maximum(e_p, e_q)}[metric]
    return e.max(1) if np.isinf(order) else np.average(e**order, axis=1, weights=weights) ** (1 / order)

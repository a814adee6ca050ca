"""The claims of AT09 and of VN on the model: the warping frustum, and the formulas of the errors."""

import itertools
import math

import numpy as np
from claim_checks import DEGREE, EXACT, FAR, NEAR, Claim, Geometry, relative, scientific, verdict

LAM, Y, Z = 7.0, 1.0, 30.0  # a point and a warp as good as any for formulas that must hold everywhere


def _factorised(key: str, where: str, degrees: float, printed: float, end: float, amount: str, proof: str) -> Claim:
    """F_p (z + G)^2 / z with the printed F_p; G as printed for the plane at depth `end`, which is right."""
    g = Geometry(degrees * DEGREE)
    shift = LAM / g.sin - end + (end * g.tan - Y) * g.cos / g.sin
    ratio = printed * (Z + shift) ** 2 / Z / g.error("p", LAM, Y, Z)
    return Claim(
        key,
        "AT09 appendix, VN 1.6",
        f"E_p = F_p (z + G)^2 / z with F_p as printed for theta {where} phi",
        verdict(abs(ratio - 1) < EXACT),
        f"printed / right = {ratio:.4f} = {amount}",
        f"theta = {degrees:g} deg, lambda = {LAM:g}",
        proof,
    )


def factorised_above() -> Claim:
    g = Geometry(60 * DEGREE)
    span = FAR - NEAR + (FAR + NEAR) * g.tan * g.cos / g.sin
    printed = g.sin**2 * span / (g.tan * LAM * (LAM + span * g.sin))
    proof = "mu carries one sin(theta), (z + G)^2 two, the printed F_p two in all: sin^3 is right"
    return _factorised("f_p_above", ">=", 60, printed, NEAR, "1 / sin(theta)", proof)


def factorised_below() -> Claim:
    g = Geometry(20 * DEGREE)
    printed = 2 * FAR * g.sin**2 / (LAM * (LAM + 2 * FAR * g.tan * g.cos) * g.tan)
    proof = "mu / tan(phi) = 2 f cos(theta): the tangent cancels and a cosine is missing"
    return _factorised("f_p_below", "<=", 20, printed, FAR, "1 / (tan(phi) cos(theta))", proof)


def depth_range() -> Claim:
    off = 0.0
    for degrees in (5, 20, 35, 60, 90):
        g = Geometry(degrees * DEGREE)
        above = NEAR * g.tan * g.cos + (FAR - NEAR) * g.sin + FAR * g.tan * g.cos
        off = max(off, relative(above if g.a >= 0 else 2 * FAR * g.tan * g.cos, g.mu))
    return Claim(
        "mu",
        "VN (13)",
        "mu, both branches",
        verdict(off < EXACT),
        f"largest relative difference {scientific(off)}",
        "theta = 5, 20, 35, 60, 90 deg",
    )


def warp_depth() -> Claim:
    off = 0.0
    for degrees in (5, 20, 35, 60, 90):
        g = Geometry(degrees * DEGREE)
        end = NEAR if g.a >= 0 else FAR
        shift = LAM / g.sin - end + (end * g.tan - g.y) * g.cos / g.sin
        off = max(off, relative((g.z + shift) * g.sin, g.z_w(LAM, g.y, g.z)))
    return Claim(
        "z_w",
        "AT09 appendix, VN 1.6",
        "z_w = (z + G) sin(theta), both branches of G",
        verdict(off < EXACT),
        f"largest relative difference {scientific(off)}",
        "theta = 5, 20, 35, 60, 90 deg, lambda = 7, over V",
    )


def local_representation() -> Claim:
    g, z = Geometry(math.pi / 2), np.geomspace(NEAR, FAR, 50)
    e_q = 2 * FAR / (FAR - NEAR + LAM) * (z - NEAR + LAM) / z
    e_p = (FAR - NEAR) / ((FAR - NEAR + LAM) * LAM * g.tan) * (z - NEAR + LAM) ** 2 / z
    off = max(relative(e_q, g.error("q", LAM, 0.0, z)), relative(e_p, g.error("p", LAM, 0.0, z)))
    return Claim(
        "local",
        "AT09 (8), (9)",
        "E_q and E_p on the view axis for a light overhead",
        verdict(off < EXACT),
        f"largest relative difference {scientific(off)}",
        "theta = 90 deg, lambda = 7",
    )


def factorisation() -> Claim:
    """Along the line (kx z - bx, ky z - by): dq/dt and dp/ds by central differences over z."""
    g, step, (kx, ky) = Geometry(60 * DEGREE), 1e-5, (0.3, -0.8)
    z = Z + np.array([-step, 0, step])
    x, y = kx * z - 4.0, ky * z + 20.0
    z_w = g.z_w(LAM, y, z)
    screen = (x / z / g.tan, y / z / g.tan)
    texture = (x / z_w / g.width(LAM) / 2 + 0.5, (LAM + g.mu) / g.mu * (1 - LAM / z_w))
    q, p = (abs(np.diff(a[::2])[0] / np.diff(b[::2])[0]) for a, b in zip(screen, texture, strict=True))
    x, y, z, z_w, slope = x[1], y[1], z[1], z_w[1], g.sin - ky * g.cos
    e_q = g.error("q", LAM, y, z) * abs((kx - x / z) / (kx - x / z_w * slope))
    e_p = g.error("p", LAM, y, z) * abs((ky - y / z) / slope)
    off = max(abs(q / e_q - 1), abs(p / e_p - 1))
    return Claim(
        "factorisation",
        "AT09 (11), VN (11)",
        "dq/dt and dp/ds along a line are E^pers E^proj with the projection factors as printed",
        verdict(off < 1e-7),
        f"E_q = {e_q:.3f}, E_p = {e_p:.3f}, as by differences",
        "theta = 60 deg, lambda = 7, x = 0.3 z - 4, y = 20 - 0.8 z, at z = 30",
    )


def width_below() -> Claim:
    off = 0.0
    for degrees, lam in itertools.product((5, 20, 30), (0.3, 5.0, 50.0)):
        g = Geometry(degrees * DEGREE)
        off = max(off, relative(FAR * g.tan / lam, g.width(lam)))
    return Claim(
        "width_below",
        "AT09 appendix, VN 1.6",
        "tan(phi_w) = f tan(phi) / lambda for theta <= phi",
        verdict(off < EXACT),
        f"largest relative difference {scientific(off)}",
        "theta = 5, 20, 30 deg; lambda = 0.3, 5, 50",
    )


def width_above() -> Claim:
    ratios = {d: FAR * (g := Geometry(d * DEGREE)).tan / (g.mu + 20) / g.width(20.0) for d in (45, 60, 90)}
    right = {d: abs(r - 1) < EXACT for d, r in ratios.items()}
    return Claim(
        "width",
        "AT09 appendix, VN 1.6",
        "tan(phi_w) = f tan(phi) / (mu + lambda) for theta >= phi",
        verdict(all(right.values()), right[90]),
        ", ".join(f"{r:.3f} of the width of V at {d}" for d, r in ratios.items()),
        "lambda = 20",
        "only at 90 deg does the upper far corner, the widest, lie on W's far plane",
    )


def width_in_f_q() -> Claim:
    ratios = []
    for degrees, factor in itertools.product((45, 60, 90), (3.0, 1 / 3)):
        g = Geometry(degrees * DEGREE)
        lam = factor * NEAR * g.a
        ratios.append(FAR * g.tan / (lam + (FAR - NEAR) * g.a) / g.width(lam))
    inside, outside = (np.abs(np.array(ratios[k::2]) - 1) < EXACT for k in (0, 1))
    return Claim(
        "width_f_q",
        "AT09 appendix, VN 1.6",
        "the width inside F_q holds V",
        verdict(bool((inside & outside).all()), bool(inside.all())),
        f"{min(ratios[1::2]):.3f} of the width needed at lambda = n a / 3",
        "theta = 45, 60, 90 deg; lambda = 3 n a, n a / 3",
        "for lambda >= n a; below it the near corners are the widest",
    )


CHECKS = (
    factorised_above,
    factorised_below,
    depth_range,
    warp_depth,
    local_representation,
    factorisation,
    width_below,
    width_above,
    width_in_f_q,
)

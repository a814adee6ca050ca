"""The claims of AT09 and of VN on the model, its extrema and the degenerate case."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from claim_checks import DEGREE, EXACT, FAR, NEAR, PHI, Claim, Geometry, lam_of, optimum, relative, verdict

from warpopt import rules

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
        f"largest relative difference {off:.0e}",
        "theta = 5, 20, 35, 60, 90 deg",
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


def _maps(*metrics: str) -> Iterator[np.ndarray]:
    """On both sides of phi, for a strong, a medium and a weak warp: `_INPUTS`."""
    for degrees, lam, metric in itertools.product((10, 30, 60, 90), (0.3, 5.0, 50.0), metrics):
        yield Geometry(degrees * DEGREE).map(metric, lam)


_INPUTS = "theta = 10, 30, 60, 90 deg; lambda = 0.3, 5, 50"


def grows_downwards() -> Claim:
    least = min(float(np.diff(values, axis=0).min()) for values in _maps("p", "q", "pxq"))
    return Claim(
        "grows_downwards",
        "AT09 3.1",
        "E_p, E_q and E_pxq increase as y decreases",
        verdict(least >= -1e-9),
        f"smallest step towards the lower plane {least:.1g}",
        _INPUTS,
    )


def _e_q_order(factor: float) -> bool:
    """Whether E_q is largest at the lower near and least at the upper far corner."""
    good = True
    for degrees in (45, 60, 85):
        g = Geometry(degrees * DEGREE)
        values = g.map("q", factor * NEAR * g.a)
        good &= values[-1, 0] == values.max() and values[0, -1] <= values.min() * (1 + EXACT)
    return good


def extrema_of_e_q() -> Claim:
    above, below = _e_q_order(3.0), _e_q_order(1 / 3)
    return Claim(
        "e_q_extrema",
        "AT09 3.1",
        "E_q is largest at the lower near and least at the upper far corner, for any lambda",
        verdict(above and below, above),
        f"lambda = 3 n a: {above}; lambda = n a / 3: {below}",
        "theta = 45, 60, 85 deg",
        "z_w / z is a constant plus (lambda - n a) / z on both side planes: it falls with z iff lambda > n a",
    )


def largest_at_the_ends() -> Claim:
    good = [max(v[-1, 0], v[-1, -1]) >= v.max() * (1 - EXACT) for v in _maps("p", "pxq")]
    return Claim(
        "largest",
        "AT09 3.1",
        "E_p and E_pxq are largest on the lower plane at z = n or z = f",
        verdict(all(good)),
        f"at {sum(good)} of {len(good)} maps",
        _INPUTS,
    )


def least_at_the_far_corner() -> Claim:
    g, lam = Geometry(60 * DEGREE), 10.0
    values = g.map("p", lam)
    row, column = np.unravel_index(values.argmin(), values.shape)
    at_corner = values[0, -1] / values.min()
    return Claim(
        "least",
        "AT09 3.1",
        "every error is least at the upper far corner",
        verdict(at_corner < 1 + EXACT),
        f"E_p there is {at_corner:.2f} times its least, at z = {g.z[column]:.1f} on the "
        f"{'upper' if row == 0 else 'lower'} plane",
        "theta = 60 deg, lambda = 10",
        "z_w^2 / z is stationary where z_w = 2 z dz_w/dz: at z = (lambda - d0) / a, inside V",
    )


def tsm_is_stronger() -> Claim:
    pairs = {d: (lam_of(rules.tsm, d * DEGREE), lam_of(rules.lispsm, d * DEGREE)) for d in (90, 60)}
    stronger = all(tsm < lispsm for tsm, lispsm in pairs.values())
    other = all(lam_of(rules.tsm, d * DEGREE, kappa=0.28) < lam_of(rules.lispsm, d * DEGREE) for d in (90, 60))
    return Claim(
        "tsm_stronger",
        "AT09 3.1",
        "lambda_TSM < lambda_LiSPSM at 90 and 60 deg",
        verdict(stronger, other),
        ", ".join(f"{tsm:.1f} against {lispsm:.1f} at {d}" for d, (tsm, lispsm) in pairs.items()),
        "VN's kappa = 0.5, xi = 0.8",
        "evaluation; it holds for kappa = 0.28 (below 2/7 at 90 deg)",
    )


def no_advantage_below_phi() -> Claim:
    gains = {}
    for metric in ("p", "pxq"):
        best = float(optimum(metric, [PHI]).value[0])
        gains[metric] = Geometry(PHI).worst(metric, math.inf) / best
    return Claim(
        "no_advantage",
        "AT09 3.2",
        "warps have no particular advantage over no warp for theta <= phi",
        verdict(max(gains.values()) < 1.1),
        ", ".join(f"no warp is {v:.2f} times the optimum in E_{k}" for k, v in gains.items()),
        "theta = phi = 30 deg, L-inf over V",
        "the optimum exhibits one: at theta = phi the near plane still spans a share n/f of W's depth",
    )


def nothing_along_the_view() -> Claim:
    none = {metric: bool(optimum(metric, [0.0]).warp.no_warp[0]) for metric in ("p", "q", "pxq")}
    return Claim(
        "along_the_view",
        "AT09 3.2, VN 3",
        "for a light along the view no warp reduces the errors",
        verdict(all(none.values())),
        f"the optimum is no warp for {', '.join('E_' + k for k, v in none.items() if v)}",
        "theta = 0",
    )


def upper_and_lower_half() -> Claim:
    g = Geometry(PHI)
    ratios = {}
    for name in ("lispsm", "tsm"):
        gain = g.map("pxq", lam_of(rules.PUBLISHED[name], PHI)) / g.map("pxq", math.inf)
        ratios[name] = (float(np.exp(np.log(gain[:20]).mean())), float(np.exp(np.log(gain[21:]).mean())))
    ordered = all(upper < lower for upper, lower in ratios.values())
    return Claim(
        "halves",
        "AT09 3.2",
        "at theta = 30 deg LiSPSM and TSM make errors smaller in the upper half and larger in the lower",
        verdict(ordered and all(u < 1 < v for u, v in ratios.values()), ordered),
        "; ".join(f"{name}: {u:.2f} and {v:.2f} times no warp's" for name, (u, v) in ratios.items()),
        "E_pxq, geometric mean over each half of V (heights and log depth)",
        "if larger means than in the upper half; against no warp the lower half gains too, less",
    )


def lispsm_below_the_view_plane() -> Claim:
    g = Geometry(PHI)
    ratios = {}
    for metric in ("p", "pxq"):
        ours, theirs = (g.map(metric, lam_of(rules.PUBLISHED[name], PHI))[20:] for name in ("lispsm", "tsm"))
        ratios[f"L-inf of E_{metric}"] = float(ours.max() / theirs.max())
        ratios[f"L2 of E_{metric}"] = math.sqrt((ours**2 * g.z).sum() / (theirs**2 * g.z).sum())  # dz = z d(log z)
    return Claim(
        "lispsm_below",
        "AT09 3.2",
        "at theta = 30 deg LiSPSM is better than TSM for objects on or below the view plane",
        verdict(all(r < 1 for r in ratios.values()), any(r < 1 for r in ratios.values())),
        "LiSPSM's over TSM's: " + ", ".join(f"{k} {r:.2f}" for k, r in ratios.items()),
        "lower half of V, uniform over screen and depth; kappa = 0.5, xi = 0.8",
        "in the mean of E_p; not by its largest error, and not by E_pxq: evaluation",
    )


CHECKS = (
    factorised_above,
    factorised_below,
    depth_range,
    width_above,
    width_in_f_q,
    grows_downwards,
    extrema_of_e_q,
    largest_at_the_ends,
    least_at_the_far_corner,
    tsm_is_stronger,
    no_advantage_below_phi,
    nothing_along_the_view,
    upper_and_lower_half,
    lispsm_below_the_view_plane,
)

"""The claims of AT09, section 3: the extrema of the errors, and the degenerate case."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from claim_checks import DEGREE, EXACT, FAR, NEAR, PHI, Claim, Geometry, lam_of, optimum, verdict

from warpopt import rules


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
        f"{_INPUTS}; at 90 deg they do not depend on y",
    )


def _e_q_order(factor: float) -> bool:
    """Whether E_q is largest at the lower near and least at the upper far corner."""
    good = True
    for degrees in (45, 60, 85):
        g = Geometry(degrees * DEGREE)
        values = g.map("q", factor * NEAR * g.a)
        good &= values[-1, 0] == values.max() and values[0, -1] <= values.min() * (1 + EXACT)
    return good


def _words(holds: bool) -> str:
    return "holds" if holds else "does not"


def extrema_of_e_q() -> Claim:
    above, below = _e_q_order(3.0), _e_q_order(1 / 3)
    return Claim(
        "e_q_extrema",
        "AT09 3.1",
        "E_q is largest at the lower near and least at the upper far corner, for any lambda",
        verdict(above and below, above),
        f"lambda = 3 n a: {_words(above)}; lambda = n a / 3: {_words(below)}",
        "theta = 45, 60, 85 deg",
        "z_w / z is a constant plus (lambda - n a) / z on both side planes: it falls with z iff lambda > n a",
    )


def falls_with_depth() -> Claim:
    steps = {}
    for factor in (3.0, 1 / 3):
        geometries = [Geometry(degrees * DEGREE) for degrees in (45, 60, 85)]
        steps[factor] = max(float(np.diff(g.map("q", factor * NEAR * g.a), axis=1).max()) for g in geometries)
    below = max(float(np.diff(Geometry(d * DEGREE).map("q", 0.01), axis=1).max()) for d in (10, 30))
    good = [v <= EXACT for v in (steps[3.0], below, steps[1 / 3])]
    return Claim(
        "e_q_falls",
        "AT09 3.1",
        "E_q increases as z decreases",
        verdict(all(good), all(good[:2])),
        f"largest step away from the eye: {steps[3.0]:.2g} at lambda = 3 n a, {steps[1 / 3]:.2g} at n a / 3",
        "theta = 45, 60, 85 deg; 10, 30 deg with lambda = 0.01",
        "for lambda >= n a, so for theta <= phi always",
    )


def which_end() -> Claim:
    ends = {}
    for metric, lam in itertools.product(("p", "pxq"), (0.3, 50.0)):
        values = Geometry(60 * DEGREE).map(metric, lam)[-1]
        ends[metric, lam] = "n" if values[0] > values[-1] else "f"
    good = all(end == ("f" if lam < 1 else "n") for (_, lam), end in ends.items())
    return Claim(
        "which_end",
        "AT09 3.1",
        "lambda determines whether E_p and E_pxq are largest at z = n or z = f",
        verdict(good),
        ", ".join(f"E_{m} at z = {end} for lambda = {lam:g}" for (m, lam), end in ends.items()),
        "theta = 60 deg",
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
    maps = {metric: g.map(metric, lam) for metric in ("p", "q", "pxq")}
    at_corner = {metric: values[0, -1] / values.min() for metric, values in maps.items()}
    row, column = np.unravel_index(maps["p"].argmin(), maps["p"].shape)
    return Claim(
        "least",
        "AT09 3.1",
        "every error is least at the upper far corner",
        verdict(max(at_corner.values()) < 1 + EXACT),
        f"E_p there is {at_corner['p']:.2f} times its least, at z = {g.z[column]:.1f} on the "
        f"{'upper' if row == 0 else 'lower'} plane; E_q {at_corner['q']:.2f}, E_pxq {at_corner['pxq']:.2f} times",
        "theta = 60 deg, lambda = 10",
        "z_w^2 / z is stationary where z_w = 2 z dz_w/dz: at z = (lambda - d0) / a, inside V",
    )


def tsm_is_stronger() -> Claim:
    pairs = {d: (lam_of(rules.tsm, d * DEGREE), lam_of(rules.lispsm, d * DEGREE)) for d in (90, 60)}
    stronger = all(tsm < lispsm for tsm, lispsm in pairs.values())
    other = all(lam_of(rules.tsm, d * DEGREE, kappa=0.28) < lam_of(rules.lispsm, d * DEGREE) for d in (90, 60))
    bounds = {d: _largest_kappa(d) for d in (90, 60)}
    return Claim(
        "tsm_stronger",
        "AT09 3.1",
        "lambda_TSM < lambda_LiSPSM at 90 and 60 deg",
        verdict(stronger, other),
        ", ".join(f"{tsm:.1f} against {lispsm:.1f} at {d}" for d, (tsm, lispsm) in pairs.items()),
        "VN's kappa = 0.5, xi = 0.8",
        "evaluation; it holds for kappa = 0.28: below " + ", ".join(f"{k:.3f} at {d}" for d, k in bounds.items()),
    )


def _largest_kappa(degrees: float) -> float:
    """Below which TSM's lambda, which rises with kappa, is less than LiSPSM's; by bisection."""
    low, high, lispsm = 0.01, 0.79, lam_of(rules.lispsm, degrees * DEGREE)
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if lam_of(rules.tsm, degrees * DEGREE, kappa=middle) < lispsm else (low, middle)
    return low


def smaller_lambda() -> Claim:
    degrees = np.array([90, 60])
    best = {metric: np.asarray(optimum(metric, degrees * DEGREE).warp.lam)[:2] for metric in ("p", "pxq")}
    lispsm = np.array([lam_of(rules.lispsm, d * DEGREE) for d in degrees])
    return Claim(
        "smaller_lambda",
        "AT09 3.1",
        "minimising max E_pxq requires a relatively smaller lambda",
        verdict(bool((best["pxq"] < np.minimum(best["p"], lispsm)).all())),
        ", ".join(
            f"{q:.2f} against {p:.1f} for max E_p and LiSPSM's {r:.1f} at {d}"
            for d, p, q, r in zip(degrees, *best.values(), lispsm, strict=True)
        ),
        "theta = 90, 60 deg",
    )


def tsm_is_more_suitable() -> Claim:
    """The largest E_pxq over V is below the view plane, where the scene is."""
    ratios = {}
    for kappa, d in itertools.product((0.5, 0.28), (90, 60)):
        lams = (lam_of(rules.tsm, d * DEGREE, kappa=kappa), lam_of(rules.lispsm, d * DEGREE))
        tsm, lispsm = (Geometry(d * DEGREE).worst("pxq", lam) for lam in lams)
        ratios[kappa, d] = tsm / lispsm
    return Claim(
        "tsm_suitable",
        "AT09 3.1",
        "TSM is more suitable than LiSPSM for objects on or below the view plane at 90 and 60 deg, by max E_pxq",
        verdict(max(ratios.values()) < 1, max(r for (kappa, _), r in ratios.items() if kappa < 0.5) < 1),
        "TSM's over LiSPSM's: " + ", ".join(f"{r:.2f} at {d}, kappa = {kappa:g}" for (kappa, d), r in ratios.items()),
        "xi = 0.8",
        "where its lambda is the smaller, for kappa = 0.28; it is not for VN's kappa = 0.5",
    )


def quad() -> Claim:
    good = {}
    for degrees in (5, 20, 30, 31, 60, 90):
        g = Geometry(degrees * DEGREE)
        near, far = (np.array([z * g.a, z * g.b]) for z in (NEAR, FAR))
        good[degrees] = bool(far[0] <= near[0] + EXACT and near[1] <= far[1])
    return Claim(
        "quad",
        "AT09 3.2",
        "seen from the light, V is a quad when theta <= phi",
        verdict(all(inside == (d <= 30) for d, inside in good.items())),
        f"the near plane lies within the far plane at {', '.join(str(d) for d, v in good.items() if v)} deg alone",
        "theta = 5, 20, 30, 31, 60, 90 deg",
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
        "theta = phi = 30 deg, L-inf over V; none: less than 1.1 times",
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


def noticeable_in_the_product() -> Claim:
    g, contrast = Geometry(PHI), {}
    for name, metric in itertools.product(("lispsm", "tsm"), ("p", "q", "pxq")):
        gain = g.map(metric, lam_of(rules.PUBLISHED[name], PHI)) / g.map(metric, math.inf)
        contrast[name, metric] = float(np.exp(np.log(gain[21:]).mean() - np.log(gain[:20]).mean()))
    return Claim(
        "halves_tsm",
        "AT09 3.2",
        "that is most noticeable in E_pxq for TSM",
        verdict(max(contrast, key=contrast.get) == ("tsm", "pxq")),
        "lower over upper half: " + ", ".join(f"{name} E_{m} {v:.2f}" for (name, m), v in contrast.items()),
        "as above",
    )


def lispsm_below_the_view_plane() -> Claim:
    g = Geometry(PHI)
    ratios = {}
    for metric in ("p", "pxq"):
        ours, theirs = (g.map(metric, lam_of(rules.PUBLISHED[name], PHI))[20:] for name in ("lispsm", "tsm"))
        ratios[metric, "L-inf"] = float(ours.max() / theirs.max())
        ratios[metric, "L2"] = math.sqrt((ours**2 * g.z).sum() / (theirs**2 * g.z).sum())  # dz = z d(log z)
    return Claim(
        "lispsm_below",
        "AT09 3.2",
        "at theta = 30 deg LiSPSM is better than TSM for objects on or below the view plane",
        verdict(all(r < 1 for (_, norm), r in ratios.items() if norm == "L-inf")),
        "LiSPSM's over TSM's: " + ", ".join(f"{norm} of E_{metric} {r:.2f}" for (metric, norm), r in ratios.items()),
        "lower half of V, uniform over screen and depth; kappa = 0.5, xi = 0.8",
        "by AT09's own measure, the largest error (3.1), TSM is better in E_p and in E_pxq, there by the mean too: its "
        "lambda is nearer to both optima. LiSPSM's mean of E_p alone is better",
    )


CHECKS = (
    grows_downwards,
    extrema_of_e_q,
    falls_with_depth,
    largest_at_the_ends,
    which_end,
    least_at_the_far_corner,
    tsm_is_stronger,
    smaller_lambda,
    tsm_is_more_suitable,
    quad,
    no_advantage_below_phi,
    nothing_along_the_view,
    upper_and_lower_half,
    noticeable_in_the_product,
    lispsm_below_the_view_plane,
)

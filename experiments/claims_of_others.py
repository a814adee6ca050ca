"""The claims of WI and SC: log maps, storage factor, and when to warp."""

import math

import numpy as np
from claim_checks import DEGREE, EXACT, FAR, NEAR, PAPER, PHI, Claim, Geometry, lam_of, optimum, relative, verdict

import warpopt
from warpopt import rules


def n_opt() -> Claim:
    best = float(optimum("p", [math.pi / 2]).warp.lam[0])
    return Claim(
        "n_opt",
        "WI, LiSPSM optimal choice",
        "n_opt = z_n + sqrt(z_f z_n)",
        verdict(abs(best / 11 - 1) < EXACT),
        f"the optimum of E_p over V is at {best:.6f}",
        "theta = 90 deg",
    )


def logarithm() -> Claim:
    z = np.geomspace(1, 100, 50)
    e_p = (FAR - NEAR) / (z * math.tan(PHI)) / ((FAR - NEAR) / (z * math.log(FAR / NEAR)))
    least = float(warpopt.lower_bound(warpopt.FrustumView(PAPER, math.pi / 2)))
    spread, gap = relative(e_p, e_p[0]), abs(float(e_p[0]) / least - 1)
    gain = float(optimum("p", [math.pi / 2]).value[0]) / least
    return Claim(
        "logarithm",
        "WI, error analysis",
        "s ~ log z makes dp/ds constant, and is the best map",
        verdict(max(spread, gap) < EXACT),
        f"E_p = {e_p[0]:.3f}, the lower bound; the best warp's is {gain:.2f} times it",
        "theta = 90 deg",
    )


def between() -> Claim:
    g, lams = Geometry(math.pi / 2), [lam_of(rule, math.pi / 2) for rule in (rules.psm, rules.lispsm, rules.ssm)]
    near, far = ([float(g.error("p", lam, 0.0, z)) for lam in lams] for z in (NEAR, FAR))
    return Claim(
        "between",
        "WI, LiSPSM optimal choice",
        "LiSPSM's dp/ds lies between uniform and perspective",
        verdict(near[0] < near[1] < near[2] and far[0] > far[1] > far[2]),
        ", ".join(f"{a:.2f} to {b:.2f} for {n}" for a, b, n in zip(near, far, ("PSM", "LiSPSM", "none"), strict=True)),
        "E_p from z = n to z = f on the view axis, theta = 90 deg",
    )


def lispsm_against_psm() -> Claim:
    ratios = {}
    for degrees in (90, 60, 45):
        g = Geometry(degrees * DEGREE)
        psm, lispsm = (g.worst("p", lam_of(rule, degrees * DEGREE)) for rule in (rules.psm, rules.lispsm))
        ratios[degrees] = psm / lispsm
    return Claim(
        "lispsm_psm",
        "WI, error comparison",
        "LiSPSM's error is much lower than PSM's for the same depth range",
        verdict(min(ratios.values()) > 5),
        "max E_p of PSM over LiSPSM's: " + ", ".join(f"{r:.1f} at {d}" for d, r in ratios.items()),
        "theta = 90, 60, 45 deg, over V; much: more than 5 times",
    )


def lispsm_across() -> Claim:
    g = Geometry(math.pi / 2)
    psm, lispsm = (g.worst("q", lam_of(rule, math.pi / 2)) for rule in (rules.psm, rules.lispsm))
    return Claim(
        "dp_dt",
        "WI, error comparison",
        "dp/dt ~ 1 for PSM, slightly worse for LiSPSM",
        verdict(lispsm / psm < 2),
        f"max E_q: {psm:.3f} and {lispsm:.3f}, {lispsm / psm:.2f} times as much",
        "theta = 90 deg, over V; slightly: less than 2 times",
        "E_q(n) = 2 f lambda / (n (f - n + lambda)): 2 at lambda = n, 2 sqrt(f / n) at LiSPSM's",
    )


def _storage(degrees: float) -> float:
    """Spread of max E_p max E_q over lambda from PSM's to the optimum's."""
    g = Geometry(degrees * DEGREE)
    best = float(optimum("p", [degrees * DEGREE]).warp.lam[0])
    values = [g.worst("p", lam) * g.worst("q", lam) for lam in np.geomspace(NEAR * g.a, best, 9)]
    return max(values) / min(values) - 1


def storage_factor() -> Claim:
    spread = {d: _storage(d) for d in (90, 60, 45)}
    constant = {d: v < EXACT for d, v in spread.items()}
    overhead = Geometry(math.pi / 2)
    value = overhead.worst("p", 5.0) * overhead.worst("q", 5.0)
    closed = 2 * (FAR - NEAR) / (NEAR * overhead.tan)
    return Claim(
        "storage",
        "WI, error comparison",
        "the storage factor is constant for n between z_n and n_opt",
        verdict(all(constant.values()), constant[90] and abs(value / closed - 1) < EXACT),
        f"2 (f - n) / (n tan(phi)) = {value:.1f} at 90; it varies by "
        + ", ".join(f"{100 * v:.0f} % at {d}" for d, v in spread.items()),
        "max E_p max E_q over V, lambda from n a to the optimum",
        "overhead, max E_p = E_p(f) ~ (lambda + mu) / lambda and max E_q = E_q(n) ~ its inverse; elsewhere z_w of "
        "the lower near corner is not lambda",
    )


def best_distribution() -> Claim:
    g, lams = Geometry(math.pi / 2), np.geomspace(NEAR, lam_of(rules.lispsm, math.pi / 2), 400)
    p, q = (np.array([g.worst(metric, lam) for lam in lams]) for metric in ("p", "q"))
    larger = np.maximum(p, q)
    return Claim(
        "best_distribution",
        "WI, error comparison",
        "of the n with one storage factor, z_n to n_opt, n_opt has the best error distribution",
        verdict(p.argmin() == larger.argmin() == len(lams) - 1, p.argmin() == len(lams) - 1),
        f"max E_p {p[-1]:.2f} and max E_q {q[-1]:.2f} at n_opt = {lams[-1]:.2f}; the larger of the two is least, "
        f"{larger.min():.1f}, at n = {lams[larger.argmin()]:.1f}",
        "theta = 90 deg, over V",
        "by max E_p; by the larger of max E_p and max E_q, whose product is constant, it is where they are equal",
    )


def best_when_perpendicular() -> Claim:
    degrees = np.array([90, 75, 60, 45, 30, 20, 10, 5])
    view, gains = warpopt.FrustumView(PAPER, degrees * DEGREE), {}
    for metric, norm in (("p", "inf"), ("pxq", "inf"), ("p", "l2"), ("pxq", "l2")):
        best = optimum(metric, degrees * DEGREE, norm).value
        none = warpopt.error_norm(view, warpopt.Warp.from_eta(1.0, view), warpopt.Objective(metric, norm))
        gains[metric, norm] = np.asarray(none / best)
    at = {key: int(degrees[v.argmax()]) for key, v in gains.items()}
    return Claim(
        "perpendicular",
        "SC 4.4",
        "a warp gains most when view and light are perpendicular",
        verdict(set(at.values()) == {90}, 90 in at.values()),
        ", ".join(f"E_{m} {n}: {v[0]:.3g} at 90, {v[4]:.3g} at 30" for (m, n), v in gains.items()),
        "no warp over the optimum, norms over V and the screen",
        "not for E_p in L2, where it gains most at theta = phi",
    )


def most_aliasing_when_perpendicular() -> Claim:
    degrees = np.arange(1, 91)
    worst = np.array([Geometry(d * DEGREE).worst("p", math.inf) for d in degrees])
    return Claim(
        "most_aliasing",
        "SC 4.4",
        "perpendicular light and view is where most perspective aliasing is present",
        verdict(degrees[worst.argmax()] == 90),
        f"max E_p is {worst[-1]:.1f} at 90, {worst.max():.1f} at {degrees[worst.argmax()]}",
        "no warp, over V",
        "without a warp max E_p = mu / (n tan(phi)), and mu, V's extent across the light, is not largest at 90",
    )


def no_perspective_aliasing_when_parallel() -> Claim:
    z = np.array([NEAR, FAR])
    values = Geometry(0.0).error("p", math.inf, 0.0, z)
    best_map = float(values[0] / warpopt.lower_bound(warpopt.FrustumView(PAPER, 0.0)))
    return Claim(
        "parallel",
        "SC 4.4",
        "for parallel light and view no perspective aliasing is present",
        verdict(values[0] / values[1] < 1.1),
        f"E_p at the near plane is {values[0] / values[1]:.0f} times that at the far plane",
        "theta = 0, no warp; none: less than 1.1 times",
        "E_p = mu / (z tan(phi)): the foreshortening remains. No perspective warp mends it, with the near plane in the "
        f"middle of the map; the best monotone map would, {best_map:.1f} times",
    )


def only_worsens() -> Claim:
    g, least = Geometry(0.0), math.inf
    for metric in ("p", "q", "pxq"):
        worst = [g.worst(metric, lam * g.mu) for lam in np.geomspace(1e-3, 10, 17)]
        least = min(least, min(worst) / g.worst(metric, math.inf))
    gain = (g.map("p", g.mu) / g.map("p", math.inf)).min()
    return Claim(
        "only_worsens",
        "SC 4.4",
        "for parallel light and view a warp can only worsen the quality",
        verdict(least > 1 and gain >= 1, least > 1),
        f"the largest error is at least {least:.4f} times no warp's; single points gain, to {gain:.2f} times",
        "theta = 0; E_p, E_q, E_pxq; lambda / mu from 1e-3 to 10, and 1 for the points",
        "by the largest error; half of the map's depth, towards W's near plane, gains what the rest loses",
    )


def converges_to_uniform() -> Claim:
    degrees = np.array([5.0, 1.0, 0.1])
    ratios = [Geometry(d * DEGREE).worst("p", lam_of(rules.lispsm, d * DEGREE)) for d in degrees]
    ratios = [r / Geometry(d * DEGREE).worst("p", math.inf) for r, d in zip(ratios, degrees, strict=True)]
    return Claim(
        "converges",
        "SC 4.4, figure 11",
        "for near parallel light and view LiSPSM converges to uniform shadow mapping",
        verdict(bool((np.diff(np.abs(np.array(ratios) - 1)) < 0).all()) and abs(ratios[-1] - 1) < 0.01),
        "max E_p over no warp's: " + ", ".join(f"{r:.3f} at {d:g}" for r, d in zip(ratios, degrees, strict=True)),
        "theta = 5, 1, 0.1 deg, over V",
    )


def strength_falls_with_the_angle() -> Claim:
    degrees = np.array([90, 75, 60, 45, 30, 15, 5, 2.0])
    lispsm = np.array([lam_of(rules.lispsm, d * DEGREE) for d in degrees])
    best = np.asarray(optimum("p", degrees * DEGREE).warp.lam_over_mu)
    falls, best_falls = bool((np.diff(lispsm) > 0).all()), bool((np.diff(best) > 0).all())
    below = bool((np.diff(best[degrees <= 30]) > 0).all())
    return Claim(
        "strength",
        "SC 4.4",
        "the warp should weaken as the angle decreases, as sin(gamma) makes LiSPSM's do",
        verdict(falls and best_falls, falls and below),
        f"optimal lambda / mu: {best[0]:.3f} at 90, {best[4]:.3f} at 30, {best[5]:.3f} at 15, {best[6]:.3g} at 5",
        "E_p, L-inf over V",
        "for theta <= phi; above it the optimal warp strengthens slightly as the angle decreases: lambda = b sqrt(n "
        "f) + n a",
    )


def scherzers_apex() -> Claim:
    degrees, deep = np.array([90, 60, 30, 15, 5.0]), warpopt.ViewFrustum(1.0, 1000.0, PHI)
    defined = np.asarray(rules.scherzer(deep, degrees * DEGREE).defined)
    return Claim(
        "apex",
        "SC (1)-(3)",
        "n_opt with the apex n_opt - z_n before the eye gives a warp",
        verdict(bool(defined.all()), bool(defined[:3].all())),
        f"none at {', '.join(f'{d:g}' for d in degrees[~defined])} deg",
        "f = 1000, theta = 90, 60, 30, 15, 5 deg",
        "for theta >= phi always; below, V reaches f (tan(phi) cos - sin) behind the eye along Z_w, which n_opt does "
        "not know",
    )


def smaller_extent() -> Claim:
    extents = np.array([99.0, 50.0, 10.0])
    n_opts = (NEAR + np.sqrt(NEAR * (NEAR + extents))) / math.sin(1.0)
    near = [Geometry(1.0).error("p", lam, 0.0, NEAR) for lam in n_opts]
    return Claim(
        "extent",
        "SC 4.4",
        "a smaller depth extent in n_opt gives near objects more of the map",
        verdict(bool((np.diff(near) < 0).all())),
        f"E_p at the near plane {near[0]:.1f}, {near[1]:.1f}, {near[2]:.1f}",
        "theta = 1; extent 99, 50, 10",
    )


CHECKS = (
    n_opt,
    logarithm,
    between,
    lispsm_against_psm,
    lispsm_across,
    storage_factor,
    best_distribution,
    best_when_perpendicular,
    most_aliasing_when_perpendicular,
    no_perspective_aliasing_when_parallel,
    only_worsens,
    converges_to_uniform,
    strength_falls_with_the_angle,
    scherzers_apex,
    smaller_extent,
)

"""The claims of AT09, VN and WI on the rules for lambda and the distributions they give."""

import itertools
import math

import numpy as np
from claim_checks import (
    DEGREE,
    EXACT,
    FAR,
    NEAR,
    PAPER,
    PHI,
    Claim,
    Geometry,
    lam_of,
    optimum,
    relative,
    scientific,
    verdict,
)  # fmt: skip

import warpopt
from warpopt import rules


def lispsm_is_minimal() -> Claim:
    theta = np.array([90, 60, 30]) * DEGREE
    best = np.asarray(optimum("p", theta).value)[:3]
    ratio = [Geometry(t).worst("p", lam_of(rules.lispsm, t)) / b for t, b in zip(theta, best, strict=True)]
    return Claim(
        "lispsm_minimal",
        "AT09 2.5, VN 2.1",
        "LiSPSM's lambda gives the least L-inf norm of E_p",
        verdict(max(ratio) < 1 + 1e-6, ratio[0] < 1 + 1e-6),
        ", ".join(f"{r:.2f} times it at {d}" for r, d in zip(ratio, (90, 60, 30), strict=True)),
        "theta = 90, 60, 30 deg, over V",
        "so for a light overhead; elsewhere the equality of both ends needs n sin(theta), not n / sin(theta)",
    )


def equal_ends() -> Claim:
    ratios = {}
    for degrees in (90, 60, 30):
        lam, g = lam_of(rules.lispsm, degrees * DEGREE), Geometry(degrees * DEGREE)
        ratios[degrees] = float(g.error("p", lam, 0.0, NEAR) / g.error("p", lam, 0.0, FAR))
    equal = {d: abs(r - 1) < EXACT for d, r in ratios.items()}
    return Claim(
        "equal_ends",
        "VN 2.1",
        "(n + sqrt(f n)) / sin(theta) makes E_p equal at both ends of the view axis, about so if not overhead",
        verdict(all(equal.values()), equal[90]),
        "near over far: " + ", ".join(f"{r:.2f} at {d}" for d, r in ratios.items()),
        "theta = 90, 60, 30 deg",
        "for a light overhead; not nearly so at 30 deg",
    )


def ends_of_lambda() -> Claim:
    g, far_away, off = Geometry(60 * DEGREE), 1e12, 0.0
    for metric in ("p", "q", "pxq"):
        off = max(off, relative(g.map(metric, far_away), g.map(metric, math.inf)))
    psm = lam_of(rules.psm, math.pi / 2)
    return Claim(
        "ends",
        "AT09 2.1, WI (free parameter n)",
        "lambda = inf is no warp; lambda = n, for a light overhead, is PSM",
        verdict(off < EXACT and abs(psm / NEAR - 1) < EXACT and g.a > 0),
        f"errors at lambda = 1e12 within {off:.0e} of no warp's; PSM's lambda is {psm:.6f}",
        "theta = 60 deg over V; 90 deg",
    )


def psm_near_the_eye() -> Claim:
    g = Geometry(math.pi / 2)
    lams = (rules.psm, rules.lispsm, rules.tsm, rules.ssm)
    near, far = ([float(g.error("p", lam_of(r, math.pi / 2), 0.0, z)) for r in lams] for z in (NEAR, FAR))
    return Claim(
        "psm_near",
        "VN 1.3, AT09 2.5, WI (PSM)",
        "PSM is good near the viewer, and very bad far away",
        verdict(near[0] == min(near) and far[0] == max(far) and far[0] > 5 * sorted(far)[-2]),
        f"E_p of PSM, LiSPSM, TSM and no warp: {', '.join(f'{v:.2f}' for v in near)} at z = n, "
        f"{', '.join(f'{v:.2f}' for v in far)} at z = f",
        "theta = 90 deg, view axis; very: 5 times the next",
    )


def psm_distribution() -> Claim:
    g, z = Geometry(math.pi / 2), np.geomspace(1, 100, 50)
    lam = lam_of(rules.psm, math.pi / 2)
    p, q = g.error("p", lam, 0.0, z) / z, g.error("q", lam, 0.0, z)
    spread = max(relative(p, p[0]), relative(q, q[0]))
    return Claim(
        "psm",
        "VN 1.3, WI (PSM)",
        "PSM: E_q ~ 1 and E_p ~ z",
        verdict(spread < EXACT),
        f"spread {spread:.0e}",
        "theta = 90 deg, view axis",
    )


def ssm_distribution() -> Claim:
    z = np.geomspace(1, 100, 50)
    spread = 0.0
    for degrees, metric in itertools.product((0, 45, 90), ("p", "q")):
        scaled = Geometry(degrees * DEGREE).error(metric, math.inf, 0.0, z) * z
        spread = max(spread, relative(scaled, scaled[0]))
    return Claim(
        "ssm",
        "VN 1.3, WI (uniform)",
        "no warp: E_q ~ 1/z and E_p ~ 1/z",
        verdict(spread < EXACT),
        f"spread {spread:.0e}",
        "theta = 0, 45, 90 deg",
    )


def _maps_focus(lam: float, g: Geometry, kappa: float, xi: float) -> float:
    """s(z_kappa) - xi."""
    focus = NEAR + (FAR - NEAR) * kappa
    return float((lam + g.mu) / g.mu * (1 - lam / g.z_w(lam, 0.0, focus)) - xi)


def tsm_above() -> Claim:
    g, kappa, xi = Geometry(60 * DEGREE), 0.5, 0.8
    ratio = g.sin / g.cos / g.tan
    top = (FAR - NEAR) * kappa * (1 - xi) + NEAR * (1 - xi) * ratio * g.mu
    off = _maps_focus(top / ((FAR - NEAR) * (xi - kappa) + (FAR * xi - NEAR * (1 - xi)) * ratio) * g.mu, g, kappa, xi)
    right = _maps_focus(lam_of(rules.tsm, 60 * DEGREE), g, kappa, xi)
    return Claim(
        "tsm_above",
        "VN (16), theta >= phi",
        "the lambda printed maps the focus point to s = xi",
        verdict(abs(off) < EXACT),
        f"s = xi {off:+.3f}; corrected, xi {scientific(right)}",
        "theta = 60 deg, kappa = 0.5, xi = 0.8",
        "s(z_kappa) = xi gives tan(phi) / tan(theta), printed upside down, and no second mu",
    )


def tsm_below() -> Claim:
    off = 0.0
    for degrees, (kappa, xi) in itertools.product((5, 15, 29), ((0.5, 0.8), (0.3, 0.9))):
        g = Geometry(degrees * DEGREE)
        r = g.sin / g.cos / g.tan
        top = (FAR - NEAR) * (kappa - 1) * (1 - xi) * r + (1 - xi) * FAR
        lam = top / ((FAR - NEAR) * (1 - kappa) * r + (2 * xi - 1) * FAR) * g.mu
        off = max(off, abs(_maps_focus(lam, g, kappa, xi)))
    return Claim(
        "tsm_below",
        "VN (16), theta <= phi",
        "the lambda printed maps the focus point to s = xi",
        verdict(off < EXACT),
        f"off by at most {off:.0e}",
        "theta = 5, 15, 29 deg; (kappa, xi) = (0.5, 0.8), (0.3, 0.9)",
    )


def tsm_simplified() -> Claim:
    g = Geometry(15 * DEGREE)
    r = g.sin / g.cos / g.tan
    offs = [
        _maps_focus((2 * FAR - (FAR - NEAR) * r * extra) / (5 * (FAR - NEAR) * r + 6 * FAR) * g.mu, g, 0.5, 0.8)
        for extra in (g.mu, 1.0)
    ]
    return Claim(
        "tsm_simplified",
        "VN 2.2, theta <= phi",
        "(16) simplified for kappa = 0.5, xi = 0.8 maps the focus point to s = xi",
        verdict(abs(offs[0]) < EXACT),
        f"as printed s = xi {offs[0]:+.3f}; without the mu inside, xi {offs[1]:+.0e}",
        "theta = 15 deg",
        "(16) has no mu inside the numerator, where lambda would not scale as a length",
    )


def focus_along_the_view() -> Claim:
    """The focus region covers depths 1/4 to 3/4 of W, and half of V's width."""
    lam = lam_of(rules.tsm, 0.0) / Geometry(0.0).mu
    s = [(lam + 1) * depth / (lam + depth) for depth in (0.25, 0.75)]
    widths = [lam / (lam + depth) / 2 for depth in (0.25, 0.75)]
    share = sum(widths) / 2 * (s[1] - s[0])
    return Claim(
        "focus_zero",
        "VN 3",
        "at theta = 0 TSM warps the focus region into very few texels",
        verdict(share < 0.25 / 2),
        f"{share:.4f} of the map, for 0.25 without a warp",
        "kappa = 0.5, xi = 0.8, f/n without bound; very few: less than half",
    )


def area_is_bounded() -> Claim:
    lam = np.geomspace(1e-3, 1e6, 200)[:, None]
    m = np.linspace(1 / 3, 1 / 2, 50)  # VN's a: the middle of the focus region
    h1 = m / 2
    h2 = m - h1 / 2
    gain = lam**2 * (lam + 1) * (lam + m) / ((lam + h2) * (lam + h1 + h2)) ** 2
    good = gain.max() <= 1 + EXACT
    return Claim(
        "area_bound",
        "VN 3",
        "the focus region's area is largest without a warp if its middle lies at a >= 1/3",
        verdict(good and bool((gain.argmax(0) == len(lam) - 1).all())),
        f"at most {gain.max():.6f} of that without a warp",
        "lambda / mu from 1e-3 to 1e6, a from 1/3 to 1/2, h1 = a / 2",
    )


def tsm_along_the_view() -> Claim:
    g = Geometry(0.0)
    lam = lam_of(rules.tsm, 0.0) / g.mu
    quarter = (lam + 1) * 0.25 / (lam + 0.25)
    return Claim(
        "tsm_zero",
        "VN 3",
        "at theta = 0 lambda_TSM = mu / 3, and the first quarter of the depths takes 4/7 of the map",
        verdict(abs(lam - 1 / 3) < EXACT and abs(quarter - 4 / 7) < EXACT),
        f"lambda / mu = {lam:.4f}, s(1/4) = {quarter:.4f}",
        "kappa = 0.5, xi = 0.8",
    )


def alternative_area() -> Claim:
    lam, h1, h2, w = 0.7, 0.3, 0.25, 0.6
    x, s = (np.array([[-v, v] for v in vs]) for vs in ((lam / (lam + h2) * w, lam / (lam + h1 + h2) * w), (0, 0)))
    s = [(lam + 1) * h / (lam + h) for h in (h2, h1 + h2)]
    area = (np.diff(x[0])[0] + np.diff(x[1])[0]) / 2 * (s[1] - s[0])
    shape = w * h1 * lam**2 * (lam + 1) * (lam + h1 / 2 + h2) / ((lam + h2) * (lam + h1 + h2)) ** 2
    return Claim(
        "area",
        "VN 3",
        "the focus region's area has the factor 4",
        verdict(abs(area / shape - 4) < EXACT),
        f"factor {area / shape:.4f}",
        "lambda = 0.7, h1 = 0.3, h2 = 0.25, w1/w = 0.6",
        "half the sum of the parallel sides times the height, with VN's own vertices",
    )


def alternative_vanishes() -> Claim:
    degrees = np.linspace(0, 30, 301)
    warp = rules.tsm_alternative(PAPER, np.minimum(degrees * DEGREE, PHI))
    none = np.asarray(warp.no_warp)
    end = math.degrees(math.atan(math.tan(PHI) / 3 / (1 - 50.5 / 100)))
    predicted = degrees <= end
    return Claim(
        "alternative",
        "VN 3",
        "TSM's alternative goes to no warp as theta goes to 0",
        verdict(bool((none == predicted).all())),
        f"no warp up to {degrees[none].max():.1f} deg",
        "kappa = 0.5",
        "and already where (1 - z_k / f) tan(theta) <= tan(phi) / 3",
    )


def only_the_ratio_counts() -> Claim:
    off = 0.0
    for name in ("lispsm", "tsm", "scherzer"):
        rule = rules.PUBLISHED[name]
        scaled = rule(warpopt.ViewFrustum(0.02, 2.0, PHI), 1.0)
        off = max(off, abs(float(scaled.lam_over_mu / rule(PAPER, 1.0).lam_over_mu) - 1))
    return Claim(
        "scale",
        "VN 2",
        "lambda / mu depends on f/n alone, for given angles",
        verdict(off < EXACT),
        f"relative difference {scientific(off)}",
        "theta = 1; n = 1 and 0.02; LiSPSM, TSM, Scherzer",
    )


def minimum_norm_is_equal() -> Claim:
    off = 0.0
    for degrees in (31, 60, 90):
        g, lam = Geometry(degrees * DEGREE), lam_of(rules.minimum_norm, degrees * DEGREE)
        off = max(off, relative(g.error("p", lam, 0.0, NEAR), g.error("p", lam, 0.0, FAR)))
    return Claim(
        "minimum_norm",
        "ZSZW08, which AT09 cites",
        "one lambda makes E_p equal at both ends of the view axis for any theta",
        verdict(off < EXACT),
        f"relative difference {scientific(off)}",
        "lambda = d0 + sin(theta) sqrt(n f), theta = 31, 60, 90 deg",
    )


CHECKS = (
    lispsm_is_minimal,
    equal_ends,
    ends_of_lambda,
    psm_near_the_eye,
    psm_distribution,
    ssm_distribution,
    tsm_above,
    tsm_below,
    tsm_simplified,
    tsm_along_the_view,
    focus_along_the_view,
    alternative_area,
    area_is_bounded,
    alternative_vanishes,
    only_the_ratio_counts,
    minimum_norm_is_equal,
)

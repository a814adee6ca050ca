"""The published rules by what defines them, and the facts that their papers state."""

import inspect
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from twin import mp, mpf

import warpopt
from warpopt.compare import rule_set
from warpopt.rules import registry

EPS = np.finfo(np.float64).eps
FRUSTUM, THETA = scenes.batch()
TWINS = scenes.twins()
PAPER = warpopt.ViewFrustum(1.0, 100.0, scenes.PHI)
# a: its sign tells theta > phi; at theta = phi, sixty digits leave 1e-62 of it
SLOPES = [float(mp.chop(s.sin - s.tan_phi * abs(s.cos), mpf(10) ** -40)) for s in TWINS]


@pytest.fixture(scope="module")
def warps():
    """Every rule over the shared scenes, in one compiled call."""
    names = ("ssm", "psm", "lispsm", "tsm", "tsm_alternative", "minimum_norm", "scherzer")
    return jax.jit(lambda f, t: {name: getattr(warpopt.rules, name)(f, t) for name in names})(FRUSTUM, THETA)


def close(got, exact, tolerance=32 * EPS):
    """Relative agreement with a 60-digit number, to the roundings of a closed form (a dozen) with some room."""
    return abs(float(mpf(float(got)) / exact - 1)) < tolerance


def test_ssm_is_no_warp(warps):
    assert bool(warps["ssm"].no_warp.all())
    assert bool(warps["ssm"].defined.all())
    assert np.isinf(warps["ssm"].lam).all()


def test_psm_has_its_apex_at_the_eye(warps):
    """z_w of the eye is lambda - d0 = 0; no such warp for theta <= phi, which is flagged."""
    for i, s in enumerate(TWINS):
        assert bool(warps["psm"].defined[i]) == (SLOPES[i] > 0)
        if SLOPES[i] > 0:
            assert close(warps["psm"].lam[i], s.d0, 1e-6 if "just above" in scenes.TAGS[i] else 64 * EPS)
        else:
            assert bool(warps["psm"].no_warp[i])


def test_psm_distribution_under_an_overhead_light():
    """On the axis E_q is constant and E_p proportional to z; lambda = n, eta = n/f, strength 1."""
    warp = warpopt.rules.psm(PAPER, np.pi / 2)
    z = jnp.linspace(1.0, 100.0, 50)
    e_q = warpopt.theory.aliasing_error(PAPER, np.pi / 2, warp, 0.0, z, "q")
    e_p = warpopt.theory.aliasing_error(PAPER, np.pi / 2, warp, 0.0, z, "p")
    np.testing.assert_allclose(e_q / e_q[0], 1, rtol=64 * EPS)
    np.testing.assert_allclose(e_p / z, e_p[0], rtol=64 * EPS)
    assert float(warp.lam) == pytest.approx(1.0, rel=64 * EPS)
    assert float(warp.strength(PAPER)) == pytest.approx(1.0, rel=1e-14)


def test_psm_distribution_at_other_angles():
    """E_q is about constant on the axis and E_p about linear: within b/a over f/n = 100, where SSM's spread is 100."""
    theta = np.pi / 3
    warp = warpopt.rules.psm(PAPER, theta)
    z = jnp.linspace(1.0, 100.0, 50)
    e_q = warpopt.theory.aliasing_error(PAPER, theta, warp, 0.0, z, "q")
    e_p = warpopt.theory.aliasing_error(PAPER, theta, warp, 0.0, z, "p")
    assert float(e_q.max() / e_q.min()) < 1.01
    assert float((e_p / z).max() / (e_p / z).min()) < 1.01


def test_lispsm(warps):
    for i, s in enumerate(TWINS):
        assert close(warps["lispsm"].lam[i], (s.near + mp.sqrt(s.near * s.far)) / s.sin)


def test_lispsm_is_the_overhead_optimum_of_e_p():
    """n + sqrt(f n), to 1e-12, over f/n from 1.1 to 1e4."""
    ratio = np.array([1.1, 2.0, 30.0, 1e4])
    frustum = warpopt.ViewFrustum(0.7, 0.7 * ratio, 0.4)
    solution = warpopt.optimal_warp(warpopt.FrustumView(frustum, np.pi / 2), warpopt.Objective("p", "inf"))
    np.testing.assert_allclose(solution.warp.lam, 0.7 * (1 + np.sqrt(ratio)), rtol=1e-12)
    np.testing.assert_allclose(warpopt.rules.lispsm(frustum, np.pi / 2).lam, solution.warp.lam, rtol=1e-12)
    np.testing.assert_allclose(solution.warp.strength(frustum), 0.5, rtol=1e-12)


def test_scherzer(warps):
    """SC (1), (2): n_opt from the depth extent of the body in light space, the apex n_opt - z_n behind the eye."""
    for i, s in enumerate(TWINS):
        n_opt = (s.near + mp.sqrt(s.near * (s.near + s.mu))) / s.sin
        lam = n_opt - s.near + s.d0
        assert bool(warps["scherzer"].defined[i]) == (lam > 0)
        if lam > 0:  # lambda is a difference where d0 < 0: its condition number times a few eps
            assert close(warps["scherzer"].lam[i], lam, 64 * EPS * float((n_opt + s.near + abs(s.d0)) / lam))


def test_minimum_norm_equalises_the_axis(warps):
    for i, s in enumerate(TWINS):
        lam = s.d0 + s.sin * mp.sqrt(s.near * s.far)
        assert bool(warps["minimum_norm"].defined[i]) == (lam > 0)
        if lam > 0:
            assert abs(s.e_p(lam, 0, s.near) / s.e_p(lam, 0, s.far) - 1) < mpf(10) ** -50
            span = float((abs(s.d0) + s.sin * mp.sqrt(s.near * s.far)) / lam)
            assert close(warps["minimum_norm"].lam[i], lam, 64 * EPS * span)


@pytest.mark.parametrize(("kappa", "xi"), [(0.5, 0.8), (0.1, 0.6), (0.3, 0.95), (0.9, 0.92)])
def test_tsm_maps_its_focus_point_to_xi(kappa, xi):
    """The defining property s(z_kappa) = xi, on both branches; where xi mu <= d_kappa there is no such warp."""
    warp = warpopt.rules.tsm(FRUSTUM, THETA, kappa, xi)
    defined = 0
    for i, s in enumerate(TWINS):
        focus = s.near + (s.far - s.near) * mpf(kappa)
        gap = mpf(xi) - s.depth(0, focus) / s.mu
        assert bool(warp.defined[i]) == (gap > 0)
        if gap > 0:
            defined += 1
            got = s.texture(s.lam(mpf(float(warp.eta[i]))), 0, 0, focus)[1]
            # s's sensitivity to log(eta) is at most 1/4; eta near 1 keeps gap only to eps
            assert abs(float(got - mpf(xi))) < 32 * EPS
        else:
            assert bool(warp.no_warp[i])
    assert defined > 4


def test_tsm_of_a_light_along_the_view():
    """VN 3: lambda_TSM(theta = 0) = mu / 3 for kappa = .5, xi = .8; then s(1/4) = 4/7, over half the map."""
    warp = warpopt.rules.tsm(PAPER, 0.0)
    assert float(warp.lam_over_mu) == pytest.approx(1 / 3, rel=8 * EPS)
    assert float(warp.lam) == pytest.approx(float(warp.mu) / 3, rel=8 * EPS)
    quarter = 0.25  # of mu = 2 f tan(phi), from the upper plane at z = f: y = f tan(phi) / 2
    y = 100.0 * np.tan(scenes.PHI) * (1 - 2 * quarter)
    _, s = warpopt.theory.texture_coordinates(PAPER, 0.0, warp, 0.0, y, 100.0)
    assert float(s) == pytest.approx(4 / 7, rel=16 * EPS)


def test_tsm_alternative_maximises_the_focus_regions_area(warps):
    """The trapezoid's area over a grid of lambda, from vertices; no warp iff (1 - z_k/f) tan theta <= tan phi / 3."""
    frustum = warpopt.ViewFrustum(1.0, 100.0, 0.6)
    theta = np.array([0.02, 0.2, 0.36, 0.42, 0.5, 0.6])
    kappa = 0.3
    warp = warpopt.rules.tsm_alternative(frustum, theta, kappa)
    focus = 1 + 99 * kappa
    none = (1 - focus / 100) * np.tan(theta) <= np.tan(0.6) / 3
    assert 0 < none.sum() < len(theta)
    assert np.asarray(warp.no_warp).tolist() == none.tolist()
    assert bool(warp.defined.all())
    grid = np.exp(np.linspace(-8, 0, 40001))[:-1]
    for i, t in enumerate(theta):
        mu = 2 * 100 * np.tan(0.6) * np.cos(t)
        depth = [
            focus * np.sin(t) - y * np.cos(t) - 100 * (np.sin(t) - np.tan(0.6) * np.cos(t))
            for y in (focus * np.tan(0.6), -focus * np.tan(0.6))
        ]
        lam = mu * grid / (1 - grid)
        # widths of the region's ends in the map, and the length between them, up to a constant
        ends = [lam / (lam + d) for d in depth]
        s = [(lam + mu) / mu * (1 - e) for e in ends]
        area = (ends[0] + ends[1]) / 2 * (s[1] - s[0])
        best = grid[area.argmax()]
        if none[i]:
            assert area.argmax() == len(grid) - 1
        else:
            assert abs(np.log(float(warp.eta[i]) / best)) < 8 / 40000 + 1e-6  # a grid step; ties round
    # above theta = phi the rule is not defined
    assert np.asarray(warps["tsm_alternative"].defined).tolist() == [a <= 0 for a in SLOPES]


def test_n_opt_is_the_axis_optimum_seen_from_the_apex():
    """WI: n_opt = z_n + sqrt(z_f z_n), the near distance of the warp that equalises the axis, light overhead."""
    for rule in (warpopt.rules.lispsm, warpopt.rules.minimum_norm):
        warp = rule(PAPER, np.pi / 2)
        assert float(warp.lam) == pytest.approx(1 + np.sqrt(100.0), rel=8 * EPS)
        ends = warpopt.theory.aliasing_error(PAPER, np.pi / 2, warp, 0.0, jnp.array([1.0, 100.0]))
        np.testing.assert_allclose(ends[0], ends[1], rtol=32 * EPS)


def test_storage_factor_is_constant_between_psm_and_lispsm():
    """WI: max E_p max E_q = 2 (f - n) / (n tan phi) for lambda in [n, n_opt], light overhead; larger outside."""
    constant = 2 * 99 / np.tan(scenes.PHI)
    lam = jnp.array([1.0, 2.0, 5.0, 8.0, 11.0, 0.9, 12.0])
    view = warpopt.FrustumView(PAPER, np.full(7, np.pi / 2))
    warp = warpopt.Warp.from_lam(lam, view)
    p, q = (warpopt.error_norm(view, warp, warpopt.Objective(metric)) for metric in ("p", "q"))
    np.testing.assert_allclose((p * q)[:5], constant, rtol=64 * EPS)
    assert bool(((p * q)[5:] > constant * 1.001).all())


def test_the_logarithmic_map_has_constant_e_p():
    """WI: light overhead, s = log(z/n) / log(f/n) makes dp/ds constant; its E_p bounds the optimum's."""
    z = jnp.linspace(1.0, 100.0, 30)
    ds = jax.vmap(jax.grad(lambda v: jnp.log(v) / jnp.log(100.0)))(z)
    dp = 1 / (z * np.tan(scenes.PHI))  # along y = z - b at the axis, up to the projection factor
    np.testing.assert_allclose(dp / ds, np.log(100.0) / np.tan(scenes.PHI), rtol=8 * EPS)
    assert float(warpopt.optimal_warp(warpopt.FrustumView(PAPER, np.pi / 2), warpopt.Objective("p")).value) > np.log(
        100.0
    ) / np.tan(scenes.PHI)


def test_rules_are_mirror_symmetric():
    """theta -> pi - theta; to 256 eps of lambda, since pi - theta is itself rounded."""
    theta = np.linspace(0.05, np.pi / 2, 16)
    for name in ("psm", "lispsm", "tsm", "minimum_norm", "scherzer"):
        rule = getattr(warpopt.rules, name)
        here, there = rule(PAPER, theta), rule(PAPER, np.pi - theta)
        assert np.asarray(here.defined == there.defined).all()
        np.testing.assert_allclose(here.eta, there.eta, rtol=256 * EPS)


def test_the_registry_is_read_without_jax():
    """Nor does warpopt itself load SciPy, which few calls need: a third of its time."""
    code = (
        "import sys, warpopt.rules; assert len(warpopt.rules.PUBLISHED) == 7; assert 'jax' not in sys.modules;"
        "warpopt.optimal_warp, warpopt.shadow_matrix, warpopt.cascades; assert 'scipy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("rule", registry.EVERY.values(), ids=lambda rule: rule.name)
def test_a_rule_of_the_registry_is_its_function_and_its_source_is_the_docstrings(rule):
    assert rule.function is getattr(warpopt.rules, rule.name)
    assert rule.function.__name__ == rule.name
    assert rule.source in " ".join(inspect.getdoc(rule.function).split())


def test_a_rule_of_the_registry_is_taken_as_its_name_is():
    rule = registry.EVERY["tsm"]
    assert rule_set.rule_set([rule]) == rule_set.rule_set("tsm") == {"tsm": warpopt.rules.tsm}
    assert float(rule(PAPER, 1.0, kappa=0.4).eta) == float(warpopt.rules.tsm(PAPER, 1.0, kappa=0.4).eta)

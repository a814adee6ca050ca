"""The engines' rules: their formulas as printed in their sources, in 60-digit arithmetic, and what they mean."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from pages import same_to_the_digits, section
from twin import mp, mpf

import warpopt
from warpopt import rules
from warpopt.solve.optimal_warp import optimum_and_norms

EPS = np.finfo(np.float64).eps
FRUSTUM, THETA = scenes.batch()
TWINS = scenes.twins()
PAPER = warpopt.ViewFrustum(1.0, 100.0, scenes.PHI)
DEGREES = np.array([90.0, 60.0, 45.0, 30.0, 10.0])
# Worked by hand from each engine's source for n = 1, f = 100, phi = 30 degrees, to the digits given. Dagor's cutoff
# |cos| >= 0.95 leaves its map uniform at 10 degrees; its formula alone gives 42.2 there.
WORKED = {
    "lispsm_paper": ("11.00", "12.73", "14.04", "16.28", "31.99"),
    "filament": ("11.00", "12.70", "14.04", "16.28", "31.99"),
    "osg_lispsm": ("11.00", "13.36", "16.35", "23.40", "62.46"),
    "osg_vdsm": ("2.475", "11.06", "32.11", "86.60", "1055.8"),
    "openmw": ("12.38", "14.36", "32.11", "86.60", "1055.8"),
    "ogre": ("1.10", "1.10", "1.10", "1.10", "19.76"),
    "veloren": ("11.00", "12.77", "14.90", "45.35", "inf"),
    "tsm_xray": ("11.88", "13.79", "13.35", "12.00", "13.65"),
    "tsm_dagor": ("36.8", "42.7", "41.3", "37.1", "inf"),
}


@jax.jit
def every_engine(frustum, theta, unit):
    """Filament's hints are lengths, in the unit given."""
    own = {"filament": {"near_hint": unit, "far_hint": 100 * unit}}
    return {name: rule(frustum, theta, **own.get(name, {})) for name, rule in rules.ENGINES.items()}


@pytest.fixture(scope="module")
def warps():
    return every_engine(FRUSTUM, THETA, 1.0)


@pytest.fixture(scope="module")
def worked():
    return every_engine(PAPER, np.deg2rad(DEGREES), 1.0)


@pytest.mark.parametrize("name", WORKED)
def test_worked_values(worked, name):
    """Half a unit of the last digit printed."""
    for got, printed in zip(np.asarray(worked[name].lam), WORKED[name], strict=True):
        if printed == "inf":
            assert got > 1e30  # 10 degrees are phi/3 up to rounding, where Veloren's e + 1 grows from 0
        else:
            unit = 10.0 ** -len(printed.partition(".")[2])
            assert abs(got - float(printed)) <= unit / 2 * (1 + 1e-9)
    assert bool(worked[name].defined.all())


def test_dagor_without_its_cutoff(worked):
    warp = rules.tsm_dagor(PAPER, np.deg2rad(10.0), cutoff=1.0)
    assert float(warp.lam) == pytest.approx(42.2, abs=0.05)


def as_printed(name, s, theta, phi):
    """(lambda, or None for uniform; the size of its largest term) from the engine's own lines, mu and d0 aside."""
    n, f, d, sin, cos = s.near, s.far, s.mu, s.sin, abs(s.cos)
    root = mp.sqrt
    if name == "lispsm_paper":
        lam = (n + root(n * (n + d * sin))) / sin
    elif name == "filament":
        dzn, dzf = max(mpf(0), 1 - n), max(mpf(0), f - 100)
        if not (sin > 0.02 and 3 * dzn / (f - n) < 2):
            return None, 0
        v0, v1 = max(n, n + dzn), max(mpf(0), min(f, f - dzf, n + d * sin))
        lam = max((n + root(v0 * v1)) / sin, dzn / (2 - 3 * dzn / (f - n)))
    elif name == "osg_lispsm":
        z_n = n / sin
        N = max((z_n + root((z_n + d * sin) * z_n)) / sin, d * mpf("0.02"))
        return N - n + s.d0, N + n + abs(s.d0)
    elif name == "osg_lispsm_corrected":
        far_end = n / sin + d  # along Z_w from the eye
        c = root(n / sin * far_end)
        return c + s.d0, c + abs(s.d0)
    elif name in ("osg_vdsm", "openmw"):
        if sin < mp.sin(mp.radians(2)):
            return None, 0
        eye = -(2 * s.d0 + d) / d
        least = max(-1 - eye, mpf("0.05" if name == "osg_vdsm" else "0.25"))
        lam = d / 2 * max(mp.tan(mp.radians(30)) * (cos / sin) ** 2, least)
    elif name == "ogre":
        c = mp.cos(mpf("0.451"))
        lam = (n + root(n * f)) / 10 * (1 if cos < c else 1 + 20 * (cos - c) / (1 - c))
    elif name == "veloren":
        g = mp.asin(sin)
        if g < phi / 3:
            return None, 0
        if g < phi:
            e = -1 + mpf("0.8") * (1 - mp.cos(mp.pi / 2 * (g - phi / 3) / (phi - phi / 3)))
        else:
            e = -mpf("0.2") + mpf("0.2") * mp.sin(mp.pi / 2 * min((g - phi) / (mpf("0.3") * (mp.pi / 2 - phi)), mpf(1)))
        A = min(f, n + d * sin) / n
        if e < 0:
            lam = d * (1 + root(A) - e * (A - 1)) / ((A - 1) * (e + 1))
        else:
            lam = d / ((root(A) - 1) * (e * root(A) + 1))
    else:
        delta, cutoff = (mpf("0.3"), 0.99) if name == "tsm_xray" else (mpf("0.52"), 0.95)
        if cos >= cutoff:
            return None, 0
        xi = -mpf("0.6")
        lam = d * delta * (1 + xi) / ((1 - xi) - 2 * delta)
    return lam, lam


@pytest.mark.parametrize("name", list(rules.ENGINES))
def test_against_the_sources_own_lines(warps, name):
    """On both branches, thin, deep and mirrored, to 256 eps of the largest term.

    mu and d0 are the twin's, from the corners.
    """
    checked = 0
    for i, s in enumerate(TWINS):
        lam, size = as_printed(name, s, scenes.CASES[i].theta, mpf(scenes.CASES[i].half_fov))
        got = warps[name].lam[i]
        if lam is None:
            assert bool(warps[name].no_warp[i])
            assert bool(warps[name].defined[i])
        elif lam <= 0:
            assert not bool(warps[name].defined[i])
            assert bool(warps[name].no_warp[i])
        else:
            checked += 1
            assert bool(warps[name].defined[i])
            if lam > 1e30:  # Veloren at g = phi/3: e + 1 is the square of a rounding
                assert got > 1e30
                continue
            # Veloren's e + 1 is a square of (theta - phi/3)/phi
            slack = 1024 if name == "veloren" else 256
            assert abs(float((mpf(float(got)) - lam) / size)) < slack * EPS, scenes.TAGS[i]
    assert checked >= 8


def test_guards_at_their_edges():
    def uniform(rule, theta, **options):
        warp = rule(PAPER, theta, **options)
        assert bool(warp.defined)
        return bool(warp.no_warp)

    step = 1e-9
    assert uniform(rules.filament, np.arcsin(0.02) - step)
    assert not uniform(rules.filament, np.arcsin(0.02) + step)
    assert uniform(rules.filament, 1.0, near_hint=1 + 66 + step)
    assert not uniform(rules.filament, 1.0, near_hint=1 + 66 - step)
    for rule in (rules.osg_vdsm, rules.openmw):
        assert uniform(rule, np.deg2rad(2) - step)
        assert not uniform(rule, np.deg2rad(2) + step)
        assert uniform(rule, np.deg2rad(178) + step)
    assert uniform(rules.veloren, scenes.PHI / 3 - step)
    assert not uniform(rules.veloren, scenes.PHI / 3 + 1e-5)
    for rule, cutoff in ((rules.tsm_xray, 0.99), (rules.tsm_dagor, 0.95)):
        assert uniform(rule, np.arccos(cutoff) - step)
        assert not uniform(rule, np.arccos(cutoff) + step)
    # 1 - xi = 2 delta is lambda = inf; beyond it there is none
    assert uniform(rules.tsm_xray, 1.0, delta=0.75, xi=-0.5)
    assert not bool(rules.tsm_xray(PAPER, 1.0, delta=0.8, xi=-0.5).defined)
    # N >= 0.02 d in OpenSceneGraph, for f/n above 2600
    deep = warpopt.ViewFrustum(1.0, 1e5, scenes.PHI)
    assert float(rules.osg_lispsm(deep, np.pi / 2).lam) == pytest.approx(0.02 * (1e5 - 1), rel=1e-12)


@pytest.mark.parametrize(
    ("rule", "options", "words"),
    [
        ("filament", {"near_hint": -1.0}, "near_hint"),
        ("filament", {"far_hint": 0.0}, "far_hint"),
        ("osg_vdsm", {"near_far_ratio": 0.0}, "near_far_ratio"),
        ("ogre", {"adjust": 0.0}, "adjust"),
        ("ogre", {"threshold": 2.0}, "threshold"),
        ("veloren", {"at_phi": 0.1}, "at_phi"),
        ("veloren", {"span": 0.0}, "span"),
        ("tsm_xray", {"delta": 1.0}, "delta"),
        ("tsm_xray", {"xi": 1.0}, "xi"),
        ("tsm_dagor", {"cutoff": 0.0}, "cutoff"),
        ("lispsm_paper", {}, "theta"),
    ],
)
def test_bad_parameters_are_named(rule, options, words):
    with pytest.raises(ValueError, match=words):
        rules.ENGINES[rule](PAPER, 1.0 if options else -1.0, **options)


def test_no_rule_beats_the_optimum_and_units_do_not_matter(warps):
    """The optimum of E_p and E_pxq is never worse; lengths times 7.5 leave eta alone (Filament's hints with them)."""
    stacked = jax.tree.map(lambda *fields: jnp.stack(fields), *warps.values())
    for metric in ("p", "pxq"):
        best, values = optimum_and_norms(warpopt.FrustumView(FRUSTUM, THETA), stacked.eta, warpopt.Objective(metric))
        assert bool((values / best.value >= 1 - 1e-13).all())
    scaled = every_engine(warpopt.ViewFrustum(7.5 * FRUSTUM.near, 7.5 * FRUSTUM.far, FRUSTUM.half_fov), THETA, 7.5)
    for name in rules.ENGINES:  # 7.5 n rounds, and osg's lambda is a difference
        np.testing.assert_allclose(scaled[name].eta, warps[name].eta, rtol=1e-12, err_msg=name)


def test_single_precision_and_finite_gradients(warps):
    """float32 within 64 eps of float64's eta, and a finite gradient in everything, at every edge too."""
    frustum32, theta32 = scenes.batch(dtype=np.float32)
    same = warpopt.ViewFrustum(*(np.asarray(v, np.float64) for v in jax.tree.leaves(frustum32)))
    half, whole = every_engine(frustum32, theta32, np.float32(1)), every_engine(same, np.asarray(theta32, float), 1.0)
    for name in rules.ENGINES:
        assert half[name].eta.dtype == np.float32
        # where lambda is a difference, eta moves by its condition number
        loose = 64 * np.finfo(np.float32).eps * (1 if not name.startswith("osg_lispsm") else 16)
        np.testing.assert_allclose(half[name].eta, whole[name].eta, rtol=loose, err_msg=name)

    edges = np.array([0.0, 1e-9, scenes.PHI / 3, scenes.PHI, np.pi / 2, np.pi])

    def total(near, far, phi, theta):
        warps = every_engine(warpopt.ViewFrustum(near, far, phi), theta, 1.0)
        return sum(warp.eta.sum() for warp in warps.values())

    slopes = jax.jit(jax.grad(total, (0, 1, 2, 3)))(1.0, 100.0, scenes.PHI, edges)
    assert all(bool(jnp.isfinite(slope).all()) for slope in slopes)


def test_what_the_rules_equalise():
    """The property each is derived from, by the errors themselves, not by its formula."""
    for degrees in (35.0, 60.0, 90.0):
        s = scenes.twin.Scene(1.0, 100.0, scenes.PHI, np.deg2rad(degrees))

        def e_p(lam, distance, z, s=s):  # at a distance from the apex along Z_w
            return s.mu * distance**2 / ((lam + s.mu) * lam * s.tan_phi * z)

        theta = np.deg2rad(degrees)
        lam = mpf(float(rules.lispsm_paper(PAPER, theta).lam))
        ends = [e_p(lam, lam + t, s.near + t * s.sin) for t in (mpf(0), s.mu)]
        assert abs(ends[0] / ends[1] - 1) < 1e-13
        # through the eye: eye depth grows by sin(theta) along Z_w
        lam = mpf(float(rules.osg_lispsm_corrected(PAPER, theta).lam))
        apex = s.d0 - lam
        ends = [e_p(lam, z / s.sin - apex, z) for z in (s.near, s.near + s.mu * s.sin)]
        assert abs(ends[0] / ends[1] - 1) < 1e-13
        lam = mpf(float(rules.osg_lispsm(PAPER, theta).lam))
        ends = [e_p(lam, z / s.sin - s.d0 + lam, z) for z in (s.near, s.near + s.mu * s.sin)]
        if degrees < 90:
            assert abs(ends[0] / ends[1] - 1) > 0.03
        else:  # one unit for both lengths: the slip does nothing
            assert abs(ends[0] / ends[1] - 1) < 1e-13


def test_filaments_second_distance_minimises_the_product_at_its_near_hint():
    """n1 is where E_p E_q at (axis, z = near_hint) is stationary, for a light overhead; n0 takes over below."""
    hint = 55.0
    lam = float(rules.filament(PAPER, np.pi / 2, near_hint=hint).lam)
    assert lam == pytest.approx(54 / (2 - 3 * 54 / 99), rel=1e-12)
    view = warpopt.FrustumView(PAPER, np.pi / 2)
    around = warpopt.Warp.from_lam(lam * np.array([0.99, 1.0, 1.01]), view)
    values = warpopt.theory.aliasing_error(PAPER, np.pi / 2, around, 0.0, hint, "pxq")
    assert float(values[1]) < float(min(values[0], values[2]))
    # E_p alone would be stationary at h / (1 - 2 h / (f - n)), and never where 2 h >= f - n: it only falls here
    values = warpopt.theory.aliasing_error(PAPER, np.pi / 2, around, 0.0, hint, "p")
    assert float(values[0]) > float(values[1]) > float(values[2])
    nearer = rules.filament(PAPER, np.pi / 2, near_hint=40.0)
    assert float(nearer.lam) == pytest.approx(1 + np.sqrt(40 * 100), rel=1e-12)


def test_filaments_hint_is_counted_from_the_cameras_near_plane():
    """Over a body that begins at 10 before a camera whose near is 2: dzn = 50 - 2, zf - zn = 100 - 10."""
    body = rules.Body(*jnp.array([10.0, 100.0, 0.5, 10.0, 90.0, 2.0, 500.0]))
    warp = rules.filament(body, np.pi / 2, near_hint=50.0)
    first, second = 10 + np.sqrt(50 * 100), 48 / (2 - 3 * 48 / 90)
    assert second > first
    assert float(warp.lam) == pytest.approx(second, rel=1e-12)
    assert bool(rules.filament(body, np.pi / 2, near_hint=62.0).no_warp)  # 3 * 60 = 2 * 90


@pytest.mark.parametrize(
    ("rule", "lam"),
    [
        # from calculateNOptSimple: |e_z| of the body's nearest point, but the clip distances under the root
        (rules.ogre, (10 + np.sqrt(2 * 400)) / 10),
        # SC (1), (2): z_n of the eye's frustum, Delta z of the body; the apex is n_opt - z_n before the eye
        (rules.scherzer, (2 + np.sqrt(2 * (2 + 90))) - 2 + 10),
        # the hull's own nearest depth, for the distance and for the apex (nearDist = -bb._max[2])
        (rules.osg_lispsm, 10 + np.sqrt(10 * (10 + 90))),
        (rules.osg_lispsm_corrected, 10 + np.sqrt(10 * (10 + 90))),
        (rules.lispsm_paper, 10 + np.sqrt(10 * (10 + 90))),
        (rules.veloren, 10 + np.sqrt(10 * (10 + 90))),  # z_0 and z_1 = z_0 + d s from bounds of what is visible
        (rules.lispsm, 10 + np.sqrt(10 * 100)),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_each_rule_takes_the_planes_that_its_source_takes(rule, lam):
    """A body from 10 to 100 before a camera of planes 2 and 400, the light overhead; docs/corrections.md has whose."""
    body = rules.Body(*jnp.array([10.0, 100.0, 0.5, 10.0, 90.0, 2.0, 400.0]))
    assert float(rule(body, np.pi / 2).lam) == pytest.approx(lam, rel=1e-12)


def test_tsm_of_engines_maps_its_depth_fraction_to_its_line():
    for rule, delta in ((rules.tsm_xray, 0.3), (rules.tsm_dagor, 0.52)):
        warp = rule(PAPER, 1.0)
        eta = float(warp.eta)
        assert delta / ((1 - delta) * eta + delta) == pytest.approx(0.8, rel=16 * EPS)


def test_tsms_two_rules_each_have_their_range(monkeypatch):
    """docs/corrections.md: near the view direction the alternative, without a warp, is the better; near phi the other.

    The alternative's no-warp range ends where (1 - z_k/f) tan(theta) = tan(phi)/3, on the experiment's grid. The page
    has the experiment's table.
    """
    root = Path(__file__).parents[1]
    monkeypatch.setattr(sys, "path", [str(root / "experiments"), *sys.path])
    import tsm_rules

    rows = [tsm_rules.compare(*view) for view in tsm_rules.VIEWS]
    page = (root / "docs" / "corrections.md").read_text(encoding="utf-8")
    assert same_to_the_digits(section(page, "tsm rules"), tsm_rules.table(rows))
    row = rows[tsm_rules.VIEWS.index((100.0, 30.0))]
    assert row["tsm: no warp"] == row["tsm: undefined"] == row["alternative: undefined"] == []
    end = np.rad2deg(np.arctan(np.tan(scenes.PHI) / 3 / (1 - 50.5 / 100)))
    assert row["alternative: no warp"] == [(0.0, pytest.approx(end, abs=0.1))]
    for metric, crossing in (("p", 14.3), ("pxq", 23.8)):
        ((start, last),), ((first, stop),) = row[metric]["alternative better"], row[metric]["tsm better"]
        assert (start, stop) == (0.0, 30.0)
        assert last == pytest.approx(crossing, abs=0.15)
        assert first == pytest.approx(crossing, abs=0.15)

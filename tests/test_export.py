"""Exported code, compiled and run: the lookup of a table, and the closed form."""

import equinox as eqx
import numpy as np
import pytest
from shaders import run_compiled, run_glsl, run_wgsl, validate

import warpopt
from warpopt.export.closed_form import closed_form_source
from warpopt.export.languages import CPP, GLSL_330, GLSL_450, HLSL, LANGUAGES, WGSL, C
from warpopt.export.lookup import source
from warpopt.export.program import checked_prefix

FRUSTUM = warpopt.ViewFrustum(1.0, 100.0, np.pi / 6)
EPS = float(np.finfo(np.float32).eps)
SPECIAL = (0.0, -0.0, np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-40, -1.0, np.pi, 4.0, np.pi / 2)


@pytest.fixture(scope="module")
def table():
    return warpopt.build_table(FRUSTUM, max_regret=1e-3)


def directions(table, count: int) -> np.ndarray:
    """(theta, near, far, half_fov) rows: random, beyond the ends, at every knot, and what is no angle."""
    theta = np.random.default_rng(0).uniform(-1, 4.2, count)
    knots = np.float32(table.theta.ravel())
    theta = np.concatenate([theta, SPECIAL, knots, np.nextafter(knots, np.float32(9))])
    rows = np.tile(np.float32([0, 1, 100, np.pi / 6]), (len(theta), 1))
    rows[:, 0] = theta
    return rows


def ulps(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.abs(found.view(np.int32).astype(np.int64) - expected.astype(np.float32).view(np.int32))


@pytest.mark.parametrize(("compiler", "language"), [("gcc", C), ("g++", CPP)])
def test_a_tables_code_is_its_look_up(table, tmp_path, compiler, language):
    """100,000 inputs with NaN, infinities and what lies outside: within 4 ulp of float32, under the sanitisers."""
    if language is CPP:  # one whose ends lie within, so that both clamp
        inner = table.theta[..., 1:-1], table.knot_eta[..., 1:-1]
        table = eqx.tree_at(lambda t: (t.theta, t.knot_eta), table, inner)
    given = directions(table, 100_000)
    eta, lam = run_compiled(compiler, language.suffix, source(table, language), given, False, tmp_path).T
    expected = table.eta_numpy(given[:, 0])
    assert ulps(eta, expected).max() <= 4
    inside = (given[:, 0] >= 0) & (given[:, 0] <= np.float32(np.pi / 2)) & (expected < 1)
    exact = table.warp(FRUSTUM, given[inside, 0].astype(float)).lam
    # mu's sum, and 1 - eta next to no warp, which costs digits in single precision
    assert (np.abs(lam[inside] / exact - 1) < 1e-5 + 2 * EPS / (1 - expected[inside])).all()
    assert (lam[expected == 1] > 3.3e38).all()
    assert ((lam > 0) & np.isfinite(lam)).all()


def rows_of(rows: int, fovs: int) -> warpopt.LambdaTable:
    """A table over far/near and the field of view, smooth as real ones are, with knots that move."""

    def single(values: np.ndarray) -> np.ndarray:
        return np.float32(values).astype(float)

    ratios, half_fovs = single(np.geomspace(2, 1e4, rows)), single(np.linspace(0.2, 0.9, fovs))
    phi = half_fovs[None, :, None]
    theta = np.linspace(0, 1, 7) ** 2 * np.ones((rows, 1, 1)) * np.where(np.arange(7) < 4, 2 * phi, np.pi / 2)
    theta[..., 4:] = np.maximum(theta[..., 4:], theta[..., 3:4])
    theta[..., -1] = np.pi / 2
    eta = ratios[:, None, None] ** -0.5 * (1 + np.cos(5 * theta) * phi) ** 2 + 0.01
    return warpopt.LambdaTable(
        ratios, half_fovs, single(theta), single(eta), warpopt.Objective(), np.inf, 1e-3, 9e-4, (1.0, 2.0, 0.5), "0"
    )


def frusta_around(count: int) -> np.ndarray:
    """Rows within the axes of `rows_of` and beyond, and what is no frustum."""
    rng = np.random.default_rng(2)
    given = np.empty((count, 4), np.float32)
    given[:, 0], given[:, 1] = rng.uniform(-0.5, 3.6, count), 10 ** rng.uniform(-2, 2, count)
    given[:, 2] = given[:, 1] * 10 ** rng.uniform(0.01, 5, count)
    given[:, 3] = rng.uniform(0.05, 1.2, count)
    given[:40] = 0.7, 1, 100, 0.5
    for i, (column, value) in enumerate([(c, v) for c in range(4) for v in (np.nan, np.inf, -np.inf, 0, -1, 1e-38)]):
        given[i, column] = value
    return given


@pytest.mark.parametrize(("rows", "fovs", "compiler"), [(12, 1, "gcc"), (1, 5, "g++"), (12, 5, "gcc"), (12, 5, "g++")])
def test_the_code_of_several_rows_is_their_look_up(rows, fovs, compiler, tmp_path):
    """As above; 4 ulp, of which the blend's exp and log may differ by one or two each."""
    table, language = rows_of(rows, fovs), C if compiler == "gcc" else CPP
    if fovs == 1:
        table = eqx.tree_at(lambda t: t.half_fov, table, np.array([0.5]))
    given = frusta_around(100_000)
    eta, lam = run_compiled(compiler, language.suffix, source(table, language), given, fovs > 1, tmp_path).T
    assert (np.isfinite(lam) & (lam > 0)).all()
    no_frustum = ~((given[:, 1] > 0) & (given[:, 2] > given[:, 1]) & np.isfinite(given[:, 2]))
    assert (lam[no_frustum] > 3.3e38).all()
    with np.errstate(all="ignore"):
        expected = table.eta_numpy(given[:, 0], given[:, 2] / given[:, 1], given[:, 3])
    assert ulps(eta, expected).max() <= 4
    needed = [0] + [1, 2] * (rows > 1) + [3] * (fovs > 1)
    assert (eta[np.isnan(given[:, needed]).any(1)] == 1).all()


@pytest.mark.parametrize(
    ("ranges", "compiler"),
    [({"depth_ratio_range": (2.0, 30.0)}, "gcc"), ({"half_fov_range": (0.45, 0.6)}, "g++")],
)
def test_a_built_table_over_one_axis_is_for_the_frusta_that_it_was_built_for(ranges, compiler, tmp_path):
    """From the range to the lambda of compiled code, whose regret is what was promised."""
    table = warpopt.build_table(FRUSTUM, max_regret=0.03, **ranges)
    table.save(tmp_path / "table.json")
    table = warpopt.LambdaTable.load(tmp_path / "table.json")
    language, by_fov = (C if compiler == "gcc" else CPP), "half_fov_range" in ranges
    rng = np.random.default_rng(3)
    given = np.tile(np.float32([0, 0.5, 50, np.pi / 6]), (20_000, 1))
    given[:, 0] = rng.uniform(0, np.pi, len(given))
    if by_fov:
        given[:, 3] = rng.uniform(0.45, 0.6, len(given))
    else:
        given[:, 2] = 0.5 * 2 * 15 ** rng.random(len(given))
    eta, lam = run_compiled(compiler, language.suffix, source(table, language), given, by_fov, tmp_path).T
    theta, near, far, half_fov = given.astype(float).T
    frustum = warpopt.ViewFrustum(near, far, half_fov if by_fov else np.pi / 6)
    view = warpopt.FrustumView(frustum, theta)
    best = warpopt.optimal_warp(view)
    for warp in (
        warpopt.Warp.from_eta(eta.astype(float), view),
        warpopt.Warp.from_lam(np.where(lam > 3.3e38, np.inf, lam.astype(float)), view),
        table.warp(frustum, theta),
    ):
        assert (warpopt.error_norm(view, warp) / best.value - 1).max() <= 0.03 * (1 + 1e-4)


def frusta(count: int) -> np.ndarray:
    """Rows for the closed form: f/n to 1e6, a tenth to 1e34, all fields of view, and a third next to where it turns."""
    rng = np.random.default_rng(1)
    rows = np.empty((count, 4), np.float32)
    rows[:, 3] = np.radians(rng.uniform(1, 85, count))
    rows[:, 0] = rng.uniform(0, np.pi, count)
    near_phi = rng.random(count) < 1 / 3
    rows[near_phi, 0] = (rows[:, 3] * (1 + rng.normal(size=count) * 10 ** rng.uniform(-8, -1, count)))[near_phi]
    mirrored = rng.random(count) < 0.3
    rows[mirrored, 0] = np.float32(np.pi) - rows[mirrored, 0]
    rows[:, 0] = np.clip(rows[:, 0], 0, np.float32(np.pi))
    rows[:, 1] = 10 ** rng.uniform(-2, 2, count)
    rows[:, 2] = rows[:, 1] * (1 + 10 ** rng.uniform(-3, 6, count))
    # Not next to phi, where E_q's eta, n a/(f b), is below the normal numbers.
    deep = (rng.random(count) < 0.1) & ~near_phi
    rows[deep, 2] = (rows[:, 1] * 10 ** rng.uniform(6, 34, count))[deep]
    return rows


def frusta_at_the_ends(count: int, metric: str) -> np.ndarray:
    """Near planes from the least to the largest normal numbers, half of the far planes at the largest of all."""
    rng = np.random.default_rng(7)
    rows = np.empty((count, 4), np.float32)
    rows[:, 3] = np.radians(rng.uniform(5, 80, count))
    rows[:, 0] = rows[:, 3] + (np.pi - 2 * rows[:, 3]) * rng.uniform(0.02, 0.98, count)
    log_near = rng.uniform(-37, 37, count)
    log_far = rng.uniform(log_near + 0.5, 38.5)
    rows[:, 1], rows[:, 2] = 10**log_near, 10**log_far
    rows[::2, 2] = np.finfo(np.float32).max
    # eta is n a/(f b) for E_q, and as (n/f)^(2/3) for E_pxq: a normal number.
    least = {"p": 0.0, "q": 1e-35, "pxq": 1e-53}[metric]
    return rows[log_near - np.log10(rows[:, 2].astype(float)) > np.log10(least)] if least else rows


def regret(given: np.ndarray, eta: np.ndarray, metric: str) -> np.ndarray:
    """value/minimum - 1 of the eta found, in double precision."""
    theta, near, far, phi = given.astype(float).T
    frustum = warpopt.ViewFrustum(near, far, phi)
    theta = np.minimum(theta, np.pi)
    view, objective = warpopt.FrustumView(frustum, theta), warpopt.Objective(metric)
    best = warpopt.optimal_warp(view, objective).value
    return np.asarray(warpopt.error_norm(view, warpopt.Warp.from_eta(eta.astype(float), view), objective) / best - 1)


def check_closed_form(given: np.ndarray, eta: np.ndarray, lam: np.ndarray, metric: str, eps: float) -> None:
    """eta loses next to nothing, and both are the library's in double precision at the same inputs.

    12 eps: some 20 operations, and E changes by at most three times eta's relative error. E_q's eta jumps where the
    warp sets in, and on which side of the jump a rounded input falls says nothing: there only the regret counts.
    """
    assert ((eta > 0) & (eta <= 1)).all()
    assert regret(given, eta, metric).max() < 12 * eps
    theta, near, far, phi = given.astype(float).T
    frustum = warpopt.ViewFrustum(near, far, phi)
    view = warpopt.FrustumView(frustum, np.minimum(theta, np.pi))
    warp = warpopt.optimal_warp(view, warpopt.Objective(metric)).warp
    exact, exact_lam, rest = (np.asarray(v) for v in (warp.eta, warp.lam, warp.one_minus_eta))
    error = np.abs(eta / exact - 1)
    jumped = ((eta == 1) != (exact == 1)) if metric == "q" else np.zeros(len(eta), bool)
    assert jumped.mean() < 0.01
    assert (error[~jumped] < 12 * eps).all()
    large = np.isfinite(exact_lam) & (exact_lam > 3.3e38) & (rest > 12 * eps)  # next to the largest float, or beyond
    assert (lam[large] > 3.2e38).all()
    warped = np.isfinite(exact_lam) & (lam < 3.3e38) & ~jumped & ~large
    # lambda = mu eta/(1 - eta): relative to the small difference that a weak warp is
    assert (np.abs(lam[warped] / exact_lam[warped] - 1) < 12 * eps / rest[warped]).all()
    assert (rest[~warped & ~jumped & ~large] < 12 * eps).all()


@pytest.mark.parametrize("metric", ["p", "q", "pxq"])
@pytest.mark.parametrize(("compiler", "language"), [("gcc", C), ("g++", CPP)])
def test_the_closed_forms_code_is_the_optimum(tmp_path, compiler, language, metric):
    """100,000 frusta and directions, then what is no frustum."""
    given = np.concatenate([frusta(100_000), frusta_at_the_ends(2000, metric)])
    bad = np.float32([[t, 1, 100, 0.5] for t in (np.nan, np.inf, -np.inf)])
    bad = np.concatenate([bad, [[1, n, f, p] for n, f, p in _NO_FRUSTA]]).astype(np.float32)
    far_off = np.float32([[t, 1, 100, 0.5] for t in SPECIAL])
    rows = np.concatenate([given, far_off, bad])
    text = closed_form_source(metric, language)
    found = run_compiled(compiler, language.suffix, text, rows, True, tmp_path)
    check_closed_form(given, *found[: len(given)].T, metric, EPS)
    assert ((found[:, 0] > 0) & (found[:, 0] <= 1)).all()
    assert (found[-len(bad) :] == np.float32([1, 3.4e38])).all()
    endless = given[:1000] * np.float32([1, 1, np.inf, 1])
    eta, lam = run_compiled(compiler, language.suffix, text, endless, True, tmp_path).T
    theta, near, _, phi = endless.astype(float).T
    limit = warpopt.theory.far_limit(near, phi, np.minimum(theta, np.pi), metric)
    # atol: |theta - phi| and theta + phi are exact to eps of phi
    np.testing.assert_allclose(eta, limit.eta, rtol=12 * EPS, atol=EPS)
    np.testing.assert_allclose(lam, np.minimum(limit.lam, 3.4e38), rtol=12 * EPS)


_NO_FRUSTA = (
    (0, 100, 0.5), (-1, 100, 0.5), (1, 1, 0.5), (2, 1, 0.5), (1, 100, 0), (1, 100, 1.6), (1, 100, -0.5),
    (np.nan, 100, 0.5), (1, np.nan, 0.5), (1, 100, np.nan), (np.inf, 100, 0.5), (np.inf, np.inf, 0.5),
)  # fmt: skip


SHADERS = {"GLSL 330": GLSL_330, "GLSL 450": GLSL_450, "HLSL": HLSL}


@pytest.mark.parametrize("name", SHADERS)
def test_glslang_accepts_the_shading_languages(table, tmp_path, name):
    language = SHADERS[name]
    for code, arguments in (
        (source(table, language), "x, 1.0, 100.0"), (source(rows_of(12, 5), language), "x, 1.0, 100.0, 0.5"),
        (closed_form_source("p", language), "x, 1.0, 100.0, 0.5"),
        (closed_form_source("q", language), "x, 1.0, 100.0, 0.5"),
        (closed_form_source("pxq", language), "x, 1.0, 100.0, 0.5"),
    ):  # fmt: skip
        value = f"warpopt_eta({arguments}) + warpopt_lambda({arguments})"
        if language is HLSL:
            main = f"float4 main(float x : TEXCOORD0) : SV_Target {{ return {value}; }}"
            words = ["-D", "-S", "frag", "-e", "main", "-V", "-o", str(tmp_path / "shader.spv")]
            validate(words, f"{code}\n{main}\n", tmp_path / "shader.hlsl")
        else:
            version = name.split()[1]
            main = f"in float x;\nout float y;\nvoid main() {{ y = {value}; }}"
            validate(["-S", "frag"], f"#version {version}\n{code}\n{main}\n", tmp_path / "shader.frag")


RUNNERS = {
    "GLSL 330": lambda *given: run_glsl(330, *given),
    "GLSL 450": lambda *given: run_glsl(450, *given),
    "WGSL": run_wgsl,
}


@pytest.mark.parametrize("name", RUNNERS)
def test_shaders_run_as_the_look_up_and_the_optimum(table, name):
    """On real drivers: the lookup to 1e-5 of Python's, beyond its ends too; the closed form within their freedoms."""
    language = {"GLSL 330": GLSL_330, "GLSL 450": GLSL_450, "WGSL": WGSL}[name]
    given = directions(table, 20_000)
    given = given[np.isfinite(given[:, 0])]  # shading languages define nothing else
    eta, lam = RUNNERS[name](source(table, language), given, False).T
    expected = table.eta_numpy(given[:, 0])
    np.testing.assert_allclose(eta, expected, rtol=1e-5)
    assert (lam[expected == 1] > 3.3e38).all()
    several, around = rows_of(12, 5), frusta_around(20_000)[40:]
    eta, _ = RUNNERS[name](source(several, language), around, True).T
    expected = several.eta_numpy(around[:, 0], around[:, 2] / around[:, 1], around[:, 3])
    np.testing.assert_allclose(eta, expected, rtol=1e-5)
    rows = frusta(100_000)
    rows[:, 2] = np.minimum(rows[:, 2], 1000 * rows[:, 1])
    for metric in ("p", "q", "pxq"):
        eta, _ = RUNNERS[name](closed_form_source(metric, language), rows, True).T
        # sin and cos are exact to an absolute 1e-7 only and sums may be reordered, so that the upper plane's slope is
        # too; f/n times that enters lambda, and its power of up to three the error
        assert regret(rows, eta, metric).max() < 3 * 1000 * EPS


def test_code_is_the_same_for_the_same_table_and_says_where_it_is_from(table):
    for forms in LANGUAGES.values():
        for form in forms:
            text = source(table, form)
            assert source(table, form) == text
            head = text.split("To warp")[0]
            for words in ("E_p, norm inf, measure screen", "far/near = 100", "30 degrees", f"warpopt {table.version}",
                          f"promised {table.promised:g}, achieved {table.achieved:.6g}"):  # fmt: skip
                assert words in head
            assert text.isascii()
            other = source(table, form, "sun_p")
            assert "warpopt_" not in other.replace("warpopt {", "")
            assert "WARPOPT_" not in other


def test_prefixes_and_metrics_are_checked(table):
    for prefix in ("", "1st", "Sun", "a-b", "gl_x", "a__b", "_a"):
        with pytest.raises(ValueError, match="prefix: got"):
            source(table, C, prefix)
    assert checked_prefix("sun2_p") == "sun2_p"
    with pytest.raises(ValueError, match="metric: got 'max'"):
        closed_form_source("max", C)

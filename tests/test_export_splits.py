"""The exported cascades, compiled and run, against the library's plans."""

import numpy as np
import pytest
from shaders import SHADERS, run_glsl, run_program, run_wgsl, validate_call

import warpopt
from warpopt.app.cli import main
from warpopt.cascades import plan, splits
from warpopt.export.languages import CPP, GLSL_450, HLSL, LANGUAGES, WGSL, C
from warpopt.export.splits import splits_source

_MAIN = """#include "code{suffix}"
#include <stdio.h>
#include <string.h>
int main(void) {{
    float g[6];
    while (fread(g, sizeof g, 1, stdin) == 1) {{
        float plain[17], splits[17], starts[16], etas[16], found[67];
        warpopt_splits(g[1], g[2], g[4], plain);
        warpopt_cascades(g[0], g[1], g[2], g[3], g[4], g[5], splits, starts, etas);
        memcpy(found, plain, sizeof plain);
        memcpy(found + 17, splits, sizeof splits);
        memcpy(found + 34, starts, sizeof starts);
        memcpy(found + 50, etas, sizeof etas);
        found[66] = warpopt_log_of_one_and((g[2] - g[1]) / g[1]);
        if (fwrite(found, sizeof found, 1, stdout) != 1) return 1;
    }}
    return 0;
}}
"""
EPS = float(np.finfo(np.float32).eps)
COUNT, OVERLAP = 4, 0.2


def rows(number: int) -> np.ndarray:
    """(theta, near, far, half_fov, count, overlap): far/near from 1.3 to 1e6, at every scale."""
    rng = np.random.default_rng(8)
    near = 10 ** rng.uniform(-3, 3, number)
    far = near * 10 ** rng.uniform(np.log10(1.3), 6, number)
    theta, half_fov = rng.uniform(0, np.pi, number), rng.uniform(0.05, 1.4, number)
    return np.float32(np.stack([theta, near, far, half_fov, np.full(number, COUNT), np.full(number, OVERLAP)], 1))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Of each compiler's program: rows to (splits without bands, splits, starts, etas, log(far/near))."""

    def run(compiler: str, given: np.ndarray) -> list[np.ndarray]:
        language, metric = (C, "p") if compiler == "gcc" else (CPP, "pxq")
        text, folder = splits_source(metric, language), tmp_path_factory.mktemp(compiler)
        main_text = _MAIN.format(suffix=language.suffix)
        return np.split(run_program(compiler, language.suffix, text, main_text, given, 67, folder), [17, 34, 50, 66], 1)

    return run


def tolerance(given: np.ndarray) -> np.ndarray:
    """exp turns the roundings of its argument, up to ln(far/near), into relative ones; and those of bands and products.

    Measured: 1.14 (2 + ln(far/near)) eps against the plan in single precision, 0.8 against that in double.
    """
    return 2 * (2 + np.log(given[:, 2] / given[:, 1]))[:, None] * EPS


@pytest.mark.parametrize("compiler", ["gcc", "g++"])
def test_compiled_code_is_the_plan(compiler, compiled):
    """Splits and starts of plans in double and in single precision, and no more error than theirs."""
    given = rows(4000)
    plain, bands, starts, etas, _ = compiled(compiler, given)
    objective = warpopt.Objective("p" if compiler == "gcc" else "pxq")
    for dtype in (np.float64, np.float32):
        theta, near, far, half_fov = given[:, :4].astype(dtype).T
        view = warpopt.FrustumView(warpopt.ViewFrustum(near, far, half_fov), theta)
        best = plan(view, COUNT, objective, overlap=OVERLAP)
        assert best.splits.dtype == dtype
        for found, exact in (
            (bands, best.splits), (starts, best.starts), (plain, splits.logarithmic(near, far, COUNT))
        ):  # fmt: skip
            assert (np.abs(found[:, : exact.shape[-1]] / np.asarray(exact) - 1) <= tolerance(given)).all()
        if dtype is np.float32:
            continue
        # Each map's error with the eta found, over the best of all: E changes with its ends' rounding as 1/share does.
        ends, begins = bands[:, 1 : COUNT + 1].astype(float), starts[:, :COUNT].astype(float)
        piece = warpopt.FrustumView(warpopt.ViewFrustum(begins, ends, half_fov[:, None]), theta[:, None])
        found = warpopt.error_norm(piece, warpopt.Warp.from_eta(etas[:, :COUNT].astype(float), piece), objective)
        over = np.asarray(found).max(1) / np.asarray(best.value) - 1
        assert (over < 12 * EPS + tolerance(given)[:, 0] / (1 - begins / ends).min(1)).all()
    # Fixed arrays: the rest is maps of no length.
    assert (bands[:, COUNT:] == given[:, 2:3]).all()
    assert (starts[:, COUNT:] == given[:, 2:3]).all()
    assert (etas[:, COUNT:] == 1).all()


def test_every_count_is_logarithmic(compiled):
    """1 to 16 maps, thin frusta too, and the logarithm to the last digits of (far - near)/near."""
    given = rows(2000)
    given[:1000, 2] = given[:1000, 1] * np.float32(1 + 10.0 ** np.linspace(-6, -1, 1000))
    given[:, 4] = 1 + np.arange(2000) % 16
    given[:, 5] = 0
    plain, bands, starts, _, log = compiled("gcc", given)
    np.testing.assert_array_equal(plain, bands)
    np.testing.assert_array_equal(starts, plain[:, :-1])
    assert (np.diff(plain, axis=1) >= 0).all()
    reach = (given[:, 2] - given[:, 1]) / given[:, 1]  # in singles, as there
    np.testing.assert_allclose(log[:, 0], np.log1p(reach.astype(float)), rtol=4 * EPS)
    for count in range(1, 17):
        mine = given[:, 4] == count
        near, far = given[mine, 1:3].astype(float).T
        exact = np.asarray(splits.logarithmic(near, far, count))
        off = np.abs(plain[mine, : count + 1] / exact - 1)
        assert (off < 2 * EPS + 2 * np.log(far / near)[:, None] * EPS).all()
        np.testing.assert_array_equal(plain[mine][:, [0, count]], given[mine, 1:3])  # the very ends


_NONE = (
    (0, 100, 4, 0), (-1, 100, 4, 0), (1, 1, 4, 0), (2, 1, 4, 0), (np.nan, 100, 4, 0), (1, np.nan, 4, 0),
    (1, np.inf, 4, 0), (np.inf, np.inf, 4, 0), (1e-10, 1e38, 4, 0), (1, 100, 0, 0), (1, 100, 17, 0), (1, 100, -1, 0),
    (1, 100, 2.5, 0), (1, 100, np.nan, 0), (1, 100, np.inf, 0), (1, 100, 4, 1), (1, 100, 4, -0.1), (1, 100, 4, np.nan),
    (1, 1.2, 2, 0.2),
)  # fmt: skip


def test_what_has_no_cascades(compiled):
    """Zeros and no warp, as the header says; an angle that is none leaves the splits, without warps."""
    given = np.float32([[1.0, near, far, 0.5, count, overlap] for near, far, count, overlap in _NONE])
    _, bands, starts, etas, _ = compiled("gcc", given)
    assert (bands == 0).all()
    assert (starts == 0).all()
    assert (etas == 1).all()
    angles = np.float32([[np.nan, 1, 100, 0.5, 2, 0], [1, 1, 100, 0, 2, 0], [1, 1, 100, np.nan, 2, 0]])
    plain, bands, _, etas, _ = compiled("g++", angles)
    np.testing.assert_allclose(bands[:, :3], np.tile([1, 10, 100], (3, 1)), rtol=4 * EPS)
    np.testing.assert_array_equal(plain, bands)
    assert (etas == 1).all()


def probes(language) -> str:
    """The file for "sun", with two functions of its arrays under the names that the drivers' programs call."""
    text = splits_source("p", language, "sun")
    if language is WGSL:
        head = "fn warpopt_{name}(theta: f32, near: f32, far: f32, half_fov: f32) -> f32 {{ {body} }}\n"
        arrays = "var splits: array<f32, 17>; var starts: array<f32, 16>; var etas: array<f32, 16>; "
        given = "&splits", "&splits, &starts, &etas"
    else:
        head = "float warpopt_{name}(float theta, float near, float far, float half_fov) {{ {body} }}\n"
        arrays = "float splits[17]; float starts[16]; float etas[16]; "
        given = "splits", "splits, starts, etas"
    every = f"{arrays}sun_cascades(theta, near, far, half_fov, 4.0, 0.2, {given[1]}); return etas[2];"
    plain = f"{arrays.split(';')[0]}; sun_splits(near, far, 4.0, {given[0]}); return splits[3];"
    return text + head.format(name="eta", body=every) + head.format(name="lambda", body=plain)


@SHADERS
def test_shading_languages_accept_it(language, words, tmp_path):
    call = "(warpopt_eta(1.0, 1.0, 9.0, 0.5) + warpopt_lambda(1.0, 1.0, 9.0, 0.5))"
    validate_call(language, words, probes(language), call, tmp_path)


@pytest.mark.parametrize("name", ["glsl", "wgsl"])
def test_shaders_run_as_the_compiled_code(name, compiled):
    """On real drivers, whose exp and log are exact to some 1e-6 of their argument's range."""
    given = rows(4000)
    if name == "glsl":
        eta, third = run_glsl(450, probes(GLSL_450), given[:, :4], True).T
    else:
        eta, third = run_wgsl(probes(WGSL), np.ascontiguousarray(given[:, :4]), True).T
    plain, _, starts, etas, _ = compiled("gcc", given)
    np.testing.assert_allclose(third, plain[:, 3], rtol=32 * EPS)
    # eta's slope by the piece's ratio; where a warp sets in, 1 is as good
    far_off = np.abs(eta / etas[:, 2] - 1) > 1e-3
    assert far_off.mean() < 0.01
    assert (starts[:, 2] > 0).all()


def test_the_command_writes_every_language(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def code(*words: str) -> int:
        with pytest.raises(SystemExit) as stop:
            main(["export", "splits", *words])
        return stop.value.code

    assert code("--to", "c,cpp,glsl,hlsl,wgsl", "--prefix", "sun", "--metric", "pxq") == 0
    for forms in LANGUAGES.values():
        for form in forms:
            text = (tmp_path / f"splits_pxq{form.suffix}").read_text()
            assert all(f"sun_{name}(" in text for name in ("split", "start", "splits", "cascades", "eta", "lambda"))
            assert "Warps: E_pxq" in text
            assert "warpopt_" not in text
    assert "out float splits[17]" in (tmp_path / f"splits_pxq{HLSL.suffix}").read_text()
    assert code("--to", "npz") == 2
    assert code("--to", "c", "--metric", "max", "--receivers", "ground") == 2
    told = capsys.readouterr().err
    assert "to: got 'npz'" in told
    assert "metric: got 'max', expected p, q, pxq" in told
    assert "receivers: got 'ground' with splits, which are for frusta" in told
    with pytest.raises(ValueError, match="metric: got 'storage'"):
        splits_source("storage", C)

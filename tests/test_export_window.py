"""The exported stable window, compiled and run, against the library's own arithmetic and through whole matrices."""

import jax.numpy as jnp
import numpy as np
import pytest
from shaders import SHADERS, run_program, validate_call

from warpopt.app.cli import main
from warpopt.export.languages import CPP, LANGUAGES, C
from warpopt.export.window import window_source
from warpopt.stable.pencil import Square, offset_for

_MAIN = """#include "code{suffix}"
#include <stdio.h>
int main(void) {{
    float g[7];
    while (fread(g, sizeof g, 1, stdin) == 1) {{
        float last = g[6] > 0.0f ? warpopt_window_horizon(g[6]) : 1e9f;
        float found[3] = {{warpopt_window_update(g[0], g[1], g[2], g[3], g[4], g[5], last),
                          warpopt_window_horizon(g[6]), warpopt_window_entry(g[0], g[1], g[5], g[2])}};
        if (fwrite(found, sizeof found, 1, stdout) != 1) return 1;
    }}
    return 0;
}}
"""
SIZE = 512


def compiled(compiler, language, given, folder) -> np.ndarray:
    main_text = _MAIN.format(suffix=language.suffix)
    return run_program(compiler, language.suffix, window_source(language), main_text, given, 3, folder)


@pytest.mark.parametrize(("compiler", "language"), [("gcc", C), ("g++", CPP)], ids=["c", "cpp"])
def test_compiled_code_moves_the_map_as_the_library_does(compiler, language, tmp_path):
    rng = np.random.default_rng(6)
    count = 400
    least = rng.uniform(-1, 1, count)
    largest = least + rng.uniform(0.3, 1.05, count)
    eta = np.where(rng.random(count) < 0.3, 1, np.exp(rng.uniform(np.log(0.01), 0, count)))
    offset = rng.integers(-500, 500, count)
    given = np.float32(np.stack([least, largest, np.full(count, SIZE), np.ones(count),
                                 rng.choice([0, 0.5, 1, 0.3], count), offset, eta], 1))  # fmt: skip
    found = compiled(compiler, language, given, tmp_path)
    refits = moves = 0
    for (low, high, _, padding, ahead, old, warp), (told, horizon, entry) in zip(given, found, strict=True):
        last = jnp.asarray(horizon if warp < 1 else np.inf, jnp.float32)
        square = Square(jnp.zeros(2, jnp.float32), jnp.asarray([low, high]))  # along s
        both = jnp.asarray([0, int(old)], jnp.int32)
        new, fits = offset_for(
            square, jnp.full(2, SIZE, jnp.int32), both, jnp.asarray(padding, int), jnp.asarray(ahead), last
        )
        assert bool(fits) == (told < 1e8), (low, high, old, warp)
        refits += told >= 1e8
        if told < 1e8:
            assert told == int(new[1])
            moves += told != old
        if warp < 1:
            assert horizon == pytest.approx((1 - warp / 8) / (1 - warp), rel=1e-5)
        assert entry == pytest.approx(low - 2 * old / SIZE * high, rel=1e-5, abs=1e-6)
    assert min(refits, moves, count - refits - moves) > 20  # all three were tried


@SHADERS
def test_shading_languages_accept_it(language, words, tmp_path):
    text = window_source(language)
    call = "warpopt_window_update(0.1, 0.9, 512.0, 1.0, 0.5, 3.0, warpopt_window_horizon(0.2))"
    validate_call(language, words, text, call, tmp_path)


def test_the_command_writes_every_language(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def code(*words: str) -> int:
        with pytest.raises(SystemExit) as stop:
            main(["export", "window", *words])
        return stop.value.code

    assert code("--to", "c,cpp,glsl,hlsl,wgsl", "--prefix", "sun") == 0
    for forms in LANGUAGES.values():
        for form in forms:
            text = (tmp_path / f"window{form.suffix}").read_text()
            assert all(f"sun_window_{name}(" in text for name in ("horizon", "update", "entry"))
    assert code("--to", "csv") == 2
    assert code("--to", "c", "--metric", "p") == 2
    told = capsys.readouterr().err
    assert "to: got 'csv'" in told
    assert "metric: got 'p' with the window, which has none" in told

"""The exported closed form of level ground, compiled and run, against the library's plane and its matrix."""

import numpy as np
import pytest
from shaders import SHADERS, run_program, validate_call

import warpopt
from warpopt import Camera, DirectionalLight, Objective, SceneView, optimal_warp, shadow_matrix
from warpopt.export.ground import ground_source
from warpopt.export.languages import CPP, LANGUAGES, WGSL, C
from warpopt.receivers import GroundPlane

_MAIN = """#include "code{suffix}"
#include <stdio.h>
int main(void) {{
    float g[11];
    while (fread(g, sizeof g, 1, stdin) == 1) {{
        float found[20];
        for (int i = 0; i < 3; i++) found[i] = warpopt_direction((float)i, g[5], g[6], g[7]);
        found[3] = warpopt_eta(g[0], g[1], g[2], g[3], g[4], g[5], g[6], g[7]);
        for (int i = 0; i < 16; i++) found[4 + i] = warpopt_matrix((float)(i / 4), (float)(i % 4), g[0], g[1], g[2],
            g[3], g[4], g[5], g[6], g[7], g[8], g[9], g[10]);
        if (fwrite(found, sizeof found, 1, stdout) != 1) return 1;
    }}
    return 0;
}}
"""
HEIGHT, NEAR, FAR, HALF_FOV, ASPECT = 1.7, 0.1, 120.0, 0.5, 1.6


def compiled(compiler, language, metric, given, folder) -> np.ndarray:
    """(direction, eta, matrix) of each row: height, pitch, near, far, half_fov, sun, aspect, caster height, relief."""
    main = _MAIN.format(suffix=language.suffix)
    return run_program(compiler, language.suffix, ground_source(metric, language), main, given, 20, folder)


def rows() -> np.ndarray:
    rng = np.random.default_rng(4)
    sun = rng.normal(size=(40, 3))
    sun[:, 1] = -np.abs(sun[:, 1]) - 0.05
    fixed = np.tile([HEIGHT, 0, NEAR, FAR, HALF_FOV], (40, 1))
    fixed[:, 1] = rng.uniform(-0.3, 0.9, 40)
    return np.c_[fixed, sun, np.tile([ASPECT, 5.0, 0.5], (40, 1))]


@pytest.mark.parametrize(
    ("metric", "compiler", "language"), [("storage", "gcc", C), ("pxq", "g++", CPP)], ids=["storage", "pxq"]
)
def test_compiled_code_is_the_library_s_plane(metric, compiler, language, tmp_path):
    """Direction, eta, and the map's rows: 1 - t is as good as t, so the first row may have the other sign."""
    given = rows()
    found = compiled(compiler, language, metric, given, tmp_path)
    ground = GroundPlane((0, 1, 0), 0)
    for row, told in zip(given, found, strict=True):
        pitch, sun = row[1], row[5:8]
        camera = Camera((0, HEIGHT, 0), (0, -np.sin(pitch), -np.cos(pitch)), (0, 1, 0), NEAR, FAR, HALF_FOV, ASPECT)
        view = SceneView(camera, DirectionalLight(sun), ground, warp_direction="gradient", lateral="free")
        solution = optimal_warp(view, Objective(metric))
        np.testing.assert_allclose(told[:3], solution.direction, atol=2e-5)
        assert told[3] == pytest.approx(float(solution.warp.eta), rel=1e-4)
        own, exact = told[4:].reshape(4, 4).astype(float), np.asarray(shadow_matrix(view, solution))
        own /= own[3, 3] / exact[3, 3]
        if own[0, 0] * exact[0, 0] < 0:
            own[0] *= -1
        np.testing.assert_allclose(own[[0, 1, 3]], exact[[0, 1, 3]], atol=2e-3 * np.abs(exact[3]).max())
        # The map holds the ground in sight, and what stands on it, between its ends.
        eye = np.asarray(ground.places(camera)[0])[np.asarray(ground.places(camera)[1]) > 0]
        world = eye @ np.asarray(camera.rotation) + np.asarray(camera.position)
        toward = np.asarray(sun) / sun[1]
        for above in (-0.5, 0.0, 5.0):
            clip = np.c_[world + above * toward, np.ones(len(world))] @ told[4:].reshape(4, 4).astype(float).T
            assert (clip[:, 3] > 0).all()
            assert np.abs(clip[:, :3] / clip[:, 3:]).max() <= 1 + 2e-3


def test_nothing_to_map(tmp_path):
    """A camera that looks up or straight down, a sun below the ground, no height: eta = 1 and a matrix of zeros."""
    good = rows()[0]
    bad = np.array([good] * 4)
    bad[0, 1], bad[1, 6], bad[2, 0], bad[3, 1] = -0.9, 0.4, 0.0, 2.0
    found = compiled("gcc", C, "p", bad, tmp_path)
    assert (found[:, 3] == 1).all()
    assert (found[:, 4:] == 0).all()


@SHADERS
def test_shading_languages_accept_it(language, words, tmp_path):
    text = ground_source("pxq", language)
    call = "warpopt_matrix(0.0, 0.0, 1.0, 0.0, 1.0, 9.0, 0.5, 0.0, -1.0, 0.0, 1.0, 1.0, 1.0)"
    validate_call(language, words, text, call, tmp_path)


def test_every_language_has_every_function():
    for forms in LANGUAGES.values():
        for form in forms:
            text = ground_source("storage", form, "sun")
            for name in ("nearest", "farthest", "eta", "direction", "matrix"):
                assert f"sun_{name}(" in text
    assert "-> f32" in ground_source("p", WGSL)
    with pytest.raises(ValueError, match="metric: got 'q', expected 'p', 'pxq' or 'storage'"):
        ground_source("q", C)
    assert warpopt.__version__ in ground_source("p", C)

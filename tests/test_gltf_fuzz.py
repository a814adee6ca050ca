"""Mutated glTF files: a result that the oracle does not refute, or one sentence."""

import contextlib
import json
from pathlib import Path

import gltf_oracle
import numpy as np
import pytest
from gltf_cases import MAKERS, document, mutated

from warpopt.scene_files.gltf import read_geometry, read_gltf_camera, read_light


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fuzzed(seed: int, path: Path) -> str:
    """What reading a mutated document comes to: "read", or the refusal; any other exception is a defect."""
    random = np.random.default_rng(seed)
    names = list(MAKERS)
    data = mutated(document(names[seed % len(names)]), random)
    path.write_text(json.dumps(data))
    outcome = "read"
    try:
        triangles = read_geometry(path).triangles
    except ValueError as error:
        outcome = str(error)
        assert outcome.startswith(f"{path}: cannot be read as glTF: "), outcome
        assert "\n" not in outcome
    else:
        try:
            expected = gltf_oracle.triangles(data)
        except Exception:  # it trusts its input; a document that it cannot read has no expected value
            expected = None
        if expected is not None:
            assert triangles.shape == expected.shape
            atol = 1e-12 * max(np.abs(expected).max(), 1e-300)
            np.testing.assert_allclose(gltf_oracle.box(triangles), gltf_oracle.box(expected), rtol=1e-12, atol=atol)
    for read in (read_gltf_camera, read_light):
        with contextlib.suppress(ValueError):
            read(path)
    return outcome


@pytest.mark.parametrize("seed", range(60))
def test_a_mutated_file_is_read_right_or_refused(folder, capfd, seed):
    fuzzed(seed, Path("fuzz.gltf"))
    assert capfd.readouterr() == ("", "")

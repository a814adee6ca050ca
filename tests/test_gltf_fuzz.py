"""Mutated glTF files: a result that the oracle does not refute, or one sentence."""

import contextlib
import copy
import json
from pathlib import Path

import gltf_oracle
import numpy as np
import pytest
from gltf_cases import MAKERS, document

from warpopt.scene_files.gltf import read_geometry, read_gltf_camera, read_light


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


VALUES = [
    None,
    True,
    -1,
    0,
    1,
    3,
    2**31,
    10**30,
    0.5,
    1e308,
    float("nan"),
    "",
    "x",
    "VEC3",
    [],
    [0],
    [1e308] * 3,
    {},
    {"a": 1},
]


def mutated(data: dict, random: np.random.Generator) -> dict:
    """Some values of a document replaced, moved or taken away."""
    data = copy.deepcopy(data)
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        places = []

        def walk(value, places=places):
            items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
            for key, inner in items:
                if key != "uri":
                    places.append((value, key))
                    walk(inner)

        walk(data)
        holder, key = places[random.integers(len(places))]
        if random.random() < 0.2 and isinstance(holder, dict):
            del holder[key]
        elif random.random() < 0.7 and isinstance(holder[key], int) and not isinstance(holder[key], bool):
            holder[key] += int(random.integers(-3, 4))
        elif random.random() < 0.7 and isinstance(holder[key], float):
            holder[key] *= random.normal()
        else:
            holder[key] = copy.deepcopy(VALUES[random.integers(len(VALUES))])
    return data


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

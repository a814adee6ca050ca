"""Scenes from a seed: closed meshes, another for another seed, and eyes that stand outside of things."""

import numpy as np
import pytest
from scene_cases import run, toml

from warpopt.scene_files.made import KINDS, made_scene
from warpopt.scene_files.made.shapes import box, broadleaf, conifer, lathe


@pytest.mark.parametrize("shape", [
    box(np.zeros(3), np.array([1, 2, 3])), lathe(np.array([0, 1, 2]), np.array([1, 0.5, 0.5]), 5),
    lathe(np.array([0, 1]), np.array([1, 0]), 7), conifer(np.random.default_rng(1)),
    broadleaf(np.random.default_rng(2)),
])  # fmt: skip
def test_shapes_are_closed_and_wound_outwards(shape):
    """Each edge belongs to two triangles in opposite directions; the enclosed volume is positive."""
    points = np.round(shape, 9)
    edges = [(tuple(t[i]), tuple(t[(i + 1) % 3])) for t in points for i in range(3)]
    count = {edge: edges.count(edge) - edges.count(edge[::-1]) for edge in set(edges)}
    assert not any(count.values())
    assert np.linalg.det(shape).sum() > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_seed_decides_the_scene(kind):
    one, same, other = made_scene(kind, 3), made_scene(kind, 3), made_scene(kind, 4)
    assert np.array_equal(one.triangles, same.triangles)
    assert np.array_equal(one.eyes, same.eyes)
    assert one.triangles.shape != other.triangles.shape or not np.allclose(one.triangles, other.triangles)
    assert np.isfinite(one.triangles).all()
    assert len(one.triangles) > 1000
    reach = np.linalg.norm(np.ptp(one.triangles, axis=(0, 1)))
    assert reach / 2 < one.far
    assert len(one.eyes) == len(one.forwards) == 64
    assert (np.abs(one.eyes) <= np.abs(one.triangles).max((0, 1))).all()


def test_bad_scenes_are_refused():
    with pytest.raises(ValueError, match="kind: got 'desert', expected one of hills"):
        made_scene("desert", 1)
    with pytest.raises(ValueError, match="seed: got -1"):
        made_scene("city", -1)


@pytest.mark.thorough
def test_a_command_reads_them(tmp_path, monkeypatch):
    """`warpopt scene` over a corridor: its cameras come from the seed."""
    monkeypatch.chdir(tmp_path)
    told = run(toml("made = { scene = 'corridor', seed = 2, views = 2, width = 64 }", camera=""))
    assert len(told["cameras"]) == 2
    np.testing.assert_allclose(told["cameras"][1]["position"], made_scene("corridor", 2).eyes[1])

"""docs/support.md says what is refused, with the words it is refused with."""

import re
import sys
from pathlib import Path

import jax
import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def support(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "experiments"), *sys.path])
    import support

    return support


def cells_of(page: str) -> dict[tuple[str, str, str, str], str]:
    """(verb, camera, receivers, objective): "works", or the words."""
    found = {}
    for section in page.split("\n## ")[1:]:
        verb, *lines = section.split("\n")
        notes = dict(re.findall(r"^(\d+)\. `(.*)`$", section, re.M))
        rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]
        _, _, *objectives = rows[0]
        for camera, seen, *cells in rows[1:]:
            for objective, cell in zip(objectives, cells, strict=True):
                found[verb, camera, seen, objective] = notes.get(cell, cell)
    return found


@pytest.mark.thorough("every cell")
@pytest.mark.parametrize("every", [False, True], ids=["refusals", "every cell"])
def test_the_page_says_what_is_refused_and_how(support, every):
    """Every refusal again, word for word; every cell is there; of what works all, or once a verb with points."""
    page = (ROOT / "docs/support.md").read_text(encoding="utf-8")
    found = cells_of(page)
    assert len(found) == len(support.VERBS) * len(support.CAMERAS) * len(support.RECEIVERS) * len(support.OBJECTIVES)
    tried = set()
    for (verb, camera, seen, objective), cell in found.items():
        if cell != "works":
            assert support.words(verb, camera, seen, objective) == cell
        elif every or (seen == "PointReceivers" and camera == "orthographic" and verb not in tried):
            tried.add(verb)
            assert support.words(verb, camera, seen, objective) is None
        if every and objective == list(support.OBJECTIVES)[-1]:
            jax.clear_caches()  # of programs that nothing runs again
    assert len(tried) == len(support.VERBS)
    assert found["`compare_rules`", "orthographic", "DepthHistogram", "p inf"].startswith("camera: got an orthographic")

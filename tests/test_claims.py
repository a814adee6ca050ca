"""Every claim of experiments/claims.py with the verdict that it is known to have, and numbers worked elsewhere."""

import re
import sys
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
VERDICTS = {
    "reproduced": {
        "mu", "grows_downwards", "largest", "along_the_view", "psm", "ssm", "tsm_below", "tsm_zero", "alternative",
        "scale", "minimum_norm", "n_opt", "logarithm", "extent",
    },
    "holds under a condition": {
        "width", "width_f_q", "e_q_extrema", "tsm_stronger", "halves", "lispsm_minimal", "storage", "strength", "apex",
        "lispsm_below", "perpendicular",
    },
    "contradicted": {
        "f_p_above", "f_p_below", "least", "no_advantage", "tsm_above", "area", "parallel", "most_aliasing",
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def module():
    sys.path.insert(0, str(EXPERIMENTS))
    try:
        import claims
    finally:
        sys.path.pop(0)
    return claims


@pytest.fixture(scope="module")
def rows(module):
    return {row.key: row for row in module.claims()}


def test_every_verdict(rows):
    expected = {key: verdict for verdict, keys in VERDICTS.items() for key in keys}
    assert {key: row.verdict for key, row in rows.items()} == expected


@pytest.mark.parametrize(
    ("key", "numbers"),
    [
        ("f_p_above", ("1.1547",)),  # 1 / sin(60 deg)
        ("tsm_stronger", ("33.0", "11.0", "20.3", "12.7")),
        ("no_advantage", ("9.09", "13.5")),
        ("area", ("2.0000",)),
        ("lispsm_minimal", ("1.00", "1.04", "1.79")),
        ("logarithm", ("7.976", "2.15")),  # log(100) / tan(30 deg)
        ("perpendicular", ("10 at 90", "464 at 90", "3.45 at 30")),
        ("most_aliasing", ("171.5 at 90",)),  # 99 / tan(30 deg)
        ("tsm_zero", ("0.3333", "0.5714")),
    ],
)
def test_numbers(rows, key, numbers):
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}", rows[key].number), rows[key].number


def test_the_page_is_what_the_experiment_writes(module, rows):
    """Each statement with its verdict stands on docs/claims.md; those that do not simply hold say why."""
    page = (EXPERIMENTS.parent / "docs" / "claims.md").read_text()
    for row in rows.values():
        assert f"| {row.source} | {row.statement} | **{row.verdict}** |" in page
        assert row.verdict == module.REPRODUCED or row.proof
    assert all(line.count("|") == 7 for line in module.table(list(rows.values())).splitlines()[2:])

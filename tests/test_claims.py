"""Every claim of experiments/claims.py with the verdict that it is known to have, and numbers worked elsewhere."""

import re
import sys
from pathlib import Path

import pytest
from pages import same_to_the_digits, section

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
VERDICTS = {
    "reproduced": {
        "mu", "grows_downwards", "largest", "along_the_view", "psm", "ssm", "tsm_below", "tsm_zero", "alternative",
        "scale", "minimum_norm", "n_opt", "logarithm", "extent", "z_w", "local", "factorisation", "width_below",
        "which_end", "smaller_lambda", "quad", "halves_tsm", "ends", "psm_near", "focus_zero", "area_bound", "between",
        "lispsm_psm", "converges",
    },
    "holds under a condition": {
        "width", "width_f_q", "e_q_extrema", "tsm_stronger", "halves", "lispsm_minimal", "storage", "strength", "apex",
        "perpendicular", "e_q_falls", "tsm_suitable", "equal_ends", "only_worsens",
        "best_distribution",
    },
    "contradicted": {
        "f_p_above", "f_p_below", "least", "no_advantage", "tsm_above", "area", "parallel", "most_aliasing",
        "lispsm_below", "tsm_simplified", "dp_dt",
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
        ("tsm_suitable", ("6.25 at 90",)),  # 29.0 / 4.64
        ("storage", ("342.9 at 90",)),  # 198 / tan(30 deg)
        ("best_distribution", ("17.15", "20.00", "18.5, at n = 10.1")),  # the storage factor's root
        ("dp_dt", ("2.000", "20.000", "10.00 times")),  # sqrt(f / n)
        ("psm_near", ("1.71", "171.47")),  # 0.99 and 99 / tan(30 deg)
        ("smaller_lambda", ("4.82", "11.0")),  # 0.0487 mu, 10 + 1
    ],
)
def test_numbers(rows, key, numbers):
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}", rows[key].number), rows[key].number


def test_the_page_is_what_the_experiment_writes(module, rows):
    """docs/claims.md has each row to the digits printed; what does not simply hold says why."""
    page = (EXPERIMENTS.parent / "docs" / "claims.md").read_text(encoding="utf-8")
    table = module.table(list(rows.values()))
    assert same_to_the_digits(section(page, "claims"), table)
    assert all(row.verdict == module.REPRODUCED or row.proof for row in rows.values())
    assert all(line.count("|") == 7 for line in table.splitlines()[2:])


@pytest.mark.parametrize(
    ("printed", "computed", "same"),
    [
        ("1.79 at 30", "1.79 at 30", True),
        ("1.79 at 30", "1.80 at 30", True),  # rounded to the other side
        ("1.79 at 30", "1.81 at 30", False),
        ("1.79 at 30", "1.79 in 30", False),
        ("1.79 at 30", "1.79 at 31", False),
        ("3e-16", "-4e-15", True),  # rounding, which is another one elsewhere
        ("3e-16", "4e-8", False),
        ("**reproduced** | 1", "**contradicted** | 1", False),
    ],
)
def test_pages_are_compared_to_their_digits(printed, computed, same):
    assert same_to_the_digits(printed, computed) == same

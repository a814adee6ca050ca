"""The table of README's "What it finds": the optimum of the paper's frustum, and what three rules lose against it.

python experiments/results.py [--readme README.md]
"""

import argparse
from pathlib import Path

import numpy as np
from claim_checks import PAPER
from provenance import markdown_table, write_section

import warpopt

DEGREES = {"p": (90, 60, 30, 10), "pxq": (90, 45, 10)}
RULES = {"no warp": warpopt.rules.ssm, "LiSPSM": warpopt.rules.lispsm, "TSM (0.5, 0.8)": warpopt.rules.tsm}


def losses(metric: str) -> np.ndarray:
    """A row for each direction: the optimal lambda/mu, each rule's largest error over the optimum's, and the optimum's
    over the lower bound; NaN where none is known.
    """
    view, objective = warpopt.FrustumView(PAPER, np.deg2rad(DEGREES[metric])), warpopt.Objective(metric)
    best = warpopt.optimal_warp(view, objective)
    bound = np.nan if objective.no_bound_because else warpopt.lower_bound(view, objective)
    errors = [warpopt.error_norm(view, rule(PAPER, view.theta), objective) for rule in RULES.values()]
    return np.stack([best.warp.lam_over_mu, *(error / best.value for error in errors), best.value / bound], 1)


def table(rows: dict[str, np.ndarray]) -> str:
    cells = (
        (f"E_{metric}", f"{degrees} deg", _digits(row[0], 4) if np.isfinite(row[0]) else "inf: no warp",
         *(_digits(ratio, 3) if np.isfinite(ratio) else "not known" for ratio in row[1:]))
        for metric, found in rows.items() for degrees, row in zip(DEGREES[metric], found, strict=True)
    )  # fmt: skip
    return markdown_table(("error", "theta", "optimal lambda/mu", *RULES, "optimum / bound"), cells)


def _digits(value: float, count: int) -> str:
    return f"{value:#.{count}g}".rstrip(".")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--readme", type=Path, help="a page with a place for `results`")
    arguments = parser.parse_args()
    text = table({metric: losses(metric) for metric in DEGREES})
    print(text)
    if arguments.readme:
        write_section(arguments.readme, "results", text)


if __name__ == "__main__":
    main()

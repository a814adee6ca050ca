"""How small a table of eta may be: knots, rows and bytes for several objectives, and the regret that each keeps.

    python experiments/table_sizes.py --directory runs/table_sizes --page docs/engines.md

Also, for comparison, how many entries a plain table takes that is linear in log(eta) between directions a fixed step
apart. Writes `sizes.json` and prints the table. `--short` is a slice for tests.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from claim_checks import PAPER
from provenance import markdown_table, provenance, sentence, write_section

import warpopt


def plain_entries(objective: warpopt.Objective, promise: float) -> int:
    """The fewest evenly spaced directions with exact log(eta) between which linear interpolation keeps the promise."""
    theta = np.random.default_rng(5).uniform(0, np.pi / 2, 20_000)
    view = warpopt.FrustumView(PAPER, theta)
    best = warpopt.optimal_warp(view, objective).value
    for count in (2 ** np.arange(2, 13.01, 0.25)).round().astype(int):
        knots = np.linspace(0, np.pi / 2, count)
        filled = np.append(knots, np.zeros(2**13 - count))  # one shape for all: one compilation
        exact = warpopt.optimal_warp(warpopt.FrustumView(PAPER, filled), objective).warp.eta
        heights = np.log(np.asarray(exact)[:count])
        warp = warpopt.Warp.from_eta(np.exp(np.interp(theta, knots, heights)), view)
        if (warpopt.error_norm(view, warp, objective) / best - 1).max() <= promise:
            return int(count)
    return 0


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/table_sizes"))
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--page", type=Path, help="a page with a place for `table sizes`")
    arguments = parser.parse_args(words)
    single = [(m, n, {}) for m in ("p", "q", "pxq") for n in ("inf", "l2")]
    wide = {"depth_ratio_range": (2.0, 1e5)}
    cases = single[:1] if arguments.short else [*single, ("p", "inf", wide), ("p", "l2", wide)]
    rows = []
    for metric, norm, ranges in cases:
        start = time.perf_counter()
        objective = warpopt.Objective(metric, norm)
        table = warpopt.build_table(PAPER, objective, **ranges)
        took = time.perf_counter() - start
        plain = "" if ranges else plain_entries(objective, table.promised) or "> 8192"
        over = "theta, f/n 2 to 1e5" if ranges else "theta"
        rows.append((f"E_{metric} {norm}", over, table.theta.shape[0], table.theta.shape[2], table.size,
                     f"{table.achieved:.3g}", plain, f"{took:.0f}"))  # fmt: skip
        print(*rows[-1], flush=True)
    head = ("objective", "over", "rows", "knots a row", "bytes", "largest regret", "plain entries", "built in s")
    summary = provenance()
    words = f"Promised: 0.001; half field of view 30 degrees, f/n = 100. {sentence(summary)}."
    arguments.directory.mkdir(parents=True, exist_ok=True)
    content = summary | {"tables": [dict(zip(head, row, strict=True)) for row in rows]}
    (arguments.directory / "sizes.json").write_text(json.dumps(content, indent=1) + "\n")
    if arguments.page:
        write_section(arguments.page, "table sizes", f"{markdown_table(head, rows)}\n\n{words}")


if __name__ == "__main__":
    main()

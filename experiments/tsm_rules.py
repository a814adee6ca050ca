"""TSM's two rules for theta <= phi: where each has the smaller error, and where it gives no warp.

python experiments/tsm_rules.py [--page docs/corrections.md]
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import numpy as np
from provenance import markdown_table, write_section

import warpopt

METRICS = ("p", "pxq")
VIEWS = ((10.0, 30.0), (100.0, 30.0), (1000.0, 30.0), (100.0, 20.0), (100.0, 45.0))  # f/n, phi in degrees


def compare(ratio: float, phi_deg: float, kappa: float = 0.5, xi: float = 0.8, count: int = 2001) -> dict:
    """What each rule gives over 0 < theta <= phi, in degrees: ranges of no warp, and where each is the better."""
    frustum = warpopt.ViewFrustum(1.0, ratio, np.deg2rad(phi_deg))
    degrees = np.linspace(0, phi_deg, count)
    theta = np.minimum(np.deg2rad(degrees), np.deg2rad(phi_deg))
    view = warpopt.FrustumView(frustum, theta)
    warps = {"tsm": warpopt.rules.tsm(frustum, theta, kappa, xi)}
    warps["alternative"] = warpopt.rules.tsm_alternative(frustum, theta, kappa)
    row = {"f/n": ratio, "phi": phi_deg}
    for name, warp in warps.items():
        row[f"{name}: no warp"] = ranges(degrees, np.asarray(warp.no_warp))
        row[f"{name}: undefined"] = ranges(degrees, ~np.asarray(warp.defined))
    none = warpopt.Warp.from_eta(1.0, view)
    for metric in METRICS:
        objective = warpopt.Objective(metric)
        best = np.asarray(warpopt.optimal_warp(view, objective).value)
        of = {
            name: np.asarray(warpopt.error_norm(view, warp, objective)) / best
            for name, warp in (warps | {"no warp": none}).items()
        }
        row[metric] = {
            "over bound": float((best / warpopt.lower_bound(view)).max()) if metric == "p" else None,
            "alternative better": ranges(degrees, of["alternative"] < of["tsm"] * (1 - 1e-12)),
            "tsm better": ranges(degrees, of["tsm"] < of["alternative"] * (1 - 1e-12)),
            "worst": {name: float(values.max()) for name, values in of.items()},
        }
    return row


def ranges(degrees: np.ndarray, holds: np.ndarray) -> list[tuple[float, float]]:
    """The stretches of the grid on which something holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [(float(degrees[i]), float(degrees[j - 1])) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def words(stretches: list[tuple[float, float]]) -> str:
    return ", ".join(f"{low:.1f} to {high:.1f}" for low, high in stretches) or "nowhere"


def table(rows: list[dict]) -> str:
    heads = ("f/n", "phi", "E", "alternative: no warp", "alternative better", "TSM better")
    cells = []
    for row in rows:
        for metric in METRICS:
            one = row[metric]
            ranges_of = (row["alternative: no warp"], one["alternative better"], one["tsm better"])
            worst = (one["worst"][name] for name in ("tsm", "alternative", "no warp"))
            start = (f"{row['f/n']:g}", f"{row['phi']:g}", f"E_{metric}")
            cells.append([*start, *map(words, ranges_of), *worst, one["over bound"] or "not known"])
    always = all(not row["tsm: no warp"] and not row["tsm: undefined"] for row in rows)
    heads = (
        *heads,
        "worst over the optimum's: TSM",
        "alternative",
        "no warp",
        "the optimum's worst over the lower bound",
    )
    text = markdown_table(heads, cells)
    return f"{text}\n\nAngles in degrees, L-inf over V. " + (
        "TSM's first rule warps everywhere here, at theta = 0 too, where eta = 1 (no warp) is optimal."
        if always
        else "TSM's first rule has directions without a warp here."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="write the table into this page")
    arguments = parser.parse_args()
    text = table([compare(*view) for view in VIEWS])
    print(text)
    if arguments.page:
        write_section(arguments.page, "tsm rules", text)


if __name__ == "__main__":
    main()

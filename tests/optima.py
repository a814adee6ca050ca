"""The 60-digit optima of tests/data/optima.csv: read, or found anew by the twin's search.

python tests/optima.py    # writes the file, in a minute or two
"""

import csv
import functools
from pathlib import Path
from typing import NamedTuple

import scenes
import twin
from twin import mp, mpf

DATA = Path(__file__).parent / "data" / "optima.csv"
DIGITS = 40  # of the 60 that the twin computes with; its search stops at 20 of eta


class Of(NamedTuple):
    """An objective, by exponents, order and measure."""

    alpha: float
    beta: float
    norm: str | float
    measure: str


NAMED = {"p": (1.0, 0.0), "q": (0.0, 1.0), "pxq": (1.0, 1.0)}
OBJECTIVES = [Of(*NAMED[m], n, over) for m in NAMED for n in ("inf", "l1", "l2") for over in ("screen", "axis")] + [
    Of(1.0, 0.0, "l2", "volume"), Of(1.0, 1.0, "l1", "log_depth"), Of(0.0, 1.0, "l2", "ground"),
    Of(1.0, 0.0, "l1", "ground"), Of(0.5, 1.0, "l1", "screen"),
]  # fmt: skip
REAL_ORDERS = [Of(1.0, 0.0, 2.5, "axis"), Of(0.7, 0.3, 1.5, "screen")]
FEW = [case for case in scenes.CASES if case.tag in ("below phi", "mirrored, near the top")]


def norm_of(scene: twin.Scene, of: Of):
    """lambda -> the norm, by raw geometry."""
    if of.norm == "inf":
        return functools.partial(scene.supremum, mpf(of.alpha), mpf(of.beta), axis=of.measure == "axis")
    return twin.PowerMean(scene, of.alpha, of.beta, {"l1": 1, "l2": 2}.get(of.norm, of.norm), of.measure)


def searched(case: scenes.Case, of: Of) -> tuple[mpf, mpf, mpf]:
    """(eta, lambda, value) of the least norm. A real order's search is 1e-13 wide: each of its steps is an integral."""
    scene = twin.Scene(*case[1:])
    return twin.search(scene, norm_of(scene, of), width=1e-13 if of in REAL_ORDERS else 1e-20)


@functools.cache
def known() -> dict[tuple[str, Of], tuple[mpf, mpf, mpf]]:
    """What the file has."""
    with DATA.open(encoding="utf-8", newline="") as file:
        return {
            (row["scene"], Of(float(row["alpha"]), float(row["beta"]), _norm(row["norm"]), row["measure"])):
            (mpf(row["eta"]), mpf(row["lambda"]), mpf(row["value"]))
            for row in csv.DictReader(file)
        }  # fmt: skip


def _norm(text: str) -> str | float:
    return float(text) if text[0].isdigit() else text


def write() -> None:
    """All of them, by a search each."""
    DATA.parent.mkdir(exist_ok=True)
    with DATA.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("scene", "alpha", "beta", "norm", "measure", "eta", "lambda", "value"))
        for of in OBJECTIVES + REAL_ORDERS:
            for case in FEW if of in REAL_ORDERS else scenes.CASES:
                writer.writerow((case.tag, *of, *(mp.nstr(v, DIGITS) for v in searched(case, of))))


if __name__ == "__main__":
    write()

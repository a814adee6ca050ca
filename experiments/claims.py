"""What the sources claim, checked: each statement one row, with its verdict, the number behind it and the inputs.

    python experiments/claims.py [--page docs/claims.md]

Errors are evaluated from raw geometry in NumPy (`claim_checks.Geometry`), rules and optima by the package. A verdict is
computed from its numbers; the words of a row never decide it.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import claims_of_at09
import claims_of_model
import claims_of_others
import claims_of_rules
from claim_checks import CONDITION, CONTRADICTED, REPRODUCED, Claim
from provenance import markdown_table, write_section

MODULES = (claims_of_model, claims_of_at09, claims_of_rules, claims_of_others)


def claims() -> Iterator[Claim]:
    return (check() for module in MODULES for check in module.CHECKS)


def table(rows: list[Claim]) -> str:
    count = {v: sum(r.verdict == v for r in rows) for v in (REPRODUCED, CONDITION, CONTRADICTED)}
    summary = f"{len(rows)} statements: {', '.join(f'{n} {v}' for v, n in count.items())}."
    heads = ("where", "claim", "verdict", "number", "inputs", "why not, or when")
    cells = ((r.source, r.statement, f"**{r.verdict}**", r.number, r.inputs, r.why) for r in rows)
    return f"{summary}\n\n{markdown_table(heads, cells)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="write the table into this page")
    arguments = parser.parse_args()
    text = table(list(claims()))
    print(text)
    if arguments.page:
        write_section(arguments.page, "claims", text)


if __name__ == "__main__":
    main()

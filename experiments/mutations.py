"""Breaks the package at one place after another, and says which tests notice.

    PYTHONPATH=src python experiments/mutations.py                # all, some minutes of CPU time
    PYTHONPATH=src python experiments/mutations.py --only table   # of files whose path has the word

Each mutant is a copy of `src` in a temporary folder with one line changed, and the tests named beside it are run on
that copy until the first fails. A mutant that survives asks for a test, or has its reason. The list is
`mutations.toml`.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Mutation(NamedTuple):
    """One change of one file, and what should notice it: files of `tests/`, an expression for pytest's -k.

    `equivalent`: why nothing can notice it, or nothing.
    """

    file: str
    old: str
    new: str
    tests: str
    chosen: str = ""
    equivalent: str = ""


MUTATIONS = tuple(
    Mutation(**entry) for entry in tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))["mutation"]
)


def mutated(mutation: Mutation, folder: Path) -> None:
    """A copy of the sources with the change, which must be in the file exactly once."""
    shutil.copytree(ROOT / "src", folder, ignore=shutil.ignore_patterns("__pycache__"))
    path = folder / "warpopt" / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise SystemExit(f"{mutation.file}: got {text.count(mutation.old)} of {mutation.old!r}, expected one")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")


def noticed(mutation: Mutation, cache: Path) -> tuple[bool, str]:
    """Whether a test fails on the mutant, and which."""
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "src"
        mutated(mutation, source)
        files = [f"tests/test_{name}.py" for name in mutation.tests.split()]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files]
        command += ["-k", mutation.chosen] if mutation.chosen else []
        environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1", "WARPOPT_LANE": "all"}
        # What the mutant does not touch is compiled once for all of them.
        environment |= {"JAX_COMPILATION_CACHE_DIR": str(cache), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode == 5:
        raise SystemExit(f"{mutation.file}: got no test in {mutation.tests!r} for {mutation.chosen!r}, expected some")
    if done.returncode not in (0, 1):
        return True, f"pytest ended with {done.returncode}: {done.stdout.strip().splitlines()[-1:]}"
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    name = failed[0].split("::", 1)[1].split(" - ")[0] if failed else ""
    return done.returncode == 1, name


def main(arguments: list[str] | None = None) -> int:
    """The table; the exit status is the number of survivors without a reason."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="mutate files whose path has this")
    parser.add_argument("--first", type=int, default=0, help="begin with the mutation of this number")
    options = parser.parse_args(arguments)
    survivors = 0
    with tempfile.TemporaryDirectory() as cache:
        for number, mutation in enumerate(MUTATIONS):
            if options.only not in mutation.file or number < options.first:
                continue
            start = time.perf_counter()
            killed, by = noticed(mutation, Path(cache))
            survivors += not killed and not mutation.equivalent
            verdict = f"killed by {by}" if killed else f"survived: {mutation.equivalent or 'no test notices'}"
            took = time.perf_counter() - start
            print(
                f"{number:2} {mutation.file}: {mutation.old} -> {mutation.new}\n   {verdict} ({took:.0f} s)", flush=True
            )
    return survivors


if __name__ == "__main__":
    raise SystemExit(main())

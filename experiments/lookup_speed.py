"""What a lookup costs in C beside LiSPSM's own formula, in one program over the same directions.

    python experiments/lookup_speed.py --directory runs/lookup_speed --readme README.md

Compiles `speed.c` with each compiler that is there (gcc, clang; -O2), and reports medians. `--short` is a slice for
tests. Writes `speed.json`, and the table into a page.
"""

import argparse
import json
import shutil
import statistics
import subprocess
from pathlib import Path

import numpy as np
from claim_checks import PAPER, PHI
from provenance import markdown_table, provenance, sentence, write_section

import warpopt

TARGET = 4.0  # times LiSPSM's formula, for eta of a table
_BASE = "LiSPSM's formula"
_METHODS = {
    _BASE: "(n + sqrtf(n * f)) / sinf(theta)",
    "table: eta": "table_eta(theta, n, f)",
    "table: lambda": "table_lambda(theta, n, f)",
    "table over far/near: eta": "wide_eta(theta, n, f)",
    "over far/near: lambda": "wide_lambda(theta, n, f)",
    "closed form, E_p: lambda": "closed_p_lambda(theta, n, f, phi)",
    "E_pxq: lambda": "closed_pxq_lambda(theta, n, f, phi)",
}
# One loop for each, stores kept by a checksum; the methods take turns, so that a disturbed second disturbs them all.
_PROGRAM = """#define _POSIX_C_SOURCE 199309L
#include "table.h"
#include "wide.h"
#include "closed_p.h"
#include "closed_pxq.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}
%(loops)s
int main(int argc, char **argv) {
    if (argc != 6) return 2;
    long count = atol(argv[1]), repeats = atol(argv[2]);
    float n = strtof(argv[3], 0), f = strtof(argv[4], 0), phi = strtof(argv[5], 0);
    float *in = malloc((size_t)count * sizeof *in), *out = malloc((size_t)count * sizeof *out);
    if (!in || !out || fread(in, sizeof *in, (size_t)count, stdin) != (size_t)count) return 1;
    for (long repeat = 0; repeat < repeats; repeat++) {
%(calls)s
        printf("\\n");
    }
    return 0;
}
"""
_LOOP = """
static double run%(k)d(const float *in, float *out, long count, float n, float f, float phi) {
    double start = now(), sum = 0;
    (void)phi;
    for (long i = 0; i < count; i++) { float theta = in[i]; out[i] = %(expression)s; }
    double spent = (now() - start) / (double)count;
    for (long i = 0; i < count; i++) sum += out[i];
    printf("%%.9g %%.17g ", spent, sum);
    return sum;
}
"""


def build(compiler: str, folder: Path, tables: dict[str, warpopt.LambdaTable]) -> Path:
    """The program, from the headers that `warpopt export` writes."""
    for name, one in tables.items():
        (folder / f"{name}.h").write_text(warpopt.export_source(one, "c", name))
    for metric in ("p", "pxq"):
        (folder / f"closed_{metric}.h").write_text(warpopt.export_closed_form(metric, "c", f"closed_{metric}"))
    loops = "".join(_LOOP % {"k": k, "expression": e} for k, e in enumerate(_METHODS.values()))
    calls = "\n".join(f"        run{k}(in, out, count, n, f, phi);" for k in range(len(_METHODS)))
    (folder / "speed.c").write_text(_PROGRAM % {"loops": loops, "calls": calls})
    program = folder / f"speed_{compiler}"
    command = [compiler, "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-o", str(program)]
    subprocess.run([*command, str(folder / "speed.c"), "-lm"], check=True)
    return program


def measure(program: Path, count: int, repeats: int) -> dict[str, float]:
    """Median ns a call of each method."""
    theta = np.random.default_rng(0).uniform(0.02, np.pi / 2, count).astype(np.float32)
    words = [str(program), str(count), str(repeats), "1", "100", repr(PHI)]
    out = subprocess.run(words, input=theta.tobytes(), capture_output=True, check=True).stdout.decode()
    times = np.array([[float(v) for v in line.split()] for line in out.splitlines()])[:, ::2]
    return {name: statistics.median(column) for name, column in zip(_METHODS, times.T, strict=True)}


def table(measured: dict[str, dict[str, float]]) -> str:
    rows = (
        [f"{compiler} -O2", *(f"{ns:.3g} ns ({ns / times[_BASE]:.2g})" for ns in times.values())]
        for compiler, times in measured.items()
    )
    return markdown_table(("in C", *_METHODS), rows)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/lookup_speed"))
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--short", action="store_true", help="few directions, one compiler")
    parser.add_argument("--readme", type=Path, help="a page with a place for `lookup speed`")
    arguments = parser.parse_args(words)
    compilers = [name for name in ("gcc", "clang") if shutil.which(name)]
    if not compilers:
        raise SystemExit("lookup_speed: got neither gcc nor clang on the path, expected a C compiler")
    arguments.directory.mkdir(parents=True, exist_ok=True)
    count, repeats = (10_000, 3) if arguments.short else (arguments.count, arguments.repeats)
    tables = {
        "table": warpopt.build_table(PAPER),
        "wide": warpopt.build_table(
            PAPER,
            max_regret=0.05 if arguments.short else 1e-3,
            depth_ratio_range=(50.0, 200.0) if arguments.short else (2.0, 1e5),
        ),
    }
    measured = {
        compiler: measure(build(compiler, arguments.directory, tables), count, repeats)
        for compiler in (compilers[:1] if arguments.short else compilers)
    }
    ratios = {c: [t[name] / t[_BASE] for name in _METHODS if name.endswith("eta")] for c, t in measured.items()}
    summary = provenance() | {"ns": measured, "ratio": ratios, "target": TARGET}
    (arguments.directory / "speed.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(table(measured))
    for compiler, (one, several) in ratios.items():
        print(f"{compiler}: eta takes {one:.2g}, over far/near {several:.2g}, of at most {TARGET:g}")
    if arguments.readme:
        words = f"Time a call (over LiSPSM's), random directions. {sentence(summary)}."
        write_section(arguments.readme, "lookup speed", f"{table(measured)}\n\n{words}")


if __name__ == "__main__":
    main()

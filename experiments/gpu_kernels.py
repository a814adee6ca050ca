"""What XLA makes of a call for a GPU, counted on a machine that has none: the kernels of a depth buffer's warp, and the
bytes that kernels of a batch read and write.

    pip install --no-deps jax-cuda13-pjrt==0.10.1 jax-cuda13-plugin==0.10.1    # JAX's own version
    python experiments/gpu_kernels.py --page docs/performance.md

XLA compiles for a GPU from its description alone. Times need the GPU (`gpu.py`), but most of a small program's is that
of launching its kernels, and a batch's cannot be less than its bytes take. `--short` is a slice for tests.
"""

import argparse
import functools
import json
import math
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from unittest import mock

os.environ.setdefault("JAX_SKIP_CUDA_CONSTRAINTS_CHECK", "1")  # of libraries that only running needs

import jax
import numpy as np
from gpu import BATCH, PER_PIXEL, frusta, needed, still
from jax.experimental import topologies
from jax.sharding import SingleDeviceSharding
from jaxtyping import PyTree
from provenance import markdown_table, provenance, sentence, write_section

import warpopt

# XLA's own description of the card: xla/backends/gpu/target_config/specs/h100_sxm.txtpb in openxla/xla.
H100 = """
gpu_device_info {
  threads_per_block_limit: 1024  threads_per_warp: 32  threads_per_core_limit: 2048
  shared_memory_per_block: 49152  shared_memory_per_core: 233472  shared_memory_per_block_optin: 232448
  core_count: 132  fpus_per_core: 128  clock_rate_ghz: 1.98
  block_dim_limit_x: 2147483647  block_dim_limit_y: 65535  block_dim_limit_z: 65535
  registers_per_core_limit: 65536  registers_per_block_limit: 65536
  memory_bandwidth: 3352320000000  l2_cache_size: 52428800  device_memory_size: 84942979072
  cuda_compute_capability { major: 9 }
}
runtime_version { major: 13 }
platform_name: "CUDA"
dnn_version_info { major: 9 minor: 7 }
device_description_str: "NVIDIA H100 80GB HBM3"
"""
_NO_KERNEL = {"parameter", "constant", "tuple", "get-tuple-element", "bitcast"}


def card() -> SingleDeviceSharding:
    """An H100, to compile for.

    Raises:
        NotImplementedError, RuntimeError: JAX has no plugin for such cards.
    """
    jax.devices("cpu")  # finds the plugins
    return SingleDeviceSharding(
        topologies.get_topology_desc("h100", "cuda", target_config=H100, topology="1x1x1").devices[0]
    )


def compiled_for(place: SingleDeviceSharding, call: Callable, argument: PyTree) -> jax.stages.Compiled:
    """A call compiled for the card, from the shapes of its argument."""
    shapes = jax.tree.map(lambda v: jax.ShapeDtypeStruct(np.shape(v), np.asarray(v).dtype, sharding=place), argument)
    with mock.patch("jax.default_backend", return_value="gpu"):
        lowered = jax.jit(call).lower(shapes)
    return lowered.compile({"xla_gpu_autotune_level": "0"})


def kernels_of(program: str) -> int:
    """Of the entry of a program in XLA's text: what is neither an argument nor a view of a result.

    Raises:
        ValueError: there is a loop or a branch, whose kernels this does not count.
    """
    entry = program[program.index("\nENTRY ") :]
    entry = entry[: entry.index("\n}")]
    kinds = re.findall(r"^\s+(?:ROOT )?%\S+ = .*? ([a-z][a-z\-]*)\(", entry, re.M)
    if loops := {"while", "conditional", "call"} & set(kinds):
        raise ValueError(f"program: got {', '.join(loops)} in its entry, expected kernels alone")
    return sum(kind not in _NO_KERNEL and not kind.endswith("-done") for kind in kinds)


def bytes_of(program: str) -> float:
    """What the kernels of a batch read and write for each problem.

    They are those of the loop over its pieces, if there is one, which carries arrays of all pieces; a kernel reads or
    writes one piece of these.
    """
    computations = re.findall(r"^(?:ENTRY )?%(?!fused).*? {$(.*?)^}", program, re.M | re.S)
    body = max(computations, key=lambda text: text.count(" fusion("))
    sizes, total, problems = {}, 0, 1
    for line in body.splitlines():
        if found := re.match(r"\s+(?:ROOT )?%(\S+) = (.+?) ([a-z][a-z\-]*)\((.*?)\)", line):
            name, shapes, kind, operands = found.groups()
            carried = "dynamic_update_slice" in name or operands.startswith("%arg_tuple")
            sizes[name] = 0
            for dtype, lengths in re.findall(r"([a-z]+\d*)\[([\d,]*)\]", shapes):
                lengths = [int(n) for n in lengths.split(",") if n][carried:]
                sizes[name] += (1 if dtype == "pred" else 4) * math.prod(lengths)
                problems = max([problems, *lengths])
            if kind not in _NO_KERNEL:
                total += sizes[name] + sum(sizes.get(operand, 0) for operand in re.findall(r"%([\w.\-]+)", operands))
    return total / problems


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--directory", type=Path, default=Path("runs/gpu_kernels"))
    parser.add_argument("--page", type=Path, help="a page with a place for `gpu kernels`")
    parser.add_argument("--short", action="store_true")
    asked = parser.parse_args(words)
    sizes = [(36, 64)] if asked.short else [(1080, 1920), (2160, 3840)]
    try:
        place = card()
    except (NotImplementedError, RuntimeError) as error:
        print(f"Nothing is counted: JAX {jax.__version__} cannot compile for an H100 here: {error}", file=sys.stderr)
        return 1
    rows = []
    for height, width in sizes:
        for o in PER_PIXEL[:1] if asked.short else PER_PIXEL:
            program = compiled_for(place, needed(o), still(height, width, o)).as_text()
            rows.append([f"{width} x {height}", o.title, kernels_of(program)])
    batches, view = [], frusta(2**10 if asked.short else 2**24)
    for o in BATCH[::3] if asked.short else BATCH:
        compiled = compiled_for(place, functools.partial(warpopt.optimal_warp, objective=o, throw=False), view)
        memory = compiled.memory_analysis()
        least = (memory.argument_size_in_bytes + memory.output_size_in_bytes) / len(view.theta)
        batches.append([o.title, bytes_of(compiled.as_text()), least])
    asked.directory.mkdir(parents=True, exist_ok=True)
    summary = provenance()
    (asked.directory / "kernels.json").write_text(
        json.dumps(summary | {"kernels": rows, "batches": batches}, indent=1) + "\n"
    )
    text = "\n\n".join(
        [
            markdown_table(["pixels", "objective", "kernels"], rows), f"{len(view.theta)} frusta:",
            markdown_table(["objective", "bytes a problem", "of these inputs and outputs"], batches),
            f"For an H100; {sentence(summary)}.",
        ]
    )  # fmt: skip
    print(text)
    if asked.page:
        write_section(asked.page, "gpu kernels", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

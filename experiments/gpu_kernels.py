"""How many kernels a depth buffer's warp takes on a GPU, counted on a machine that has none.

    pip install --no-deps jax-cuda13-pjrt==0.10.1 jax-cuda13-plugin==0.10.1    # JAX's own version
    python experiments/gpu_kernels.py --page docs/performance.md

XLA compiles for a GPU from its description alone. Times need the GPU (`gpu.py`), but most of a small program's is that
of launching its kernels. `--short` is a slice for tests.
"""

import argparse
import json
import os
import re
import sys
from pathlib import Path
from unittest import mock

os.environ.setdefault("JAX_SKIP_CUDA_CONSTRAINTS_CHECK", "1")  # of libraries that only running needs

import jax
import numpy as np
from gpu import PER_PIXEL, needed, still
from jax.experimental import topologies
from jax.sharding import SingleDeviceSharding
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


def program_of(objective: warpopt.Objective, height: int, width: int, place: SingleDeviceSharding) -> str:
    """The optimised program of one buffer's warp."""
    view = still(height, width, objective)
    shapes = jax.tree.map(lambda v: jax.ShapeDtypeStruct(np.shape(v), np.asarray(v).dtype, sharding=place), view)
    with mock.patch("jax.default_backend", return_value="gpu"):
        lowered = needed(objective).lower(shapes)
    return lowered.compile({"xla_gpu_autotune_level": "0"}).as_text()


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
    rows = [
        [f"{width} x {height}", o.title, kernels_of(program_of(o, height, width, place))]
        for height, width in sizes
        for o in (PER_PIXEL[:1] if asked.short else PER_PIXEL)
    ]
    asked.directory.mkdir(parents=True, exist_ok=True)
    summary = provenance()
    (asked.directory / "kernels.json").write_text(json.dumps(summary | {"kernels": rows}, indent=1) + "\n")
    text = f"{markdown_table(['pixels', 'objective', 'kernels'], rows)}\n\nFor an H100; {sentence(summary)}."
    print(text)
    if asked.page:
        write_section(asked.page, "gpu kernels", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

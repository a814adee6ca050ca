"""One process of several: computes its share of the blocks and writes them to the working folder."""

import os
import threading
import time
from pathlib import Path

import jax

from ..frusta.block_files import BlockFiles, folder_of
from ..frusta.block_solver import BlockSolver, field_shapes, shares, solve_blocks
from .process_launcher import LAUNCHER_VARIABLE, alive_path
from .settings import RunConfig

_WEEK_S = 7 * 24 * 3600


def work(config: RunConfig) -> int:
    """Join the process group, compute, wait for the others; returns 0 when this process's share is finished.

    Blocks do not depend on other processes: JAX's distributed runtime forms the group, assigns the devices, detects
    dead processes (on a cluster, where nothing else does), and keeps process 0 alive until all are done.
    """
    compute = config.compute
    me, timeout_s = compute.process_id, round(compute.timeout_s)
    problem = config.problem()
    assert me is not None  # otherwise the launcher would run
    folder = folder_of(config.output.directory, problem)
    folder.mkdir(parents=True, exist_ok=True)
    _stay_alive_with_launcher(alive_path(folder, me), compute.timeout_s)
    jax.distributed.initialize(
        compute.coordinator,
        compute.processes,
        me,
        initialization_timeout=timeout_s,
        heartbeat_timeout_seconds=timeout_s,
        shutdown_timeout_seconds=_WEEK_S,  # shares may differ; a dead process ends the wait by its heartbeat
    )

    def say(words: str) -> None:
        print(f"process {me}: {words}", flush=True)

    files = BlockFiles(folder, problem, jax.default_backend(), field_shapes(problem), say)
    blocks, devices = range(problem.tiling.count), jax.devices()
    mine = [block for share in shares(blocks, devices).values() for block in share]
    kept = {block for block in mine if files.read(block) is not None}
    say(
        f"pid {os.getpid()}, {jax.local_device_count()} of {len(devices)} devices, "
        f"{len(mine) - len(kept)} blocks to compute, {len(kept)} kept from before"
    )
    start = time.perf_counter()
    solve_blocks(BlockSolver(problem), blocks, devices, files.write, skip=kept.__contains__)
    say(f"finished in {time.perf_counter() - start:.1f} s")
    jax.distributed.shutdown()
    return 0


def _stay_alive_with_launcher(alive: Path, timeout_s: float) -> None:
    """Touch a file that shows the launcher that this process runs; exit when the launcher does."""
    launcher = os.environ.get(LAUNCHER_VARIABLE)
    if launcher is None:
        return

    def watch() -> None:
        while os.getppid() == int(launcher):
            alive.touch()
            time.sleep(min(1.0, timeout_s / 10))
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()

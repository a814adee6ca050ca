"""Computes a block on a device. Every run uses it, on one device or thousands."""

import concurrent.futures
import dataclasses
import threading
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import warpopt
from warpopt._checks import trusted
from warpopt.objective import Objective
from warpopt.rules.registry import PUBLISHED
from warpopt.solve.optimal_warp import optimum_and_norms

from .block_files import Block
from .problem import SweepProblem, View

Device = Any  # type checkers see jax.Device as a variable

_OF_OBJECTIVE = ("eta", "lam_over_mu", "lam", "value", "result", "residual", "limit")


def frustum_of(views: Sequence[View]) -> "warpopt.ViewFrustum":
    """The views as one frustum of shape (views, 1), against which directions broadcast."""
    near, far, half_fov_deg = np.array([dataclasses.astuple(v) for v in views], float).T[..., None]
    return warpopt.ViewFrustum(near, far, np.deg2rad(half_fov_deg))


def field_shapes(problem: SweepProblem) -> dict[str, tuple[int, ...]]:
    """Leading shape of each array of a block, before (views, directions)."""
    rules, objectives = len(PUBLISHED), len(problem.objectives)
    per_rule = {f"rule_{name}": (rules,) for name in ("eta", "lam_over_mu", "lam", "defined")}
    per_objective = {name: (objectives,) for name in _OF_OBJECTIVE}
    return {**per_rule, **per_objective, "ratio": (objectives, rules)}


@jax.jit
def _rules(frustum: "warpopt.ViewFrustum", theta: jax.Array) -> "list[warpopt.Warp]":
    with trusted():  # settings were checked
        return [rule(frustum, theta) for rule in PUBLISHED.values()]


@jax.jit
def _lengths(warp: "warpopt.Warp") -> tuple[jax.Array, jax.Array]:
    return warp.lam_over_mu, warp.lam


class BlockSolver:
    """Computes blocks of a problem.

    A block is a single-device program of the tile's shape; its inputs select the device. One program over all devices
    (`jax.shard_map`) would be compiled once instead of once per device, but XLA uses different passes for programs with
    one and with several partitions, which fuse differently: half of the L2 optima then differ in their last bit
    (measured, jax 0.10.1). Programs that differ only in their device do not.
    """

    def __init__(self, problem: SweepProblem):
        self._problem = problem
        self._tiling = problem.tiling
        self._theta = np.deg2rad(problem.theta_deg)

    def solve(self, block: int, device: Device, progress: Callable[[str], None]) -> Block:
        """The arrays of a block, without its padding; `progress` receives each finished objective."""
        views, directions = self._tiling.padded(block)
        frustum = jax.device_put(frustum_of([self._problem.all_views[view] for view in views]), device)
        theta = jax.device_put(self._theta[directions], device)
        warps = _rules(frustum, theta)
        view = warpopt.FrustumView(frustum, theta)
        etas = [warp.eta for warp in warps]
        progress("rules")

        def solve(objective: Objective) -> Block:
            solution, values = optimum_and_norms(view, etas, objective)
            value = np.asarray(solution.value)
            least = np.nan if objective.no_bound_because else warpopt.lower_bound(view, objective)
            progress(f"{objective.name} {objective.norm}")
            found = {
                "value": value,
                "result": solution.result,
                "residual": solution.residual,
                "ratio": np.stack(jax.device_get(values)) / value,
                "limit": np.broadcast_to(np.asarray(least, value.dtype), value.shape),
            }
            return {**self._curves(solution.warp), **found}

        # Most of the time is compilation, which runs outside Python's lock.
        with concurrent.futures.ThreadPoolExecutor() as pool:
            solved = list(pool.map(solve, self._problem.objectives))
        of_rules = [{**self._curves(warp), "defined": warp.defined} for warp in warps]
        joined = {f"rule_{name}": np.stack([one[name] for one in of_rules]) for name in of_rules[0]}
        joined.update({name: np.stack([one[name] for one in solved]) for name in solved[0]})
        inner = tuple(slice(part.stop - part.start) for part in self._tiling.extent(block))
        return {name: array[(..., *inner)] for name, array in joined.items()}

    def _curves(self, warp: "warpopt.Warp") -> Block:
        lam_over_mu, lam = _lengths(warp)
        shape = self._tiling.tile
        arrays = {"eta": warp.eta, "lam_over_mu": lam_over_mu, "lam": lam}
        return {name: np.broadcast_to(np.asarray(array), shape) for name, array in arrays.items()}


def shares(blocks: Sequence[int], devices: Sequence[Device]) -> dict[Device, Sequence[int]]:
    """The blocks of each device of this process: one axis of blocks, sharded over the devices of all processes."""
    mesh = Mesh(np.array(devices), ("device",))
    padded = -(-len(blocks) // len(devices)) * len(devices)
    sharding = NamedSharding(mesh, PartitionSpec("device"))
    placed: dict[Device, Any] = dict(sharding.addressable_devices_indices_map((padded,)))
    return {d: blocks[where] for d, (where,) in placed.items()}


def solve_blocks(
    solver: BlockSolver,
    blocks: Sequence[int],
    devices: Sequence[Device],
    done: Callable[[int, Block], None],
    progress: Callable[[str], None] = lambda name: None,
    skip: Callable[[int], bool] = lambda block: False,
) -> None:
    """Compute this process's share of the blocks, its devices side by side; `done` is given each as it is finished."""
    failed = threading.Event()

    def work(share: tuple[Device, Sequence[int]]) -> None:
        device, mine = share
        try:
            for block in mine:
                if failed.is_set():
                    return
                if not skip(block):
                    done(block, solver.solve(block, device, progress))
        except BaseException:
            failed.set()
            raise

    busy = [(device, mine) for device, mine in shares(blocks, devices).items() if mine]
    with concurrent.futures.ThreadPoolExecutor(max(1, len(busy))) as pool:
        for _ in pool.map(work, busy):
            pass

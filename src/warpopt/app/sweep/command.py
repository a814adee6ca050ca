"""The arguments of `warpopt run`, and its steps: read, start processes or be one of them, solve."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax


@dataclasses.dataclass(frozen=True)
class Run(Configured):
    """Solve a configuration and write its table, figures and report."""

    @staticmethod
    def model() -> Any:
        from .settings import RunConfig

        return RunConfig

    def answer(self, overrides: list[str]) -> int:
        config = self.read(overrides)
        compute = config.compute
        prepare_jax(compute.devices_per_process)
        if compute.process_id is not None:
            from .worker_process import work

            return work(config)
        if compute.processes > 1:
            from .process_launcher import compute_in_processes

            compute_in_processes(config, [str(self.config), *overrides], print)
        from .run import run

        return run(config)

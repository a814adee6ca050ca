"""The arguments of `warpopt table`."""

import dataclasses
from typing import Any

from ..common.command import Configured
from ..common.jax_settings import prepare_jax
from ..common.output import check_files_replaceable
from ..common.settings import read_config


@dataclasses.dataclass(frozen=True)
class Table(Configured):
    """Build a table of the optimal warp over theta with a promised accuracy, for `export`."""

    @staticmethod
    def model() -> Any:
        from .settings import TableConfig

        return TableConfig

    def answer(self, overrides: list[str]) -> int:
        config = read_config(self.config, overrides, self.model())
        check_files_replaceable([config.output.file])
        prepare_jax()
        from .run import run_table

        return run_table(config)

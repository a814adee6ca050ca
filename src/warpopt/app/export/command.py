"""The arguments of `warpopt export`."""

import dataclasses
from pathlib import Path

import tyro

from ..common.command import Plain
from ..common.jax_settings import prepare_jax


@dataclasses.dataclass(frozen=True)
class Export(Plain):
    """Source code for engines, from a table or of the closed form."""

    table: tyro.conf.Positional[str]
    """A table (.npz, .csv, .json), or `closed-form`: the exact L-inf optimum of any view frustum, no table."""
    to: str
    """Which, separated by commas: c, cpp, glsl, hlsl, wgsl; of a table also csv, json, npz."""
    directory: Path = Path(".")
    """Where the files go, named as the table."""
    metric: str | None = None
    """Of the closed form: p (if not given), q or pxq."""
    prefix: str = "warpopt"
    """What the names in code begin with; for several tables in one program."""

    def run(self) -> int:
        from .request import ExportRequest

        request = ExportRequest.of(self.table, self.to, self.directory, self.metric, self.prefix)
        prepare_jax()
        from .run import export

        return export(request)

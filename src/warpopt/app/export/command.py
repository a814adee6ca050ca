"""The arguments of `warpopt export`."""

import dataclasses
from pathlib import Path

import tyro

from ..common.command import Plain
from ..common.jax_settings import prepare_jax


@dataclasses.dataclass(frozen=True)
class Export(Plain):
    """Source code for engines: from a table, of the closed form, of the stable window, or of cascades."""

    table: tyro.conf.Positional[str]
    """A table (.npz, .csv, .json); `closed-form`, the exact L-inf optimum of any view frustum, without a table;
    `window`, moving a map by whole texels so that every texel stays in place; or `splits`, where to split a view
    frustum into several maps, and the optimal warp in each."""
    to: str
    """Languages, separated by commas: c, cpp, glsl, hlsl, wgsl; for a table also csv, json, npz."""
    directory: Path = Path(".")
    """Output folder; the files are named after the table."""
    metric: str | None = None
    """Metric of the closed form and of splits' warps: p (default), q or pxq; over the ground p, pxq or storage."""
    receivers: str = "frustum"
    """Of the closed form: frustum, the whole view frustum, or ground, level ground: direction, eta and matrix."""
    prefix: str = "warpopt"
    """Prefix of the names in code; needed for several tables in one program."""

    def run(self) -> int:
        from .request import ExportRequest

        request = ExportRequest.of(self.table, self.to, self.directory, self.metric, self.receivers, self.prefix)
        prepare_jax()
        from .run import export

        return export(request)

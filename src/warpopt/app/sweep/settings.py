"""The configuration of `warpopt run`: view frusta, light angles, objectives, processes. Does not import JAX."""

from typing import Annotated

import pydantic
from pydantic import Field

from ..common.settings import (
    Distinct,
    FarEnd,
    HalfFovDeg,
    LightAngles,
    NearFar,
    ObjectiveConfig,
    OutputConfig,
    Positive,
    Section,
    listed,
)
from ..frusta.problem import BLOCK_MULTIPLE, BLOCK_SIZE, SweepProblem, View

_FIGURE_RATIOS = (10.0, 100.0, 1000.0, 10000.0)  # f/n of the figure over several f/n, in addition to the config's


class ViewConfig(NearFar):
    """View frusta: every combination of the listed values."""

    near: Positive = 1.0
    far: Annotated[list[Positive], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct, FarEnd]
    half_fov_deg: Annotated[list[HalfFovDeg], pydantic.BeforeValidator(listed), Field(min_length=1), Distinct]


class ComputeConfig(Section):
    """The distribution of a run over processes and devices. Only block_size can change a bit of the result."""

    processes: Annotated[int, Field(ge=1, le=65_536)] = 1
    """1: this process computes. More: it starts them on this machine, unless process_id makes it one of them."""
    devices_per_process: Annotated[int, Field(ge=1, le=1024)] | None = None
    """CPU devices that each process creates; by default JAX's devices: one CPU, or every visible GPU."""
    block_size: Annotated[int, Field(ge=BLOCK_MULTIPLE, le=16_777_216, multiple_of=BLOCK_MULTIPLE)] = BLOCK_SIZE
    """Maximum number of problems in a block, the unit of work that one device computes and one file keeps."""
    timeout_s: Annotated[float, Field(ge=1, le=86_400)] = 120.0
    """A process that is silent for this long counts as dead."""
    keep_blocks: bool = False
    """Keep finished blocks on disk until the run is complete; always on with several processes."""
    coordinator: Annotated[str, Field(pattern=r"^.+:[0-9]{1,5}$")] | None = None
    """host:port at which process 0 can be reached; by default chosen by the command that starts the processes."""
    process_id: Annotated[int, Field(ge=0)] | None = None
    """Index of this process, from 0; on a cluster, given on each process's command line."""

    @pydantic.field_validator("process_id")
    @classmethod
    def _one_of_them(cls, value: int | None, info: pydantic.ValidationInfo) -> int | None:
        processes = info.data.get("processes")
        if value is not None and processes is not None and value >= processes:
            raise ValueError(f"expected less than compute.processes = {processes}")
        if value is not None and "coordinator" in info.data and info.data["coordinator"] is None:
            raise ValueError("expected compute.coordinator = 'host:port' too")
        return value


class RunConfig(Section):
    """One run of the main job: `warpopt run`."""

    view: ViewConfig
    light: LightAngles
    objective: ObjectiveConfig = ObjectiveConfig()
    output: OutputConfig
    compute: ComputeConfig = ComputeConfig()

    def problem(self) -> SweepProblem:
        """The problem, including views that only figures need."""
        view = self.view
        views = tuple(View(view.near, far, half_fov) for half_fov in view.half_fov_deg for far in view.far)
        return SweepProblem(
            views,
            _context(views) if self.output.figures else (),
            self.light.values(),
            tuple(self.objective.objectives()),
            self.compute.block_size,
        )


def _context(views: tuple[View, ...]) -> tuple[View, ...]:
    first = views[0]
    fars = (first.near * ratio for ratio in _FIGURE_RATIOS)
    candidates = (View(first.near, far, first.half_fov_deg) for far in fars)
    return tuple(view for view in candidates if view not in views)

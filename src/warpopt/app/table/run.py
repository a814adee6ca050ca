"""`warpopt table`: builds a table from a configuration and writes it."""

import math
import sys

import warpopt

from ..common.output import whole_files
from .settings import TableConfig


def run_table(config: TableConfig) -> int:
    """Build, write, print the result; returns 0 if the promise is kept, 1 (and no file) if rounding prevents it.

    Raises:
        ConfigError: the output cannot be written, or is a file that warpopt did not write.
    """
    view, objective, span = config.view, config.objective, config.light.theta_deg
    path = config.output.file
    ratios, fovs = view.far_over_near, view.half_fov_deg_range
    far = view.near * ratios.start if ratios else view.far
    half_fov = fovs.start if fovs else view.half_fov_deg
    assert far is not None  # the settings require one of each pair
    assert half_fov is not None
    frustum = warpopt.ViewFrustum(view.near, far, math.radians(half_fov))
    try:
        table = warpopt.build_table(
            frustum, objective.objective_value(), max_regret=objective.max_regret,
            theta_range=(math.radians(span.start), math.radians(span.stop)),
            depth_ratio_range=ratios and (ratios.start, ratios.stop),
            half_fov_range=fovs and (math.radians(fovs.start), math.radians(fovs.stop)), max_slope=objective.max_slope,
        )  # fmt: skip
    except RuntimeError as error:
        print(f"warpopt: objective.max_regret: {error}", file=sys.stderr)
        return 1
    whole_files({path: table.encoded(path)})
    counts = [f"{len(table.depth_ratio)} far/near"] * (ratios is not None)
    counts += [f"{len(table.half_fov)} fields of view"] * (fovs is not None)
    rows = f" for each of {' by '.join(counts)}" if counts else ""
    print(
        f"{table.theta.shape[-1]} knots for theta in [{span.start:g}, {span.stop:g}] degrees{rows}: {table.size} bytes"
    )
    theta, ratio, half_fov = table.worst
    where = f"theta = {math.degrees(theta):.6g} degrees"
    where += f", far/near = {ratio:.6g}" * (ratios is not None)
    where += f", half field of view {math.degrees(half_fov):.6g} degrees" * (fovs is not None)
    if objective.max_slope is None:
        print(f"largest regret {table.achieved:.4g} of {table.promised:g} promised, at {where}")
    else:
        bound = f"|d log(eta) / d theta| <= {objective.max_slope:g}"
        print(f"largest regret {table.achieved:.4g} with {bound}, at {where}")
        if table.promised > objective.max_regret:
            slack = f"within {10 if ratios is None and fovs is None else 25} % of the least that the bound allows"
            print(f"more than the {objective.max_regret:g} requested: {slack}")
    print(f"Written: {path}")
    return 0

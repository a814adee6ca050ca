"""`warpopt table`: a configuration in, a table with its promise out."""

import math
import sys

import warpopt

from ..common.output import whole_files
from .settings import TableConfig


def run_table(config: TableConfig) -> int:
    """Build, write, say what was achieved; 0 if the promise is kept, 1 (and no file) if rounding does not allow it.

    Raises:
        ConfigError: the output's place cannot be written, or holds what warpopt did not write.
    """
    view, objective, span = config.view, config.objective, config.light.theta_deg
    path = config.output.file
    ratios, fovs = view.far_over_near, view.half_fov_deg_range
    far = view.far or view.near * ratios.start
    frustum = warpopt.ViewFrustum(view.near, far, math.radians(view.half_fov_deg or fovs.start))
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
            print(f"more than the {objective.max_regret:g} asked for: {slack}")
    print(f"Written: {path}")
    return 0

"""`warpopt table`: a configuration in, a table with its promise out."""

import math
import sys

import warpopt
from warpopt.table.build import build_table
from warpopt.table.files import encoded

from .table_config import TableConfig
from .writing import whole_files


def run_table(config: TableConfig) -> int:
    """Build, write, say what was achieved; 0 if the promise is kept, 1 (and no file) if rounding does not allow it.

    Raises:
        ConfigError: the output's place cannot be written, or holds what warpopt did not write.
    """
    view, objective, span = config.view, config.objective, config.light.theta_deg
    path = config.output.file
    frustum = warpopt.ViewFrustum(view.near, view.far, math.radians(view.half_fov_deg))
    try:
        table = build_table(
            frustum, objective.metric, objective.norm, objective.measure, max_regret=objective.max_regret,
            theta_range=(math.radians(span.start), math.radians(span.stop)),
        )  # fmt: skip
    except RuntimeError as error:
        print(f"warpopt: objective.max_regret: {error}", file=sys.stderr)
        return 1
    whole_files({path: encoded(table, path)})
    print(f"{len(table.theta)} knots for theta in [{span.start:g}, {span.stop:g}] degrees")
    print(
        f"largest regret {table.achieved:.4g} of {table.promised:g} promised, "
        f"at theta = {math.degrees(table.worst_theta):.6g} degrees"
    )
    print(f"Written: {path}")
    return 0

"""The settings of `warpopt solve`, `rules` and `limit`, from the command line only. Does not import JAX."""

from ..common.settings import OneObjective, OneView, ThetaDeg


class Problem(OneObjective, OneView):
    """One view, one light direction, one objective: `warpopt solve`, `rules` and `limit`."""

    theta_deg: ThetaDeg

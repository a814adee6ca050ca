"""What `warpopt solve`, `rules` and `limit` are asked, on the command line alone. Knows nothing of JAX."""

from ..common.settings import OneObjective, OneView, ThetaDeg


class Problem(OneObjective, OneView):
    """One view, one light direction, one objective: `warpopt solve`, `rules` and `limit`."""

    theta_deg: ThetaDeg

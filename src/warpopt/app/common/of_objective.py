"""What every result of one objective is asked for."""

from warpopt.objective import Objective


class OfObjective:
    """A result with the objective that was minimised, under the names of its parts."""

    objective: Objective

    @property
    def metric(self) -> str:
        """Its name."""
        return self.objective.name

    @property
    def norm(self) -> str:
        """Its name."""
        return self.objective.norm

"""Rules for lambda that the literature offers, to compare the optimum with."""

from .published import lispsm, minimum_norm, psm, scherzer, ssm, tsm, tsm_alternative

__all__ = ["lispsm", "minimum_norm", "psm", "scherzer", "ssm", "tsm", "tsm_alternative"]

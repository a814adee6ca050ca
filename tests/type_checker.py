"""What checks every call of the package in the lane WARPOPT_LANE=types; see conftest.py."""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int where a float is asked for, as for static checkers

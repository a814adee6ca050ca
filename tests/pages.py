"""What an experiment wrote into a page, compared with what it computes now."""

import re
from decimal import Decimal

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_ROUNDING = 1e-9  # numbers below are errors of rounding, of which nothing but the size is known


def section(page: str, name: str) -> str:
    """What stands between `<!-- name -->` and `<!-- end name -->`."""
    return page.split(f"<!-- {name} -->\n")[1].split(f"\n<!-- end {name} -->")[0]


def same_to_the_digits(printed: str, computed: str) -> bool:
    """The same words and integers, and other numbers that differ by at most one unit of the last digit."""
    if _NUMBER.sub("#", printed) != _NUMBER.sub("#", computed):
        return False
    for one, other in zip(_NUMBER.findall(printed), _NUMBER.findall(computed), strict=True):
        if one.isdigit() and other.isdigit() and one != other:
            return False
        numbers = Decimal(one), Decimal(other)
        unit = Decimal((0, (1,), min(number.as_tuple().exponent for number in numbers)))
        if abs(numbers[0] - numbers[1]) > unit and max(map(abs, numbers)) > _ROUNDING:
            return False
    return True

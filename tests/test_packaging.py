"""What an installed warpopt has: all that the checkout has."""

from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("builder", [WheelBuilder, SdistBuilder])
def test_every_file_of_the_package_is_installed(builder):
    """Hatchling leaves out what git ignores: a pattern for outputs once took the modules that build tables with it."""
    packed = {Path(file.path) for file in builder(str(ROOT)).recurse_included_files()}
    own = {path for path in (ROOT / "src").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert len(own) > 200
    assert not own - packed

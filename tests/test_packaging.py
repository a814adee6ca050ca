"""What an installed warpopt has: every file of the package."""

from pathlib import Path, PurePath

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(("builder", "below"), [(WheelBuilder, "warpopt"), (SdistBuilder, "src/warpopt")])
def test_every_file_of_the_package_is_installed(builder, below):
    """Hatchling leaves out what git ignores: a pattern for outputs once took the modules that build tables with it."""
    packed = {PurePath(file.distribution_path) for file in builder(str(ROOT)).recurse_included_files()}
    package = ROOT / "src/warpopt"
    files = (path.relative_to(package) for path in package.rglob("*") if path.is_file())
    own = {below / path for path in files if not any(part.startswith((".", "__pycache__")) for part in path.parts)}
    assert len(own) > 200
    assert not own - packed

"""The house: what may import what, and how full a room may be."""

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_imports_keep_to_the_floors():
    """pyproject's contracts: floors, commands that know nothing of each other, no circle among files."""
    found = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run()", "--no-cache"],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stdout + found.stderr


def test_experiments_use_public_names_only():
    """Of the command line, what `app/common/__init__.py` and `app/inputs` name; nothing that begins with _."""
    public = re.compile(
        r"cli|inputs(\.\w+)?|common|common\.(figure_style|error_maps|flicker_figure|jax_settings|light_plane)"
    )
    for path in (ROOT / "experiments").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                app = name.removeprefix("warpopt.app.")
                assert app == name or public.fullmatch(app), f"{path.name}: {name}"
                assert not re.match(r"warpopt(\.\w+)*\._", name), f"{path.name}: {name}"


def test_no_room_is_too_full():
    """At most 16 files in a folder, and 400 lines in a file."""
    files = sorted((ROOT / "src").rglob("*.py"))
    rooms = {path.parent for path in files}
    assert len(rooms) > 15
    crowded = {room.name: len(list(room.glob("*.py"))) for room in rooms if len(list(room.glob("*.py"))) > 16}
    long = {path.name: len(path.read_text().splitlines()) for path in files}
    assert not crowded
    assert not {name: lines for name, lines in long.items() if lines > 400}


def test_the_top_of_the_package_stays_small():
    """At most 30 names; what comes later lives in modules of its own."""
    import warpopt

    assert len(warpopt.__all__) <= 30
    assert all(getattr(warpopt, name) is not None for name in warpopt.__all__)

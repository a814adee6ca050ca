"""What the pages say of the code: names, links, formulas, examples and command lines hold."""

import doctest
import importlib
import importlib.util
import inspect
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import warpopt
from warpopt.app import cli
from warpopt.app.common.settings import read_config, validated
from warpopt.app.compare.own_rules import check_modules
from warpopt.app.compare.settings import read_compare_config
from warpopt.app.export.request import ExportRequest
from warpopt.app.inputs.camera_settings import CameraConfig
from warpopt.app.inputs.scene_settings import DepthReceivers, GltfReceivers
from warpopt.app.one_view.settings import Problem
from warpopt.app.scene.settings import SceneConfig
from warpopt.app.sweep.settings import RunConfig
from warpopt.app.table.settings import TableConfig

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
REFERENCE = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
COMPUTED = re.compile(r"\[`([\w.]+)`\]\(\.\./src/(warpopt/[\w/]+)\.py\)")
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)


def public_names() -> dict[str, object]:
    """Each name as it follows `warpopt.`, once: what stands at the top too is not named by its room again."""
    top = {name: getattr(warpopt, name) for name in warpopt.__all__}
    rooms = {name: found for name, found in top.items() if inspect.ismodule(found)}
    names = {name: found for name, found in top.items() if name not in rooms}
    for room, module in rooms.items():
        inside = {name: getattr(module, name) for name in module.__all__ if name not in top}
        names |= {f"{room}.{name}": found for name, found in inside.items() if not isinstance(found, dict)}
    return names


PUBLIC = public_names()


def prose(page: Path) -> str:
    """The page without its code blocks."""
    return re.sub(r"(^|\n\n)(    .*(\n|$))+", "\n\n", FENCED.sub("", page.read_text(encoding="utf-8")))


def anchors(page: Path) -> set[str]:
    """What a forge makes of the page's headings."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", page.read_text(encoding="utf-8")), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_images_resolve(page):
    targets = re.findall(r"\]\(([^)\s]+)\)", prose(page))
    for target in targets:
        assert not target.startswith("/"), f"{target} leaves the repository"
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        assert file.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(file), f"{page.name}: {target}"


def test_pictures_are_small_and_shown():
    """A page that loads quickly, and no picture that no page shows."""
    pictures = sorted((ROOT / "docs" / "images").iterdir())
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size < 250_000, picture.name
        assert f"images/{picture.name})" in text, picture.name


def test_formulas_are_numbered_in_order_and_each_has_its_function():
    stated = [int(number) for number in re.findall(r"^\*\*\(T(\d+)\)\*\*", THEORY, re.M)]
    assert stated == list(range(1, len(stated) + 1))
    rows = re.findall(r"^\| T(\d+) \| ([^|]+) \| (.+) \|$", THEORY, re.M)
    assert [int(number) for number, _, _ in rows] == stated
    for number, source, function in rows:
        assert COMPUTED.search(function), f"T{number} is computed by nothing"
        assert re.search(r"AT09|VN|WI|SC|derived here|theorem|2004|\w @[0-9a-f]{7}$", source), (
            f"T{number} comes from nowhere"
        )
    for number in re.findall(r"\(T(\d+)\)", THEORY):
        assert int(number) in stated, f"T{number} is referred to and not there"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_formulas_in_the_text_survive_a_forge(page):
    """Forges read Markdown's escapes and emphasis before the formula: no backslash before punctuation, no asterisk."""
    for formula in re.findall(r"(?<![\\$])\$([^$\n]+)\$", prose(page)):
        assert not re.search(r"\\[^A-Za-z]|\*", formula), f"{page.name}: {formula}"


@pytest.mark.parametrize(("name", "module"), sorted(set(COMPUTED.findall(THEORY))))
def test_functions_that_compute_formulas_exist(name, module):
    found = importlib.import_module(module.replace("/", "."))
    for part in name.split("."):
        found = getattr(found, part)
    assert found.__doc__ or isinstance(found, property), f"{name} has nothing to read"


def test_the_reference_has_every_public_name_and_no_other():
    rows = re.findall(r"^\| \[`([\w.]+)`\]\(\.\./src/(warpopt/[\w/]+)\.py\) \| .+ \|$", REFERENCE, re.M)
    assert sorted(name for name, _ in rows) == sorted(PUBLIC)
    for name, module in rows:
        found = getattr(importlib.import_module(module.replace("/", ".")), name.split(".")[-1])
        assert found.__module__ == module.replace("/", "."), f"{name} is not written there"


def test_the_reference_says_what_the_docstrings_say():
    """Else: python docs/write_reference.py."""
    spec = importlib.util.spec_from_file_location("write_reference", ROOT / "docs" / "write_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.described(REFERENCE).splitlines() == REFERENCE.splitlines()


def test_every_public_name_has_an_example_that_runs():
    assert [name for name, found in PUBLIC.items() if ">>>" not in inspect.getdoc(found)] == []


def test_the_site_builds_without_a_warning(tmp_path):
    """With the `docs` extra. Slow for a test of this file, and the only one that sees docstrings as a page."""
    if any(importlib.util.find_spec(name) is None for name in ("sphinx", "furo", "myst_parser", "latex2mathml")):
        pytest.skip("the docs extra is not installed: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-c", str(ROOT / "docs"), str(ROOT), str(tmp_path)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "docs" / "reference.html").read_text(encoding="utf-8")
    assert set(re.findall(r'id="warpopt\.([\w.]+)"', page)) >= set(PUBLIC)
    assert "<math" in (tmp_path / "docs" / "theory.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [page for page in PAGES if ">>>" in page.read_text(encoding="utf-8")], ids=str)
def test_examples_print_what_the_page_says(page):
    result = doctest.testfile(str(page), module_relative=False, encoding="utf-8")
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_blocks_run(page):
    """Those without a prompt; their last lines are expressions that must only evaluate."""
    names: dict = {}
    for language, block in FENCED.findall(page.read_text(encoding="utf-8")):
        if language == "python" and ">>>" not in block:
            exec(compile(block, page.name, "exec"), names)


def commands(page: Path) -> list[list[str]]:
    """The arguments of every `warpopt` command line on the page: in blocks; in text, if with an option or a file."""
    text = page.read_text(encoding="utf-8")
    blocks = [line for line in text.replace("\\\n", " ").splitlines() if line.startswith("    ")]
    spans = [span for span in re.findall(r"`(warpopt [^`]+)`", text) if "--" in span or ".toml" in span]
    found = []
    for line in blocks + spans:
        for part in re.split(r"&&|sh -c '(?:exec )?", re.sub(r"\$\w+|\$\(\(?.*?\)\)?", "0", line)):
            words = re.match(r"\s*(?:\S+/)?warpopt (.*)", part, re.S)
            if words:
                inner = words[1].removesuffix("'") if "sh -c" in line else words[1]
                found.append(shlex.split(inner, comments=True))
    return found


@pytest.mark.parametrize(
    ("page", "words"),
    [pytest.param(p, w, id=f"{p.name}: {' '.join(w)}") for p in PAGES for w in commands(p)],
)
def test_command_lines_are_accepted(page, words):
    """As far as the checks go that come before anything is computed."""
    command, rest = cli.parsed(words)
    models = {cli.Run: RunConfig, cli.Scene: SceneConfig, cli.Table: TableConfig}
    if type(command) in models:
        config = ROOT / command.config
        if not config.exists():
            assert "/" not in str(command.config), f"{page.name}: {command.config}"  # a name of the reader's own
            config = ROOT / "configs" / "paper.toml"
        read_config(config, rest, models[type(command)])
    elif isinstance(command, cli.Compare):
        config = ROOT / command.config
        check_modules(read_compare_config(config, rest).rules, config.parent)
    elif isinstance(command, cli.Export):
        asked = command.metric, command.receivers, command.prefix
        ExportRequest.of(command.table, command.to, command.directory, *asked)
    elif isinstance(command, cli.Solve | cli.Rules | cli.Limit):
        fields = {name: value for name, value in vars(command).items() if name in Problem.model_fields}
        validated(Problem, fields, page.name)


def test_pages_show_command_lines():
    assert len([words for page in PAGES for words in commands(page)]) >= 12


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_experiments_named_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"experiments/\w+\.py", text):
        assert (ROOT / name).exists(), name
    for name, options in re.findall(r"python (experiments/\w+\.py)([^`\n]*)", text):
        script = (ROOT / name).read_text(encoding="utf-8")
        assert all(f'"{option}"' in script for option in re.findall(r"--[\w-]+", options)), name


def test_scenes_shown_are_accepted():
    """Each block of docs/scenes.md in a whole scene, and every key of its tables."""
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    base = tomllib.loads((ROOT / "tests" / "cases" / "depth.toml").read_text(encoding="utf-8"))
    blocks = [tomllib.loads(block) for language, block in FENCED.findall(page) if language == "toml"]
    assert len(blocks) >= 6
    for block in blocks:
        validated(SceneConfig, base | block, "docs/scenes.md")
    models = (CameraConfig, DepthReceivers, GltfReceivers)
    known = {name for model in models for name in model.model_fields}
    shown = {name for row in re.findall(r"^\| (`.+?) \|", page, re.M) for name in re.findall(r"`(\w+)`", row)}
    assert shown <= known
    assert set(DepthReceivers.model_fields) - {"files"} <= shown
    assert set(GltfReceivers.model_fields) - {"file"} <= shown

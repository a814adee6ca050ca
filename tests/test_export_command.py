"""`warpopt table` and `warpopt export` end to end."""

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from shaders import missing

import warpopt
from warpopt import LambdaTable
from warpopt.app import cli
from warpopt.app.common import output
from warpopt.app.table import run as table_command

ROOT = Path(__file__).parents[1]
TABLE = str(ROOT / "configs" / "table.toml")
FAR_NEAR = str(ROOT / "configs" / "table_far_near.toml")
ALL = "c,cpp,glsl,hlsl,wgsl,csv,json,npz"
LOOSE = ["--objective.max_regret", "0.05", "--view.far", "10"]  # few knots: quickly built


def invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(list(arguments))
    return exit_.value.code


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """(the table's file, what the command printed)."""
    path = tmp_path_factory.mktemp("table") / "new" / "lambda.json"
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert invoke("table", TABLE, *LOOSE, "--output.file", str(path)) == 0
    return path, out.getvalue()


@pytest.fixture
def folder(built, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(built[0], tmp_path)
    return tmp_path


def test_a_table_is_built_to_its_configuration_and_says_what_it_achieved(built):
    path, out = built
    table = LambdaTable.load(path)
    assert (table.depth_ratio[0], table.objective.name, table.promised) == (10.0, "p", 0.05)
    assert table.half_fov[0] == pytest.approx(np.pi / 6, rel=1e-15)
    assert f"{table.theta.size} knots" in out
    assert f"largest regret {table.achieved:.4g} of 0.05 promised" in out
    assert f"theta = {np.degrees(table.worst[0]):.6g} degrees" in out
    assert list(path.parent.iterdir()) == [path]


def test_every_format_is_written_and_the_same_each_time(folder, capsys):
    assert invoke("export", "lambda.json", "--to", ALL, "--directory", "one") == 0
    assert invoke("export", "one/lambda.npz", "--to", ALL, "--directory", "two") == 0
    endings = (".h", ".hpp", ".330.glsl", ".450.glsl", ".hlsl", ".wgsl", ".csv", ".json", ".npz")
    one, two = ({p.name: p.read_bytes() for p in Path(name).iterdir()} for name in ("one", "two"))
    assert one.keys() == {f"lambda{ending}" for ending in endings}
    assert one == two
    assert one["lambda.json"] == Path("lambda.json").read_bytes()
    for name, content in one.items():
        assert str(folder).encode() not in content
        for words in (b"warpopt", b"screen"):
            assert words in content.replace(b"\0", b""), name
    assert (
        invoke("export", "lambda.json", "--to", "c", "--prefix", "sun", "--directory", "one") == 0
    )  # replaces its own
    assert "float sun_eta(float theta" in Path("one/lambda.h").read_text()


def test_the_readme_goes_from_an_empty_folder_to_a_look_up(tmp_path):
    """Its lines in a shell, but for the installation; the lambda that the program prints loses at most 0.1 %."""
    if shutil.which("cc") is None:
        missing("cc is not on this machine: apt-get install gcc")
    block = re.search(r"## In your engine\n\n((?:    .*\n)+)", (ROOT / "README.md").read_text(encoding="utf-8"))[1]
    install, *lines = textwrap.dedent(block).splitlines()
    assert "pip install" in install
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    script = "\n".join(lines).replace(".venv/bin/warpopt", f"{sys.executable} -m warpopt.app.cli")
    run = subprocess.run(["bash", "-e", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    lam = float(re.search(r"^lambda = (\S+)$", run.stdout, re.M)[1])
    frustum = warpopt.ViewFrustum(0.1, 300.0, np.pi / 6)
    view = warpopt.FrustumView(frustum, 1.0)
    best = warpopt.optimal_warp(view)
    assert (
        1 <= warpopt.error_norm(view, warpopt.Warp.from_lam(lam, view)) / best.value < 1.001 + 1e-5
    )  # printed to six digits


def test_the_closed_form_needs_no_table(folder):
    assert invoke("export", "closed-form", "--to", "c,wgsl", "--metric", "pxq") == 0
    names = {p.name for p in folder.iterdir()}
    assert names == {"lambda.json", "closed_form_pxq.h", "closed_form_pxq.wgsl"}
    assert "E_pxq, norm inf" in Path("closed_form_pxq.h").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["export", "lambda.json", "--to", "c,rust"], "to: got 'rust', expected c, cpp, glsl"),
        (["export", "closed-form", "--to", "json"], "to: got 'json', expected c, cpp"),
        (["export", "lambda.json", "--to", ""], "to: got ''"),
        (["export", "lambda.txt", "--to", "c"], "table: got 'lambda.txt', expected a file ending in .npz, .csv, .json"),
        (["export", "none.json", "--to", "c"], "none.json: cannot be read: No such file"),
        (["export", "half.json", "--to", "c"], "half.json: not a whole json table"),
        (["export", "lambda.json", "--to", "c", "--metric", "q"], "metric: got 'q' with a table"),
        (["export", "closed-form", "--to", "c", "--metric", "z"], "metric: got 'z', expected p, q, pxq"),
        (["export", "lambda.json", "--to", "c", "--prefix", "1x"], "prefix: got '1x'"),
        (["export", "lambda.json", "--to", "c", "--directory", "lambda.json"], "lambda.json: cannot be made"),
        (["export", "lambda.json", "--to", "c", "--directory", "mine"], "lambda.h: got a file that warpopt did not"),
        (["export", "lambda.json", "--to", "c", "--x", "1"], "unknown argument(s): --x 1"),
        (["table", TABLE, "--output.file", "table.xls"], "output.file: got 'table.xls', expected an ending of .npz"),
        (["table", TABLE, "--output.file", "mine"], "output.file"),
        (["table", TABLE, "--view.far", "0.5"], "view.far: got 0.5, expected more than near = 1.0"),
        (["table", TABLE, "--objective.max_regret", "0"], "objective.max_regret: got 0"),
        (["table", TABLE, "--light.theta_deg.stop", "91"], "light.theta_deg.stop: got 91"),
        (["table", TABLE, "--light.theta_deg.start", "50", "--light.theta_deg.stop", "40"], "more than start = 50"),
        (["table", TABLE, "--view.far_over_near", "{start = 2.0, stop = 9.0}"], "one of far and far_"),
        (["table", FAR_NEAR, "--view.far_over_near.start", "0.5"], "start: got 0.5, expected more than 1"),
        (["table", FAR_NEAR, "--objective.max_slope", "-1"], "objective.max_slope: got -1"),
        (["table", TABLE, "--view.colour", "1"], "view.colour: unknown key"),
        (["table", "none.toml"], "none.toml: cannot be read"),
    ],
)  # fmt: skip
def test_bad_input_exits_with_two_and_a_few_lines(folder, capsys, arguments, words):
    Path("half.json").write_bytes(Path("lambda.json").read_bytes()[:100])
    Path("mine").mkdir()
    Path("mine/lambda.h").write_text("// years of work\n")
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert invoke(*arguments) == 2
    message = capsys.readouterr().err
    assert words in message
    assert "Traceback" not in message
    assert len(message.splitlines()) <= 4
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before


def test_a_promise_that_cannot_be_kept_leaves_no_file(folder, monkeypatch, capsys):
    def refuse(*_, **__):
        raise RuntimeError("build_table: got a regret of 1e-14")

    monkeypatch.setattr(table_command.warpopt, "build_table", refuse, raising=False)
    assert invoke("table", TABLE, "--output.file", "t.json") == 1
    assert "objective.max_regret: build_table: got a regret" in capsys.readouterr().err
    assert not Path("t.json").exists()


def test_all_files_or_none(folder, monkeypatch, capsys):
    """The third move fails: what was there before is there again, and nothing else."""
    assert invoke("export", "lambda.json", "--to", "c", "--prefix", "old", "--directory", "out") == 0
    before = Path("out/lambda.h").read_bytes()
    moves = []
    replace = output.Path.replace

    def failing(self, target):
        moves.append(target)
        if len(moves) == 3:
            raise OSError("disk full")
        return replace(self, target)

    monkeypatch.setattr(output.Path, "replace", failing)
    assert invoke("export", "lambda.json", "--to", ALL, "--directory", "out") == 1
    assert "disk full" in capsys.readouterr().err
    assert os.listdir("out") == ["lambda.h"]
    assert Path("out/lambda.h").read_bytes() == before


def test_the_schema_of_a_table_names_every_section(capsys):
    with pytest.raises(SystemExit):
        cli.main(["schema", "--of", "table"])
    assert set(json.loads(capsys.readouterr().out)["properties"]) == {"view", "light", "objective", "output"}

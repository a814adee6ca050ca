"""Several devices, several processes: the same bits as on one device, and nothing lost when a process dies.

The processes are real ones of the command line, on loopback. Oracle: the table of one process with one device.
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from warpopt.app import cli
from warpopt.app.common.settings import ConfigError, read_config
from warpopt.app.frusta import block_files, solve
from warpopt.app.frusta.problem import Tiling
from warpopt.app.sweep import process_launcher as launcher
from warpopt.app.sweep.settings import RunConfig

CONFIG = """
[view]
near = 1.0
far = [100.0, 1000.0]
half_fov_deg = 30.0
[light]
theta_deg = { start = 0.0, stop = 90.0, count = 6400 }
[objective]
metrics = ["p"]
norms = ["inf"]
[output]
directory = "out"
figures = false
[compute]
block_size = 64
"""
BLOCKS = 200
COMMAND = [sys.executable, "-m", "warpopt.app.cli", "run", "config.toml"]
TABLES = ("table.csv", "table.npz")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.toml").write_text(CONFIG)
    return tmp_path


def environment(**more: str) -> dict[str, str]:
    """The user's own, without what would decide devices or compiler for the command; compiled programs are shared."""
    cache = ("JAX_COMPILATION_CACHE", "JAX_PERSISTENT_CACHE")
    own = {k: v for k, v in os.environ.items() if k.startswith(cache) or not k.startswith(("XLA_", "JAX_"))}
    return {**own, "TF_CPP_MIN_LOG_LEVEL": "3", **more}


def run(folder: Path, *arguments: str, **variables: str) -> str:
    done = subprocess.run(
        [*COMMAND, *arguments], cwd=folder, env=environment(**variables), capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def tables(directory: Path) -> list[bytes]:
    return [(directory / name).read_bytes() for name in TABLES]


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("one")
    (folder / "config.toml").write_text(CONFIG)
    run(folder)
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "out"]
    return tables(folder / "out")


def test_several_devices_give_the_same_bits_as_one(folder, expected):
    run(folder, XLA_FLAGS="--xla_force_host_platform_device_count=3")  # each compiles for itself
    assert tables(folder / "out") == expected


def test_two_processes_resume_after_one_died_to_the_same_bits_as_one(folder, expected):
    """Blocks of both runs are in the table: what two processes kept, and what two others computed after them."""
    process = subprocess.Popen(
        [*COMMAND, "--compute.processes", "2"], cwd=folder, env=environment(), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        begun = {}
        for line in process.stdout:
            if found := re.match(r"process (\d): pid (\d+), 1 of 2 devices, 100 blocks to compute, 0 kept", line):
                begun[found[1]] = int(found[2])
            if "1" in begun:
                break
        victim = begun["1"]
        # the second half of the blocks is process 1's
        while not (done := sorted(folder.glob(".out.*.parts/block-0000001*.npz"))):
            assert process.poll() is None
            time.sleep(0.005)
        os.kill(victim, signal.SIGKILL)
        killed = time.monotonic()
        # Not `communicate`, which does not have the lines that iterating has read ahead.
        more, words = process.stdout.read(), process.stderr.read()
        process.wait(timeout=120)
    finally:
        process.kill()
        process.stdout.close()
        process.stderr.close()
    assert process.returncode == 1
    assert "0" in begun or re.search(r"^process 0: pid \d+, 1 of 2 devices, 100 blocks to compute, 0 kept", more, re.M)
    assert f"process 1 (pid {victim}) was killed by signal 9 (SIGKILL)" in words
    assert "Traceback" not in words
    assert time.monotonic() - killed < 60
    assert not (folder / "out").exists()
    kept = len(list(folder.glob(".out.*.parts/block-*.npz")))
    assert 0 < kept < BLOCKS
    assert f"{kept} of {BLOCKS} blocks are finished and kept; the same command resumes" in words
    done[0].write_bytes(done[0].read_bytes()[:1000])

    told = run(folder, "--compute.processes", "2")
    assert f"{done[0].name}: truncated or not a part; computed again" in told
    counts = np.array(re.findall(r"(\d+) blocks to compute, (\d+) kept", told), int)
    assert counts.sum(0).tolist() == [BLOCKS - kept + 1, kept - 1]
    assert tables(folder / "out") == expected
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "out"]


def _invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["run", "config.toml", *arguments])
    return exit_.value.code


def _edited(path: Path, **changes) -> None:
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(path, **{name: changes.get(name, array) for name, array in arrays.items()})


def test_truncated_edited_and_foreign_parts_are_computed_again(folder, monkeypatch, capsys):
    """In this process, with blocks kept on disk; the finished run's are saved from deletion to be spoilt."""
    small = ("--light.theta_deg.count", "300", "--compute.keep-blocks", "true")
    with monkeypatch.context() as patch:
        patch.setattr(block_files.BlockFiles, "delete", lambda self: None)
        assert _invoke(*small) == 0
    before = tables(folder / "out")
    (kept,) = folder.glob(".out.*.parts")
    files = sorted(kept.glob("block-*.npz"))
    assert len(files) == 10
    files[0].write_bytes(files[0].read_bytes()[:-200])
    with np.load(files[1]) as file:
        eta = file["eta"].copy()
    eta[0, 0, 3] = np.nextafter(eta[0, 0, 3], 0)
    _edited(files[1], eta=eta)
    _edited(files[2], identity=np.array("another"))
    files[3].write_bytes(files[4].read_bytes())
    _edited(files[5], eta=eta[..., :-1])
    files[6].unlink()
    (kept / "block-999999999.npz").write_bytes(b"foreign")
    written = []
    original = block_files.BlockFiles.write
    monkeypatch.setattr(block_files.BlockFiles, "write", lambda self, b, a: (written.append(b), original(self, b, a)))
    capsys.readouterr()
    assert _invoke(*small) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert written == [0, 1, 2, 3, 5, 6]
    for words in (
        "block-000000000.npz: truncated or not a part; computed again",
        "block-000000001.npz: its numbers are not those that were written; computed again",
        "block-000000002.npz: a part of another job; computed again",
        "block-000000003.npz: got block 4, expected 3; computed again",
        "block-000000005.npz: eta: got shape (1, 1, 63), expected (1, 1, 64); computed again",
    ):
        assert words in told
    assert tables(folder / "out") == before
    assert not kept.exists()


def test_a_merge_refuses_a_missing_block(folder):
    problem = read_config(folder / "config.toml", [], RunConfig).problem()
    store = block_files.BlockFiles(folder / "parts", problem, "cpu", {}, print)
    with pytest.raises(solve.Incomplete, match="200 of 200 blocks are missing, the first is 0"):
        solve.sweep_of(problem, store, all_there=True)


def test_another_problem_block_size_or_compiler_has_another_folder(folder, monkeypatch):
    def name(*overrides: str) -> Path:
        return block_files.folder_of(
            Path("out"), read_config(folder / "config.toml", list(overrides), RunConfig).problem()
        )

    monkeypatch.delenv("XLA_FLAGS", raising=False)
    first = name()
    assert name("--compute.processes", "3", "--compute.timeout-s", "9", "--output.directory", "b") == first
    others = [name("--view.near", "2"), name("--compute.block-size", "128"), name("--objective.norms", "l2")]
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=8")
    assert name() == first
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=1")
    others.append(name())
    assert len({first, *others}) == 5


@pytest.mark.parametrize(("views", "directions", "size"), [(1, 1, 64), (5, 91, 32768), (7, 100, 256), (3, 1000, 128)])
def test_tiles_cover_the_rectangle_once_and_have_one_shape(views, directions, size):
    tiling = Tiling.of(views, directions, size)
    seen = np.zeros((views, directions), int)
    for block in range(tiling.count):
        seen[tiling.extent(block)] += 1
        rows, columns = tiling.padded(block)
        assert (len(rows), len(columns)) == tiling.tile
        inner = seen[tiling.extent(block)].shape
        assert rows[: inner[0]].tolist() == list(range(views))[tiling.extent(block)[0]]
        assert columns[: inner[1]].tolist() == list(range(directions))[tiling.extent(block)[1]]
    assert (seen == 1).all()
    assert tiling.tile[0] * tiling.tile[1] <= size
    assert tiling.tile[1] % 64 == 0


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["--compute.processes", "0"], "compute.processes: got 0"),
        (["--compute.processes", "two"], "compute.processes: got 'two'"),
        (["--compute.devices-per-process", "0"], "compute.devices_per_process: got 0"),
        (["--compute.block-size", "100"], "compute.block_size: got 100"),
        (["--compute.timeout-s", "0"], "compute.timeout_s: got 0"),
        (["--compute.coordinator", "nowhere"], "compute.coordinator: got 'nowhere'"),
        (["--compute.process-id", "0"], "compute.process_id: got 0, expected compute.coordinator"),
        (
            ["--compute.processes", "2", "--compute.coordinator", "h:1", "--compute.process-id", "2"],
            "compute.process_id: got 2, expected less than compute.processes = 2",
        ),
        (["--compute.gpus", "2"], "compute.gpus: unknown key"),
    ],
)
def test_bad_values_are_refused_by_their_paths(folder, overrides, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        read_config(folder / "config.toml", overrides, RunConfig)


def test_the_section_is_optional(folder):
    (folder / "config.toml").write_text(CONFIG.split("[compute]")[0])
    config = read_config(folder / "config.toml", [], RunConfig)
    assert isinstance(config, RunConfig)
    assert config.compute.processes == 1


LIVES = """
import pathlib, sys, time
for _ in range(600):
    pathlib.Path(sys.argv[1]).touch()
    time.sleep(0.1)
"""


def _command(code: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", code, *arguments]


def test_an_exit_code_is_named_with_the_last_words_and_the_others_are_ended(tmp_path):
    lives = _command(LIVES, str(launcher.alive_path(tmp_path, 0)))
    dies = _command("import sys; print('no room left', file=sys.stderr); sys.exit(3)")
    start = time.monotonic()
    with pytest.raises(
        launcher.ProcessDied, match=r"^process 1 \(pid \d+\) ended with exit code 3; .*\n +no room left$"
    ):
        launcher.launch([lives, dies], tmp_path, 50.0, print)
    assert time.monotonic() - start < 30


def test_a_silent_process_is_named_after_the_timeout(tmp_path):
    lives = _command(LIVES, str(launcher.alive_path(tmp_path, 0)))
    with pytest.raises(launcher.ProcessDied, match=r"^process 1 \(pid \d+\) gave no sign of life for 3 s$"):
        launcher.launch([lives, _command("import time; time.sleep(60)")], tmp_path, 3.0, print)


def test_an_interrupt_ends_the_processes(tmp_path, request):
    path = launcher.alive_path(tmp_path, 0)
    # A shell starts background jobs with SIGINT ignored, and this test with them.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    timer = threading.Timer(1.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        launcher.launch([_command(LIVES, str(path))], tmp_path, 50.0, print)
    touched = path.stat().st_mtime
    time.sleep(0.5)
    assert path.stat().st_mtime == touched

"""Starts the processes of a run on this machine and watches them. Does not import JAX."""

import collections
import contextlib
import dataclasses
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from ..common.command import Failed
from ..frusta.block_files import count_of, folder_of
from .settings import RunConfig

LAUNCHER_VARIABLE = "WARPOPT_LAUNCHER"  # the launcher's process id; children end when it ends
_POLL_S = 0.1
_GRACE_S = 5.0  # between asking a process to end and killing it
_TAIL_LINES = 12


class ProcessDied(Failed):
    """A process ended or stopped responding before its share was finished; the message says how."""


def alive_path(folder: Path, process: int) -> Path:
    """A file whose modification time shows that a process is running."""
    return folder / f"process-{process}.alive"


def free_address() -> str:
    """A loopback address whose port is currently free."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{listener.getsockname()[1]}"


def worker_command(arguments: list[str], process: int, coordinator: str) -> list[str]:
    """The same command line, with options that make it one of the processes."""
    identity = ["--compute.process-id", str(process), "--compute.coordinator", coordinator]
    return [sys.executable, "-m", "warpopt.app.cli", "run", *arguments, *identity]


@dataclasses.dataclass(eq=False)
class _Child:
    number: int
    process: subprocess.Popen
    alive: Path
    tail: collections.deque
    threads: list[threading.Thread]
    last_touch: float = 0.0
    last_seen: float = dataclasses.field(default_factory=time.monotonic)

    def silent_for(self) -> float:
        """Seconds since the process last touched its file, by this process's clock."""
        try:
            touch = self.alive.stat().st_mtime
        except OSError:
            touch = 0.0
        now = time.monotonic()
        if touch != self.last_touch:
            self.last_touch, self.last_seen = touch, now
        return now - self.last_seen

    def flaw(self, timeout_s: float) -> str | None:
        code = self.process.poll()
        if code == 0 or (code is None and self.silent_for() <= timeout_s):
            return None
        if code is None:
            what = f"gave no sign of life for {timeout_s:g} s"
        elif code < 0:
            what = f"was killed by signal {-code} ({signal.Signals(-code).name})"
        else:
            what = f"ended with exit code {code}"
        if code is not None:  # its last output may still be in the pipe
            for thread in self.threads:
                thread.join(1.0)
        words = "".join(f"\n    {line}" for line in self.tail)
        return f"process {self.number} (pid {self.process.pid}) {what}" + (
            f"; its last output:{words}" if words else ""
        )


def compute_in_processes(config: RunConfig, arguments: list[str], say: Callable[[str], None]) -> None:
    """Compute every block in the requested number of processes, all with the same command line.

    Raises:
        ProcessDied: as `launch`, with the number of kept blocks.
    """
    compute, problem = config.compute, config.problem()
    address = compute.coordinator or free_address()
    commands = [worker_command(arguments, process, address) for process in range(compute.processes)]
    folder = folder_of(config.output.directory, problem)
    try:
        launch(commands, folder, compute.timeout_s, say)
    except ProcessDied as death:
        kept = f"{count_of(folder)} of {problem.tiling.count} blocks are finished and kept"
        raise ProcessDied(f"{death}\n{kept}; the same command resumes") from None


def launch(commands: list[list[str]], folder: Path, timeout_s: float, say: Callable[[str], None]) -> None:
    """Run the commands in parallel until all have succeeded.

    Raises:
        ProcessDied: one failed, or was silent for `timeout_s`; the others are stopped first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _children(commands, folder, say) as children:
        while any(child.process.poll() is None for child in children):
            _check(children, timeout_s)
            time.sleep(_POLL_S)
        _check(children, timeout_s)
        for child in children:
            for thread in child.threads:
                thread.join()


def _check(children: list[_Child], timeout_s: float) -> None:
    flaws = [flaw for child in children if (flaw := child.flaw(timeout_s))]
    if flaws:
        raise ProcessDied("\n".join(flaws))


@contextlib.contextmanager
def _children(commands: list[list[str]], folder: Path, say: Callable[[str], None]) -> Iterator[list[_Child]]:
    """The processes; none of them outlives the block."""
    children: list[_Child] = []
    environment = {**os.environ, LAUNCHER_VARIABLE: str(os.getpid())}
    try:
        for number, command in enumerate(commands):
            alive_path(folder, number).unlink(missing_ok=True)
            # A new session: the launcher forwards interrupts from the terminal.
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment,
                start_new_session=True, encoding="utf-8", errors="replace",
            )  # fmt: skip
            tail: collections.deque = collections.deque(maxlen=_TAIL_LINES)
            assert process.stdout is not None  # both are pipes
            assert process.stderr is not None
            threads = [_reader(process.stdout, say), _reader(process.stderr, tail.append)]
            children.append(_Child(number, process, alive_path(folder, number), tail, threads))
        yield children
    finally:
        running = [child.process for child in children if child.process.poll() is None]
        for process in running:
            process.terminate()
        deadline = time.monotonic() + _GRACE_S
        for process in running:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _reader(stream: IO[str], heard: Callable[[str], object]) -> threading.Thread:
    def read() -> None:
        with stream:
            for line in stream:
                heard(line.rstrip())

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    return thread

"""JAX settings of the command line, set before JAX is first imported."""

import hashlib
import importlib.metadata
import os
import platform
import warnings
from pathlib import Path

import platformdirs

CACHE_VARIABLE = "WARPOPT_CACHE"
"""The environment variable for the folder of compiled programs; 0 disables the cache."""


def prepare_jax(devices: int | None = None) -> None:
    """Double precision; settings that the user made are kept."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")  # of each operation's origin, which nothing reads
    # Tables are small: compilation takes most of the time, and optimisation level 0 halves it.
    wanted = {"xla_backend_optimization_level": "0"}
    # The older of two emitters saves time too, and so does one part for each program: making several costs more than
    # compiling them side by side saves. An unknown flag ends the process, so they are set only if known.
    if importlib.metadata.version("jaxlib") == "0.10.1":
        wanted |= {"xla_cpu_use_fusion_emitters": "false", "xla_cpu_parallel_codegen_split_count": "1"}
    flags = os.environ.get("XLA_FLAGS", "")
    added = (f"--{name}={value}" for name, value in wanted.items() if name not in flags)
    os.environ["XLA_FLAGS"] = " ".join([flags, *added]).strip()
    if devices is not None:
        os.environ["JAX_NUM_CPU_DEVICES"] = str(devices)
    _keep_compiled_programs()


def _keep_compiled_programs() -> None:
    """JAX's compilation cache, in a folder specific to versions, flags and processor.

    A truncated or damaged program fails its checksum and is compiled again.
    """
    wanted = os.environ.get(CACHE_VARIABLE, "")
    if wanted == "0" or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    root = Path(wanted) if wanted else platformdirs.user_cache_path("warpopt", appauthor=False)
    folder = root / f"programs-{_machine()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # no writable folder: no cache
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.01")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    # jaxlib 0.10.1 warns at each cached program that the machine may differ, which the folder name excludes.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache")


def _machine() -> str:
    """A digest of everything that determines a compiled program."""
    versions = [importlib.metadata.version(package) for package in ("warpopt", "jax", "jaxlib")]
    try:
        info = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
        features = [line for line in info if line.startswith(("flags", "Features", "model name"))]
    except OSError:
        features = [platform.processor()]
    told = [*versions, platform.python_version(), platform.machine(), os.environ["XLA_FLAGS"], *features]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]

"""What the command line asks of JAX, set before its first import."""

import hashlib
import importlib.metadata
import os
import platform
import warnings
from pathlib import Path

import platformdirs

CACHE_VARIABLE = "WARPOPT_CACHE"
"""The environment variable that names the folder of compiled programs, or is 0 for none."""


def prepare_jax(devices: int | None = None) -> None:
    """Double precision, on the user's own settings where there are any."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    # Tables are small: compiling is most of the time, and code of level 0 halves it.
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_backend_optimization_level" not in flags:
        flags += " --xla_backend_optimization_level=0"
        # So does the older of two emitters. An unknown flag ends the process, so only where it is known.
        if importlib.metadata.version("jaxlib") == "0.10.1":
            flags += " --xla_cpu_use_fusion_emitters=false"
        os.environ["XLA_FLAGS"] = flags.strip()
    if devices is not None:
        os.environ["JAX_NUM_CPU_DEVICES"] = str(devices)
    _keep_compiled_programs()


def _keep_compiled_programs() -> None:
    """JAX's own cache, in a folder that only the same versions, flags and processor share.

    A program that is cut off or damaged fails its checksum and is compiled anew.
    """
    wanted = os.environ.get(CACHE_VARIABLE, "")
    if wanted == "0" or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    root = Path(wanted) if wanted else platformdirs.user_cache_path("warpopt", appauthor=False)
    folder = root / f"programs-{_machine()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # no place for it: compile
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.01")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    # jaxlib 0.10.1 says at each program that it reads that this may be another machine, which the folder rules out.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache")


def _machine() -> str:
    """A digest of all that decides what a compiled program is."""
    versions = [importlib.metadata.version(package) for package in ("warpopt", "jax", "jaxlib")]
    try:
        info = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
        features = [line for line in info if line.startswith(("flags", "Features", "model name"))]
    except OSError:
        features = [platform.processor()]
    told = [*versions, platform.python_version(), platform.machine(), os.environ["XLA_FLAGS"], *features]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]

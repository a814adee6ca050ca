"""What the command line asks of JAX, set before its first import."""

import importlib.metadata
import os


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

"""The tests run in float64; the library itself never decides that.

Compiling is most of their time: they take the command line's settings for it, and what one process has compiled, the
others read, commands and experiments that tests start included. Experiments run the optimised code.
"""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # workers have their parent's
    _cache = tempfile.mkdtemp(prefix="warpopt-tests-")
    atexit.register(shutil.rmtree, _cache, ignore_errors=True)
    os.environ |= {
        "JAX_COMPILATION_CACHE_DIR": _cache,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }

if os.environ.get("WARPOPT_CHECK_TYPES"):
    # Every call's shapes and types, against the signatures. The application's settings check themselves.
    from jaxtyping import install_import_hook

    _parts = [path for path in (Path(__file__).parents[1] / "src/warpopt").iterdir() if path.name != "app"]
    install_import_hook([f"warpopt.{path.stem}" for path in _parts], "type_checker.checked")

from warpopt.app.common.jax_settings import prepare_jax

prepare_jax()

import jax
import pytest

jax.config.update("jax_enable_x64", True)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With -n, whole files to a worker unless --dist says otherwise: what one test compiles, the next one has.

    In their own order, at whose end are the many short ones of src: both workers finish at about the same time.
    """
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log) if config.getoption("dist") == "load" else None


def pytest_collection_modifyitems(config, items):
    """What gives wrong types on purpose would be stopped by the run-time checker before warpopt refuses it."""
    if os.environ.get("WARPOPT_CHECK_TYPES"):
        wrong = [item for item in items if item.get_closest_marker("wrong_types")]
        config.hook.pytest_deselected(items=wrong)
        items[:] = [item for item in items if item not in wrong]

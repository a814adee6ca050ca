"""The tests run in float64; the library itself never decides that.

Compiling is most of their time: they take the command line's settings for it, and what one process has compiled, the
others read, commands and experiments that tests start included. Experiments run the optimised code.
"""

import atexit
import os
import shutil
import tempfile

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # workers have their parent's
    _cache = tempfile.mkdtemp(prefix="warpopt-tests-")
    atexit.register(shutil.rmtree, _cache, ignore_errors=True)
    os.environ |= {
        "JAX_COMPILATION_CACHE_DIR": _cache,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }

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

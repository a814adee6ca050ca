"""The tests run in float64; the library itself never decides that.

Compiling is most of their time: they take the command line's settings for it. Experiments run the optimised code.
"""

from warpopt.app.cli import prepare_jax

prepare_jax()

import jax
import pytest

jax.config.update("jax_enable_x64", True)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With -n, whole files to a worker unless --dist says otherwise: what one test compiles, the next one has."""
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log) if config.getoption("dist") == "load" else None

"""The tests run in float64; the library itself never decides that.

Compiling is most of their time: they take the command line's settings for it. Experiments run the optimised code.
"""

from warpopt.app.cli import prepare_jax

prepare_jax()

import jax

jax.config.update("jax_enable_x64", True)

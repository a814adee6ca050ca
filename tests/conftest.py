"""The tests run in float64; the library itself never decides that.

Compiling is most of their time, and code of level 0 takes half of it; experiments run the fully optimised code.
"""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import jax

jax.config.update("jax_enable_x64", True)

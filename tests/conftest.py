"""The tests run in float64; the library itself never decides that."""

import jax

jax.config.update("jax_enable_x64", True)

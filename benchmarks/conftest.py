"""Configure the benchmarks; run them with `pytest benchmarks -n 0`, because parallel processes disturb each other.

Each benchmark compares qtraj with an alternative on the same task, in one session.
"""

import jax

jax.config.update("jax_enable_x64", True)

"""Benchmarks: run with `pytest benchmarks -n 0`, in one process, because two would disturb each other.

Each benchmark compares qtraj with an alternative, on the same work, in one session.
"""

import jax

jax.config.update("jax_enable_x64", True)

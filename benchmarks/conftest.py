"""Benchmarks: run with `pytest benchmarks -n 0` (in one process, since two would disturb each other).

Each compares with what a user would use instead, on the same work, in one session.
"""

import jax

jax.config.update("jax_enable_x64", True)

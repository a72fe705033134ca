"""Benchmarks: run with `pytest benchmarks`. Each compares with what a user would use instead, in one session."""

import jax

jax.config.update("jax_enable_x64", True)

"""A strict session: float64, no silent broadcasting or promotion, shapes checked at run time, warnings as errors."""

import os

# Most of the time goes into compiling what runs once: leave out LLVM's optimisation, unless told otherwise.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

install_import_hook("qtraj", "beartype.beartype")

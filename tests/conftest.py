"""A strict session: float64, no silent broadcasting or promotion, shapes checked at run time, warnings as errors."""

import os

import jax
from jaxtyping import install_import_hook

# Most of the time goes into compiling what runs once: compile quickly rather than well, unless told otherwise.
QUICKLY = ["--xla_backend_optimization_level=0"]
if jax.__version_info__ < (0, 11):
    QUICKLY.append("--xla_cpu_use_fusion_emitters=false")  # later versions do not know it
os.environ.setdefault("XLA_FLAGS", " ".join(QUICKLY))  # read when the first computation starts

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

install_import_hook("qtraj", "beartype.beartype")

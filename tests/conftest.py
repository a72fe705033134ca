"""A strict session: float64, no silent broadcasting or promotion, shapes checked, warnings as errors."""

import os
import tempfile

import jax
import jaxtyping
import pytest

# Most of the time goes into compiling what runs once: compile quickly rather than well, unless told otherwise.
QUICKLY = ["--xla_backend_optimization_level=0"]
if jax.__version_info__ < (0, 11):
    QUICKLY.append("--xla_cpu_use_fusion_emitters=false")  # later versions do not know it
os.environ.setdefault("XLA_FLAGS", " ".join(QUICKLY))  # read when the first computation starts

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

# The same programs are compiled in many tests: what one process has compiled in this run, the others read.
if "PYTEST_XDIST_WORKER" not in os.environ:
    compiled = tempfile.TemporaryDirectory(prefix="qtraj-tests-")
    os.environ["QTRAJ_TESTS_COMPILED"] = compiled.name
jax.config.update("jax_compilation_cache_dir", os.environ["QTRAJ_TESTS_COMPILED"])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)

jaxtyping.install_import_hook("qtraj", "beartype.beartype")


@pytest.fixture(scope="module")
def as_a_user_runs_it():
    """Without the checks of shapes, under which the tests of the library itself run: here they cost a quarter."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)

"""A strict test session: float64, no silent broadcasting or promotion, warnings as errors; shape checks on request."""

import ctypes
import gc
import hashlib
import os
import platform
import shutil
import sys
import tempfile
import time
from pathlib import Path

import jax
import jaxtyping
import pytest
from benchmarks import bare as bare  # before qtraj, for machines with few packages

from qtraj.foundation.compilation_cache import default_folder, enable_compilation_cache

CHECKS_TYPES = os.environ.get("QTRAJ_TESTS_CHECK_TYPES", "") not in ("", "0")
"""Whether every shape and type is checked at run time, which doubles the tracing time."""

MAX_MAPS, MAX_MEMORY, MAX_MEMORY_WITHIN = 40_000, 1.8e9, 2.2e9
"""Numbers of memory maps and bytes of a test process above which compiled code is dropped; the kernel's limit is 65 530
maps, and each compiled function has a few. Within a module, which may compile its functions again, more is allowed. No
process may need more than 3 GB; dropped code is traced again by the next modules."""

if "PYTEST_XDIST_WORKER" in os.environ:
    gc.disable()  # until all test modules are imported: there is nothing to collect

UNUSED = 14 * 24 * 3600
"""[s] Compiled code of other versions or flags is deleted after this time without a run."""

# Most of the time is spent on compiling code that runs once: by default, compile quickly rather than well.
QUICKLY = ["--xla_backend_optimization_level=0"]
if jax.__version_info__ < (0, 11):  # XLA ends the process at a flag that it does not know, as later versions might
    QUICKLY += ["--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1"]
os.environ.setdefault("XLA_FLAGS", " ".join(QUICKLY))  # read when the first computation starts

# As many processes as cores: threads of a process would only wait for each other, and waiting threads of OpenBLAS spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers, which import NumPy after this

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


def processor() -> str:
    """The model and the features of the processor, on which compiled code may depend."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


# Many tests and all runs compile the same functions: one process compiles, the others and later runs load the code.
key = "\n".join([jax.__version__, jax.lib.__version__, os.environ["XLA_FLAGS"], platform.machine(), processor()])
try:
    cache = default_folder().parent / "tests"
except ModuleNotFoundError:  # platformdirs
    cache = Path(tempfile.gettempdir()) / "qtraj-tests"
of_this_jax = cache / f"jax-{jax.__version__}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"
enable_compilation_cache(of_this_jax)

CACHED = {
    "JAX_COMPILATION_CACHE_DIR": str(of_this_jax),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
"""Variables of the environment with which a process of a test loads compiled code, too."""

if "PYTEST_XDIST_WORKER" not in os.environ:
    os.utime(of_this_jax)
    for folder in of_this_jax.parent.iterdir():
        if folder.stat().st_mtime < time.time() - UNUSED:
            shutil.rmtree(folder, ignore_errors=True)

if CHECKS_TYPES:
    jaxtyping.install_import_hook("qtraj", "beartype.beartype")


def pytest_collection_finish():
    """Exclude the modules and the tests, a million objects, from all garbage collections."""
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)
    gc.enable()


def resident() -> int:
    """The memory of this process [bytes], or 0 where the system does not say."""
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if file.exists() else 0


def drop_compiled_code() -> None:
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux" and platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).malloc_trim(0)  # otherwise the process keeps the memory


@pytest.fixture(scope="module", autouse=True)
def little_memory():
    """Drop compiled code of earlier modules before a process becomes too large."""
    yield
    maps = Path("/proc/self/maps")
    if resident() > MAX_MEMORY or (maps.exists() and maps.read_bytes().count(b"\n") > MAX_MAPS):
        drop_compiled_code()


@pytest.fixture(autouse=True)
def little_memory_within(little_memory):
    """Drop compiled code of earlier tests of a module before a process becomes too large."""
    yield
    if resident() > MAX_MEMORY_WITHIN:
        drop_compiled_code()


@pytest.fixture
def compiled():
    """The compilations since the start of the test."""
    events = []

    def listen(name, *_, **__):
        if name.endswith("backend_compile_duration"):
            events.append(name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield events
    jax.monitoring.unregister_event_duration_listener(listen)


@pytest.fixture(scope="session")
def cached_code():
    """The environment of a process that loads the code that earlier runs compiled."""
    return os.environ | CACHED


@pytest.fixture(scope="module")
def as_a_user_runs_it():
    """Switch off the shape checks, if the session has them."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


DRAWN: dict[str, bytes] = {}
"""The pictures that commands have drawn in this process, by the name of the file."""


@pytest.fixture(scope="module")
def each_picture_is_drawn_once():
    """Draw the first picture of each name, and copy it afterwards: drawing takes longer than most commands compute.

    The figure itself, its axes and curves, is still made by each command; tests/viz draws many. The value is the
    function that draws.
    """
    from qtraj.viz import figures, style

    draw = figures.save

    def save(figure, file):
        name = os.path.basename(file)
        if name not in DRAWN:
            draw(figure, file)
            DRAWN[name] = Path(file).read_bytes()
        else:
            Path(file).write_bytes(DRAWN[name])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "save", save)
        yield draw

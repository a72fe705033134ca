"""Input becomes arrays without a program of JAX, and without a hold on the caller's memory."""

import jax
import numpy as np
import pytest

from qtraj.foundation.arrays import as_array, as_float, part

SIZE = 1009  # of no other array in the tests, so that nothing of this shape has been compiled before


@pytest.fixture
def compiled():
    """The compilations since the test began."""
    events = []

    def listen(name, *_, **__):
        if name.endswith("backend_compile_duration"):
            events.append(name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield events
    jax.monitoring.unregister_event_duration_listener(listen)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64, np.bool_])
def test_known_input_compiles_nothing(compiled, dtype):
    x = np.ones(SIZE, dtype)
    assert as_float(x).dtype == (dtype if np.issubdtype(dtype, np.floating) else np.float64)
    assert as_float(x.tolist()).shape == as_array(x, np.int32).shape == (SIZE,)
    np.testing.assert_array_equal(part(as_float(x), slice(3, 7)), np.ones(4))
    assert not compiled


def test_what_the_caller_writes_later_is_not_seen():
    room = np.zeros(SIZE + 8)
    x = room[-room.ctypes.data % 64 // 8 :][:SIZE]  # aligned as JAX would like to keep it
    kept = as_float(x)
    x[:] = 1.0
    assert not np.any(kept)


def test_a_part_can_be_traced():
    rows = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(jax.vmap(lambda row: part(row, slice(1, 3)))(rows), rows[:, 1:3])
    np.testing.assert_array_equal(jax.grad(lambda row: part(row, 2))(rows[0]), [0, 0, 1, 0])

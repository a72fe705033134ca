"""Blocks of a batch: the results are in the order of the elements, for any batch size and number of threads."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation import cores

SIZE = 4


@pytest.mark.parametrize("elements", [1, 3, 4, 5, 23])
def test_results_are_in_the_order_of_the_elements(elements):
    batch = {"a": np.arange(elements, dtype=float), "b": np.arange(2 * elements).reshape(elements, 2)}
    parts = cores.split(np.arange(elements)[::-1], SIZE)
    calls = [(cores.take(batch, part, SIZE),) for part in parts]
    assert all(call[0]["b"].shape == (SIZE, 2) for call in calls), "all blocks have one size"
    blocks = cores.map_blocks(jax.jit(lambda x: (x["a"] ** 2, x["b"] + 1)), calls)
    found = [[x[: part.size] for x in block] for part, block in zip(parts, blocks, strict=True)]
    squares, more = (np.concatenate(x) for x in zip(*found, strict=True))
    np.testing.assert_array_equal(squares, batch["a"][::-1] ** 2)
    np.testing.assert_array_equal(more, batch["b"][::-1] + 1)


def test_a_new_call_is_compiled_by_one_thread_and_the_rest_run_in_several(monkeypatch):
    monkeypatch.setattr(cores, "CORES", 2)
    meet, threads, traced = threading.Barrier(2, timeout=60), [], []

    @jax.jit
    def double(x):
        traced.append(x)
        return 2 * x

    def call(x):
        threads.append(threading.current_thread())
        if len(threads) > 1:
            meet.wait()  # needs two threads at the same time
        return double(x)

    result = list(cores.map_blocks(call, [(np.full(3, k),) for k in range(5)]))
    np.testing.assert_array_equal(result, [[2 * k] * 3 for k in range(5)])
    assert len(traced) == 1
    assert threads[0] is threading.current_thread()
    assert len(set(threads[1:])) == 2


def test_threads_have_the_precision_of_the_caller():
    calls = [(np.ones(2),)] * 3
    for x64, dtype in ((True, np.float64), (False, np.float32)):
        with jax.enable_x64(x64):
            assert [x.dtype for x in cores.map_blocks(lambda x: jnp.asarray(x) / 3, calls)] == [dtype] * 3


def test_every_block_runs_on_the_device_of_the_caller():
    here, there = jax.devices()[0], jax.devices()[-1]
    calls = [(np.full(2, k),) for k in range(4)]
    seen = []

    def call(x):
        result = jnp.asarray(x)
        seen.append(result.devices())
        return result

    list(cores.map_blocks(call, calls, there))
    with jax.default_device(here):
        list(cores.map_blocks(call, calls))
    assert seen == [{there}] * 4 + [{here}] * 4
    assert list(cores.map_blocks(call, [])) == []


def test_an_error_of_a_block_is_raised():
    def call(x):
        if x[0] == 2:
            raise ValueError("block 2 is bad")
        return x

    with pytest.raises(ValueError, match="block 2 is bad"):
        list(cores.map_blocks(call, [(np.full(1, k),) for k in range(4)]))


def test_an_accelerator_computes_a_batch_in_one_block(monkeypatch):
    assert [cores.block_size(n) for n in (1, 8, 10**6)] == [8, 8, 64]
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert [cores.block_size(n) for n in (1, 8, 1000, 1025)] == [1, 8, 1024, 2048]
    with jax.default_device(jax.devices("cpu")[0]):
        assert cores.block_size(10**6) == 64

"""Every public function, class and method: all kinds and shapes of arguments, in jit, vmap and grad."""

import inspect
import subprocess
import sys
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.contracts.every_call import CALLS, COMPILED, HEAVY, MEMBERS, OTHERS, STORED, UNTRACED

import qtraj as qt

ELSEWHERE = (qt.quaternion, qt.rotation, qt.dual_quaternion, qt.matrices)
"""Modules that `tests/algebra/test_every_function.py` enumerates."""

EXACT, SMOOTH, STEP = 1e-12, 1e-4, 1e-6
"""Relative differences between equal values, and of derivatives to central differences with a relative step."""


def methods(cls):
    """The public methods of a class by their qualified names, with the class that defines them."""
    for name in dir(cls):
        if name.startswith("_") and name != "__call__":
            continue
        value = inspect.getattr_static(cls, name)
        if isinstance(value, property) or not callable(getattr(cls, name)):
            continue
        function = inspect.unwrap(getattr(cls, name))
        if inspect.isfunction(getattr(function, "__func__", function)) and function.__module__.startswith("qtraj"):
            yield function.__qualname__


def public():
    """The names of all public functions, classes and methods."""
    for name in qt.__all__:
        value = getattr(qt, name)
        if isinstance(value, types.ModuleType):
            own = getattr(value, "__all__", None) or [k for k in vars(value) if not k.startswith("_")]
            things = {f"{name}.{k}": getattr(value, k) for k in own if value not in ELSEWHERE}
        else:
            things = {name: value}
        for key, thing in things.items():
            if not callable(thing) or not thing.__module__.startswith("qtraj"):
                continue
            yield key.removeprefix("control.") if hasattr(qt, key.removeprefix("control.")) else key
            if inspect.isclass(thing):
                yield from methods(thing)


NAMES = {name for name in public() if name.rpartition(".")[2] not in MEMBERS}


def leaves(result):
    return [np.asarray(x, float) for x in jax.tree.leaves(result)]


def close(results, expected, atol):
    for a, b in zip(leaves(results), leaves(expected), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=0, atol=atol * (1 + np.abs(b).max(initial=0.0)))


def test_every_public_name_has_a_row_or_a_reason():
    rows = {*CALLS, *OTHERS}
    assert not NAMES - rows, "add rows to CALLS, or reasons to OTHERS, in tests/contracts/every_call.py"
    assert not rows - NAMES, "these names are gone"
    assert not {*CALLS} & {*OTHERS}
    assert {*UNTRACED, *HEAVY, *COMPILED, *STORED} <= {*CALLS}


@pytest.mark.parametrize("name", CALLS)
class TestKindsAndShapes:
    def test_lists_integers_and_floats_are_the_same(self, name):
        call, *whole = CALLS[name]
        right = call(*(np.asarray(x, float) for x in whole))
        assert all(np.isfinite(x).all() for x in leaves(right))
        kinds = [lambda x: x, np.asarray, lambda x: np.asarray(x, float).tolist()]
        for convert in [*kinds, jnp.asarray, lambda x: jnp.asarray(x, float)]:
            close(call(*map(convert, whole)), right, EXACT)

    @pytest.mark.parametrize("shape", [(5,), (2, 3)])
    def test_leading_axes_are_a_batch_or_refused(self, name, shape):
        call, *whole = CALLS[name]
        arguments = drawn(whole, shape)
        try:
            results = leaves(call(*arguments))
        except ValueError as error:
            message = str(error)
            assert "given" in message or "shape" in message
            return
        for at in np.ndindex(*shape):
            close([x[at] for x in results], call(*(x[at] for x in arguments)), EXACT)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in HEAVY)) for name in CALLS if name not in UNTRACED]
)
def test_jit_vmap_and_grad(name):
    """The values are those of NumPy, and the derivatives those of central differences."""
    call, *whole = CALLS[name]
    arguments = drawn(whole, (2,))

    def total(*x):
        result = call(*x)
        return weighted(result, jnp), result

    compiled = jax.jit(jax.vmap(jax.value_and_grad(total, tuple(range(len(whole))), has_aux=True)))
    (_, results), gradients = compiled(*map(jnp.asarray, arguments))
    for k in range(2):
        each, slope = [x[k] for x in arguments], [np.asarray(g[k]) for g in gradients]
        close(jax.tree.map(lambda x, k=k: x[k], results), call(*each), 1e3 * EXACT)
        step = [STEP * (1 + np.abs(x)) for x in each]
        ends = [weighted(call(*(x + sign * dx for x, dx in zip(each, step, strict=True))), np) for sign in (1, -1)]
        expected = sum(np.sum(g * dx) for g, dx in zip(slope, step, strict=True))
        size = sum(np.sum(np.abs(g * dx)) for g, dx in zip(slope, step, strict=True))
        np.testing.assert_allclose((ends[0] - ends[1]) / 2, expected, rtol=0, atol=SMOOTH * size + 1e-13)


WHERE = """
import sys
import jax, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
from tests.contracts.every_call import CALLS, COMPILED, STORED, UNTRACED

first, second = jax.local_devices()
ELSEWHERE = {*UNTRACED, "Vehicle", "Curve"}  # a number, and a result that does not depend on the argument


def moved(x, device):
    return jax.device_put(np.asarray(x, float), device)


def values(tree):
    return [np.asarray(x, float) for x in jax.tree.leaves(tree)]


for name, (call, *whole) in CALLS.items():
    if sys.argv[1] == "numpy" and name in COMPILED:
        continue
    expected, found = (call(*(moved(x, device) for x in whole)) for device in (first, second))
    where = [x.devices() if isinstance(x, jax.Array) else type(x) for x in jax.tree.leaves(found)]
    if name not in ELSEWHERE and any(x != {second} for x in where):
        print(name, "is on", *where)
    if not all(np.array_equal(x, y, equal_nan=True) for x, y in zip(values(found), values(expected), strict=True)):
        print(name, "has other values")
    if len(whole) == 1:
        continue
    try:
        call(moved(whole[0], first), *(moved(x, second) for x in whole[1:]))
    except ValueError as error:
        if "cpu:0 and cpu:1" not in str(error) or "jax.device_put(x, device)" not in str(error):
            print(name, "refuses a mixture without a clear text:", error)
        if name in STORED:
            print(name, "refuses a mixture, so it does not belong to STORED")
    else:
        if name not in STORED:
            print(name, "accepts a mixture")
"""


@pytest.mark.parametrize("rows", ["numpy", pytest.param("all", marks=pytest.mark.slow)])
def test_results_are_on_the_device_of_the_arguments(rows, cached_code):
    """The values are those of the first device, and arguments on two devices are refused."""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", WHERE, rows]
    process = subprocess.run(command, cwd=root, env=cached_code, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout == ""


def drawn(whole, shape):
    """Arguments near the integers, of a shape with further leading axes."""
    rng = np.random.default_rng(5)
    return [np.asarray(x, float) + rng.uniform(0.01, 0.05, (*shape, *np.shape(x))) for x in whole]


def weighted(result, xp):
    """A sum of all numbers of a result with fixed weights."""
    parts = [xp.ravel(xp.asarray(x)) for x in jax.tree.leaves(result)]
    return sum(xp.sum(x * np.cos(np.arange(x.size) + 1.0)) for x in parts)

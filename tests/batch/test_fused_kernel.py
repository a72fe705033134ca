"""The fused kernel, interpreted on the CPU, gives the values of XLA, and it can be compiled for a GPU."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import Literal

import qtraj as qt
from qtraj.batch.executables import _peaks, _worker
from qtraj.batch.fused_kernel import _parts, _reduced_blocks, peaks, sums, supports, written
from qtraj.batch.instant_formulas import instant_formulas
from qtraj.batch.kernel_choice import VARIABLE, uses_kernel
from qtraj.batch.stacking import stacked
from qtraj.batch.task import Task
from qtraj.path.channel import outputs_with

VEHICLE = qt.Vehicle(1200.0, inertia=np.diag([500.0, 1800.0, 2000.0]), wheelbase=2.7)
ALL = outputs_with(VEHICLE)
FEW = ("velocity", "defined")
TOLERANCES = {"float64": 1e-11, "float32": 2e-4}
EXACT = 1e-14
"""The same operations in the same order, except for sums."""
FRAMES = [qt.Natural(), qt.Upright()]
SLOW = pytest.mark.slow
SAFETY = [jax.export.DisabledSafetyCheck.custom_call("__gpu$xla.gpu.triton")]


def helix(scale=1.0, kind="float64"):
    c = lambda *x: jnp.stack([jnp.asarray(v, kind) for v in x])  # noqa: E731
    return qt.SpiralHelix(c(20.0 * scale, 1.0, 0.3), c(0.2, 0.35, 0.01), c(1.0, 0.4, 0.05), jnp.asarray(4.5, kind))


def many(kind="float64", count=3):
    return jax.vmap(lambda c: helix(c, kind))(jnp.linspace(1.0, 1.2, count, dtype=kind))


def request(names, frame, kind="float64", paths=None, batched=True):
    """Return the arrays of the paths, the function that evaluates them, 150 times, and the formulas."""
    times = jnp.linspace(0.1, 4.4, 150, dtype=kind)[None]
    vehicle = jax.tree.map(lambda x: jnp.asarray(x, kind), VEHICLE)
    task = Task(names, "last", batched, False, None)
    driven, about = stacked(task, (many(kind) if paths is None else paths, frame, vehicle))
    arrays, work = _worker(driven, about, names)
    return arrays, work, times, instant_formulas(work, arrays, times)


def both(monkeypatch, call):
    """Return the results of XLA and of the interpreted kernel."""
    found = []
    for choice in ("off", "interpret"):
        monkeypatch.setenv(VARIABLE, choice)
        found.append(call())
    return found


def agree(found, expected, tolerance=EXACT):
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert x.shape == y.shape
        assert x.dtype == y.dtype
        x, y = np.asarray(x, float), np.asarray(y, float)
        np.testing.assert_allclose(x, y, rtol=0, atol=tolerance * max(1.0, np.abs(y[np.isfinite(y)]).max(initial=0.0)))


@SLOW
@pytest.mark.parametrize("kind", TOLERANCES)
@pytest.mark.parametrize("frame", FRAMES, ids=["natural", "upright"])
def test_all_outputs(kind, frame):
    arrays, work, times, formulas = request(ALL, frame, kind)
    found = jax.jit(lambda a, t: written(formulas, a, t, True))(arrays, times)
    expected = jax.jit(lambda a, t: work(a, (t,)))(arrays, times)
    assert found.keys() == set(ALL)
    for name, x in found.items():
        y = np.stack(expected[name])
        if name == "gibbs":  # near half a turn it magnifies roundings, but not as the vector part of a quaternion
            x, y = (v / np.sqrt(1 + np.sum(np.square(v), axis=0)) for v in (np.asarray(x, float), np.asarray(y, float)))
        atol = TOLERANCES[kind] * max(np.abs(y).max(), 1e-3)
        np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), rtol=0, atol=atol, err_msg=name)


@SLOW
@pytest.mark.parametrize("kind", TOLERANCES)
@pytest.mark.parametrize("frame", FRAMES, ids=["natural", "upright"])
def test_all_outputs_can_be_compiled_for_a_gpu(kind, frame):
    arrays, _, times, formulas = request(ALL, frame, kind)
    exported = jax.export.export(
        jax.jit(lambda a, t: written(formulas, a, t, False)), platforms=("cuda",), disabled_checks=SAFETY
    )(arrays, times)
    assert exported.mlir_module().count("custom_call @__gpu$xla.gpu.triton") == 1


@pytest.mark.parametrize("what", ["written", "peaks", "sums"])
def test_the_kernel_can_be_compiled_for_a_gpu(what):
    arrays, _, times, formulas = request(FEW, qt.Natural())
    calls = {
        "written": lambda a, t: written(formulas, a, t, False),
        "peaks": lambda a, t: peaks(formulas, a, t, "max", False),
        "sums": lambda a, t: sums(formulas, a, t, t[:, [0, -1]], False),
    }
    exported = jax.export.export(jax.jit(calls[what]), platforms=("cuda",), disabled_checks=SAFETY)(arrays, times)
    assert exported.mlir_module().count("custom_call @__gpu$xla.gpu.triton") == 1


@pytest.mark.parametrize(("path", "components"), [(helix(), "first"), (many(), "last")], ids=["one", "many"])
def test_values(monkeypatch, path, components):
    """The last block is not full; a table can be used again."""
    times = jnp.linspace(0.0, 4.5, 700)
    call = lambda old=None: qt.evaluate(path, times, FEW, components=components, reuse=old)  # noqa: E731
    expected, found = both(monkeypatch, call)
    agree(found.values, expected.values)
    agree(call(found).values, expected.values)


@pytest.mark.parametrize(
    "reduce", ["max", pytest.param("min", marks=SLOW), pytest.param("integral", marks=SLOW), "mean"]
)
def test_reductions_over_several_parts(monkeypatch, reduce):
    """A program reduces 64 blocks of 128 instants, so this row has two parts."""
    times = jnp.linspace(0.0, 4.5, 9001)
    expected, found = both(monkeypatch, lambda: qt.evaluate(many(), times, ("velocity",), reduce=reduce))
    agree(found.values, expected.values, 1e-12)
    assert (found.times is None) == (reduce in ("integral", "mean"))
    if found.times is not None:
        agree(found.times, expected.times)


def test_peaks_of_values_that_are_not_numbers_and_of_constants(monkeypatch):
    """The second path is not a number; its rate has no normal component, which is a constant."""
    paths = many(count=2)
    paths = eqx.tree_at(lambda x: x.radius, paths, paths.radius.at[1, 0].set(jnp.nan))
    times = jnp.linspace(0.0, 4.5, 300)
    expected, found = both(monkeypatch, lambda: qt.evaluate(paths, times, ("curvature", "rate"), reduce="max"))
    assert np.isnan(found["curvature"][1])
    agree((found.values, found.times), (expected.values, expected.times))
    np.testing.assert_array_equal(found["rate"][:, 1], 0.0)


@pytest.mark.parametrize(
    ("reduce", "derivative"),
    [
        (None, jax.grad),
        ("mean", jax.jacfwd),
        pytest.param(None, jax.jacfwd, marks=SLOW),
        pytest.param("mean", jax.grad, marks=SLOW),
        pytest.param("max", jax.grad, marks=SLOW),
        pytest.param("max", jax.jacfwd, marks=SLOW),
    ],
)
def test_derivatives_are_those_of_the_plain_formulas(monkeypatch, reduce, derivative):
    times = jnp.linspace(0.0, 4.5, 40)

    def total(scale):
        values = qt.evaluate(helix(scale), times, ("velocity",), reduce=reduce).values
        return sum(jnp.sum(x**2) for x in jax.tree.leaves(values))

    expected, found = both(monkeypatch, lambda: derivative(total)(1.1))
    assert expected != 0
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_vmap_and_one_row_of_times_for_each_path(monkeypatch):
    times = jnp.linspace(0.0, 4.5, 40)
    mapped = lambda: jax.vmap(lambda c: qt.evaluate(helix(c), times, FEW).values)(jnp.linspace(1.0, 1.1, 3))  # noqa: E731
    agree(*reversed(both(monkeypatch, mapped)))
    rows = jnp.stack([times, times[::-1], times / 2])
    agree(*reversed(both(monkeypatch, lambda: qt.evaluate(many(), rows, FEW).values)))


@pytest.mark.parametrize(
    "path",
    [
        qt.Curve(lambda t: jnp.stack([t, jnp.sin(t), t**2]), 4.5),
        qt.Route([0.0, 2.0, 4.5], np.eye(3), np.ones((3, 3)), np.zeros((3, 3))),
    ],
    ids=["curve", "route"],
)
def test_what_is_not_elementwise_is_evaluated_by_xla(monkeypatch, path):
    arrays, _, times, formulas = request(("velocity",), qt.Natural(), paths=path, batched=False)
    assert not supports(formulas, arrays, times)
    expected, found = both(monkeypatch, lambda: qt.evaluate(path, jnp.linspace(0.0, 4.5, 40), ("velocity",)).values)
    agree(found, expected)


def test_numbers_of_instants_have_32_bits():
    arrays, _, _, formulas = request(("velocity",), qt.Natural(), paths=many(count=1))
    times: Any = lambda n: jax.ShapeDtypeStruct((1, n), jnp.float64)  # noqa: E731
    largest = next(n for n in range(2**31, 0, -1) if supports(formulas, arrays, times(n)))
    size, blocks = _reduced_blocks(times(largest))
    assert 2**31 - 2 * size * blocks < largest < 2**31
    assert _parts(times(largest), size, blocks) * blocks * size <= 2**31


def test_no_maximum_of_a_constant_on_accelerators():
    """XLA needs seconds to compute the maximum of a large constant array while it compiles."""
    names = ("rate",)
    task = Task(names, "last", True, False, "max")
    paths, about = stacked(task, (many(), qt.Natural(), None))
    reduced = lambda paths, t: _peaks(task, paths, about, t, "gpu")  # noqa: E731
    times = jnp.linspace(0.0, 4.5, 300)[None]
    jaxpr = jax.make_jaxpr(reduced)(paths, times).jaxpr
    constant = {
        e.outvars[0]
        for e in jaxpr.eqns
        if e.primitive.name == "broadcast_in_dim" and all(isinstance(x, Literal) for x in e.invars)
    }
    operands = [e.invars[0] for e in jaxpr.eqns if e.primitive.name == "reduce_max"]
    assert len(operands) == 4  # two components in a block, and over the blocks
    assert not constant & set(operands)
    agree(jax.jit(reduced)(paths, times), jax.jit(lambda p, t: _peaks(task, p, about, t, "cpu"))(paths, times))


def test_the_kernel_is_chosen_explicitly(monkeypatch):
    assert not uses_kernel("off", "gpu")
    assert uses_kernel("on", "gpu")
    assert not uses_kernel("on", "cpu")
    monkeypatch.setenv(VARIABLE, "yes")
    with pytest.raises(ValueError, match=r"must be 'off', 'on' or 'interpret', but 'yes' was given"):
        qt.evaluate(helix(), jnp.linspace(0.0, 4.5, 4))

"""What runs on an accelerator gives the values of NumPy; on a machine without one, JAX's CPU stands in.

On a machine with an accelerator, with few packages installed:

    XLA_FLAGS= PYTHONPATH=src python -m pytest -o addopts= tests/device
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.channel import CHANNELS

pytestmark = pytest.mark.device

DEVICE, HOST = jax.devices()[0], jax.local_devices(backend="cpu")[0]
VEHICLE = qt.Vehicle(1200.0, inertia=np.diag([500.0, 1800.0, 2000.0]), wheelbase=2.7)
OUTPUTS = tuple(
    name for name, x in CHANNELS.items() if name not in ("tangential_moment", "normal_moment", "binormal_moment")
)
TOLERANCES = {"float64": 1e-10, "float32": 3e-4}


def path(scale=1.0):
    return qt.SpiralHelix([20.0 * scale, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01], [1.0, 0.4, 0.05, -0.01], 4.5)


def moved(tree, kind="float64", device=DEVICE):
    """Return the tree with its arrays on the device."""
    return jax.tree.map(lambda x: jax.device_put(jnp.asarray(x, kind), device) if eqx.is_array(x) else x, tree)


def agree(found, expected, tolerance):
    """Assert that each output is right, relative to its largest value."""
    assert found.keys() == expected.keys()
    for name, value in found.items():
        x, y = np.asarray(value, float), np.asarray(expected[name], float)
        np.testing.assert_allclose(x, y, rtol=0, atol=tolerance * max(np.abs(y).max(), 1e-3), err_msg=name)


def stacked(scales):
    return jax.tree.map(lambda *x: np.stack(x), *[path(c) for c in scales])


@pytest.mark.parametrize("kind", TOLERANCES)
@pytest.mark.parametrize("frame", [qt.Natural(), qt.Upright()], ids=["natural", "upright"])
def test_all_outputs_of_many_paths(kind, frame):
    scales, times = np.linspace(1.0, 1.2, 5), np.linspace(0.1, 4.4, 1000)
    table = qt.evaluate(*moved((stacked(scales), times), kind), OUTPUTS, frame, vehicle=moved(VEHICLE, kind))
    assert all(x.devices() == {DEVICE} and x.dtype in (kind, bool) for x in table.values.values())
    for k in (0, 3):
        expected = qt.evaluate(path(scales[k]), times, OUTPUTS, frame, vehicle=VEHICLE).values
        small = np.abs(expected["gibbs"]).max(axis=1) < 10  # near half a turn, a Gibbs vector amplifies rounding
        found = {name: np.asarray(x[k])[small] for name, x in table.values.items()}
        agree(found, {name: x[small] for name, x in expected.items()}, TOLERANCES[kind])


@pytest.mark.parametrize("components", ["first", "last"])
def test_one_long_path(components):
    times = np.linspace(0.0, 4.5, 70_000)
    found = qt.evaluate(moved(path()), moved(times), components=components)
    expected = qt.evaluate(path(), times[::10], components=components)
    step = (..., slice(None, None, 10)) if components == "first" else slice(None, None, 10)
    agree({name: x[step] for name, x in found.values.items()}, expected.values, 1e-11)


@pytest.mark.parametrize("kind", TOLERANCES)
@pytest.mark.parametrize("reduce", [None, "max"])
def test_the_fused_kernel(monkeypatch, kind, reduce):
    """On a CPU, the kernel is interpreted; a GPU compiles it."""
    monkeypatch.setenv("QTRAJ_EVALUATE_KERNEL", "interpret" if DEVICE.platform == "cpu" else "on")
    times, names = np.linspace(0.0, 4.5, 1000), ("velocity", "speed")
    found = qt.evaluate(moved(stacked([1.0, 1.1, 1.2]), kind), moved(times, kind), names, reduce=reduce)
    expected = qt.evaluate(path(1.1), times, names).values
    if reduce is not None:
        expected = {name: x.max(axis=0) for name, x in expected.items()}
    agree({name: x[1] for name, x in found.values.items()}, expected, TOLERANCES[kind])


@pytest.mark.parametrize(("reduce", "function"), [("max", np.max), ("min", np.min), ("mean", np.trapezoid)])
def test_reductions(reduce, function):
    times, names = np.linspace(0.0, 4.5, 5001), ("position", "curvature", "rate")
    found = qt.evaluate(moved(path()), moved(times), names, reduce=reduce)
    table = qt.evaluate(path(), times, names)
    unit = {"dx": 1 / (times.size - 1)} if reduce == "mean" else {}
    expected = {name: function(np.asarray(x), axis=0, **unit) for name, x in table.values.items()}
    agree(dict(found.values), expected, 1e-11)
    assert all(x.devices() == {DEVICE} for x in found.values.values())


def test_gradients():
    times = np.linspace(0.1, 4.4, 300)

    def loss(radius, height, times):
        table = qt.evaluate(qt.SpiralHelix(radius, [0.2, 0.35], height, 4.5), times, ("curvature", "rate"))
        return jnp.mean(jnp.asarray(table.curvature) ** 2) + jnp.mean(jnp.asarray(table.rate) ** 2)

    numbers = np.array([20.0, 1.0, 0.3]), np.array([1.0, 0.4, 0.05])
    found = jax.jit(jax.grad(loss, (0, 1)))(*moved((*numbers, times)))
    forward = jax.jit(jax.jacfwd(loss, (0, 1)))(*moved((*numbers, times)))
    assert all(x.devices() == {DEVICE} for x in found)
    for k in (0, 1):
        slopes = []
        for h in 1e-5 * np.eye(3):
            more, less = ([x + sign * h * (i == k) for i, x in enumerate(numbers)] for sign in (1, -1))
            slopes.append((loss(*more, times) - loss(*less, times)) / 2e-5)
        np.testing.assert_allclose(found[k], slopes, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(forward[k], slopes, rtol=1e-6, atol=1e-9)


def test_trihedra_and_programs():
    times, program = np.linspace(0.1, 4.4, 40), qt.FrameProgram(path())
    found = jax.jit(jax.vmap(qt.trihedral, (None, 0)))(*moved((path(), times)))
    attitudes = jax.jit(jax.vmap(lambda p, t: qt.FrameProgram(p)(t), (None, 0)))(*moved((path(), times)))
    for k in (0, 17, 39):
        expected, attitude = qt.trihedral(path(), times[k]), program(times[k])
        np.testing.assert_allclose(found.dcm()[k], expected.dcm(), atol=1e-12)
        np.testing.assert_allclose(found.torsion[k], expected.torsion, rtol=1e-10)
        for x, y in zip(jax.tree.leaves(attitudes), jax.tree.leaves(attitude), strict=True):
            np.testing.assert_allclose(x[k], y, atol=1e-11)


def test_rotations():
    q = np.random.default_rng(1).normal(size=(64, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    there = moved(q)
    for name in ("to_dcm", "to_gibbs", "to_mrp", "to_rotation_vector"):
        call = getattr(qt.rotation, name)
        np.testing.assert_allclose(call(there), call(q), rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(qt.quaternion.product(there, there), qt.quaternion.product(q, q), atol=1e-14)
    assert qt.quaternion.product(there, there).devices() == {DEVICE}


def test_propagation():
    times, sizes = np.linspace(0.0, 5.0, 6), np.linspace(0.5, 1.5, 7)
    start = np.array([1.0, 0.0, 0.0, 0.0])
    rate = lambda c: lambda t: c * jnp.stack([0 * t, 0 * t, 1 + jnp.sin(t)])  # noqa: E731
    run = jax.jit(jax.vmap(lambda c, start, times: qt.propagate(rate(c), start, times), (0, None, None)))
    found = run(*moved((sizes, start, times)))
    angle = sizes[:, None] * (times + 1 - np.cos(times))
    zero = np.zeros_like(angle)
    expected = np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_simulation():
    program, law, times = qt.FrameProgram(path()), qt.AccelerationLaw(2.0, 1.5), np.linspace(0.0, 4.5, 6)
    begin = program(0.0)
    q = qt.quaternion.product(begin.quaternion, [1.1, 0.2, -0.1, 0.05])
    rate = np.concatenate([[0.0], begin.rate])
    found = qt.simulate(*moved((program, law, q, rate, times)))
    assert bool(found.successful)
    assert found.quaternion.devices() == {DEVICE}
    expected = qt.simulate(program, law, q, rate, times)
    np.testing.assert_allclose(found.quaternion, expected.quaternion, atol=1e-8)
    np.testing.assert_allclose(found.error, expected.error, atol=1e-8)


def test_arrays_of_the_cpu_stay_there():
    times = np.linspace(0.1, 4.4, 70_000)
    for t in (times[:50], times):
        table = qt.evaluate(*moved((path(), t), device=HOST))
        assert all(x.devices() == {HOST} for x in table.values.values())
    assert qt.trihedral(*moved((path(), np.array(1.0)), device=HOST)).curvature.devices() == {HOST}
    table = qt.evaluate(*moved((path(), times), device=HOST), devices=[DEVICE])
    assert all(x.devices() == {DEVICE} for x in table.values.values())


def test_searches_and_proofs_are_those_of_the_cpu():
    start = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
    end = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
    limits = qt.Limits(curvature=0.048, lateral_acceleration=2.2)
    assert qt.tune(*moved((start, end)), limits).objective == qt.tune(start, end, limits).objective
    found, expected = qt.certify(moved(path()), limits), qt.certify(path(), limits)
    assert found.status == expected.status
    slow = qt.Limits(speed=13.9, lateral_acceleration=1.5, longitudinal_acceleration=1.2)
    assert qt.retime(moved(path()), slow, knots=64).duration == qt.retime(path(), slow, knots=64).duration

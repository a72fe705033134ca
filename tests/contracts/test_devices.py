"""On a machine with another device, searches and proofs run on the host; a second CPU device stands in for it."""

import os
import subprocess
import sys

import pytest

CODE = """
import sys
import jax, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
import qtraj as qt
from qtraj.foundation import namespace

host, other = jax.local_devices()
if sys.argv[1] == "accelerator":
    jax.config.update("jax_default_device", other)
    namespace._on_cpu = lambda x: x.devices() == {host}
compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, *_, **__: compiled.append(name) if name.endswith("backend_compile_duration") else None
)

path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01], [1.0, 0.4, 0.05], 4.5)
start = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
end = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
limits = qt.Limits(curvature=0.048, lateral_acceleration=2.2)
states = [[0.0, 0, 0], [3, 1, 0], [5, 4, 1]], [[3.0, 0, 0], [3, 2, 1], [2, 4, 1]]
route = qt.Route([0.0, 1.0, 2.0], *states, np.zeros((3, 3)))
on_route = qt.Limits(curvature=3.0, speed=20.0)
timed = qt.Limits(speed=13.9, lateral_acceleration=1.5, longitudinal_acceleration=1.2)
CALLS = {
    "certify": (qt.certify, (path, limits)),
    "certify a route": (qt.certify, (route, on_route)),
    "tune": (qt.tune, (start, end, limits)),
    "tune_route": (qt.tune_route, (route, on_route)),
    "certify_box": (lambda *x: qt.certify_box(*x, qt.Box(start_speed=[-0.1, 0.1])), (path, limits)),
    "retime": (lambda path, limits: qt.retime(path, limits, knots=64), (path, timed)),
    "peak": (lambda path: qt.peak(path, "curvature"), (path,)),
}


def arrays(tree):
    return [x for x in jax.tree.leaves(tree) if isinstance(x, jax.Array)]


for name, (call, args) in CALLS.items():
    expected = call(*args)
    for device in (host, other):
        compiled.clear()
        result = call(*jax.device_put(args, device))
        on_accelerator = name == "peak" and sys.argv[1] == "accelerator" and device == other
        rtol = 1e-7 if on_accelerator else 1e-12  # rounding moves the instant of a maximum by its square root
        for x, y in zip(jax.tree.leaves(expected), jax.tree.leaves(result), strict=True):
            np.testing.assert_allclose(np.asarray(x), np.asarray(y), rtol=rtol, atol=1e-12, err_msg=name)
        assert bool(compiled) == on_accelerator, (name, device, len(compiled))
        default = jax.config.jax_default_device or host
        kept = {device} if name == "retime" else set()  # its path is the argument itself
        for x in arrays(result):
            assert x.devices() <= ({device} if name == "peak" else {default} | kept), (name, device, x.devices())
print("agreed")
"""


@pytest.mark.parametrize("stands_for", ["cpu", "accelerator"])
def test_searches_and_proofs_run_on_the_host(stands_for):
    """Nothing is compiled, answers agree, and results are NumPy arrays or on the default device.

    Only the peak of a path stays on the device of the path, and is computed there on an accelerator.
    """
    process = subprocess.run(
        [sys.executable, "-c", CODE, stands_for], capture_output=True, text=True, env=os.environ, check=False
    )
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout == "agreed\n"


SIMULATIONS = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
import qtraj as qt

first, second = jax.local_devices()
spin, law = qt.Spin([0.0, 0.0, 0.3], 4.5), qt.AccelerationLaw(2.0, 1.5)
quaternion, rate, times = np.array([1.0, 0.1, 0, 0]), np.array([0, 0, 0, 0.3]), np.linspace(0.0, 4.5, 6)
CALLS = {
    "simulate": (qt.simulate, (spin, law, quaternion, rate, times)),
    "integrate": (lambda *x: qt.integrate(lambda t, q, w: -0.1 * w, *x), (quaternion, rate, times)),
}


def moved(tree, device):
    return jax.tree.map(lambda x: jax.device_put(jnp.asarray(x), device), tree)


for name, (call, args) in CALLS.items():
    expected, found = (jax.tree.leaves(call(*moved(args, device))) for device in (first, second))
    for x, y in zip(expected, found, strict=True):
        np.testing.assert_array_equal(x, y, err_msg=name)
        assert not isinstance(y, jax.Array) or y.devices() == {second}, (name, y.devices())
    try:
        call(*moved(args[:1], first), *moved(args[1:], second))
    except ValueError as error:
        assert "cpu:0 and cpu:1" in str(error), error
    else:
        raise AssertionError(name)
print("agreed")
"""


@pytest.mark.slow
def test_simulations_run_on_the_device_of_the_arguments():
    command = [sys.executable, "-c", SIMULATIONS]
    process = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout == "agreed\n"

"""Arguments on another device than JAX's default: a second CPU device stands in for an accelerator, or for the host."""

import subprocess
import sys
from pathlib import Path

import pytest
from tests.algebra import test_every_function as rotations
from tests.contracts import every_call, second_device
from tests.contracts.every_call import RESULTS
from tests.contracts.test_every_call import NAMES

ROOT = Path(__file__).parents[2]
SETTINGS = """
import jax
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
"""
ON_THE_HOST = """
import sys
import numpy as np
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
        for x in arrays(result):
            assert x.devices() == {device}, (name, device, x.devices())
print("agreed")
"""


def run_with_two_devices(cached_code, code, *arguments):
    """What a process prints that runs the code with two CPU devices."""
    command = [sys.executable, "-c", SETTINGS + code, *arguments]
    process = subprocess.run(command, cwd=ROOT, env=cached_code, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    return process.stdout


@pytest.mark.parametrize("stands_for", ["cpu", "accelerator"])
def test_searches_and_proofs_run_on_the_host(stands_for, cached_code):
    """Nothing is compiled, answers agree, and results are NumPy arrays or on the device of the arguments.

    Only the peak of a path is computed on the device of the path if this is an accelerator.
    """
    assert run_with_two_devices(cached_code, ON_THE_HOST, stands_for) == "agreed\n"


def test_every_public_name_has_a_row_or_a_reason():
    """A new public name needs a row in `second_device.CALLS` or `every_call.CALLS`, or a reason in `NO_ARRAYS`."""
    rows = {name.partition(" ")[0] for name in second_device.CALLS}
    reasons = {*second_device.NO_ARRAYS}
    known = NAMES | {*rotations.FUNCTIONS}
    assert not known - rows - reasons - {*every_call.CALLS} - ({*rotations.FUNCTIONS} - {*rotations.OTHERS})
    assert not (rows | reasons) - known, "these names are gone"
    assert not rows & reasons - {*RESULTS}
    assert {*second_device.ANYWHERE} <= {*second_device.CALLS}


@pytest.mark.parametrize("rows", ["of_rotations()", pytest.param("CALLS.items()", marks=pytest.mark.slow)])
def test_every_function_takes_arguments_of_a_second_device(rows, cached_code):
    """Values agree, results are NumPy arrays or on that device, and arguments on two devices are refused."""
    code = f"from tests.contracts.second_device import CALLS, faults, of_rotations\nprint([*faults({rows})])"
    assert run_with_two_devices(cached_code, code) == "[]\n"

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


ANALYSES = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
import qtraj as qt
from qtraj import control

second = jax.local_devices()[1]
times = np.linspace(0.0, 4.5, 60)
path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01], [1.0, 0.4, 0.05], 4.5)
states = np.array([[0.0, 0, 0], [3, 1, 0], [5, 4, 1]]), np.array([[3.0, 0, 0], [3, 2, 1], [2, 4, 1]])
route = qt.Route([0.0, 1.0, 2.0], *states, np.zeros((3, 3)))
start = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
end = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
limits, on_route = qt.Limits(curvature=0.048, lateral_acceleration=2.2), qt.Limits(curvature=3.0, speed=20.0)
timed = qt.Limits(speed=13.9, lateral_acceleration=1.5, longitudinal_acceleration=1.2)
frame, law = qt.FrameProgram(path), qt.AccelerationLaw(2.0, 1.5)
slew = qt.EulerTurn([1.0, 0, 0, 0], [1.0, 0.2, 0, 0], qt.Quintic(duration=2.0))
position, velocity, quaternion = np.array([20.0, 0, 1]), np.array([1.0, 7, 0.3]), np.array([1.0, 0.1, 0, 0])
rate, instants, joints = np.array([0, 0, 0, 0.3]), np.linspace(0.0, 2.0, 5), np.array([0.1, 0.5, 1, 0.2, 0.5, 0.3])
motion = jax.vmap(frame)(jnp.asarray(times))
driven = np.stack([path.position(t) for t in times]) + 1e-3 * np.random.default_rng(0).normal(size=(60, 3))
pose, pose_law, spread = qt.PoseProgram(path, frame), qt.PoseLaw(law, 2.0, 1.5), qt.Spread(start_velocity=0.01)
box = qt.Box(start_speed=[-0.1, 0.1])
turned, turning = np.asarray(motion.quaternion), np.asarray(motion.rate)


def history(*loop):
    return qt.loop_history(*loop[:-1], qt.simulate(*loop))


LOOP = frame, law, quaternion, rate, instants
CALLS = {
    "fit": (lambda *x: qt.fit(qt.Track(*x)), (times, driven)),
    "fit_route": (lambda *x: qt.fit_route(qt.Track(*x)), (times, driven)),
    "uncertainty": (lambda t, *x: qt.uncertainty(qt.fit(qt.Track(*x)), t), (instants, times, driven)),
    "margin_uncertainty": (
        lambda x, *y: qt.margin_uncertainty(qt.fit(qt.Track(*y)), x), (limits, times, driven)
    ),
    "compare_paths": (qt.compare_paths, (path, path)),
    "compare_attitude": (lambda p, t, x, q: qt.compare_attitude(p, qt.Track(t, x, attitudes=q)),
                         (frame, times, driven, turned)),
    "compare_rates": (lambda p, t, x, w: qt.compare_rates(p, qt.Track(t, x, rates=w)),
                      (frame, times, driven, turning)),
    "retime_together": (lambda p, x: qt.retime_together([p, p], [x, x], knots=32), (route, timed)),
    "speed_profile": (lambda p, x: qt.speed_profile(qt.retime(p, x, knots=32)), (path, timed)),
    "robust_tune": (lambda *x: qt.robust_tune(*x, box), (start, end, limits)),
    "robust_tune_route": (lambda *x: qt.robust_tune_route(*x, spread, samples=256), (route, on_route)),
    "open_loop": (qt.open_loop, (slew, instants)),
    "judge_slew": (qt.judge_slew, (slew,)),
    "loop_history": (history, LOOP),
    "judge_loop": (lambda *x: qt.judge_loop(history(*x), x[1]), LOOP),
    "assess_loop": (qt.assess_loop, LOOP),
    "closed_motion": (lambda p, x, *y: control.closed_motion(x, jax.vmap(p)(y[-1]), *y), LOOP),
    "simulate_pose": (qt.simulate_pose, (pose, pose_law, position, velocity, quaternion, rate, instants)),
    "closed_pose": (qt.closed_pose, (pose, pose_law, position, velocity, quaternion, rate, instants)),
    "simulate_arm": (lambda *x: qt.simulate_arm(qt.stanford_arm(), *x), (slew, law, joints, 0 * joints, instants)),
}


def moved(x):
    return jax.device_put(jnp.asarray(x), second) if isinstance(x, np.ndarray | np.floating | jax.Array) else x


for name, (call, args) in CALLS.items():
    expected, found = (jax.tree.leaves(call(*x)) for x in (args, jax.tree.map(moved, args)))
    for x, y in zip(expected, found, strict=True):
        if isinstance(x, np.ndarray | jax.Array):
            np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), 1e-6, 1e-9, err_msg=name)
print("agreed")
"""


@pytest.mark.slow
def test_fits_comparisons_and_judgements_take_arguments_of_a_second_device():
    command = [sys.executable, "-c", ANALYSES]
    process = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout == "agreed\n"

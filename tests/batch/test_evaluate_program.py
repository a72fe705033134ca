"""`qtraj.evaluate` of attitude programs, and of times outside a path or a program."""

import jax
import numpy as np
import pytest

import qtraj as qt

START, END = qt.BoundaryState([10.0, 0, 0], [-1.0, 8, 0.5]), qt.BoundaryState([9.0, 2, 4], [1.0, 8, 0.5])
PATH = qt.SpiralHelix.hermite(START, END, 4.0)
TURN = qt.EulerTurn([1.0, 0, 0, 0], [1.0, 1, 0, 0], qt.Quintic(duration=2.0))
TIMES = np.linspace(0.0, 2.0, 7)


@pytest.mark.parametrize("axes", ["body", "inertial"])
@pytest.mark.parametrize("program", [TURN, qt.FrameProgram(PATH, qt.Upright())], ids=["turn", "frame"])
def test_a_program_has_the_values_of_its_attitudes(program, axes):
    table = qt.evaluate(program, TIMES, axes=axes)
    for k, t in enumerate(TIMES):
        at = program.at(t, axes)
        np.testing.assert_allclose(table.quaternion[k], at.quaternion, atol=1e-15)
        np.testing.assert_allclose(table.rate[k], at.rate, atol=1e-15)
        np.testing.assert_allclose(table.angular_acceleration[k], at.acceleration, atol=1e-15)
    assert table.axes == axes
    assert table.to_xarray()["rate"].attrs["units"] == "rad s-1"


def test_many_instants_are_mapped_and_few_are_not():
    times = np.linspace(0.0, 2.0, 601)
    few, many = (qt.evaluate(TURN, x, ["dcm", "rate"]) for x in (times[::3], times))
    np.testing.assert_allclose(many.dcm[::3], few.dcm, atol=1e-14)
    np.testing.assert_allclose(many.rate[::3], few.rate, atol=1e-14)
    np.testing.assert_allclose(few.dcm[-1], qt.rotation.to_dcm(TURN(2.0).quaternion), atol=1e-15)


def test_a_program_is_evaluated_under_jit_and_differentiated():
    last = jax.jit(lambda t: qt.evaluate(TURN, t).rate[0, 0])
    assert float(last(np.array([0.5]))) == pytest.approx(float(TURN(0.5).rate[0]), abs=1e-14)
    slope = jax.grad(lambda t: qt.evaluate(TURN, t[None]).rate[0, 0])(np.float64(0.5))
    assert float(slope) == pytest.approx(float(TURN(0.5).acceleration[0]), abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"outputs": ["position"]}, "the output 'position' belongs to a path.*Evaluate program.path"),
        ({"frame": qt.Upright()}, "frame applies only to paths.*omit frame"),
        ({"reduce": "max"}, "reduce applies only to paths"),
        ({"times": 1.0}, r"times must have shape \(n,\)"),
    ],
)
def test_arguments_of_paths_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.evaluate(TURN, **({"times": TIMES} | arguments))


@pytest.mark.parametrize(("what", "subject"), [("path", PATH), ("program", TURN)])
def test_times_outside_are_refused_unless_wished(what, subject):
    end = float(subject.duration)
    times = np.array([0.0, end, end + 1])
    with pytest.raises(ValueError, match=f"within the {what}, which lasts from 0 to {end:g} s, but {end + 1:g} s"):
        qt.evaluate(subject, times)
    with pytest.raises(ValueError, match="but -1 s was given: pass extrapolate=True"):
        qt.evaluate(subject, times - 1)
    assert qt.evaluate(subject, times, extrapolate=True).rate.shape == (3, 3)


def test_rounding_of_the_last_instant_is_accepted():
    duration = 0.1 + 0.2
    path = qt.SpiralHelix.hermite(START, END, duration)
    qt.evaluate(path, np.array([0.0, np.nextafter(duration, 1)]))
    batch = jax.vmap(lambda t: qt.SpiralHelix.hermite(START, END, t))(np.array([1.0, 2.0]))
    qt.evaluate(batch, np.array([[0.0, 1.0], [0.0, 2.0]]))
    with pytest.raises(ValueError, match=r"but 1\.5 s was given"):
        qt.evaluate(batch, np.array([[0.0, 1.5], [0.0, 2.0]]))


def test_components_may_come_first_and_signs_may_be_continuous():
    last, first = (qt.evaluate(TURN, TIMES, components=c) for c in ("last", "first"))
    np.testing.assert_array_equal(first.quaternion, last.quaternion.T)
    quaternions = qt.evaluate(TURN, TIMES, continuous=True).quaternion
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0)
    with pytest.raises(ValueError, match="components must be 'last' or 'first'"):
        qt.evaluate(TURN, TIMES, components="x")


def test_a_batch_of_programs_is_refused():
    batch = jax.vmap(lambda t: qt.FrameProgram(qt.SpiralHelix.hermite(START, END, t)))(np.array([3.0, 4.0]))
    with pytest.raises(ValueError, match="one program, but a batch was given"):
        qt.evaluate(batch, TIMES)


@pytest.mark.parametrize("times", [[np.nan, 1e9], [0.1, np.inf]])
def test_times_that_are_not_finite_are_refused(times):
    path = qt.SpiralHelix([10.0], [0.0, 1.0], [0.0, 0.5], 6.0)
    for what in (path, qt.FrameProgram(path)):
        with pytest.raises(ValueError, match="times must be finite"):
            qt.evaluate(what, times)

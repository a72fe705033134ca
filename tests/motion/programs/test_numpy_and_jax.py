"""Programs in NumPy and in JAX: the same values, and no compilation in NumPy."""

import jax
import numpy as np
import pytest

import qtraj as qt

PATH = qt.SpiralHelix([20.0, 0.1], [0.0, 0.3, 0.01], [0.0, 0.5, 0.02, 0.001], 10.0)
LAWS = [
    qt.TimeOptimal(0.1, 0.02),
    qt.TimeOptimal(0.1, 0.02, start_rate=0.01),
    qt.SCurve(0.1, 0.02, 0.01, start_rate=0.01, end_acceleration=0.005),
    qt.TimeOptimal(0.1, 0.02, duration=50.0),
    qt.SCurve(0.1, 0.02, 0.01),
    qt.Quintic(max_rate=0.1, max_jerk=0.01),
    qt.MultiKnotCubic(40.0, 0.1, 0.02),
]


def assert_equal(found, expected):
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert isinstance(x, np.ndarray | np.generic)
        np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("frame", [qt.Natural(), qt.Upright(), qt.RotationMinimizing(), qt.ThrustAligned()])
@pytest.mark.parametrize("path", [PATH, qt.Route.from_path(PATH, 0.1)])
def test_frames_of_paths(path, frame, compiled):
    program = qt.FrameProgram(path, frame)
    found = [program.at(t, "inertial") for t in (0.0, 3.3, 10.0)]
    assert not compiled
    expected = jax.jit(jax.vmap(lambda path, t: qt.FrameProgram(path, frame).at(t, "inertial"), (None, 0)))(
        path, np.array([0.0, 3.3, 10.0])
    )
    for k, attitude in enumerate(found):
        assert_equal(attitude, jax.tree.map(lambda x: x[k], expected))  # noqa: B023


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_slews(law, compiled):
    turn = qt.EulerTurn([1, 0, 0, 0], [0, 1, 1, 0], law)
    found = [turn(t) for t in (0.0, 3.0, 60.0)], turn.duration, turn.switches, turn.end, turn.axis("inertial")
    assert not compiled
    expected = jax.jit(
        lambda turn: (
            [turn(t) for t in (0.0, 3.0, 60.0)],
            turn.duration,
            turn.switches,
            turn.end,
            turn.axis("inertial"),
        )
    )(turn)
    assert_equal(found, expected)


def test_sequences_of_slews(compiled):
    sequence = qt.SlewSequence([[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 1, 0]], LAWS[0])
    found = sequence(20.0), sequence.duration, sequence.switches
    assert not compiled
    assert_equal(found, jax.jit(lambda s: (s(20.0), s.duration, s.switches))(sequence))


@pytest.mark.parametrize("outside", ["error", "hold", "extrapolate"])
def test_tables(outside, compiled):
    times, attitudes = np.array([0.0, 1.0, 2.5, 4.0]), np.random.default_rng(5).normal([2, 0, 0, 0], 0.5, (4, 4))

    def values(times, attitudes):
        table = qt.TableProgram(times, attitudes, outside=outside)
        return table.rates, [table(t) for t in (0.0, 1.7, 4.0)]

    found = values(times, attitudes)
    assert not compiled
    assert_equal(found, jax.jit(values)(times, attitudes))

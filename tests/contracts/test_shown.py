"""The `repr` of every public class: values with units, short, and no types of arrays."""

import enum
import inspect
import tempfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.result import AbstractResult

LONGEST = 700
"""Characters of a `repr`; the longest is a program with its path and its frame."""

TIMES = np.linspace(0.0, 3.0, 21)
LAMBDA = np.array([0.8, 0.6, 0.0, 0.0])
STATE = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 5.0, 1.0])
PATH = qt.SpiralHelix([10.0, 0.5], [0.0, 0.4], [0.0, 1.0], 3.0, qt.Placement([1.0, 2.0, 3.0]))
PROFILE = qt.Quintic(max_rate=0.4, max_acceleration=0.2)
TURN = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8], PROFILE)
CERTIFICATE = qt.Certificate(["curvature"], [0], [1.0], [0.09], [0.1])
RESIDUAL = qt.Residual(0.1, 0.1, 0.1, 0.3, 1.2, 21)
FLIP = LAMBDA + 0.1 * np.eye(4)[[0, 1, 1, 0, 0]]


ROUTE = qt.Route([0.0, 1.0, 3.0], np.eye(3), np.ones((3, 3)), np.zeros((3, 3)))
JOINT = qt.Joint([0.0, 0.0, 1.0])


def tumble(t):
    return jnp.stack([0.1 * t, t, t * t])


EXAMPLES = [
    PATH,
    PROFILE,
    STATE,
    TURN,
    CERTIFICATE,
    RESIDUAL,
    qt.AccelerationLaw(1.0, 2.0),
    qt.Actuator(0.3, sampling=0.1),
    qt.Attitude(LAMBDA, jnp.zeros(3), jnp.zeros(3)),
    qt.Box(0.1, limits={"curvature": (0.0, 0.01)}),
    qt.Spread(0.1, [0.1, 0.2, 0.3], limits={"curvature": 0.01}),
    qt.AtlasAxis("radius", 10.0, 50.0, 0.5, unit="m"),
    qt.AxesFrame(lambda position, velocity, acceleration: jnp.eye(3)),
    qt.FunctionProfile(lambda t: t - jnp.sin(t), 2 * np.pi),
    qt.AttitudeAngles(sequence="ZYX", heading="x-anticlockwise", unit="deg", body="forward-left-up"),
    qt.AttitudeResidual(LAMBDA, 0.1, 0.2, [0.1, 0.1, 0.1], 1.0, 21),
    qt.RateResidual([0.1, 0.1, 0.1], [0.9, 0.9, 0.9], 21, LAMBDA),
    qt.Cubic(1.0),
    qt.Curve(tumble, 2.0),
    qt.DisturbanceAcceleration(tumble),
    qt.DisturbanceTorque(qt.Sinusoid([0.1, 0.0, 0.0], 3.0), np.eye(3)),
    qt.Fitted(PATH, RESIDUAL, 0, 7, [5.0, 50.0]),
    qt.FrameProgram(PATH, qt.Upright(), anchors=np.tile(LAMBDA, (5, 1))),
    qt.GaussLegendre(),
    qt.GeometricFeedback(1.0, [1.0, 2.0, 3.0]),
    qt.Gyros(0.1, key=jax.random.key(3)),
    qt.Along([0.0, 120.0], [13.9, 8.3]),
    qt.BySpeed([0.0, 30.0], upper=[3.0, 0.8]),
    qt.Ball([1.0, 2.0, 3.0], 0.5),
    qt.ConvexPolygon([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]),
    qt.Cylinder([1.0, 2.0, 0.0], [0.0, 0.0, 1.0], 0.3),
    qt.Ellipsoid([1.0, 2.0, 3.0], [2.0, 1.0, 1.0]),
    qt.HalfSpace([0.0, 0.0, 1.0], 0.0),
    qt.Ellipse(braking=8.0, accelerating=3.0, lateral=9.0),
    qt.Limits(curvature=0.1),
    qt.LogarithmicFeedback(1.0, 2.0),
    qt.Magnus(4),
    qt.Natural(),
    qt.Placement([1.0, 2.0, 3.0]),
    qt.Progress("steps", 1, 2),
    qt.Propagation(TIMES, np.tile(LAMBDA, (21, 1)), 1e-13, np.int32(8), np.int32(0)),
    qt.QuaternionFeedback(1.0, np.eye(3)),
    qt.Regions([([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]], 8.3)]),
    qt.RateLaw(1.0),
    qt.RotationMinimizing([0.0, 0.0, 1.0]),
    qt.SCurve(None, 0.2, 0.1),
    qt.Sensor(rate_noise=1e-3, sampling=0.1, key=jax.random.key(3)),
    qt.Septic(max_jerk=1.0),
    qt.Sinusoid([0.1, 0.0, 0.0], 3.0),
    qt.SlewSequence(np.eye(4)[:3], qt.TimeOptimal(0.1, 0.2)),
    qt.Spin([0.0, 0.0, 0.1], 60.0),
    qt.ProgramSequence([qt.Spin([0.0, 0.0, 0.1], 60.0)]),
    qt.Solution(TIMES, np.tile(LAMBDA, (21, 1)), np.zeros((21, 4)), 0),
    qt.Table(jnp.asarray(TIMES), position=jnp.zeros((21, 3))),
    qt.TableProgram(TIMES[:5], FLIP),
    qt.TangentPlane(),
    qt.ThrustAligned(jnp.sin),
    qt.TimeOptimal(0.1, 0.2, end_rate=0.05),
    qt.TorquePeak((0.1, 0.1, 0.1), (0.0, 0.0, 0.0), 0.2, 0.0),
    qt.Track(TIMES, np.stack([TIMES, TIMES**2, TIMES], axis=1)),
    qt.trihedral(PATH, 1.0),
    qt.Tuned(PATH, STATE, STATE, 1.0, CERTIFICATE, 0, 7),
    qt.Vehicle(12e3, (1e4, 5e4, 6e4), 6.0, 0.007, (0.6, 0.5), 0.1),
    qt.Road([0, 40], bank=[0.0, 0.1]),
    qt.Upright(),
    JOINT,
    qt.Arm([JOINT, qt.Joint([0.0, 1.0, 0.0], [0.0, 0.0, 0.5])], [0.0, 0.0, 1.0]),
    qt.MultiKnotCubic(2.0, max_rate=0.8),
    qt.Damping(),
    qt.Driving.along(ROUTE),
    qt.HystereticLaw(qt.AccelerationLaw(1.0, 2.0), sampling=0.1),
    qt.Nearest(jnp.asarray(1.0), jnp.zeros(3), jnp.asarray(0.5)),
    qt.PoseLaw(qt.AccelerationLaw(1.0, 2.0), 1.0, 2.0),
    qt.PoseProgram(PATH, TURN),
    qt.ReactionWheels(np.eye(3), 0.1),
    qt.RigidBody([1.0, 2.0, 3.0], torque=[0.0, 0.0, 0.1]),
    ROUTE,
    qt.Timing([[1.0, 0.1, 0.0, 0.0]], [0.0, 3.0]),
    qt.sweep(lambda p: {"y": p["a"]}, {"a": [1.0, 2.0]}, tempfile.mkdtemp(), workers=0),
    qt.Quantity("climb_rate", "m/s", lambda p: p.velocity[2]),
    qt.RetimedPath(PATH, qt.Timing([[1.0, 0.1, 0.0, 0.0]], [0.0, 3.0])),
]


def test_every_public_class_has_an_example():
    classes = {getattr(qt, name) for name in qt.__all__ if inspect.isclass(getattr(qt, name))}
    results = {c for c in classes if issubclass(c, AbstractResult)}  # of which tests/io/test_results.py has examples
    concrete = {c for c in classes - results if not inspect.isabstract(c) and not issubclass(c, enum.Enum)}
    assert concrete == {type(example) for example in EXAMPLES} - results


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda x: type(x).__name__)
def test_values_are_shown_not_types(example):
    text = repr(example)
    assert text.startswith(f"{type(example).__name__}(")
    for word in ("f64[", "f32[", "i64[", "i32[", "u32[", "weak_", "Partial(", "<function"):
        assert word not in text
    assert len(text) <= LONGEST
    assert "\n" not in text


@pytest.mark.parametrize(
    ("example", "expected"),
    [
        (PROFILE, "Quintic(max_rate=0.4, max_acceleration=0.2)"),
        (
            qt.TimeOptimal(0.1, 0.2, duration=9.0),
            "TimeOptimal(max_rate=0.1, max_acceleration=0.2, duration=9 s)",
        ),
        (qt.RateLaw([1.0, 2.0, 3.0, 4.0]), "RateLaw(k=[1, 2, 3, 4] 1/s)"),
        (qt.AccelerationLaw(np.eye(4), 2.0), "AccelerationLaw(k1=<4 × 4 numbers, 0 … 1 1/s>, k2=2 1/s², error='body')"),
        (qt.Actuator(0.3, sampling=TIMES), "Actuator(limit=0.3, saturation='norm', sampling=<21 numbers, 0 … 3 s>)"),
        (qt.DisturbanceAcceleration(tumble), "DisturbanceAcceleration(signal=tumble)"),
        (qt.Magnus(4), "Magnus(order=4)"),
        (TURN, f"EulerTurn(start_q=[1, 0, 0, 0], end_q=[0.6, 0, 0, 0.8], law={PROFILE!r})"),
    ],
    ids=lambda x: type(x).__name__,
)
def test_fields_have_their_units(example, expected):
    assert repr(example) == expected


def test_batched_and_traced_modules_can_be_shown():
    stacked = jax.vmap(lambda k: qt.RateLaw(k))(jnp.array([0.1, 0.2]))
    assert repr(stacked) == "RateLaw(k=[0.1, 0.2] 1/s)"
    seen = []
    jax.jit(lambda k: seen.append(repr(qt.RateLaw(k))) or k)(0.1)
    assert seen == ["RateLaw(k=weak_f64[])"]


HTML = [x for x in EXAMPLES if isinstance(x, qt.AbstractProgram | qt.control.AbstractLaw | AbstractResult)] + [
    x for x in EXAMPLES if isinstance(x, qt.Limits | qt.Sensor | qt.Gyros | qt.Vehicle | qt.PoseLaw | qt.PoseProgram)
]


@pytest.mark.parametrize("example", HTML, ids=lambda x: type(x).__name__)
def test_notebooks_show_a_table(example):
    html = example._repr_html_()
    assert f"<strong>{type(example).__name__}</strong>" in html
    assert "<table>" in html
    assert "<function" not in html.replace("&lt;", "<")


def test_the_table_of_a_module_has_a_row_for_each_field():
    html = qt.Limits(curvature=0.1, speed=(1.0, 5.0))._repr_html_()
    assert "<tr><td>curvature</td><td>0.1 1/m</td></tr>" in html
    assert html.count("<tr>") == 2


def test_traced_modules_have_html():
    seen = []
    jax.jit(lambda k: seen.append(qt.RateLaw(k)._repr_html_()) or k)(0.1)
    assert "RateLaw" in seen[0]

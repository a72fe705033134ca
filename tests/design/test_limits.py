"""Limits: path quantities against their definitions, margins, peaks and their gradients."""

import math
import re
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from tests.derivatives import with_jacobians

import qtraj as qt
from qtraj.path.frenet import Invariants
from qtraj.path.moment_quantities import MOMENTS
from qtraj.path.path_quantity import WHEELBASE
from qtraj.path.quantity import QUANTITIES
from qtraj.path.road_parameters import GRAVITY, NO_VEHICLE
from qtraj.path.values import value as value_of

ALL = {name: 1.0 for name, entry in QUANTITIES.items() if not entry.needs}
STEERING = [name for name, entry in QUANTITIES.items() if entry.needs == WHEELBASE]
PLACEMENTS = [None, qt.Placement([5.0, 6.0, 7.0]), qt.Placement([0.0, 0.0, 0.0], [1.0, 0.2, -0.1, 0.3])]


def helix(placement=None) -> qt.SpiralHelix:
    return qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02], [1.0, 0.4, 0.05, -0.01], 4.5, placement)


def bend(v, a):
    """The curvature of the horizontal projection."""
    return (v[0] * a[1] - v[1] * a[0]) / (v[0] ** 2 + v[1] ** 2) ** 1.5


def rate_of(function, path, t):
    """The derivative of a function of velocity and acceleration with respect to time."""
    return jax.jvp(lambda t: function(*path.derivatives(t, 2)[1:]), (t,), (1.0,))[1]


@pytest.mark.parametrize("placement", PLACEMENTS, ids=["axis z", "moved", "tilted"])
def test_quantities_match_their_definitions(placement):
    path, t = helix(placement), 1.3
    r = np.asarray(path.derivatives(t, 3))
    v, a = r[1], r[2]
    speed = np.linalg.norm(v)
    at, upright = qt.trihedral(path, t), qt.trihedral(path, t, qt.Upright())
    force = a + np.array([0.0, 0.0, GRAVITY])
    expected = {
        "curvature": np.linalg.norm(np.cross(v, a)) / speed**3,
        "torsion": abs(np.cross(v, a) @ r[3]) / np.linalg.norm(np.cross(v, a)) ** 2,
        "speed": speed,
        "acceleration": np.linalg.norm(a),
        "lateral_acceleration": np.linalg.norm(a - (a @ v) * v / speed**2),
        "longitudinal_acceleration": abs(a @ v) / speed,
        "slope": abs(v[2]) / np.hypot(v[0], v[1]),
        "angular_rate": np.linalg.norm(at.rate),
        "angular_acceleration": np.linalg.norm(at.acceleration),
        "jerk": np.linalg.norm(r[3]),
        "yaw_rate": abs(upright.rate[2]),
        "yaw_acceleration": abs(upright.acceleration[2]),
        "longitudinal_jerk": abs(rate_of(lambda v, a: v @ a / jnp.linalg.norm(v), path, t)),
        "lateral_jerk": abs(rate_of(lambda v, a: (v[0] * a[1] - v[1] * a[0]) / jnp.hypot(v[0], v[1]), path, t)),
        "horizontal_curvature": abs(bend(v, a)),
        "curvature_rate": abs(rate_of(bend, path, t)),
        "sharpness": abs(rate_of(bend, path, t)) / np.hypot(v[0], v[1]),
        "height": abs(r[0, 2]),
        "vertical_speed": abs(v[2]),
        "vertical_acceleration": abs(a[2]),
        "load_factor": np.linalg.norm(force) / GRAVITY,
        "tilt": np.arccos(force[2] / np.linalg.norm(force)),
        "bank_angle": abs(np.arctan2(*(force @ np.asarray([upright.normal, upright.binormal]).T))),
    }
    assert set(expected) == set(ALL)
    values = jax.jit(lambda path, t: qt.Limits(**ALL).values(path, t))(path, t)
    assert set(values) == set(ALL)
    for name, value in expected.items():
        np.testing.assert_allclose(values[name], value, rtol=1e-11)


def test_margins_are_limit_minus_value_of_the_limits_that_are_set():
    limits = qt.Limits(speed=9.0, slope=0.01)
    margins = limits.margins(helix(), 1.0)
    assert set(margins) == {"speed", "slope"}
    assert float(margins["speed"]) == pytest.approx(9.0 - float(value_of(helix(), 1.0, "speed")))
    assert float(margins["slope"]) < 0


def test_quantities_at_a_standstill_are_infinite_or_zero_not_nan():
    stop = qt.SpiralHelix([2.0, 0.0, 1.0], [0.3], [1.0], 2.0)
    climb = qt.SpiralHelix([2.0], [0.3], [0.0, 1.0], 2.0)
    assert np.isinf(value_of(climb, 1.0, "slope"))
    for name in ALL:
        value, slope = jax.value_and_grad(lambda t: value_of(stop, t, name))(0.0)  # noqa: B023
        assert not np.isnan(value), name
        assert not np.isnan(slope), name


@pytest.mark.parametrize("name", ["curvature", "torsion", "longitudinal_acceleration", "angular_acceleration"])
def test_peaks_agree_with_a_bounded_search(name):
    path = helix()
    time, value = jax.jit(lambda path: qt.peak(path, name))(path)
    f = jax.jit(lambda t: -value_of(path, t, name))
    grid = np.linspace(0, 4.5, 2001)
    coarse = grid[np.argmin([float(f(t)) for t in grid])]
    bounds = (max(0.0, coarse - 0.01), min(4.5, coarse + 0.01))
    fine = minimize_scalar(lambda t: float(f(t)), bounds=bounds, method="bounded", options={"xatol": 1e-12})
    np.testing.assert_allclose(value, max(-fine.fun, -float(f(coarse))), rtol=1e-12)
    np.testing.assert_allclose(time, fine.x, atol=1e-5)


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.Limits(curvature=0.0), "limit curvature must be positive"),
        (lambda: qt.Limits(speed=-1.0), "limit speed must be positive"),
        (lambda: qt.Limits(torsion=float("nan")), "limit torsion must be positive"),
        (lambda: qt.Limits(slope=np.array([0.1, 0.2])), "limit slope must be one number"),
        (lambda: qt.Limits(acceleration="x"), "limit acceleration must be a number"),
        (lambda: qt.peak(helix(), "colour"), "unknown path quantity 'colour'"),
    ],
)
def test_invalid_limits_raise_with_a_reason(make, fragment):
    with pytest.raises(ValueError) as caught:
        make()
    assert fragment in str(caught.value)


def test_an_unknown_limit_is_refused_with_a_suggestion():
    with pytest.raises(TypeError, match=r"no limit 'lateral_accel': did you mean 'lateral_acceleration'\?"):
        qt.Limits(lateral_accel=2.0)
    for name, near in (("velocity", "speed"), ("max_speed", "speed"), ("max_jerk", "jerk"), ("speed_limit", "speed")):
        with pytest.raises(TypeError, match=rf"no limit '{name}': did you mean '{near}'\?"):
            qt.Limits(**{name: 2.0})
    with pytest.raises(TypeError, match=r"no limit 'angular_velocity': did you mean 'angular_rate'\?"):
        qt.Limits(angular_velocity=2.0)
    with pytest.raises(TypeError, match=r"no limit 'max_acceleration': did you mean 'acceleration'\?"):
        qt.Limits(max_acceleration=2.0)
    with pytest.raises(TypeError, match="no limit 'colour': the known limits are curvature, torsion"):
        qt.Limits(colour=2.0)


# Gradients with respect to every boundary number, against central differences.

GRADIENT = 1e-7  # relative to the largest component
STATES = np.array([[20.0, 1.0, 0.5], [-0.4, 7.0, 0.3], [-2.0, 24.0, 1.5], [-8.9, 0.6, 0.8]])
# Uniform rotation takes V_φ/ρ from the start. Inside a trace, a different rate at the end is not an error.


def make_path(x, motion):
    start, end = qt.BoundaryState(x[0], x[1]), qt.BoundaryState(x[2], x[3])
    if motion == "uniform":
        return qt.SpiralHelix.from_boundary(start, end)
    return qt.SpiralHelix.hermite(start, end, 4.0)


def quantities_of(x, motion):
    """The largest curvature, a quaternion and a rate, (8,)."""
    path = make_path(x, motion)
    at = qt.trihedral(path, 1.7)
    return jnp.concatenate([qt.peak(path, "curvature")[1][None], at.quaternion(), at.rate])


PARTS = {"largest curvature": slice(0, 1), "quaternion": slice(1, 5), "rate": slice(5, 8)}


def central(f, x, step):
    """Fourth-order central differences, with steps proportional to the size of each number."""
    columns = []
    for k in range(x.size):
        h = step * max(1.0, abs(x.flat[k]))
        d = np.zeros_like(x)
        d.flat[k] = h
        columns.append((8 * (f(x + d) - f(x - d)) - (f(x + 2 * d) - f(x - 2 * d))) / (12 * h))
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, *x.shape)


@pytest.mark.parametrize("motion", ["uniform", pytest.param("hermite", marks=pytest.mark.slow)])
def test_gradients_in_every_boundary_number(motion):
    """Forward and reverse mode, both from one trace."""
    derivatives = jax.jit(with_jacobians(partial(quantities_of, motion=motion)))
    _, forward, reverse = derivatives(STATES)
    differences = central(lambda x: np.asarray(derivatives(x)[0]), STATES, 1e-3)
    for name, part in PARTS.items():
        scale = np.abs(differences[part]).max()
        assert scale > 1e-3, name
        np.testing.assert_allclose(forward[part], differences[part], rtol=0, atol=GRADIENT * scale, err_msg=name)
        np.testing.assert_allclose(reverse[part], forward[part], rtol=0, atol=1e-12 * scale, err_msg=name)


def test_float32_keeps_its_dtype():
    path = jax.tree.map(lambda x: x.astype(jnp.float32), helix())
    values = qt.Limits(**{name: jnp.asarray(1.0, jnp.float32) for name in ALL}).values(path, 1.0)
    assert {v.dtype for v in values.values()} == {jnp.dtype(jnp.float32)}


def test_a_path_with_nan_has_a_nan_peak():
    """JAX's derivative of t ** [0., 1., …] at 0 is NaN: the maximum of the other values is not the peak."""
    coefficients = jnp.asarray([[0.0, 5.0, 0.4, -0.1], [1.0, 0.3, 0.8, 0.0], [0.0, 0.2, 0.0, 0.05]])
    time, size = qt.peak(qt.Curve(lambda t: coefficients @ t ** jnp.arange(4.0), 3.0), "curvature")
    assert float(time) == 0.0
    assert math.isnan(float(size))


class Degree(int):
    """Degree of a polynomial, in the arithmetic of polynomials."""

    def __add__(self, other):
        return Degree(max(self, other))

    def __mul__(self, other):
        return Degree(int(self) + (other if isinstance(other, Degree) else 0))

    def __neg__(self):
        return self

    __sub__, __rmul__ = __add__, __mul__


def degree(entry, turning):
    """The degree of an entry's inequality for cubic ρ and h, where φ̇ has the degree `turning`."""
    degrees = (3, 3, 3)
    derivatives = [degrees]
    for _ in range(4):
        x, y, z = degrees
        degrees = (max(x - 1, y + turning), max(y - 1, x + turning), max(z - 1, 0))
        derivatives.append(degrees)
    rows = [tuple(map(Degree, vector)) for vector in derivatives]
    constant = NO_VEHICLE._replace(gravity=Degree(0), wheelbase=Degree(0))
    # The degree is that of the inequality without roots.
    invariants = Invariants(rows, vehicle=constant, root=lambda square: square)
    return max(entry.numerator(invariants), entry.denominator(invariants) if entry.denominator else 0)


def test_the_page_states_the_degrees_of_the_inequalities():
    page = (Path(__file__).parents[2] / "docs" / "tuning.md").read_text(encoding="utf-8")
    stated = re.findall(r"^\|[^|]*\|(?:[^|]|\\\|)*\| (\d+) / (\d+) \|", page, flags=re.M)
    assert sorted((int(a), int(b)) for a, b in stated) == sorted(
        (degree(QUANTITIES[name], 0), degree(QUANTITIES[name], 2)) for name in (*ALL, *MOMENTS, *STEERING)
    )


def test_limits_on_timing_and_on_shape():
    bus = qt.Vehicle(12e3)
    limits = qt.Limits(curvature=0.1, slope=0.2, speed=9.0, friction=0.5, angular_acceleration=2.0, vehicle=bus)
    assert set(limits.on_timing().given()) == {"speed", "friction"}
    assert eqx.tree_equal(limits.on_timing().vehicle, bus)
    assert set(limits.on_shape().given()) == {"curvature", "slope"}
    assert limits.on_shape().vehicle is None
    climb, ahead = qt.Quantity("climb", "m/s", "velocity[2]"), qt.Quantity("ahead", "1", "velocity[0] / speed")
    own = qt.Limits(own={climb: (-1.0, 2.0), ahead: 0.9})
    assert set(own.on_timing().given()) == {"climb_min", "climb_max"}
    assert set(own.on_shape().given()) == {"ahead"}


class Counted(qt.AbstractHodograph):
    """A path that counts the evaluations of its derivatives."""

    duration: jax.Array
    calls: list = eqx.field(static=True)

    def derivatives(self, t, order):
        self.calls.append(order)
        return helix().derivatives(t, order)


@pytest.mark.parametrize("traced", [False, True])
def test_margins_evaluate_the_path_once(traced):
    path = Counted(jnp.asarray(2.0), [])
    limits = qt.Limits(curvature=0.1, torsion=0.1, speed=8.0, acceleration=3.0, jerk=2.0, yaw_rate=0.5)
    margins = (jax.jit if traced else (lambda f: f))(lambda t: limits.margins(path, t))(1.0)
    assert path.calls == [3]
    single = {name: limits.only([name]).margins(helix(), 1.0)[name] for name in limits.given()}
    for name, margin in single.items():
        np.testing.assert_allclose(margins[name], margin, rtol=1e-12)


def test_margins_of_a_route_of_numpy_arrays_may_be_mapped():
    route = qt.Route([0.0, 1.0, 3.0], np.eye(3), np.ones((3, 3)), np.zeros((3, 3)))
    limits = qt.Limits(curvature=0.5, speed=3.0)
    times = np.linspace(0.1, 2.9, 5)
    mapped = jax.vmap(lambda t: limits.margins(route, t))(times)
    for name, margins in mapped.items():
        np.testing.assert_allclose(margins, [limits.margins(route, t)[name] for t in times], rtol=1e-12)

"""Forces of a vehicle along a path: Newton's second law with 30 digits, energy balance, derivatives, units."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation import units
from qtraj.path.channel import CHANNELS, INERTIA, VEHICLE, outputs_with
from qtraj.path.road_quantities import ROAD_QUANTITIES
from qtraj.path.values import value

COEFFICIENTS = [20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02], [1.0, 0.4, 0.05, -0.01]
PATH = qt.SpiralHelix(*COEFFICIENTS, 4.5)
TRUCK = qt.Vehicle(12e3, (1e4, 5e4, 6e4), 6.0, 0.007, (0.6, 0.5), 0.1)
FORCES = tuple(entry.name for entry in ROAD_QUANTITIES)
BALANCE = 1e-12  # relative


def mp_vector(*x):
    return mpmath.matrix(x)


def mp_cross(a, b):
    return mp_vector(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def mp_dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def newton(t, vehicle):
    """All forces from the position alone, differentiated numerically with 30 digits, in world axes."""
    rho, phi, height = ([mpmath.mpf(x) for x in c] for c in COEFFICIENTS)

    def at(k):
        def component(t):
            radius, angle = mpmath.polyval(rho, t, asc=True), mpmath.polyval(phi, t, asc=True)
            return (radius * mpmath.cos(angle), radius * mpmath.sin(angle), mpmath.polyval(height, t, asc=True))[k]

        return component

    velocity = mp_vector(*(mpmath.diff(at(k), t) for k in range(3)))
    acceleration = mp_vector(*(mpmath.diff(at(k), t, 2) for k in range(3)))
    number = {
        name: mpmath.mpf(float(getattr(vehicle, name)))
        for name in ("mass", "gravity", "drag_area", "air_density", "rolling_resistance", "bank")
    }
    speed, up = mpmath.norm(velocity), mp_vector(0, 0, 1)
    drag = number["air_density"] * number["drag_area"] * speed * velocity / 2
    force = number["mass"] * (acceleration + number["gravity"] * up) + drag
    tangent = velocity / speed
    left = mp_cross(up, tangent)
    left = left / mpmath.norm(left)
    above = mp_cross(tangent, left)
    c, s = mpmath.cos(number["bank"]), mpmath.sin(number["bank"])
    across, normal = c * left - s * above, c * above + s * left  # a road rolled to the left
    x, y, z = (mp_dot(force, axis) for axis in (tangent, across, normal))
    along, beside = (mpmath.mpf(float(mu)) for mu in vehicle.friction)
    found = {
        "longitudinal_force": abs(x),
        "lateral_force": abs(y),
        "normal_load": z,
        "friction": mpmath.sqrt((x / along) ** 2 + (y / beside) ** 2) / z,
        "power": (x + number["rolling_resistance"] * z) * speed,
    }
    return {name: float(x) for name, x in found.items()}, [float(mp_dot(force, a)) for a in (tangent, left, above)]


@pytest.mark.parametrize("t", [0.0, 1.3, 4.5])
def test_forces_are_those_of_newtons_second_law(t):
    with mpmath.workdps(30):
        exact, components = newton(t, TRUCK)
    table = qt.evaluate(PATH, [t], (*FORCES, "force"), qt.Upright(), vehicle=TRUCK)
    values = qt.Limits(**dict.fromkeys(FORCES, 1.0), vehicle=TRUCK).values(PATH, t)
    for name in FORCES:
        assert float(table.values[name][0]) == pytest.approx(exact[name], rel=1e-12), name
        assert float(values[name]) == pytest.approx(exact[name], rel=1e-12), name
    np.testing.assert_allclose(table.force[0], components, rtol=1e-11, atol=1e-8)


def integral(table, weights, name):
    return float(np.asarray(table.values[name]) @ weights)


@pytest.mark.parametrize("bank", [0.0, 0.1])
def test_the_work_of_the_forces_is_the_change_of_energy(bank):
    """∫P dt = ΔE + ∫½ρC_dA v³ dt + C_rr ∫F_b v dt, by Gauss's quadrature, which is exact to rounding here."""
    vehicle = qt.Vehicle(12e3, drag_area=6.0, rolling_resistance=0.007, bank=bank)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    times, weights = 2.25 * (nodes + 1), 2.25 * weights
    outputs = ("power", "force", "velocity", "speed", "normal_load")
    table = qt.evaluate(PATH, times, outputs, qt.Upright(), vehicle=vehicle, axes="inertial")
    ends = qt.evaluate(PATH, [0.0, 4.5], ("speed", "position"))
    energy = np.diff(12e3 * (0.5 * np.asarray(ends.speed) ** 2 + 9.80665 * np.asarray(ends.position)[:, 2]))[0]
    speed = np.asarray(table.speed)
    drag = 0.5 * 1.225 * 6.0 * (speed**3 @ weights)
    rolling = 0.007 * ((np.asarray(table.normal_load) * speed) @ weights)
    work = np.sum(np.asarray(table.force) * np.asarray(table.velocity), axis=1) @ weights
    scale = abs(energy) + drag + rolling
    assert abs(work - energy - drag) < BALANCE * scale
    assert abs(integral(table, weights, "power") - energy - drag - rolling) < BALANCE * scale
    assert drag > 1e-3 * scale  # otherwise the test would not see it
    assert rolling > 1e-3 * scale


def test_the_moment_is_that_of_eulers_equations():
    """The derivative of the angular momentum in inertial axes, by central differences."""
    program, J = qt.FrameProgram(PATH, qt.Upright()), np.diag([1e4, 5e4, 6e4])

    def momentum(t):
        at = program(t)
        return qt.quaternion.rotate(at.quaternion, jnp.asarray(J) @ at.rate)

    step = 1e-4
    expected = (momentum(1.3 + step) - momentum(1.3 - step)) / (2 * step)
    table = qt.evaluate(PATH, [1.3], ("moment",), qt.Upright(), vehicle=TRUCK, axes="inertial")
    np.testing.assert_allclose(table.moment[0], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_the_friction_of_a_level_road_is_that_of_dynamics():
    demand = qt.dynamics.friction_demand(PATH, 1.3, 1.0, 9.80665)
    vehicle = qt.Vehicle(1.0)  # μ = 1
    assert float(value(PATH, 1.3, "friction", vehicle.parameters())) == pytest.approx(float(demand.total), rel=1e-12)


def test_a_circle_at_the_speed_of_its_bank_needs_no_friction_across():
    """tan β = v²/(gR), the textbook's banked curve."""
    radius, speed = 50.0, 15.0
    circle = qt.SpiralHelix([radius], [0.0, speed / radius], [0.0], 5.0)
    bank = np.arctan(speed**2 / (9.80665 * radius))
    vehicle = qt.Vehicle(1e3, bank=bank)
    table = qt.evaluate(circle, [1.0], ("lateral_force", "normal_load", "friction"), vehicle=vehicle)
    assert float(table.lateral_force[0]) < 1e-9
    assert float(table.friction[0]) < 1e-12
    assert float(table.normal_load[0]) == pytest.approx(1e3 * np.hypot(9.80665, speed**2 / radius), rel=1e-13)


def test_a_crest_that_lifts_the_vehicle_off_has_no_grip():
    hill = qt.SpiralHelix([100.0], [0.0, 0.3], [0.0, 12.0, -6.0], 2.0)  # 12 m/s² downwards
    table = qt.evaluate(hill, [1.0], ("normal_load", "friction"), vehicle=qt.Vehicle(1e3))
    assert float(table.normal_load[0]) < 0
    assert np.isinf(table.friction[0])


def test_braking_has_negative_power_which_no_limit_bounds():
    slowing = qt.SpiralHelix([100.0], [0.0, 0.3, -0.02], [0.0], 4.0)
    limits = qt.Limits(power=1.0, vehicle=qt.Vehicle(1e3))
    assert float(limits.values(slowing, 1.0)["power"]) < -1e3
    assert float(limits.margins(slowing, 1.0)["power"]) > 1e3


@pytest.mark.parametrize("name", FORCES)
def test_derivatives_in_path_and_vehicle_are_those_of_differences(name):
    def of(x):
        path = qt.SpiralHelix(x[:4], x[4:7], x[7:11], 4.5)
        vehicle = qt.Vehicle(x[11], None, x[12], x[13], x[14:16], x[16])
        return value(path, 1.3, name, vehicle.parameters())

    x = jnp.concatenate([jnp.asarray(c) for c in (*COEFFICIENTS, [12e3, 6.0, 0.007, 0.6, 0.5, 0.1])])
    function = jax.jit(of)
    gradient, forward = jax.grad(function)(x), jax.jacfwd(function)(x)
    np.testing.assert_allclose(gradient, forward, rtol=1e-12, atol=1e-9 * np.abs(gradient).max())
    for k in range(x.size):
        h = 1e-5 * max(1e-2, abs(float(x[k])))
        step = jnp.zeros_like(x).at[k].set(h)
        difference = float(function(x + step) - function(x - step)) / (2 * h)
        assert float(gradient[k]) == pytest.approx(difference, rel=1e-5, abs=1e-6 * abs(float(function(x)))), k


def test_a_standstill_has_finite_forces_and_derivatives():
    start = qt.SpiralHelix([20.0], [0.0, 0.0, 0.05], [0.0], 4.0)
    for name in FORCES:
        number, slope = jax.value_and_grad(lambda t, name=name: value(start, t, name, TRUCK.parameters()))(0.0)
        assert np.isfinite(number), name
        assert not np.isnan(slope), name


def test_units_are_those_of_mechanics():
    assert units.base_powers("N") == {"kg": 1, "m": 1, "s": -2}
    assert units.base_powers("W") == {"kg": 1, "m": 2, "s": -3}
    assert units.per_time("W") == 3
    assert units.symbol("N m") == "N·m"
    assert units.base_powers("m s-2") == units.powers("m s-2")
    labelled = qt.evaluate(PATH, [1.0], FORCES, vehicle=TRUCK).to_xarray()
    assert labelled["power"].attrs["units"] == "W"
    assert labelled["normal_load"].attrs["units"] == "N"


def test_vehicles_are_data_and_do_not_recompile():
    traces = []

    @jax.jit
    def use(path, vehicle):
        traces.append(1)
        return value(path, 1.0, "friction", vehicle.parameters())

    assert use(PATH, TRUCK) != use(PATH, qt.Vehicle(1e3, (1.0, 2.0, 2.5), 0.5, 0.01, 0.9, -0.1))
    assert len(traces) == 1


def test_outputs_say_what_they_need():
    assert CHANNELS["moment"].needs == INERTIA
    assert {name for name, entry in CHANNELS.items() if entry.needs == VEHICLE} == {"force", *FORCES}
    assert set(outputs_with(TRUCK)) == set(CHANNELS)
    assert set(outputs_with(qt.Vehicle(1.0))) == set(CHANNELS) - {"moment"}


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.Vehicle(0.0), "mass of a vehicle must be positive"),
        (lambda: qt.Vehicle("heavy"), "mass of a vehicle must be a number [kg]"),
        (lambda: qt.Vehicle([1.0, 2.0]), "jax.vmap makes many vehicles"),
        (lambda: qt.Vehicle(1.0, drag_area=-1.0), "drag area of a vehicle must not be negative"),
        (lambda: qt.Vehicle(1.0, rolling_resistance=float("nan")), "rolling resistance of a vehicle must be finite"),
        (lambda: qt.Vehicle(1.0, friction=(0.5, 0.0)), "friction of a vehicle must be positive"),
        (lambda: qt.Vehicle(1.0, friction=(0.5, 0.5, 0.5)), "one number or two, along and across"),
        (lambda: qt.Vehicle(1.0, bank=1.6), "less than a right angle"),
        (lambda: qt.Vehicle(1.0, inertia=[1.0, -1.0, 1.0]), "positive principal moments"),
        (lambda: qt.Limits(friction=1.0), "the limit friction needs a vehicle"),
        (lambda: qt.Limits(friction=1.0, vehicle=12e3), "12000.0 was given"),
        (lambda: qt.peak(PATH, "power"), "the quantity power needs a vehicle"),
        (lambda: qt.evaluate(PATH, [0.0], ("force",)), "the output 'force' needs a vehicle"),
        (lambda: qt.evaluate(PATH, [0.0], ("moment",), vehicle=qt.Vehicle(1.0)), "'moment' needs an inertia"),
    ],
)
def test_invalid_input_raises_with_a_reason(make, fragment):
    with pytest.raises(ValueError) as caught:
        make()
    assert fragment in str(caught.value)


def test_a_vehicle_and_its_limits_are_stored(tmp_path):
    from qtraj.foundation import document

    limits = qt.Limits(friction=0.8, power=1e5, vehicle=TRUCK)
    document.save(limits, tmp_path / "limits.toml")
    again = document.load(tmp_path / "limits.toml")
    assert jax.tree.all(jax.tree.map(lambda a, b: bool(jnp.all(a == b)), limits, again))

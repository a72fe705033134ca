"""Forces of a vehicle along a path: Newton's second law with 30 digits, energy balance, derivatives, units."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import qtraj as qt
from qtraj.batch import executables
from qtraj.foundation import units
from qtraj.path.channel import CHANNELS, outputs_with
from qtraj.path.moment_quantities import MOMENTS
from qtraj.path.path_quantity import INERTIA, PRINCIPAL, VEHICLE, WHEELBASE
from qtraj.path.quantity import QUANTITIES, quantity
from qtraj.path.road_quantities import ROAD_QUANTITIES
from qtraj.path.sides import upper_side
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


MAGNITUDES = {name: quantity(name).variable for name in FORCES}
"""The outputs with the quantities that the limits bound."""


def newton(t, vehicle, coefficients=COEFFICIENTS):
    """All forces from the position alone, differentiated numerically with 30 digits, in world axes."""
    rho, phi, height = ([mpmath.mpf(x) for x in c] for c in coefficients)

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


DESCENDING = COEFFICIENTS[0], [0.2, -0.35, -0.02], [1.0, -0.9, -0.05, 0.01]  # to the right and downhill


@pytest.mark.parametrize("coefficients", [COEFFICIENTS, DESCENDING], ids=["left and up", "right and down"])
@pytest.mark.parametrize("t", [0.0, 1.3, 4.5])
def test_forces_are_those_of_newtons_second_law(t, coefficients):
    with mpmath.workdps(30):
        exact, components = newton(t, TRUCK, coefficients)
    path = qt.SpiralHelix(*coefficients, 4.5)
    table = qt.evaluate(path, [t], (*MAGNITUDES.values(), "force"), qt.Upright(), vehicle=TRUCK)
    values = qt.Limits(**dict.fromkeys(FORCES, 1.0), vehicle=TRUCK).values(path, t)
    for name in FORCES:
        assert float(table.values[MAGNITUDES[name]][0]) == pytest.approx(exact[name], rel=1e-12), name
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


def test_every_signed_quantity_has_its_magnitude():
    car = qt.Vehicle(12e3, TENSOR, wheelbase=3.0)
    signed = [name for name in QUANTITIES if upper_side(quantity(name)) != name]
    assert {"power", "normal_load", "longitudinal_acceleration"} <= set(signed)
    names = [x for name in signed for x in (name, f"{name}_magnitude") if CHANNELS[x].shape == ()]
    path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01, -0.002], [1.0, 0.4, 0.05, -0.01], 4.5)
    table = qt.evaluate(path, np.linspace(0.0, 4.5, 40), names, vehicle=car)
    for name in names[::2]:
        np.testing.assert_allclose(table[f"{name}_magnitude"], np.abs(table[name]), rtol=1e-9, atol=1e-12)
    assert (np.asarray(table.power) < 0).any()


TENSOR = np.array([[1e4, 1.5e3, -2e3], [1.5e3, 5e4, 3e3], [-2e3, 3e3, 5.5e4]])  # with products of inertia


@pytest.mark.parametrize("bank", [0.0, 0.5])
@pytest.mark.parametrize("frame", [qt.Upright(), qt.RotationMinimizing()], ids=["upright", "minimizing"])
def test_the_moment_is_that_of_eulers_equations(frame, bank):
    """The derivative of the angular momentum in inertial axes, by central differences; a bank rolls the body left."""
    program, vehicle = qt.FrameProgram(PATH, frame), qt.Vehicle(12e3, TENSOR, bank=bank)

    def momentum(t):
        at = program(t)
        lean = qt.quaternion.product(at.quaternion, jnp.asarray([np.cos(-bank / 2), np.sin(-bank / 2), 0.0, 0.0]))
        rate = qt.quaternion.rotate(qt.quaternion.conjugate(lean), qt.quaternion.rotate(at.quaternion, at.rate))
        return qt.quaternion.rotate(lean, jnp.asarray(TENSOR) @ rate)

    step = 1e-4
    expected = (momentum(1.3 + step) - momentum(1.3 - step)) / (2 * step)
    table = qt.evaluate(PATH, [1.3], ("moment",), frame, vehicle=vehicle, axes="inertial")
    np.testing.assert_allclose(table.moment[0], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_forces_do_not_depend_on_the_frame_except_for_their_axes():
    """With drag: in world axes the force is the same, also where the frame is integrated along the path."""
    upright, minimizing = (
        np.asarray(qt.evaluate(PATH, [1.3], ("force",), frame, vehicle=TRUCK, axes="inertial").force[0])
        for frame in (qt.Upright(), qt.RotationMinimizing())
    )
    np.testing.assert_allclose(minimizing, upright, rtol=1e-13)


def test_the_friction_of_a_level_road_is_that_of_dynamics():
    demand = qt.dynamics.friction_demand(PATH, 1.3, 1.0, 9.80665)
    vehicle = qt.Vehicle(1.0)  # μ = 1
    assert float(value(PATH, 1.3, "friction", vehicle.parameters())) == pytest.approx(float(demand.total), rel=1e-12)


def test_the_friction_of_a_banked_road_is_the_distance_to_the_ellipse():
    """Forces in axes with the road's normal as the vertical, and the ellipse's radius in their direction."""
    bank, grip = 0.2, (0.6, 0.4)
    natural = qt.trihedral(PATH, 1.3, qt.Upright())
    normal = np.cos(bank) * natural.binormal + np.sin(bank) * natural.normal
    x, y, z = np.asarray(qt.dynamics.forces(PATH, 1.3, 12e3, 9.80665, qt.Upright(normal)))
    radius = z / np.hypot(np.cos(np.arctan2(y, x)) / grip[0], np.sin(np.arctan2(y, x)) / grip[1])
    vehicle = qt.Vehicle(12e3, friction=grip, bank=bank)
    found = {name: float(value(PATH, 1.3, name, vehicle.parameters())) for name in FORCES}
    assert found["friction"] == pytest.approx(np.hypot(x, y) / radius, rel=1e-12)
    assert found["lateral_force"] == pytest.approx(abs(y), rel=1e-12)
    assert found["normal_load"] == pytest.approx(z, rel=1e-12)


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


@pytest.mark.parametrize("t", [0.0, 1e-7])
def test_forces_at_a_standstill_are_their_limits(t):
    """From rest in a circle with 0.1 rad/s², bank to the left: along m·2 m/s², and the weight in the banked road."""
    start = qt.SpiralHelix([20.0], [0.0, 0.0, 0.05], [0.0], 4.0)
    mass, weight = 12e3, 12e3 * 9.80665
    along, beside, load = mass * 2.0, weight * np.sin(0.1), weight * np.cos(0.1)
    expected = (along, beside, load, np.hypot(along / 0.6, beside / 0.5) / load, (along + 0.007 * load) * 2.0 * t)
    table = qt.evaluate(start, [t], tuple(MAGNITUDES.values()), vehicle=TRUCK)
    for name, exact in zip(FORCES, expected, strict=True):
        tolerance = {"rel": 1e-6, "abs": 1e-9}
        assert float(table.values[MAGNITUDES[name]][0]) == pytest.approx(exact, **tolerance), name
        number, slope = jax.value_and_grad(lambda t, name=name: value(start, t, name, TRUCK.parameters()))(t)
        assert number == pytest.approx(exact, **tolerance), name
        assert not np.isnan(slope), name


@pytest.mark.parametrize("acceleration", [0.0, 1.0], ids=["smooth", "abrupt"])
def test_a_route_from_rest_to_rest_has_forces_at_both_ends(acceleration):
    """At the end the direction is the one before the stop, also where the velocity has a zero of order two."""
    states = [[0.0, 0.0, 0.0], [8.0, 0.0, 1.0]], np.zeros((2, 3)), acceleration * np.array([[8.0, 0, 1], [-8.0, 0, -1]])
    route = qt.Route([0.0, 4.0], *states)
    slope = np.arctan2(1.0, 8.0)
    table = qt.evaluate(route, [0.0, 1e-7, 4.0 - 1e-7, 4.0], FORCES, vehicle=TRUCK)
    load = 12e3 * 9.80665 * np.cos(slope) * np.cos(0.1)
    push = 12e3 * (9.80665 * np.sin(slope) + acceleration * np.hypot(8.0, 1.0) * np.array([1.0, -1.0]))
    np.testing.assert_allclose(table.normal_load, load, rtol=1e-6)
    np.testing.assert_allclose(np.asarray(table.longitudinal_force)[[0, 3]], push, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(table.longitudinal_force)[[1, 2]], push, rtol=1e-5)
    np.testing.assert_allclose(np.asarray(table.power)[[0, 3]], 0.0)


def test_a_parked_vehicle_stands_on_a_level_road_with_its_bank():
    parked = qt.Route([0.0, 1.0], [[1.0, 2.0, 3.0]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    table = qt.evaluate(parked, [0.5], tuple(MAGNITUDES.values()), vehicle=TRUCK)
    expected = 0.0, 12e3 * 9.80665 * np.sin(0.1), 12e3 * 9.80665 * np.cos(0.1), np.tan(0.1) / 0.5, 0.0
    for name, exact in zip(FORCES, expected, strict=True):
        assert float(table.values[MAGNITUDES[name]][0]) == pytest.approx(exact, rel=1e-12), name


def test_a_vertical_path_has_no_load_and_no_grip():
    up = qt.Curve(lambda t: jnp.stack([0.0 * t, 0.0 * t, 5.0 * t + t**2]), 1.0)
    vehicle = qt.Vehicle(1e3)
    assert float(value(up, 0.5, "longitudinal_force", vehicle.parameters())) == pytest.approx(1e3 * 11.80665, rel=1e-12)
    assert float(value(up, 0.5, "normal_load", vehicle.parameters())) == 0.0
    assert np.isinf(value(up, 0.5, "friction", vehicle.parameters()))


def test_the_drive_overcomes_the_rolling_resistance_which_needs_no_grip():
    """At constant speed on the level the net force of the road is zero, and the drive's power is C_rr·m·g·v."""
    straight = qt.Route([0.0, 2.0], [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]], [[5.0, 0, 0]] * 2, np.zeros((2, 3)))
    table = qt.evaluate(straight, [1.0], FORCES, vehicle=qt.Vehicle(1e3, rolling_resistance=0.02))
    assert float(table.longitudinal_force[0]) < 1e-9
    assert float(table.friction[0]) < 1e-12
    assert float(table.power[0]) == pytest.approx(0.02 * 1e3 * 9.80665 * 5.0, rel=1e-12)


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


@pytest.fixture(scope="module")
def fleet():
    """Five paths, and a vehicle for each."""
    x = jnp.linspace(0.9, 1.3, 5)
    paths = jax.vmap(lambda k: qt.SpiralHelix(PATH.radius * k, PATH.angle, PATH.height, 4.5))(x)
    build = lambda k: qt.Vehicle(1e3 * k, k * jnp.diag(jnp.asarray([1.0, 2.0, 2.5])), k, 0.01 * k, 0.6 * k, 0.1 * k)  # noqa: E731
    return paths, jax.vmap(build)(x)


@pytest.mark.parametrize("frame", [qt.Upright(), qt.RotationMinimizing()], ids=["upright", "minimizing"])
def test_a_batch_of_vehicles_has_one_for_each_path(fleet, frame):
    paths, vehicles = fleet
    names = ("force", "moment", *FORCES)
    times = np.linspace(0.0, 4.5, 7)
    together = qt.evaluate(paths, times, names, frame, vehicle=vehicles)
    for k in (0, 3):
        path, vehicle = jax.tree.map(lambda x, k=k: x[k], (paths, vehicles))
        alone = qt.evaluate(path, times, names, frame, vehicle=vehicle)
        for name in names:
            np.testing.assert_allclose(together.values[name][k], alone.values[name], rtol=1e-12, atol=1e-9)


def test_a_batch_of_vehicles_is_reduced_split_into_blocks_and_differentiated(fleet, monkeypatch):
    paths, vehicles = fleet
    times = np.linspace(0.0, 4.5, 9)
    whole = qt.evaluate(paths, times, ("power",), vehicle=vehicles).power
    for name in ("_writing", "_reduction"):  # without the stored executables
        monkeypatch.setattr(executables, name, getattr(executables, name).__wrapped__)
    monkeypatch.setattr(executables, "_samples", lambda _: 18)  # two paths in a block, and one in the last
    names = ("power", "speed")
    np.testing.assert_allclose(qt.evaluate(paths, times, names, vehicle=vehicles).power, whole, rtol=1e-12)
    peaks = qt.evaluate(paths, times, names, vehicle=vehicles, reduce="max")
    np.testing.assert_allclose(peaks.values["power"], whole.max(axis=1), rtol=1e-12)
    total = lambda v: qt.evaluate(paths, times, names, vehicle=v).power.sum()  # noqa: E731
    slope = jax.grad(total)(vehicles).mass  # power is proportional to the mass, except for the drag
    level = eqx.tree_at(lambda v: v.drag_area, vehicles, jnp.zeros(5))
    expected = qt.evaluate(paths, times, names, vehicle=level).power.sum(axis=1) / vehicles.mass
    np.testing.assert_allclose(slope, expected, rtol=1e-10)


def test_one_vehicle_with_a_batch_of_masses_shares_its_other_parameters(fleet):
    paths, _ = fleet
    masses = jnp.asarray([1.0, 2.0, 3.0, 4.0, 5.0])
    mixed = eqx.tree_at(lambda v: v.mass, qt.Vehicle(1.0), masses)
    load = qt.evaluate(paths, [1.0], ("normal_load",), vehicle=mixed).normal_load[:, 0]
    unit = qt.evaluate(paths, [1.0], ("normal_load",), vehicle=qt.Vehicle(1.0)).normal_load[:, 0]
    np.testing.assert_allclose(load, masses * unit, rtol=1e-14)


def test_another_number_of_vehicles_is_refused(fleet):
    paths, vehicles = fleet
    three = jax.tree.map(lambda x: x[:3], vehicles)
    with pytest.raises(ValueError, match=r"or 5 vehicles \(one for each path\), but .* shape \(3,\)"):
        qt.evaluate(paths, [0.0], ("friction",), vehicle=three)
    with pytest.raises(ValueError, match=r"the one path, .* shape \(3,\): .* over the vehicles with jax.vmap"):
        qt.evaluate(PATH, [0.0], ("friction",), vehicle=three)


def test_outputs_say_what_they_need():
    assert CHANNELS["moment"].needs == INERTIA
    assert {name for name, entry in CHANNELS.items() if entry.needs == VEHICLE} == {
        "force",
        *FORCES,
        *MAGNITUDES.values(),
        "normal_load_magnitude",
        "power_magnitude",
    }
    assert {name for name, entry in CHANNELS.items() if entry.needs == PRINCIPAL} == set(MOMENTS)
    steering = {name for name, entry in CHANNELS.items() if entry.needs == WHEELBASE}
    assert steering == {"steering_angle", "steering_rate", "steering_angle_magnitude", "steering_rate_magnitude"}
    assert set(outputs_with(qt.Vehicle(1.0, inertia=[1.0, 2.0, 2.5], wheelbase=2.0))) == set(CHANNELS)
    assert set(outputs_with(TRUCK)) == set(CHANNELS) - set(MOMENTS) - steering  # its bank rolls the principal axes
    assert set(outputs_with(qt.Vehicle(1.0))) == set(CHANNELS) - {"moment", *MOMENTS} - steering


def two_vehicles():
    return jax.vmap(qt.Vehicle)(jnp.ones(2))


def two_limits():
    return jax.vmap(lambda x: qt.Limits(speed=x))(jnp.ones(2))


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.Vehicle(0.0), "mass of a vehicle must be positive"),
        (lambda: qt.Vehicle("heavy"), "mass of a vehicle must be a number [kg]"),
        (lambda: qt.Vehicle([1.0, 2.0]), "many vehicles with jax.vmap"),
        (lambda: qt.Vehicle(1.0, drag_area=-1.0), "drag area of a vehicle must not be negative"),
        (lambda: qt.Vehicle(1.0, rolling_resistance=float("nan")), "rolling resistance of a vehicle must be finite"),
        (lambda: qt.Vehicle(1.0, friction=(0.5, 0.0)), "friction of a vehicle must be positive"),
        (lambda: qt.Vehicle(1.0, friction=(0.5, 0.5, 0.5)), "one number, or two (along and across"),
        (lambda: qt.Vehicle(1.0, bank=3.0), "between -pi/2 and pi/2 rad (3 degrees are 0.0524 rad), but 3.0"),
        (lambda: qt.Vehicle(True), "mass of a vehicle must be a number [kg], but True"),
        (lambda: qt.Vehicle(1.0, inertia="wet"), "vehicle: "),
        (lambda: qt.Vehicle(1.0, inertia=float("nan")), "vehicle: the inertia must be finite"),
        (lambda: qt.Vehicle(1.0, inertia=[1.0, 1.0, 100.0]), "exceeds the sum of the other two"),
        (lambda: qt.evaluate(PATH, [0.0], ("speed",), vehicle=12e3), "needs a vehicle, but 12000.0 was given"),
        (lambda: qt.peak(PATH, "power", jax.vmap(qt.Vehicle)(jnp.ones(2))), "one path and one vehicle"),
        (lambda: qt.certify(PATH, two_limits()), "but the batch shape of the path is ()"),
        (
            lambda: qt.certify(PATH, qt.Limits(power=1.0, vehicle=two_vehicles())),
            "the vehicle has the batch shape (2,)",
        ),
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

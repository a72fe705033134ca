"""Quantities of one's own: equal to those of the registry where they are the same, proved or sampled, and refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.document import save

CURVATURE = qt.Quantity("own_curvature", "1/m", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**3)
LATERAL = qt.Quantity("own_lateral", "m/s^2", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed)
LONGITUDINAL = qt.Quantity("own_longitudinal", "m/s²", lambda p: p.velocity.dot(p.acceleration) / p.speed)
CLIMB = qt.Quantity("climb_rate", "m/s", lambda p: p.velocity[2])
HEIGHT = qt.Quantity("altitude", "m", lambda p: p.position[2])
SINE = qt.Quantity("heading_sine", "1", lambda p: jnp.sin(p.velocity[0] / p.speed))


def own_friction(p):
    """The friction of a vehicle without drag on a level road, from its definition."""
    g = p.vehicle.gravity
    along, across = p.vehicle.friction
    level = (p.speed**2 - p.velocity[2] ** 2) ** 0.5
    forward = (p.velocity.dot(p.acceleration) + g * p.velocity[2]) / p.speed
    left = p.velocity.cross(p.acceleration)[2] / level
    load = ((p.acceleration[2] + g) * p.speed**2 - p.velocity[2] * forward * p.speed) / (p.speed * level)
    return qt.sqrt((forward / along) ** 2 + (left / across) ** 2) / load


FRICTION = qt.Quantity("own_friction", "1", own_friction)
VEHICLE = qt.Vehicle(mass=1200.0, friction=(1.1, 0.9))
PAIRS = {
    "curvature": CURVATURE,
    "lateral_acceleration": LATERAL,
    "longitudinal_acceleration": LONGITUDINAL,
    "vertical_speed": CLIMB,
    "friction": FRICTION,
}


def route_of(seed, n=5, stop=False):
    rng = np.random.default_rng(seed)
    position = np.cumsum(rng.normal(size=(n, 3)) * [1, 1, 0.2] + np.array([6.0, 0.0, 0.0]), axis=0)
    velocity = rng.normal(size=(n, 3)) * [0.5, 0.5, 0.1] + np.array([4.0, 0.0, 0.0])
    acceleration = rng.normal(size=(n, 3)) * 0.4
    if stop:
        velocity[0], velocity[-1] = 0.0, 0.0
        acceleration[0], acceleration[-1] = [1.0, 0.2, 0.0], [-1.0, 0.1, 0.0]
    return qt.Route(np.arange(n) * 1.6, position, velocity, acceleration)


HELIX = qt.SpiralHelix([20.0, 0.1, 0.02], [0.0, 0.3, 0.01], [0.0, 0.5, 0.1], 8.0)
TILTED = qt.SpiralHelix(
    [20.0, 0.1, 0.02], [0.0, 0.3, 0.01], [0.0, 0.5, 0.1], 8.0, qt.Placement([1.0, 2.0, 3.0], [1.0, 0.2, 0.1, 0.0])
)
PATHS = [route_of(0), route_of(1, stop=True), HELIX, TILTED]


@pytest.mark.parametrize("path", PATHS)
def test_values_are_those_of_the_registry(path):
    t = np.linspace(0.05, 0.95, 41) * float(path.duration)
    table = qt.evaluate(path, t, (*PAIRS, *PAIRS.values()), vehicle=VEHICLE)
    for name, quantity in PAIRS.items():
        np.testing.assert_allclose(table[quantity], table[name], rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("path", PATHS)
def test_statuses_are_those_of_the_registry(path):
    """Also with limits at the largest value, and for segments that start or end at a stop."""
    t = np.linspace(0.0, 1.0, 801) * float(path.duration)
    table = qt.evaluate(path, t, tuple(PAIRS), vehicle=VEHICLE)
    largest = {name: float(np.nanmax(np.abs(table[name]))) for name in PAIRS}
    for factor in (0.9, 1.1, 3.0):
        bounds = {name: min(factor * x, 1e3) for name, x in largest.items()}
        limits = qt.Limits(**bounds, own={PAIRS[name]: x for name, x in bounds.items()}, vehicle=VEHICLE)
        found = qt.certify(path, limits)
        for name, quantity in PAIRS.items():
            assert found.status[name] == found.status[quantity.name], (name, factor)
            if found.status[name] != "undefined":
                np.testing.assert_allclose(found.worst[name][:2], found.worst[quantity.name][:2], rtol=1e-6, atol=1e-9)


def test_margins_and_peaks_are_those_of_the_registry():
    limits = qt.Limits(longitudinal_acceleration=(-2, 1), curvature=0.1, own={LONGITUDINAL: (-2, 1), CURVATURE: 0.1})
    margins = limits.margins(HELIX, 2.5)
    for side in ("_min", "_max"):
        assert margins[f"own_longitudinal{side}"] == pytest.approx(margins[f"longitudinal_acceleration{side}"])
    assert qt.peak(HELIX, CURVATURE) == pytest.approx(qt.peak(HELIX, "curvature"))


def test_tuning_gives_the_same_path():
    start = qt.BoundaryState([20.0, 0, 0], [0.2, 6, 0.5])
    end = qt.BoundaryState([0, 22.0, 6], [-6.6, 0.2, 0.5])
    built_in = qt.Limits(lateral_acceleration=1.9, longitudinal_acceleration=(-1, 1.2))
    own = qt.Limits(own={LATERAL: 1.9, LONGITUDINAL: (-1, 1.2)})
    a, b = (qt.tune(start, end, x, motion="hermite", duration=6.0) for x in (built_in, own))
    assert b.certificate.holds
    assert float(b.objective) == pytest.approx(float(a.objective), rel=1e-7)


def test_tuning_of_a_route_within_own_limits():
    found = qt.tune_route(route_of(3), qt.Limits(own={CLIMB: (-0.2, 0.2)}), tube=1.0)
    assert found.certificate.holds


def test_a_retimed_path_proves_own_quantities():
    timed = qt.retime(route_of(0), qt.Limits(speed=6.0, lateral_acceleration=3.0))
    status = qt.certify(timed.path, qt.Limits(own={CURVATURE: 5.0, LATERAL: 3.1, HEIGHT: (-50, 50)})).status
    assert status == {
        "own_curvature": "proved",
        "own_lateral": "proved",
        "altitude_min": "proved",
        "altitude_max": "proved",
    }


def test_positions_on_a_route_far_from_the_origin():
    """The origin of a route is added exactly: a limit one unit in the last place below the height is violated."""
    route = qt.Route([0.0, 2.0], [[0, 0, 1e6], [4, 0, 1e6 + 3]], [[2, 0, 0], [2, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    top = 1e6 + 3
    assert qt.certify(route, qt.Limits(own={HEIGHT: (None, top * (1 + 1e-12))})).holds
    assert qt.certify(route, qt.Limits(own={HEIGHT: (None, top - 1e-6)})).status["altitude_max"] == "broken"


def test_a_parked_vehicle_has_a_height_and_the_value_of_a_constant():
    p = [[0, 0, 2.0]] * 2
    route = qt.Route([0.0, 1.0], p, np.zeros((2, 3)), np.zeros((2, 3)))
    faster = qt.Quantity("faster", "m/s", lambda p: p.speed + 3.0)
    status = qt.certify(route, qt.Limits(own={HEIGHT: (1.0, 1.5), faster: 2.9, CURVATURE: 0.1})).status
    assert status == {
        "altitude_min": "proved",
        "altitude_max": "broken",
        "faster": "broken",
        "own_curvature": "proved",
    }


@pytest.mark.parametrize(
    ("function", "status"),
    [
        (lambda p: p.velocity[1] / p.velocity[0], "proved"),
        (lambda p: p.velocity[0] / p.velocity[1], "undefined"),
        (lambda p: p.velocity[0] / (p.velocity[1] + 0.5 * p.velocity[0]), "proved"),
        (lambda p: qt.sqrt(p.velocity[0] * p.speed) / p.speed, "proved"),
        (lambda p: qt.sqrt(p.velocity[1] * p.speed) / p.speed, "undefined"),
        (lambda p: qt.sqrt(p.velocity[1] ** 2) / p.speed, "proved"),
    ],
)
def test_divisors_and_radicands(function, status):
    """A quantity that divides by zero or takes the root of a negative number on the path is undefined."""
    route = qt.Route([0.0, 2.0], [[0, 0, 0], [8, 0, 0]], [[4, 1, 0], [4, -0.9, 0]], [[0, 0, 0], [0, 0, 0]])
    found = qt.certify(route, qt.Limits(own={qt.Quantity("mine", "1", function): (None, 1e3)}))
    assert set(found.status.values()) == {status}
    if status == "undefined":
        assert "divides by zero" in str(found)


def test_a_radicand_that_touches_zero_is_no_error():
    helix_climb = qt.Quantity("mine", "m/s", lambda p: qt.sqrt(p.speed**2 - p.velocity[2] ** 2) - p.velocity[2])
    assert qt.certify(HELIX, qt.Limits(own={helix_climb: (0.0, 30.0)})).holds


def test_horizontal_parts_are_proved_on_spiral_helices():
    """x² + y² does not depend on the directions of x and y, however it is written."""
    one = qt.Quantity("level_speed", "m/s", lambda p: qt.sqrt(p.velocity[0] ** 2 + p.velocity[1] ** 2))
    other = qt.Quantity("level_speed", "m/s", lambda p: (p.speed**2 - p.velocity[2] ** 2) ** 0.5)
    assert one == other
    assert qt.certify(HELIX, qt.Limits(own={one: 30.0})).status == {"level_speed": "proved"}
    speed = qt.Quantity("own_speed", "m/s", lambda p: qt.sqrt(sum(x * x for x in p.velocity)))
    assert speed == qt.Quantity("own_speed", "m/s", lambda p: p.speed)


def test_a_function_that_is_not_a_formula_is_sampled():
    assert not SINE.provable
    assert "sampled" in repr(SINE)
    for path in (route_of(0), HELIX):
        t = np.linspace(0, float(path.duration), 2001)
        largest = float(np.max(qt.evaluate(path, t, [SINE])[SINE]))
        status = [qt.certify(path, qt.Limits(own={SINE: (None, largest + x)})).status for x in (1e-3, -1e-3)]
        assert [x["heading_sine_max"] for x in status] == ["sampled", "broken"]


def test_components_along_x_on_a_spiral_helix_are_sampled_and_heights_proved_if_its_axis_is_vertical():
    east = qt.Quantity("east_speed", "m/s", lambda p: p.velocity[0])
    t = np.linspace(0, 8.0, 2001)
    for path, height in ((HELIX, "proved"), (TILTED, "sampled")):
        table = qt.evaluate(path, t, ("velocity", "position", east, HEIGHT))
        np.testing.assert_allclose(table[east], table.velocity[:, 0], atol=1e-12)
        np.testing.assert_allclose(table[HEIGHT], table.position[:, 2], atol=1e-12)
        limits = qt.Limits(own={east: float(np.abs(table[east]).max()) + 1e-3, CURVATURE: 1.0, HEIGHT: (None, 100.0)})
        assert [*qt.certify(path, limits).status.values()] == ["sampled", "proved", height]
        along = qt.Along([0, 5], [100.0, 99.0])
        assert qt.certify(path, qt.Limits(own={HEIGHT: (None, along)})).status == {"altitude_max": height}


def test_limits_that_change_along_the_way():
    route = route_of(0)
    along = qt.Along([0.0, 10.0], [8.0, 7.5], kind="linear")
    own = qt.Quantity("own_speed", "m/s", lambda p: p.speed)
    found = qt.certify(route, qt.Limits(speed=along, own={own: along}))
    assert found.status["speed"] == found.status["own_speed"] == "proved"
    assert found.worst["speed"] == pytest.approx(found.worst["own_speed"])


def test_values_under_jit_and_their_gradients():
    def largest(scale):
        path = qt.SpiralHelix([20.0, 0.1], [0.0, 0.3 * scale], [0.0, 0.5], 8.0)
        return qt.evaluate(path, np.linspace(0, 8.0, 5), [LATERAL])[LATERAL].max()

    derivative = (largest(1.0 + 1e-6) - largest(1.0 - 1e-6)) / 2e-6
    assert float(jax.jit(jax.grad(largest))(1.0)) == pytest.approx(float(derivative), rel=1e-6)


def test_limits_show_their_own_quantities():
    assert repr(qt.Limits(speed=9.0, own={CLIMB: (-2.0, 3.0), LATERAL: 4.0})) == (
        "Limits(speed=9 m/s, own={climb_rate: (-2, 3) m/s, own_lateral: 4 m/s²})"
    )


def test_equal_formulas_are_the_same_quantity():
    again = qt.Quantity("climb_rate", "m/s", lambda p: 1.0 * p.velocity[2])
    other = qt.Quantity("climb_rate", "m/s", lambda p: 2.0 * p.velocity[2])
    assert again == CLIMB
    assert hash(again) == hash(CLIMB)
    assert other != CLIMB
    with pytest.raises(ValueError, match="two quantities with the name climb_rate"):
        qt.Limits(own={CLIMB: 1.0, other: 1.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("climb", "m", lambda p: p.velocity[2]), "has the unit m/s, but the unit 'm' was given"),
        (("climb", "m", lambda p: jnp.cos(p.velocity[2] / p.speed) * p.speed), "has the unit m/s"),
        (("climb", "furlong", lambda p: p.velocity[2]), "is not a unit"),
        (("climb", "m/s", lambda p: p.velocity), "must return one number.*a vector"),
        (("climb", "m/s", lambda p: jnp.stack([p.speed, p.speed])), "must return one number|fails"),
        (("climb", "m/s", lambda p: 3.0), "does not depend on the motion"),
        (("climb", "m/s", lambda p: p.velocty), "has no 'velocty'"),
        (("climb", "m/s", lambda p: p.vehicle.colour), "has no 'colour'"),
        (("curvature", "1/m", lambda p: p.speed), "is taken"),
        (("height", "m", lambda p: p.position[2]), "is taken"),
        (("climb_min", "m/s", lambda p: p.speed), "is taken"),
        (("a b", "m/s", lambda p: p.speed), "identifier"),
        (("climb", "m/s", lambda p: p.speed / 0), "divides by zero"),
    ],
)
def test_wrong_quantities(arguments, message):
    with pytest.raises((ValueError, AttributeError), match=message):
        qt.Quantity(*arguments)


def test_what_does_not_support_an_own_quantity_says_so(tmp_path):
    start, end = qt.BoundaryState([20, 0, 0], [0, 6, 0.5]), qt.BoundaryState([0, 22, 6], [-6, 0, 0.5])
    east = qt.Quantity("east_speed", "m/s", lambda p: p.velocity[0])
    faster = qt.Quantity("faster", "m/s", lambda p: p.speed + 3.0)
    distance = qt.Quantity("distance", "m", lambda p: p.position.norm())
    for quantity, reason in (
        (east, "x or y"),
        (faster, "different units"),
        (SINE, "not a formula"),
        (distance, "more of the position"),
    ):
        with pytest.raises(ValueError, match=f"tune does not support the limit on {quantity.name}, .*{reason}"):
            qt.tune(start, end, qt.Limits(own={quantity: 1.0}))
    outwards = qt.Quantity("outwards", "m^2/s", lambda p: p.position.dot(p.velocity))
    with pytest.raises(ValueError, match=r"retime does not support the limit on outwards, .* the position.*certify"):
        qt.retime(route_of(0), qt.Limits(speed=5.0, own={outwards: 1.0}))
    limits = qt.Limits(own={SINE: 1.0})
    for stored in (limits, qt.certify(HELIX, limits)):
        with pytest.raises(ValueError, match="heading_sine of your own cannot be stored, because its function is not"):
            save(stored, tmp_path / "x.json")
    with pytest.raises(ValueError, match="own_friction needs a vehicle"):
        qt.Limits(own={FRICTION: 1.0})
    with pytest.raises(TypeError, match="keys of own must be quantities"):
        qt.Limits(own={"speed": 1.0})


def test_tables_and_figures_contain_own_quantities():
    route, limits = route_of(0), qt.Limits(speed=9.0, own={CLIMB: (-2.0, 2.0)})
    table = qt.evaluate(route, np.linspace(0, 6, 9), ("speed", CLIMB))
    assert table.climb_rate is table[CLIMB]
    assert table.to_xarray()["climb_rate"].attrs["units"] == "m s-1"
    table.plot("climb_rate")
    from qtraj.io.dataset import path_dataset
    from qtraj.viz.history import limits_figure

    dataset = path_dataset({"route": route}, limits, findings={"route": qt.certify(route, limits).whole})
    assert dataset["climb_rate"].attrs["limit"] == 2.0
    assert dataset["climb_rate"].attrs["lower_limit"] == -2.0
    assert any("climb" in axes.get_ylabel() for axes in limits_figure(dataset).axes)

"""Limits on the height: proved, tuned and drawn like those on other quantities, although it contains the position."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import qtraj as qt

ALTITUDE = qt.Quantity("altitude", "m", lambda p: p.position[2])
RISING = ([20.0, 0.1], [0.0, 0.3, 0.01], [0.5, 1.0, -0.2], 8.0)  # highest at 2.5 s, lowest at the end
TOP, BOTTOM = 0.5 + 1.25, 0.5 + 8.0 - 0.2 * 64
START, END = qt.BoundaryState([20, 0, 0.0], [1, 6, 1.5]), qt.BoundaryState([0, 20, 1.5], [-7, -1, -1.0])

JOINTS = 9
X = np.linspace(0.0, 80.0, JOINTS)
POSITIONS = np.stack([X, 3 * np.sin(X / 20), 100 + 1.5 * np.sin(X / 80 * np.pi) ** 2], axis=1)
VELOCITIES = np.gradient(POSITIONS, axis=0)
VELOCITIES[[0, -1], 2] = 0.0


def hill(positions=POSITIONS):
    """A route over a hill of 1.5 m, which starts and ends at 100 m."""
    return qt.Route(np.arange(JOINTS) * 1.0, positions, VELOCITIES, np.zeros((JOINTS, 3)))


def helix(origin=0.0, orientation=(1.0, 0.0, 0.0, 0.0)):
    return qt.SpiralHelix(*RISING, qt.Placement([3.0, -4.0, origin], orientation))


VERTICAL = [
    (qt.SpiralHelix(*RISING), BOTTOM, TOP),
    (helix(7.25), BOTTOM + 7.25, TOP + 7.25),
    (helix(-60.0), BOTTOM - 60.0, TOP - 60.0),
    (helix(7.25, (0.0, 0.6, 0.8, 0.0)), 7.25 - TOP, 7.25 - BOTTOM),  # its axis points down
]


@pytest.mark.parametrize(("path", "low", "high"), VERTICAL)
def test_both_sides_are_decided_next_to_the_extremes(path, low, high):
    for factor, status in ((1e-9, "proved"), (-1e-9, "broken")):
        for bounds in ((low - abs(low) * factor, None), (None, high + abs(high) * factor)):
            for limits in (qt.Limits(height=bounds), qt.Limits(own={ALTITUDE: bounds})):
                assert {*qt.certify(path, limits).status.values()} == {status}
    magnitude = max(abs(low), abs(high))
    assert qt.certify(path, qt.Limits(height=magnitude * (1 + 1e-9))).status == {"height": "proved"}
    assert qt.certify(path, qt.Limits(height=magnitude * (1 - 1e-9))).status == {"height": "broken"}
    assert float(qt.peak(path, "height")[1]) == pytest.approx(magnitude, rel=1e-14)


def test_an_inclined_axis_is_sampled_in_world_axes():
    path = helix(7.0, (1.0, 0.2, 0.1, 0.0))
    z = np.asarray(qt.evaluate(path, np.linspace(0, 8.0, 20_001), ("position",)).position)[:, 2]
    found = qt.certify(path, qt.Limits(height=(float(z.min()) - 1e-6, float(z.max()) + 1e-6)))
    assert found.status == {"height_min": "sampled", "height_max": "sampled"}
    assert found.worst["height_max"][1] == pytest.approx(z.max(), abs=1e-6)
    assert qt.certify(path, qt.Limits(height=(None, float(z.max()) - 1e-6))).status == {"height_max": "broken"}


def test_routes_with_and_without_stops_shapes_and_timings_are_proved():
    stopping = qt.Route([0.0, 4.0], [[0, 0, -2.0], [9, 1, 3.0]], np.zeros((2, 3)), [[1, 0, 0.5], [-1, 0, -0.5]])
    timed = qt.retime(hill(), qt.Limits(speed=12.0, longitudinal_acceleration=2.0))
    for path in (hill(), stopping, timed.path, qt.Shape(hill())):
        z = 101.5 if path is not stopping else 3.0
        if path is stopping:
            z = float(qt.evaluate(path, np.linspace(0, 4.0, 40_001), ("height",)).height.max())
        near = 1e-9 if path is not stopping else 1e-6
        for limits in (lambda x: qt.Limits(height=(None, x)), lambda x: qt.Limits(own={ALTITUDE: (None, x)})):
            assert {*qt.certify(path, limits(z * (1 + near))).status.values()} == {"proved"}
            assert {*qt.certify(path, limits(z * (1 - near))).status.values()} == {"broken"}


def test_a_parked_vehicle_is_at_a_height():
    route = qt.Route([0.0, 1.0], [[0, 0, -2.5]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    status = qt.certify(route, qt.Limits(height=(-2.4, -2.0))).status
    assert status == {"height_min": "broken", "height_max": "proved"}


@pytest.mark.parametrize("z", [-2.5, 0.1, 3.3])
@pytest.mark.parametrize("ulps", [-1, 0, 1])
def test_a_height_exactly_at_its_bound_is_decided(z, ulps):
    route = qt.Route([0.0, 1.0], [[0, 0, z]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    bound = z + ulps * np.spacing(z)  # the spacing has the sign of z
    above, below = bound >= z, bound <= z
    both = qt.certify(route, qt.Limits(height=(bound, z + 1))).status["height_min"]
    assert both == ("proved" if below else "broken")
    assert qt.certify(route, qt.Limits(height=(z - 1, bound))).status["height_max"] == ("proved" if above else "broken")
    assert qt.certify(route, qt.Limits(height=abs(bound))).status["height"] == (
        "proved" if abs(bound) >= abs(z) else "broken"
    )


def test_values_batches_and_gradients():
    start = jnp.array([0.0, 1.0, 2.0])
    paths = jax.vmap(lambda z: qt.SpiralHelix([20.0], [0.0, 0.3], jnp.stack([z, 0.5]), 8.0))(start)
    found = qt.certify(paths, qt.Limits(height=(0.0, 5.5)))
    assert found.status["height_min"].tolist() == ["proved"] * 3
    assert found.status["height_max"].tolist() == ["proved", "proved", "broken"]
    np.testing.assert_allclose(found.values, [[0, 4], [1, 5], [2, 6]])
    table = qt.evaluate(helix(-5.0), [1.0, 8.0], ("height", "height_magnitude", ALTITUDE))
    np.testing.assert_allclose(table.height, [-3.7, BOTTOM - 5.0], rtol=1e-14)
    np.testing.assert_allclose(table.height_magnitude, [3.7, 5.0 - BOTTOM], rtol=1e-14)
    np.testing.assert_array_equal(table[ALTITUDE], table.height)
    assert float(qt.Limits(height=(0.0, 2.0)).margins(helix(), 1.0)["height_max"]) == pytest.approx(0.7)

    def highest(origin):  # the height rises with the origin, and shrinks with the slope of the axis
        path = qt.SpiralHelix(*RISING, qt.Placement(jnp.stack([0.0, 0.0, origin]), (1.0, 0.2, 0.1, 0.0)))
        return qt.certify(path, qt.Limits(height=100.0)).values[0]

    assert float(jax.grad(highest)(7.0)) == pytest.approx(1.0, rel=1e-12)


def lowest_change(top, duration):
    """The least objective "nearest" for a height limit, by SLSQP: only vertical velocities and the duration change."""
    speed = np.sqrt((37 + 2.25 + 51) / 2)
    u = np.linspace(0.0, 1.0, 4001)

    def heights(x):
        first, last = x[:2] * x[2] * duration
        return 1.5 * (3 * u**2 - 2 * u**3) + first * (u - 2 * u**2 + u**3) + last * (u**3 - u**2)

    found = minimize(
        lambda x: (x[0] - 1.5) ** 2 + (x[1] + 1.0) ** 2 + (speed * (x[2] - 1)) ** 2,
        [1.0, -0.5, 1.0],
        constraints={"type": "ineq", "fun": lambda x: top - heights(x).max()},
        method="SLSQP",
        options={"ftol": 1e-14},
    )
    return found.fun


@pytest.mark.parametrize("origin", [0.0, -50.0])
def test_tune_finds_the_nearest_path_below_a_height(origin):
    initial = qt.tune(START, END, qt.Limits(height=99.0), motion="hermite", starts=1)  # the given velocities
    reference = lowest_change(1.7, float(initial.path.duration))
    for limits in (qt.Limits(height=(-0.1, 1.7)), qt.Limits(own={ALTITUDE: (None, 1.7)})):
        found = qt.tune(START, END, limits, motion="hermite", placement=qt.Placement([0.0, 0.0, origin]))
        assert found.certificate.holds
        assert float(found.objective) == pytest.approx(reference, rel=1e-5)


def test_tune_in_uniform_motion_and_about_an_inclined_axis():
    assert qt.tune(START, END, qt.Limits(height=1.6), motion="uniform").certificate.holds
    inclined = qt.Placement([0.0, 0.0, 100.0], [1.0, 0.02, 0.01, 0.0])
    found = qt.tune(START, END, qt.Limits(height=(-0.1, 1.55)), motion="hermite", placement=inclined)
    assert found.certificate.met
    assert found.certificate.worst["height_max"][1] == pytest.approx(1.55, abs=1e-6)


def test_tune_accepts_an_end_exactly_at_the_limit_and_refuses_one_beyond():
    found = qt.tune(START, END, qt.Limits(height=(0.0, 1.7)), motion="hermite")
    assert found.certificate.holds
    beyond = qt.tune(START, END, qt.Limits(height=(0.2, None)), motion="hermite", starts=1)
    assert beyond.status == "infeasible"


def test_the_objective_of_tune_is_differentiable():
    def objective(top):
        return qt.tune(START, END, qt.Limits(height=(None, top)), motion="hermite", starts=1).objective

    difference = (objective(1.7 + 1e-4) - objective(1.7 - 1e-4)) / 2e-4
    assert float(jax.grad(objective)(1.7)) == pytest.approx(float(difference), rel=1e-4)


def test_tune_route_stays_below_a_height_as_below_a_ceiling():
    """The origin of the route counts; obstacles are other constraints with the same routes."""
    ceiling = qt.HalfSpace([0.0, 0.0, -1.0], -101.2)
    below = qt.tune_route(hill(), qt.Limits(height=(99.9, 101.2)), tube=1.0)
    own = qt.tune_route(hill(), qt.Limits(own={ALTITUDE: (99.9, 101.2)}), tube=1.0)
    avoiding = qt.tune_route(hill(), qt.Limits(keep_out=[ceiling]), tube=1.0)
    assert below.certificate.holds
    assert own.certificate.holds
    assert avoiding.certificate.holds
    assert float(own.objective) == pytest.approx(float(below.objective), rel=1e-9)
    assert float(avoiding.objective) == pytest.approx(float(below.objective), rel=5e-3)


def test_tune_route_treats_lower_bounds_as_upper_bounds_of_the_mirrored_route():
    mirrored = POSITIONS * [1, 1, -1] + [0, 0, 200.0]
    valley = qt.Route(np.arange(JOINTS) * 1.0, mirrored, VELOCITIES * [1, 1, -1], np.zeros((JOINTS, 3)))
    below = qt.tune_route(hill(), qt.Limits(height=(None, 101.2)), tube=1.0)
    above = qt.tune_route(valley, qt.Limits(height=(98.8, None)), tube=1.0)
    assert above.certificate.holds
    assert float(above.objective) == pytest.approx(float(below.objective), rel=1e-6)
    touching = qt.tune_route(hill(), qt.Limits(height=(100.0, 101.2)), tube=1.0)  # both ends are fixed at 100 m
    assert touching.certificate.holds
    stepped = qt.tune_route(hill(), qt.Limits(height=qt.Along([0.0, 40.0], [101.2, 101.3])), tube=1.0)
    assert stepped.certificate.holds
    with pytest.raises(ValueError, match="allow zero"):
        qt.tune_route(hill(), qt.Limits(height=(99.9, qt.Along([0.0, 40.0], [101.2, 101.3]))), tube=1.0)


def test_the_objective_of_tune_route_is_differentiable():
    def objective(x):
        heights = POSITIONS[:, 2] + x[1] * np.sin(X / 80 * np.pi) + x[2]
        raised = jnp.concatenate([jnp.asarray(POSITIONS[:, :2]), heights[:, None]], axis=1)
        route = qt.Route(np.arange(JOINTS) * 1.0, raised, VELOCITIES, np.zeros((JOINTS, 3)))
        return qt.tune_route(route, qt.Limits(height=(None, x[0])), tube=1.0).objective

    at, found = jnp.array([101.2, 0.0, 0.0]), jax.grad(objective)(jnp.array([101.2, 0.0, 0.0]))
    for k, step in enumerate(np.eye(3) * 1e-3):
        difference = (objective(at + step) - objective(at - step)) / 2e-3
        assert float(found[k]) == pytest.approx(float(difference), rel=5e-3)
    assert float(found[2]) == pytest.approx(-float(found[0]), rel=1e-9)

"""`retime` with limits on quantities of one's own, on both sides of the power, on the shape, and with obstacles."""

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.own_facts import is_linear

ROUTE = qt.Route(
    [0.0, 4.0, 8.0, 12.0],
    [[0.0, 0, 0], [20, 5, 1], [40, 0, 0], [60, -8, 2]],
    [[5.0, 0, 0], [5, 0, 0.2], [5, -1, 0], [5, 0, 0]],
    np.zeros((4, 3)),
)
HELIX = qt.SpiralHelix([20.0, 0.5], [0.0, 0.3], [0.0, 0.5], 10.0)
STOPPING = qt.Route(
    [0.0, 4.0, 6.0, 10.0],
    [[0.0, 0, 0], [20, 3, 0], [20, 3, 0], [40, 6, 1]],
    [[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [5, 1, 0]],
    [[1.0, 0, 0], [-1, -0.15, 0], [1, 0.15, 0.1], [0, 0, 0]],
)
LINE = qt.Shape.through([[0.0, 0, 0], [50, 0, 0], [100, 0, 0]])
CAR = qt.Vehicle(mass=1000.0, drag_area=0.7)
OTHERS = {"speed": 15.0, "lateral_acceleration": 3.0, "longitudinal_acceleration": 2.0}

SPEED = qt.Quantity("own_speed", "m/s", lambda p: p.speed)
CLIMB = qt.Quantity("climb", "m/s", lambda p: p.velocity[2])
SIDEWAYS = qt.Quantity("sideways", "m/s^2", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed)
ALONG = qt.Quantity("own_along", "m/s^2", lambda p: p.velocity.dot(p.acceleration) / p.speed)
SIZE = qt.Quantity("size", "m/s^2", lambda p: p.acceleration.norm())
RATE = qt.Quantity("own_jerk", "m/s^3", lambda p: p.jerk.norm())
BEND = qt.Quantity("bend", "1/m", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**3)
POWER = qt.Quantity(
    "own_power",
    "W",
    lambda p: (
        p.vehicle.mass
        * (p.acceleration.dot(p.velocity) + p.vehicle.gravity * p.velocity[2] + p.vehicle.drag * p.speed**3)
    ),
)
EXACT = 1e-6
"""Relative difference of two durations whose searches have the same cells."""


def timed(path, start_speed=0.0, end_speed=0.0, **limits):
    found = qt.retime(path, qt.Limits(**limits), start_speed=start_speed, end_speed=end_speed)
    assert found.certificate.holds, found.result
    assert found.converged, found.result
    return found


@pytest.mark.parametrize(
    ("quantity", "limit", "built_in", "path", "exact"),
    [
        (SPEED, 8.0, {"speed": 8.0}, ROUTE, True),
        (SIDEWAYS, 3.0, {"lateral_acceleration": 3.0}, HELIX, False),
        (ALONG, (-3.0, 1.0), {"longitudinal_acceleration": (-3.0, 1.0)}, ROUTE, False),
        (SIZE, 3.0, {"acceleration": 3.0}, ROUTE, True),
        (CLIMB, (-0.2, 0.3), {"vertical_speed": (-0.2, 0.3)}, HELIX, True),
        (RATE, 2.0, {"jerk": 2.0}, HELIX, True),
        (POWER, (None, 1e4), {"power": 1e4, "vehicle": CAR}, ROUTE, True),
    ],
)
def test_quantity_equal_to_a_built_in_one_has_the_same_duration(quantity, limit, built_in, path, exact):
    """Each duration is proved to within its gap of the minimum, and exact where both searches have the same cells."""
    others = {name: x for name, x in OTHERS.items() if name not in built_in}
    vehicle = {"vehicle": CAR} if quantity is POWER else {}
    first = timed(path, **(others | built_in))
    second = timed(path, **others, **vehicle, own={quantity: limit})
    tolerance = EXACT if exact else max(float(first.gap), float(second.gap))
    np.testing.assert_allclose(second.duration, first.duration, rtol=tolerance)


FORWARD = qt.Quantity("forward", "m/s^2", lambda p: p.acceleration[0] - 0.5 * p.acceleration[1])


@pytest.mark.parametrize("quantity", [ALONG, FORWARD])
def test_own_limits_along_a_straight_line_bound_the_duration(quantity):
    """From rest to rest, braking with 6 m/s² and accelerating with 2 m/s²: √(2·100·(1/2 + 1/6)) s."""
    exact = np.sqrt(200.0 * (1 / 2 + 1 / 6))
    found = timed(LINE, own={quantity: (-6.0, 2.0)})
    np.testing.assert_allclose(found.duration, exact, rtol=1e-3)
    assert 0.0 < float(found.gap) < 1e-3
    assert float(found.duration) * (1 - float(found.gap)) <= exact * (1 + 1e-6)


@pytest.mark.parametrize("quantity", [ALONG, FORWARD])
def test_own_limits_raise_the_lower_bound_on_the_duration(quantity):
    """The bound is that of the relaxed timing with the limit, which is above the one of the other limits."""
    others = {"speed": 15.0, "lateral_acceleration": 3.0}
    free = timed(ROUTE, **others, own={SIZE: 60.0})
    found = timed(ROUTE, **others, own={quantity: (-3.0, 1.0)})
    assert float(found.duration) > 1.05 * float(free.duration)
    assert float(found.gap) < 0.01


@pytest.mark.parametrize(
    ("function", "unit", "linear"),
    [
        (lambda p: p.velocity.dot(p.acceleration) / p.speed, "m/s^2", True),
        (lambda p: 2 * p.acceleration[0] + p.velocity[2] * p.acceleration[2] / p.speed, "m/s^2", True),
        (lambda p: p.velocity.cross(p.acceleration)[2] / p.speed, "m/s^2", True),
        (lambda p: p.acceleration.norm(), "m/s^2", False),
        (lambda p: abs(p.acceleration[0]), "m/s^2", False),
        (lambda p: p.acceleration[0] ** 2 / p.acceleration.norm(), "m/s^2", False),
        (lambda p: p.velocity.dot(p.acceleration), "m^2/s^3", False),
        (lambda p: p.acceleration[2] + p.vehicle.gravity, "m/s^2", False),
    ],
)
def test_quantities_that_are_linear_in_the_acceleration_are_known(function, unit, linear):
    found = qt.Quantity("mine", unit, function)
    assert is_linear(found.entries["mine"]) == linear


def test_braking_power_on_a_straight_line_is_the_closed_form():
    """With a constant braking power P, the speed satisfies v³ = v₀³ − 3Ps/m, and braking takes m(v₀² − v₁²)/(2P)."""
    mass, power, fast, slow = 1000.0, 2e4, 12.0, 5.0
    found = timed(LINE, None, slow, speed=fast, power=(-power, None), vehicle=qt.Vehicle(mass=mass))
    distance = mass * (fast**3 - slow**3) / (3 * power)
    exact = (100.0 - distance) / fast + mass * (fast**2 - slow**2) / (2 * power)
    assert exact <= float(found.duration) <= exact * (1 + 1e-3)


def test_sides_of_the_power_agree_with_samples():
    found = timed(ROUTE, **OTHERS, power=(-4e3, 6e3), vehicle=CAR)
    t = np.linspace(0.01, 0.999 * float(found.duration), 400)
    power = np.asarray(qt.evaluate(found.path, t, ("power",), vehicle=CAR).power)
    assert -4e3 <= power.min() < -0.999 * 4e3
    assert 0.999 * 6e3 < power.max() <= 6e3


def test_own_quantities_at_stops_in_between():
    first = timed(STOPPING, None, None, speed=15.0, acceleration=5.0, longitudinal_acceleration=(-3.0, 2.0))
    second = timed(STOPPING, None, None, speed=15.0, acceleration=5.0, own={ALONG: (-3.0, 2.0)})
    np.testing.assert_allclose(second.duration, first.duration, rtol=max(float(first.gap), float(second.gap)))


def test_lower_bounds_of_own_quantities():
    first = timed(ROUTE, None, None, **(OTHERS | {"speed": (5.0, 9.0)}))
    second = timed(ROUTE, None, None, **OTHERS, own={SPEED: (5.0, 9.0)})
    np.testing.assert_allclose(second.duration, first.duration, rtol=1e-3)
    speeds = np.asarray(qt.evaluate(second.path, np.linspace(0, float(second.duration), 200), ("speed",)).speed)
    assert speeds.min() >= 5.0


def test_contradicting_limits_are_named():
    found = qt.retime(HELIX, qt.Limits(**OTHERS, own={SPEED: (14.0, 15.0)}))
    assert not found.converged
    assert "own_speed contradicts another limit" in found.result


def test_certificate_of_another_timing_proves_own_quantities():
    """The proofs agree with the extremes of samples, on both sides of each of them."""
    path = timed(ROUTE, **OTHERS).path
    t = np.linspace(0.0, float(path.duration), 2000)[1:-1]
    for quantity in (SIZE, SIDEWAYS, ALONG, CLIMB):
        highest = float(np.max(np.asarray(qt.evaluate(path, t, (quantity,))[quantity])))
        for factor, status in ((1.01, "proved"), (0.99, "broken")):
            found = qt.certify(path, qt.Limits(own={quantity: (None, factor * highest)}))
            assert [*found.status.values()] == [status]


def test_limits_that_no_timing_changes_are_checked_once():
    far, near = qt.Ball([30.0, 0, 40], 3.0), qt.Ball([20.0, 5, 1], 3.0)
    free = timed(ROUTE, speed=10.0, acceleration=3.0)
    found = timed(
        ROUTE, speed=10.0, acceleration=3.0, curvature=0.5, own={BEND: 0.5}, keep_out=[far], body=[(1.0, 1.0)]
    )
    assert float(found.duration) == float(free.duration)
    assert found.certificate.names == ("speed", "acceleration", "curvature", "bend", "keep_out[0]")
    assert found.timing_names == qt.speed_profile(found).names == ("speed", "acceleration")
    assert np.isnan(np.asarray(found.usage)[2:]).all()
    with pytest.raises(ValueError, match="does not depend on the timing"):
        found.intervals("curvature")
    for limits, name in (({"curvature": 0.005}, "curvature"), ({"keep_out": [near]}, r"keep_out\[0\]")):
        broken = qt.retime(ROUTE, qt.Limits(speed=10.0, **limits))
        assert not broken.converged
        assert name.replace("\\", "") in broken.result


def test_prescribed_duration_scales_limits_on_own_accelerations():
    limits = qt.Limits(speed=15.0, own={SIDEWAYS: 3.0, SIZE: 4.0})
    found = qt.retime(HELIX, limits, 0.0, 0.0, duration=30.0)
    assert found.certificate.holds
    np.testing.assert_allclose(found.duration, 30.0, rtol=1e-3)
    assert float(found.share) < 0.5


@pytest.mark.parametrize(
    ("function", "unit", "path", "fragment"),
    [
        (lambda p: p.snap.norm(), "m/s^4", ROUTE, "contains derivatives above the order 3"),
        (lambda p: p.position.cross(p.velocity)[2], "m^2/s", ROUTE, "contains the position and depends on the timing"),
        (lambda p: jax.numpy.sin(p.velocity[2]), "1", ROUTE, r"is not a formula of \+ - \* /"),
        (lambda p: p.speed + 3.0, "m/s", ROUTE, "adds numbers with different units"),
        (lambda p: p.velocity[0], "m/s", HELIX, "contains components along x or y"),
    ],
)
def test_unsupported_quantities_are_refused_with_the_reason(function, unit, path, fragment):
    with pytest.raises(ValueError, match=fragment):
        qt.retime(path, qt.Limits(speed=15.0, own={qt.Quantity("mine", unit, function): 3.0}))


def test_traced_limits_on_formulas_are_refused():
    def duration(limit):
        return qt.retime(ROUTE, qt.Limits(speed=15.0, own={SIDEWAYS: limit})).duration

    with pytest.raises(ValueError, match=r"supports the limit on sideways only for .* concrete values"):
        jax.grad(duration)(3.0)
    with pytest.raises(ValueError, match="curvature does not depend on the timing"):
        jax.grad(lambda x: qt.retime(ROUTE, qt.Limits(speed=x, curvature=1.0)).duration)(3.0)


FIRST, LAST = (qt.Quantity(f"{x}_own", "m/s^2", lambda p: p.acceleration.norm()) for x in "az")


@pytest.mark.parametrize("names", [(FIRST, LAST), (LAST, FIRST)], ids=["in order", "in reverse"])
def test_each_own_quantity_has_its_own_status(names):
    """Whatever the order of the dictionary, and on both sides."""
    path = qt.retime(HELIX, qt.Limits(speed=10.0, acceleration=3.0), 1.0, 1.0).path
    limits = {LAST: 1.0, FIRST: (0.0, 5.0)}
    found = qt.certify(path, qt.Limits(speed=11.0, own={name: limits[name] for name in names}))
    assert found.status == {
        "speed": "proved",
        "a_own_min": "proved",
        "a_own": "proved",
        "z_own": "broken",
    }
    assert found.worst["z_own"][1] > 2.9


def test_one_side_of_an_own_quantity_is_broken():
    climb = qt.Quantity("own_climb", "m/s", lambda p: p.velocity[2])
    path = qt.retime(HELIX, qt.Limits(speed=10.0, acceleration=3.0), 1.0, 1.0).path
    found = qt.certify(path, qt.Limits(own={climb: (-20.0, 0.1)}))
    assert found.status == {"own_climb_min": "proved", "own_climb_max": "broken"}


def test_retime_keeps_the_order_of_own_limits():
    found = [
        qt.retime(ROUTE, qt.Limits(speed=12.0, own={name: {FIRST: 3.0, LAST: 2.0}[name] for name in names}))
        for names in ((FIRST, LAST), (LAST, FIRST))
    ]
    assert all(x.certificate.holds for x in found)
    assert found[0].duration == pytest.approx(float(found[1].duration), rel=1e-12)


def test_a_broken_shape_limit_is_the_result_above_a_note():
    """A start above the limits is a success with a note, which must not hide an obstacle on the path."""
    way = qt.Ball(ROUTE.position(0.7 * float(ROUTE.duration)), 2.0)
    limits = {"speed": 15.0, "longitudinal_acceleration": (-2.0, 2.0)}
    assert qt.retime(ROUTE, qt.Limits(**limits), 20.0).code == qt.ResultCode.starts_above_limits
    found = qt.retime(ROUTE, qt.Limits(**limits, keep_out=[way]), 20.0)
    assert found.code == qt.ResultCode.limits_broken
    assert found.certificate.status["keep_out[0]"] == "broken"


@pytest.mark.parametrize(("limit", "status"), [(8.0, "proved"), (0.5, "broken")])
def test_an_own_limit_along_the_way_is_decided_on_another_timing(limit, status):
    along = qt.Along([0.0, 20.0], [limit, 9.0])
    found = qt.certify(qt.retime(ROUTE, qt.Limits(speed=5.0, acceleration=1.0)).path, qt.Limits(own={FIRST: along}))
    assert found.status == {"a_own": status}


def test_own_quantities_that_are_infinite_at_rest_are_refused():
    ratio = qt.Quantity("ratio", "1/s", lambda p: p.velocity.dot(p.acceleration) / p.speed**2)
    turn = qt.Quantity("turn", "rad/s", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**2)
    with pytest.raises(ValueError, match="ratio is infinite where the vehicle starts or comes to rest"):
        qt.retime(ROUTE, qt.Limits(**OTHERS, own={ratio: (-0.6, 0.4)}), 0.0, 0.0)
    assert qt.retime(ROUTE, qt.Limits(**OTHERS, own={turn: 2.0}), 0.0, 0.0).certificate.holds
    assert qt.retime(ROUTE, qt.Limits(**OTHERS, own={ratio: (-0.6, 0.4)}), 5.0, 5.0).certificate.holds

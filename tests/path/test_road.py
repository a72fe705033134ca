"""Roads: their values, their lines in intervals of a path, and their files."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.document import save
from qtraj.path.road_on_path import CORNERS, road_on
from qtraj.path.vehicle_data import vehicle_from, vehicle_quantities

TABLE = "s [m],bank_deg,mu_along,mu_across,inverted\n0,0,0.8,0.7,0\n0.05,5,0.4,0.4,1\n90,0,0.8,0.7,0\n"


def test_values_are_interpolated_linearly_or_change_in_steps():
    values = {
        "bank": [0.0, 0.2, -0.1],
        "friction": [(0.8, 0.6), (0.4, 0.3), (0.9, 0.8)],
        "inverted": [False, True, False],
    }
    at = np.array([0.0, 5.0, 10.0, 15.0, 30.0, 99.0])
    linear, steps = (qt.Road([0, 10, 30], **values, kind=kind).at(at) for kind in ("linear", "step"))
    np.testing.assert_allclose(linear.bank, [0.0, 0.1, 0.2, 0.125, -0.1, -0.1], atol=1e-15)
    np.testing.assert_allclose(linear.along, [0.8, 0.6, 0.4, 0.525, 0.9, 0.9], atol=1e-15)
    np.testing.assert_allclose(linear.across, [0.6, 0.45, 0.3, 0.425, 0.8, 0.8], atol=1e-15)
    np.testing.assert_array_equal(steps.bank, [0.0, 0.0, 0.2, 0.2, -0.1, -0.1])
    np.testing.assert_array_equal(linear.side, [1, 1, -1, -1, 1, 1])
    np.testing.assert_array_equal(steps.side, linear.side)


@pytest.mark.parametrize("kind", ["linear", "step"])
def test_lines_enclose_the_road(kind):
    rng = np.random.default_rng(3)
    path = qt.Route(
        [0.0, 3.0, 7.0], [[0, 0, 0], [20, 5, 0], [70, 0, 1]], [[6, 0, 0], [9, 1, 0], [14, -2, 0]], [[0, 0, 0]] * 3
    )
    distance = np.append(0.0, np.sort(rng.uniform(5, 80, 6)))
    road = qt.Road(distance, bank=rng.uniform(-0.4, 0.4, 7), friction=rng.uniform(0.3, 1, (7, 2)), kind=kind)
    on = road_on(qt.Vehicle(1.0, road=road), path)
    low = rng.uniform(0, 6.5, 40)
    low = low[(low < 2.5) | (low > 3)]
    cut = on.cut(low, low + 0.5)
    lines = on.lines(*cut[1:])
    for z in np.linspace(0, 1, 21):
        true = on.at(cut.low + z * (cut.high - cut.low), cut.section)
        cos, sin, along, across = (
            (1 - z) * getattr(lines.start, name) + z * getattr(lines.end, name) - getattr(true, name)
            for name in ("cos", "sin", "inv_long", "inv_lat")
        )
        assert np.all(np.abs(cos) <= lines.error + 1e-15)
        assert np.all(np.abs(sin) <= lines.error + 1e-15)
        assert np.all(along >= -1e-15)
        assert np.all(across >= -1e-15)
    assert (np.max(lines.error) > 0) == (kind == "linear")
    start, _ = lines.corner(*CORNERS[1])
    np.testing.assert_allclose(start.sin, lines.start.sin - lines.error)


def test_a_road_in_a_file(tmp_path):
    file = tmp_path / "road.csv"
    file.write_text(TABLE)
    road = qt.read_road(file, kind="step")
    assert road.distance == (0.0, 0.05, 90.0)
    assert road.friction == ((0.8, 0.7), (0.4, 0.4), (0.8, 0.7))
    assert road.inverted == (False, True, False)
    np.testing.assert_allclose(road.bank, np.radians([0, 5, 0]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\nx,y\n1,2\n3,4\n", "needs a column for the distance"),
        ("s,bank_m\n0,1\n1,2\n", "an angle"),
        ("s,bank\n0,0\n1,2\n", "3 degrees are 0.0524"),
        ("s,bank [mrad]\n0,0\n1,2\n", "'mrad', which is not a known unit"),
        ("s,mu [%]\n0,50\n1,60\n", "'%', which is not a known unit"),
        ("s,friction_deg\n0,1\n1,1\n", "a number without unit"),
        ("s,bank,inverted\n0,0,0\n1,0.1,2\n", "0 and 1"),
        ("s,bank\n1,0\n2,0.1\n", "the first one is 1 m: subtract it"),
    ],
)
def test_a_file_that_is_no_road_is_refused(tmp_path, text, message):
    file = tmp_path / "road.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        qt.read_road(file)
    assert "road.csv" in str(error.value)


def test_a_vehicle_with_a_road_is_stored_exactly(tmp_path):
    road = qt.Road(
        [0, 0.1, 40], bank=[0.1, 0.2, 1 / 3], friction=[0.1, 0.7, 0.9], inverted=[True, False, True], kind="step"
    )
    vehicle = qt.Vehicle(1000.0, wheelbase=2.7, road=road)
    for name in ("v.toml", "v.json"):
        save(vehicle, tmp_path / name)
        assert qt.load(tmp_path / name).road == road
    assert vehicle_from({name: x.values for name, x in vehicle_quantities(vehicle).items()}).road == road


@pytest.mark.parametrize("left", [(0, 1, 0), [None, (0.1, -1e-3, 2 / 3), None]])
def test_a_direction_to_the_left_is_stored_exactly(tmp_path, left):
    vehicle = qt.Vehicle(1000.0, road=qt.Road([0, 0.1, 40], left=left))
    for name in ("v.toml", "v.json"):
        save(vehicle, tmp_path / name)
        assert qt.load(tmp_path / name).road == vehicle.road
    assert vehicle_from({name: x.values for name, x in vehicle_quantities(vehicle).items()}).road == vehicle.road


def test_a_direction_to_the_left_has_any_length():
    one, tiny, huge = (qt.Road(left=x * np.array([3.0, 0.0, 4.0])).at(np.zeros(2)).left for x in (1.0, 1e-200, 1e200))
    for found in (one, tiny, huge):
        np.testing.assert_allclose(found, [[0.6, 0.0, 0.8]] * 2, rtol=1e-15)


def test_a_direction_holds_up_to_the_next_distance():
    road = qt.Road([0, 10, 20], left=[None, (0, 2, 0), None])
    np.testing.assert_array_equal(road.at(np.array([0.0, 9.9, 10.0, 19.9, 20.0])).left[:, 1], [0, 0, 1, 1, 0])
    assert not road.is_constant
    assert qt.Road(left=(0, 1, 0)).is_constant
    assert "left at 3 distances over 20 m" in repr(road)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"distance": [1.0, 2.0]}, "the first one is 1 m: subtract it"),
        ({"distance": [0.0, 2.0, 2.0]}, r"distance\[2\] = 2 m follows 2 m"),
        ({"distance": [0, 1], "bank": [0.1, 0.2, 0.3]}, "each of the 2 distances"),
        ({"distance": [0, 1], "bank": [0.0, 2.0]}, "between -pi/2 and pi/2"),
        ({"distance": [0, 1], "friction": [0.0, 0.5]}, "must be positive"),
        ({"distance": [0, 1], "inverted": [0, 1]}, "true or false"),
        ({"distance": [0, 1], "kind": "cubic"}, "'linear' or 'step'"),
        ({"left": (0, 0, 0)}, "three components that are not all zero"),
        ({"left": (0, 1)}, "three components that are not all zero"),
        ({"left": "left"}, "must contain numbers"),
        ({"left": (0, np.nan, 0)}, "must be finite"),
        ({"distance": [0, 1], "left": [(0, 1, 0)]}, "None for each of the 2 distances"),
        ({"distance": [0, 1], "left": [(0, 1, 0), (0, 0, 0)]}, "three components that are not all zero"),
        ({"distance": [0, 1]}, "at least one of bank, friction, inverted and left"),
    ],
)
def test_a_wrong_road_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.Road(**arguments)


def test_a_vehicle_and_its_road_do_not_define_the_same():
    with pytest.raises(ValueError, match="both define the bank"):
        qt.Vehicle(1.0, bank=0.1, road=qt.Road([0, 1], bank=[0.1, 0.2]))
    with pytest.raises(ValueError, match="both define the friction"):
        qt.Vehicle(1.0, friction=0.8, road=qt.Road([0, 1], friction=[0.1, 0.2]))
    with pytest.raises(ValueError, match="must be a Road"):
        qt.Vehicle(1.0, road=0.3)


def test_a_road_that_is_the_same_everywhere_is_that_of_the_vehicle():
    path = qt.SpiralHelix([60.0, 0.5], [0.0, 0.26], [0.0, 0.5], 5.5)
    times = np.linspace(0, 5.5, 7)
    vehicles = (
        qt.Vehicle(1.0, friction=(0.5, 0.4), bank=0.1),
        qt.Vehicle(1.0, road=qt.Road([0, 9], 0.1, [(0.5, 0.4)] * 2)),
    )
    found = [np.asarray(qt.evaluate(path, times, ("friction",), vehicle=x).friction) for x in vehicles]
    np.testing.assert_array_equal(*found)

"""Quantities of one's own on parked segments, with cross products of axes, and with names of fields of tables."""

import numpy as np
import pytest

import qtraj as qt

DRIVE = qt.Route(
    [0.0, 2.0, 3.0, 5.0],
    [[0, 0, 0], [6, 1, 0.5], [6, 1, 0.5], [14, 4, 0]],
    [[1, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0.0]],
    [[0, 0, 0]] * 4,
)
PARKED = qt.Route([0.0, 2.0], [[6, 1, 0.5]] * 2, [[0, 0, 0]] * 2, [[0, 0, 0]] * 2)


@pytest.mark.parametrize(
    ("unit", "function"),
    [
        ("s/m", lambda p: 1 / p.speed),
        ("s/m", lambda p: 1 / p.velocity[0]),
        ("s/m", lambda p: 1 / qt.sqrt(p.velocity[0] ** 2 + p.velocity[1] ** 2)),
        ("s/m", lambda p: p.velocity[2] / p.speed**2),
        ("1/s", lambda p: p.acceleration[2] / p.velocity[2]),
    ],
)
def test_a_division_by_zero_at_rest_is_undefined(unit, function):
    quantity = qt.Quantity("mine", unit, function)
    for path in (PARKED, DRIVE):
        assert set(qt.certify(path, qt.Limits(own={quantity: (None, 1e4)})).status.values()) == {"undefined"}


def test_a_factor_with_the_vehicle_changes_nothing_at_rest():
    """The lateral acceleration and the lateral force are zero while a vehicle waits."""
    lateral = qt.Quantity("mine", "m/s^2", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed)
    force = qt.Quantity("other", "N", lambda p: p.vehicle.mass * p.velocity.cross(p.acceleration).norm() / p.speed)
    limits = qt.Limits(own={lateral: 1e2, force: 1e5}, vehicle=qt.Vehicle(mass=500.0))
    for path in (PARKED, DRIVE):
        assert qt.certify(path, limits).status == {"mine": "proved", "other": "proved"}


def test_cross_products_with_axes_of_the_world():
    path = qt.SpiralHelix([20.0, 0.1], [0.0, 0.3], [0.0, 0.5, 0.02], 8.0)
    t = np.linspace(0.0, 8.0, 801)
    level = qt.Quantity("mine", "1", lambda p: (p.velocity / p.speed).cross([0, 0, 1]).norm())
    other = qt.Quantity("other", "m^2/s^3", lambda p: p.velocity.cross([0.3, 0.4, 1.0]).dot(p.acceleration))
    table = qt.evaluate(path, t, ("velocity", "acceleration", "speed", level, other))
    v, a = (np.asarray(x, float) for x in (table.velocity, table.acceleration))
    expected = np.linalg.norm(np.cross(v, [0, 0, 1]), axis=1) / np.linalg.norm(v, axis=1)
    np.testing.assert_allclose(table[level], expected, rtol=1e-5)
    np.testing.assert_allclose(table[other], np.sum(np.cross(v, [0.3, 0.4, 1.0]) * a, axis=1), rtol=1e-4)
    for margin, status in ((1e-5, "proved"), (-1e-5, "broken")):
        limits = qt.Limits(own={level: float(expected.max()) * (1 + margin)})
        assert qt.certify(path, limits).status == {"mine": status}


@pytest.mark.parametrize("name", ["values", "frame", "axes", "components", "batched"])
def test_names_of_the_fields_of_tables_are_taken(name):
    with pytest.raises(ValueError, match="is taken"):
        qt.Quantity(name, "m/s", lambda p: p.speed)

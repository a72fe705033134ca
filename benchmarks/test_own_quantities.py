"""Compare quantities of one's own with the equal ones of the registry: `certify`, `evaluate` and `tune`.

`pytest benchmarks/test_own_quantities.py -n 0 -s` prints the ratios of the processor times, which must be at most 2.
"""

import time

import numpy as np
import pytest

import qtraj as qt

ROUNDS, PATHS, INSTANTS = 7, 12, 2000
MOST = 2.0
"""The largest ratio of the processor times."""


def friction(p):
    """Return the friction of a vehicle without drag on a level road, from its definition."""
    g, (along, across) = p.vehicle.gravity, p.vehicle.friction
    level = (p.speed**2 - p.velocity[2] ** 2) ** 0.5
    forward = (p.velocity.dot(p.acceleration) + g * p.velocity[2]) / p.speed
    left = p.velocity.cross(p.acceleration)[2] / level
    load = ((p.acceleration[2] + g) * p.speed**2 - p.velocity[2] * forward * p.speed) / (p.speed * level)
    return qt.sqrt((forward / along) ** 2 + (left / across) ** 2) / load


OWN = {
    "curvature": qt.Quantity("own_curvature", "1/m", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**3),
    "lateral_acceleration": qt.Quantity(
        "own_lateral", "m/s^2", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed
    ),
    "longitudinal_acceleration": qt.Quantity(
        "own_longitudinal", "m/s^2", lambda p: p.velocity.dot(p.acceleration) / p.speed
    ),
    "friction": qt.Quantity("own_friction", "1", friction),
}
CAR = qt.Vehicle(mass=1200.0, friction=(1.1, 0.9))


def route(rng):
    n = 6
    position = np.cumsum(rng.normal(size=(n, 3)) * [1, 1, 0.2] + np.array([6.0, 0.0, 0.0]), axis=0)
    velocity = rng.normal(size=(n, 3)) * [0.5, 0.5, 0.1] + np.array([4.0, 0.0, 0.0])
    return qt.Route(np.arange(n) * 1.6, position, velocity, rng.normal(size=(n, 3)) * 0.4)


def helix(rng):
    radius, height = [rng.uniform(15, 30), *rng.normal(size=2) * 0.1], [0.0, *rng.normal(size=2) * 0.3]
    return qt.SpiralHelix(radius, [0.0, rng.uniform(0.2, 0.4), rng.normal() * 0.01], height, 6.0)


MAKE = {"route": route, "helix": helix}


def limits_of(path, name, factor):
    """Return the same limit on both quantities, a factor of the largest value."""
    output = "longitudinal_acceleration_magnitude" if name.startswith("long") else name
    t = np.linspace(0.0, float(path.duration), INSTANTS)
    most = factor * float(np.max(qt.evaluate(path, t, (output,), vehicle=CAR)[output]))
    return qt.Limits(**{name: most}, vehicle=CAR), qt.Limits(own={OWN[name]: most}, vehicle=CAR)


def ratio(title, built_in, own):
    """Print and return the ratio of the least processor times of two functions, which alternate."""
    spent = [[], []]
    for _ in range(ROUNDS):
        for call, times in zip((built_in, own), spent, strict=True):
            begun = time.process_time()
            call()
            times.append(time.process_time() - begun)
    least = [1e3 * min(times) for times in spent]
    found = least[1] / least[0]
    print(f"\n{title}: {least[0]:.2f} ms of the registry, {least[1]:.2f} ms of one's own, ratio {found:.2f}")
    return found


@pytest.mark.parametrize("kind", [*MAKE])
@pytest.mark.parametrize("name", [*OWN])
def test_proofs(name, kind):
    """With limits far from the largest value, near it, and just below it."""
    rng = np.random.default_rng(1)
    paths = [MAKE[kind](rng) for _ in range(PATHS)]
    cases = [(path, limits_of(path, name, x)) for path in paths for x in (1.2, 1 + 1e-6, 1 - 1e-6)]
    for path, (built_in, own) in cases:
        assert [*qt.certify(path, built_in).status.values()] == [*qt.certify(path, own).status.values()]

    def certify(which):
        return [qt.certify(path, limits[which]) for path, limits in cases]

    assert ratio(f"certify, {name}, {kind}", lambda: certify(0), lambda: certify(1)) <= MOST


@pytest.mark.parametrize("name", [*OWN])
def test_values(name):
    """Of 2000 instants of a route, in NumPy."""
    path = route(np.random.default_rng(2))
    t = np.linspace(0.0, float(path.duration), INSTANTS)
    output = {"longitudinal_acceleration": "longitudinal_acceleration_magnitude"}.get(name, name)

    def evaluate(key):
        return [qt.evaluate(path, t, (key,), vehicle=CAR) for _ in range(10)]

    assert ratio(f"evaluate, {name}", lambda: evaluate(output), lambda: evaluate(OWN[name])) <= MOST


@pytest.mark.parametrize("name", [*OWN])
def test_searches(name):
    """`tune_route` within 0.95 of the largest value of a route."""
    path = route(np.random.default_rng(3))
    both = limits_of(path, name, 0.95)

    def tuned(limits):
        return qt.tune_route(path, limits, fixed=np.zeros(6, bool))

    built_in, own = map(tuned, both)
    assert built_in.certificate.holds
    assert own.certificate.holds
    assert float(own.objective) == pytest.approx(float(built_in.objective), rel=1e-3)
    assert ratio(f"tune_route, {name}", lambda: tuned(both[0]), lambda: tuned(both[1])) <= MOST

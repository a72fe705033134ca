"""Functions of common sweeps: each point has the result of the library for this point alone."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj import sweeps

RADII = np.array([2.0, 4.0, 8.0])


def circle(p):
    return qt.SpiralHelix(jnp.reshape(p["radius"], 1), jnp.array([0.0, 1.0]), jnp.zeros(1), 2.0)


def test_evaluations_are_reduced_over_time():
    function = sweeps.evaluate(circle, ("speed", "curvature", "acceleration"), reduce="mean", instants=9)
    found = function({"radius": RADII})
    np.testing.assert_allclose(found["speed"], RADII, rtol=1e-12)
    np.testing.assert_allclose(found["curvature"], 1 / RADII, rtol=1e-12)
    assert found["acceleration"].shape == (3, 3)
    assert function.units == {"speed": "m s-1", "curvature": "m-1", "acceleration": "m s-2"}
    with pytest.raises(ValueError, match="instants must be a whole number, at least 2"):
        sweeps.evaluate(circle, instants=1)


@pytest.mark.parametrize("limits", [qt.Limits(speed=3.0), lambda p: qt.Limits(speed=0.75 * p["radius"] + 1.25)])
def test_proofs_are_those_of_certify(limits):
    found = sweeps.certify(circle, limits)({"radius": RADII})
    of = limits if callable(limits) else lambda p: limits
    single = [qt.certify(circle({"radius": r}), of({"radius": r})) for r in RADII]
    np.testing.assert_array_equal(found["holds"], [x.holds for x in single])
    np.testing.assert_allclose(found["worst_speed"], [x.worst["speed"][1] for x in single], rtol=1e-12)


def turn(p):
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, p["speed"], 0.0])
    end = qt.BoundaryState([0.0, 10.0, 0.0], [-p["speed"], 0.0, 0.0])
    return start, end, qt.Limits(lateral_acceleration=p["limit"])


def test_tunings_are_those_of_tune():
    points = {"speed": np.array([4.0, 6.0]), "limit": np.array([2.0, 1.5])}
    found = sweeps.tune(turn, starts=2)(points)
    for k in range(2):
        best = qt.tune(*turn({name: float(x[k]) for name, x in points.items()}), starts=2)
        assert found["duration"][k] == pytest.approx(float(best.path.duration), rel=1e-6)
        assert found["objective"][k] == pytest.approx(float(best.objective), rel=1e-6, abs=1e-12)
        np.testing.assert_allclose(found["start_velocity"][k], best.start.velocity, rtol=1e-5, atol=1e-6)
    assert found["holds"].all()
    assert not found["failed"].any()


def test_tunings_without_a_solution_fail(tmp_path):
    def hard(p):
        start, end, _ = turn({"speed": 5.0, "limit": 2.0})
        return start, end, qt.Limits(curvature=p["curvature"])

    swept = qt.sweep(sweeps.tune(hard, starts=1), {"curvature": [1e-4, 0.2]}, tmp_path, workers=0)
    assert swept.failed["point"].tolist() == [0]
    assert np.isnan(swept.to_xarray()["duration"].values).tolist() == [True, False]
    assert swept.to_xarray()["code"].values[0] == int(qt.ResultCode.infeasible)


def test_timings_are_those_of_retime():
    path = circle({"radius": 4.0})
    found = sweeps.retime(lambda p: (path, qt.Limits(speed=p["speed"])), end_speed=1.0)({"speed": np.array([2.0, 3.0])})
    for k, speed in enumerate((2.0, 3.0)):
        timed = qt.retime(path, qt.Limits(speed=speed), end_speed=1.0)
        assert found["duration"][k] == pytest.approx(float(timed.duration))
        assert found["end_speed"][k] == pytest.approx(float(timed.speeds[1]))


def test_routes_are_those_of_tune_route():
    times, points = [0.0, 2.0, 4.0], [[0.0, 0.0, 0.0], [8.0, 0.5, 0.0], [16.0, 3.0, 0.0]]
    route = qt.Route(times, points, [[4.0, 0.5, 0.0]] * 3, [[0.0, 0.0, 0.0]] * 3)
    found = sweeps.tune_route(lambda p: (route, qt.Limits(acceleration=p["limit"])), tube=1.0)(
        {"limit": np.array([3.0])}
    )
    best = qt.tune_route(route, qt.Limits(acceleration=3.0), tube=1.0)
    assert found["objective"][0] == pytest.approx(float(best.objective), rel=1e-6, abs=1e-12)
    assert found["holds"][0] == bool(best.certificate.holds)


def test_closed_loops_with_random_sensors(tmp_path):
    slew = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], qt.Quintic(duration=2.0))
    law, times = qt.AccelerationLaw(4.0, 4.0), np.array([0.0, 1.0, 2.0])

    def flight(p):
        error = qt.quaternion.exp(p["angle"] / 2 * jnp.array([1.0, 0.0, 0.0]))
        sensor = qt.Sensor(rate_noise=p["noise"], key=jax.random.key(p["seed"]), sampling=0.5)
        return qt.simulate(slew, law, error, jnp.zeros(3), times, sensor=sensor, rtol=1e-8)

    parameters = {"seed": [1, 2], "noise": [0.0, 1e-3], "angle": [0.0, 0.2]}
    swept = qt.sweep(sweeps.simulate(flight), parameters, tmp_path, workers=0, shard=4)
    found = swept.to_xarray(grid=True)
    exact = found.sel(noise=0.0)
    np.testing.assert_allclose(exact["peak_angle"].sel(angle=0.2), 0.2, rtol=1e-6)
    np.testing.assert_array_equal(exact["final_angle"].sel(seed=1), exact["final_angle"].sel(seed=2))
    noisy = found["final_angle"].sel(noise=1e-3)
    assert (noisy.sel(seed=1) != noisy.sel(seed=2)).all()


def test_all_shards_use_the_code_of_the_first(tmp_path, compiled):
    function = sweeps.evaluate(circle, ("speed",), instants=5)
    qt.sweep(function, {"radius": np.linspace(1.0, 2.0, 8)}, tmp_path / "one", workers=0, shard=8)
    before = len(compiled)
    assert before > 0
    qt.sweep(function, {"radius": np.linspace(1.0, 2.0, 64)}, tmp_path / "many", workers=0, shard=8)
    assert len(compiled) == before


SCALE = 1.0


def scaled_circle(p):
    return circle({"radius": SCALE * p["radius"]})


def test_a_changed_variable_is_compiled_again(monkeypatch):
    function = sweeps.evaluate(scaled_circle, ("curvature",))
    np.testing.assert_allclose(function({"radius": RADII})["curvature"], 1 / RADII, rtol=1e-12)
    monkeypatch.setitem(globals(), "SCALE", 10.0)
    np.testing.assert_allclose(function({"radius": RADII})["curvature"], 0.1 / RADII, rtol=1e-12)


@dataclass
class Unhashable:
    scale: float

    def __call__(self, p):
        return circle({"radius": self.scale * p["radius"]})


def test_functions_without_a_hash():
    found = sweeps.evaluate(Unhashable(2.0), ("curvature",))({"radius": RADII})
    np.testing.assert_allclose(found["curvature"], 0.5 / RADII, rtol=1e-12)


def only(value, allowed):
    """Return a value, or raise the ValueError of a point that is no problem."""
    if value not in allowed:
        raise ValueError(f"{value} is not allowed")
    return value


STREET = qt.Route([0.0, 2.0, 4.0], [[0.0, 0, 0], [8.0, 0.5, 0], [16.0, 3, 0]], [[4.0, 0.5, 0]] * 3, [[0.0, 0, 0]] * 3)


@pytest.mark.parametrize(
    ("make", "problem", "name"),
    [
        (sweeps.retime, lambda p: (circle({"radius": 4.0}), qt.Limits(speed=only(p["a"], (3.0,)))), "duration"),
        (sweeps.tune_route, lambda p: (STREET, qt.Limits(acceleration=only(p["a"], (3.0,)))), "duration"),
        (lambda f: sweeps.tune(f, starts=1), lambda p: turn({"speed": 5.0, "limit": only(p["a"], (3.0,))}), "duration"),
        (lambda f: sweeps.tune(f, starts=1), lambda p: turn({"speed": 5.0, "limit": p["a"]}), "duration"),
    ],
    ids=["retime", "tune_route", "tune", "limits of tune"],
)
def test_points_that_are_no_problem_fail_alone(tmp_path, make, problem, name):
    swept = qt.sweep(make(problem), {"a": [3.0, -1.0, -2.0]}, tmp_path, workers=0, shard=2)
    assert swept.successful
    assert swept.failed["point"].tolist() == [1, 2]
    assert np.isnan(swept.to_xarray()[name].values).tolist() == [False, True, True]

"""Corridors about the given path: kept to, proved, differentiable, and independent of how the distance is measured."""

import json

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

import qtraj as qt
from qtraj.cli.app import app
from qtraj.design.tuning.initial import given_path

RATE = 0.45
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, RATE * 20, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-RATE * 28, -1.0, 0.1])
LIMITS = qt.Limits(curvature=0.048, lateral_acceleration=3.2)
FRACTIONS = np.linspace(0.0, 1.0, 2001)


def distances(path, reference):
    """In space, at equal fractions of the durations."""
    own, given = (jax.vmap(p.position)(FRACTIONS * p.duration) for p in (path, reference))
    return np.linalg.norm(np.asarray(own - given), axis=1)


def exact(path, reference, u):
    """The square of the corridor's distance in 50 digits."""
    with mpmath.workdps(50):

        def numbers(p):
            t = mpmath.mpf(float(p.duration)) * mpmath.mpf(float(u))
            return [
                mpmath.polyval([mpmath.mpf(float(x)) for x in c], t, asc=True) for c in (p.radius, p.angle, p.height)
            ]

        (a, b, c), (x, y, z) = numbers(path), numbers(reference)
        return float(mpmath.sqrt((a - x) ** 2 + a * x * (b - y) ** 2 + (c - z) ** 2))


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_the_path_stays_in_its_corridor(motion):
    given = given_path(START, END, motion=motion)
    free = qt.tune(START, END, LIMITS, motion=motion)
    assert distances(free.path, given).max() > 1.5
    best = qt.tune(START, END, LIMITS, motion=motion, corridor=1.0)
    assert best.converged, best.result
    assert best.certificate.status["corridor"] == "proved"
    assert "corridor" in best.certificate.binding
    time, value, width = best.certificate.worst["corridor"]
    assert width == 1.0
    assert value == pytest.approx(exact(best.path, given, time / float(best.path.duration)), rel=1e-12)
    assert value == pytest.approx(max(exact(best.path, given, u) for u in FRACTIONS[::10]), rel=1e-4)
    assert 0.99 < distances(best.path, given).max() <= 1.0
    assert best.objective > free.objective


def test_a_corridor_that_cannot_be_kept_is_explained():
    best = qt.tune(START, END, LIMITS, corridor=0.05)
    assert best.status == "infeasible"
    assert "corridor is " in best.result
    assert "corridor can be met alone, but not with the others" in best.result


def test_each_of_many_has_a_corridor_of_its_own():
    both = jax.tree.map(lambda x: jnp.stack([x, x, x]), (START, END))
    many = qt.tune(*both, LIMITS, corridor=jnp.asarray([1.0, 3.0, 1.2]))
    one = qt.tune(START, END, LIMITS, corridor=1.2)
    assert many.converged.all()
    assert many[2].objective == pytest.approx(float(one.objective), rel=1e-9)
    np.testing.assert_allclose(many.certificate.worst["corridor"][2], [1.0, 3.0, 1.2])
    with pytest.raises(ValueError, match=r"the limit corridor must be positive and finite \[m\], but -1.0 was given"):
        qt.tune(START, END, LIMITS, corridor=-1.0)


def test_the_solution_is_differentiable_in_the_corridor():
    def duration(width):
        return qt.tune(START, END, LIMITS, corridor=width).path.duration

    slope = jax.jit(jax.grad(duration))(1.0)
    h = 1e-4
    assert slope == pytest.approx(float(duration(1.0 + h) - duration(1.0 - h)) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("margin", [1e-3, 1e-7, -1e-7, -1e-3])
def test_a_corridor_is_proved_or_broken_down_to_rounding(margin):
    given = given_path(START, END, motion="hermite")
    path = qt.tune(START, END, LIMITS, motion="hermite").path
    _, peak, _ = qt.certify(path, qt.Limits(), corridor=9.0, reference=given).worst["corridor"]
    found = qt.certify(path, LIMITS, corridor=peak * (1 + margin), reference=given)
    assert found.names[-1] == "corridor"
    assert found.status["corridor"] == ("proved" if margin > 0 else "broken")


def test_a_corridor_about_another_axis_is_refused():
    path = given_path(START, END)
    other = qt.SpiralHelix(path.radius, path.angle, path.height, path.duration, qt.Placement([1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="their placements differ"):
        qt.certify(path, LIMITS, corridor=1.0, reference=other)
    with pytest.raises(ValueError, match="pass reference="):
        qt.certify(path, LIMITS, corridor=1.0)


def test_a_scenario_has_a_corridor(tmp_path):
    (tmp_path / "s.toml").write_text(
        """
[start]
position = [20.0, 0.0, 0.0]
velocity = [1.0, 9.0, 0.3]
[end]
position = [0.0, 28.0, 1.5]
velocity = [-12.6, -1.0, 0.1]
[placement]
origin = [0.0, 0.0, 0.0]
[limits]
curvature = 0.048
lateral_acceleration = 3.2
[tune]
corridor = 1.0
"""
    )
    result = CliRunner().invoke(app, ["tune", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"), "--json"])
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    assert content["limits"]["corridor"]["after"]["status"] == "proved"
    assert content["limits"]["corridor"]["before"]["value"] == 0.0
    assert content["departure"] <= 1.0
    report = CliRunner().invoke(app, ["report", str(tmp_path / "out")])
    assert report.exit_code == 0
    assert "corridor [m]" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")

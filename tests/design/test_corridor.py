"""Corridors about the initial path: the tuned path stays inside, with a proof, and is differentiable."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

import qtraj as qt
from qtraj.cli.main import application
from qtraj.design.tuning.initial import initial_path

RATE = 0.45
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, RATE * 20, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-RATE * 28, -1.0, 0.1])
LIMITS = qt.Limits(curvature=0.048, lateral_acceleration=3.2)
FRACTIONS = np.linspace(0.0, 1.0, 2001)


def distances(path, reference):
    """Distances in space at equal fractions of the durations."""
    tuned, initial = (jax.vmap(p.position)(FRACTIONS * p.duration) for p in (path, reference))
    return np.linalg.norm(np.asarray(tuned - initial), axis=1)


def exact(path, reference, u):
    """The corridor's distance in 50 digits."""
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
    initial = initial_path(START, END, motion=motion)
    free = qt.tune(START, END, LIMITS, motion=motion)
    assert distances(free.path, initial).max() > 1.5
    best = qt.tune(START, END, LIMITS, motion=motion, corridor=1.0)
    assert best.converged, best.result
    assert best.certificate.status["corridor"] == "proved"
    assert "corridor" in best.certificate.active
    time, value, width = best.certificate.worst["corridor"]
    assert width == 1.0
    assert value == pytest.approx(exact(best.path, initial, time / float(best.path.duration)), rel=1e-12)
    assert value == pytest.approx(max(exact(best.path, initial, u) for u in FRACTIONS[::10]), rel=1e-4)
    assert 0.99 < distances(best.path, initial).max() <= 1.0
    assert best.objective > free.objective


def test_an_impossible_corridor_is_explained():
    best = qt.tune(START, END, LIMITS, corridor=0.05, starts=2)
    assert best.status == "infeasible"
    assert "corridor is " in best.result
    assert "The limit on corridor can be satisfied alone; no path was found that satisfies all limits" in best.result


def test_a_batch_may_have_a_corridor_per_element():
    both = jax.tree.map(lambda x: jnp.stack([x, x, x]), (START, END))
    batch = qt.tune(*both, LIMITS, corridor=jnp.asarray([1.0, 3.0, 1.2]))
    one = qt.tune(START, END, LIMITS, corridor=1.2)
    assert batch.converged.all()
    assert batch[2].objective == pytest.approx(float(one.objective), rel=1e-9)
    np.testing.assert_allclose(batch.certificate.worst["corridor"][2], [1.0, 3.0, 1.2])
    with pytest.raises(ValueError, match=r"the limit corridor must be positive and finite \[m\], but -1.0 was given"):
        qt.tune(START, END, LIMITS, corridor=-1.0)


def test_the_solution_is_differentiable_in_the_corridor():
    def duration(width):
        return qt.tune(START, END, LIMITS, corridor=width).path.duration

    _, slope = jax.jvp(duration, (1.0,), (1.0,))
    h = 1e-4
    assert slope == pytest.approx(float(duration(1.0 + h) - duration(1.0 - h)) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("margin", [1e-3, 1e-7, -1e-7, -1e-3])
def test_a_corridor_is_proved_or_broken_down_to_rounding(margin):
    initial = initial_path(START, END, motion="hermite")
    path = qt.tune(START, END, LIMITS, motion="hermite").path
    _, peak, _ = qt.certify(path, qt.Limits(), corridor=9.0, reference=initial).worst["corridor"]
    certificate = qt.certify(path, LIMITS, corridor=peak * (1 + margin), reference=initial)
    assert certificate.names[-1] == "corridor"
    assert certificate.status["corridor"] == ("proved" if margin > 0 else "broken")


def test_an_ill_posed_element_with_a_corridor_has_its_own_result():
    both = jax.tree.map(lambda x: jnp.stack([x, x]), (START, END))
    bad = eqx.tree_at(lambda s: s.velocity, both[0], both[0].velocity.at[1].set(jnp.nan))
    batch = qt.tune(bad, both[1], LIMITS, corridor=1.2, placement=qt.Placement())
    assert list(batch.status) == ["converged", "ill-posed"]


def test_the_finding_does_not_depend_on_how_the_paths_are_represented():
    reference = initial_path(START, END)
    path = qt.tune(START, END, LIMITS).path
    one = qt.certify(path, LIMITS, corridor=2.0, reference=reference)
    turned = eqx.tree_at(lambda p: p.angle, path, path.angle.at[0].add(2 * jnp.pi))
    placed = qt.SpiralHelix(path.radius, path.angle, path.height, path.duration, qt.Placement())
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), path)
    assert one.status["corridor"] == "proved"
    for other in (turned, placed):
        certificate = qt.certify(other, LIMITS, corridor=2.0, reference=reference)
        assert certificate.status == one.status
        assert certificate.worst["corridor"][1] == pytest.approx(one.worst["corridor"][1], rel=1e-12)
    certificate = qt.certify(batch, LIMITS, corridor=2.0, reference=reference)
    assert certificate[1].status == one.status
    for bad in (-1.0, float("nan"), [1.0, 2.0]):
        with pytest.raises(ValueError, match="corridor"):
            qt.certify(path, LIMITS, corridor=bad, reference=reference)
    with pytest.raises(ValueError, match="without a corridor"):
        qt.certify(path, LIMITS, reference=reference)


def test_a_tuning_with_a_corridor_is_drawn(tmp_path):
    best = qt.tune(START, END, LIMITS, corridor=1.0)
    assert len(best.plot().axes) > 0
    best.save(tmp_path / "tuning.toml")
    report = CliRunner().invoke(application(), ["report", str(tmp_path / "tuning.toml")])
    assert report.exit_code == 0, report.output
    assert "corridor [m]" in (tmp_path / "tuning.html").read_text(encoding="utf-8")


def test_a_corridor_about_another_axis_raises():
    path = initial_path(START, END)
    other = qt.SpiralHelix(path.radius, path.angle, path.height, path.duration, qt.Placement([1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="their placements differ"):
        qt.certify(path, LIMITS, corridor=1.0, reference=other)
    with pytest.raises(ValueError, match="pass reference="):
        qt.certify(path, LIMITS, corridor=1.0)


def test_a_scenario_may_have_a_corridor(tmp_path):
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
    result = CliRunner().invoke(
        application(), ["tune", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"), "--json"]
    )
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    found = {name: content[name]["limit"].index("corridor") for name in ("before", "tuned")}
    assert content["tuned"]["status"][found["tuned"]] == "proved"
    assert content["before"]["worst_value"][found["before"]] == 0.0
    assert content["change"]["deviation"] <= 1.0
    report = CliRunner().invoke(application(), ["report", str(tmp_path / "out")])
    assert report.exit_code == 0
    assert "corridor [m]" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")

"""`tune` with limits that change along the way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import qtraj as qt
from qtraj.design.tuning.model import build
from qtraj.design.tuning.motions.registry import get_motion
from qtraj.design.tuning.objectives.registry import get_objective
from qtraj.design.tuning.peaks import find_peaks
from qtraj.design.tuning.problem import pose
from qtraj.design.tuning.searches import Curves, searches_of
from qtraj.design.tuning.targets import search_limits
from qtraj.design.tuning.travelled import Travelled
from qtraj.design.tuning.zones import zones_of

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
TIME = 4.6
U = np.linspace(0.0, 1.0, 401)


def tuned(limits, **options):
    return qt.tune(START, END, limits, **({"motion": "hermite", "duration": TIME} | options))


def sampled(path, name):
    """Return distances and values at 401 instants, by the polynomials of the path and the trapezoidal rule."""
    t, p = U * float(path.duration), np.polynomial.polynomial
    r, angle, h = (
        [p.polyval(t, p.polyder(np.asarray(c), k) if k else np.asarray(c)) for k in range(3)]
        for c in (path.radius, path.angle, path.height)
    )
    v = np.stack([r[1], r[0] * angle[1], h[1]], axis=1)
    a = np.stack([r[2] - r[0] * angle[1] ** 2, 2 * r[1] * angle[1] + r[0] * angle[2], h[2]], axis=1)
    speed = np.linalg.norm(v, axis=1)
    s = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    return s, speed if name == "speed" else np.linalg.norm(np.cross(v, a), axis=1) / speed


def best_by_slsqp(name, along):
    """Return the least objective that SLSQP finds with limits at samples and where the limit changes."""
    states = jax.tree.map(np.asarray, (START, END))
    problem = pose(*states, get_objective("nearest", None), get_motion("hermite"), np.asarray(TIME))
    d, values = np.asarray(along.distance), np.asarray(along.values)
    before = values[1:] if along.kind == "linear" else values[:-1]

    def log_ratios(z):
        s, q = sampled(problem.path(z), name)
        at_changes = np.interp(d[1:], s, q)
        ratios = np.asarray(along.at(s)) / q, values[1:] / at_changes, before / at_changes
        return np.log(np.concatenate(ratios))

    found = minimize(
        lambda z: float(problem.cost(z)),
        np.zeros(7),
        constraints={"type": "ineq", "fun": log_ratios},
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-10},
    )
    assert log_ratios(found.x).min() > -1e-6
    return found.fun * float(problem.scale)


FOUR = [
    ("speed", [9.0, 7.4, 8.6], "step"),
    ("speed", [7.6, 9.5, 8.4], "linear"),
    ("lateral_acceleration", [2.6, 1.9, 2.4], "linear"),
    ("lateral_acceleration", [1.9, 2.7, 2.2], "step"),
]
OTHER = {"step": "linear", "linear": "step"}


@pytest.mark.parametrize(
    ("name", "values", "kind"),
    [*FOUR, *(pytest.param(*case[:2], OTHER[case[2]], marks=pytest.mark.slow) for case in FOUR)],
)
def test_optima_agree_with_slsqp(name, values, kind):
    along = qt.Along([0.0, 14.0, 26.0], values, kind)
    best = tuned(qt.Limits(**{name: along}))
    assert best.converged
    assert best.certificate.status[name] == "proved"
    assert float(best.objective) == pytest.approx(best_by_slsqp(name, along), rel=1e-3)
    assert best.certificate.active == [name]


def posed(limits):
    states = jax.tree.map(lambda x: np.asarray(x)[None], (START, END))
    problem = pose(*states, get_objective("nearest", None), get_motion("hermite"), np.asarray(TIME))
    plain = searches_of(problem, search_limits(limits, None, 1), np.full((1, 7), -9.0), np.full((1, 7), 9.0))
    length = Travelled(Curves(plain, np.zeros((7, 1))), 1).length
    return searches_of(problem, plain.limits, plain.low.T, plain.high.T, zones_of(limits, None, 1, length)), length


def test_lengths_and_times_of_distances():
    searches, length = posed(qt.Limits(speed=qt.Along([0.0, 9.0], [5.0, 6.0])))
    path = qt.SpiralHelix.hermite(START, END, TIME)
    assert length[0] == pytest.approx(float(path.length()), rel=1e-12)
    travelled = Travelled(Curves(searches, np.zeros((7, 1))), 1)
    for s in (0.0, 9.0, 25.0, 99.0):
        u = travelled.times(np.array([s]))
        assert travelled.at(u[None])[0, 0] == pytest.approx(min(s, length[0]), abs=1e-11)


@pytest.mark.parametrize("kind", ["step", "linear"])
def test_derivatives_of_constraints_agree_with_differences(kind):
    limits = qt.Limits(
        speed=qt.Along([0.0, 12.0, 25.0], [8.0, 7.0, 9.0], kind),
        longitudinal_acceleration=(-2.0, qt.Along([0.0, 9.0], [1.5, 2.5], kind)),
    )
    searches, _ = posed(limits)
    z = np.random.default_rng(2).normal(0.0, 0.05, (7, 1))
    peaks, _ = find_peaks(searches, Curves(searches, z))
    model = build(searches, z, peaks)
    compared = 0
    for k in np.flatnonzero(~peaks.fixed & (peaks.limit >= len(searches.limits))):
        slopes, values = [], []
        for j in range(7):
            near = []
            for step in (1e-6, -1e-6):
                moved = z.copy()
                moved[j] += step
                other, _ = find_peaks(searches, Curves(searches, moved))
                same = (other.limit == peaks.limit[k]) & ~other.fixed & (other.edge == peaks.edge[k])
                same &= abs(other.time - peaks.time[k]) < 1e-3
                if same.sum() != 1:
                    break
                at = np.flatnonzero(same)[0]
                near.append((other.value[at], build(searches, moved, other).slopes[other.rank[at], :, 0]))
            if len(near) < 2:
                break
            values.append((near[0][0] - near[1][0]) / 2e-6)
            slopes.append((near[0][1] - near[1][1]) / 2e-6)
        if len(values) == 7:
            row = peaks.rank[k]
            if model.value[row, 0] == peaks.value[k]:  # not expressed by a square
                np.testing.assert_allclose(model.slopes[row, :, 0], values, atol=1e-6)
                np.testing.assert_allclose(model.curvatures[row, :, :, 0], slopes, atol=1e-4 * np.abs(slopes).max())
                compared += 1
    assert compared >= 3


def test_several_limits_and_objectives():
    zones = {
        "speed": qt.Along([0.0, 15.0, 25.0], [9.0, 7.0, None]),
        "curvature": qt.Along([0.0, 10.0, 30.0], [0.06, 0.05, 0.1]),
        "longitudinal_acceleration": (qt.Along([0.0, 20.0], [-3.0, -2.0]), 3.0),
    }
    for objective in ("fastest", "smoothest"):
        best = tuned(
            qt.Limits(**zones), objective=objective, starts=3, duration=TIME if objective != "smoothest" else 5.6
        )
        assert best.converged, (objective, best.result)
        assert best.certificate.holds


def test_equal_zones_are_one_limit():
    same = tuned(qt.Limits(speed=qt.Along([0.0, 13.0, 21.0], [8.0, 8.0, 8.0])))
    assert float(same.objective) == pytest.approx(float(tuned(qt.Limits(speed=8.0)).objective), rel=1e-6)


def test_a_batch_has_the_results_of_its_problems():
    limits = qt.Limits(speed=qt.Along([0.0, 15.0, 25.0], [9.0, 8.5, None]))
    speeds = [7.0, 8.0]
    starts = jax.vmap(lambda v: qt.BoundaryState(START.position, jnp.stack([1.0, v, 0.3])))(jnp.array(speeds))
    ends = jax.vmap(lambda _: END)(jnp.array(speeds))
    best = qt.tune(starts, ends, limits, motion="hermite", duration=TIME)
    for k, v in enumerate(speeds):
        one = qt.tune(qt.BoundaryState(START.position, [1.0, v, 0.3]), END, limits, motion="hermite", duration=TIME)
        assert float(best.objective[k]) == pytest.approx(float(one.objective), rel=1e-9)
        assert best.status[k] == one.status == "converged"


def test_areas_hold_on_the_tuned_path():
    area = [(5, 15), (25, 15), (25, 25), (5, 25)]
    best = tuned(qt.Limits(speed=qt.Regions([(area, 6.5)], outside=9.0), longitudinal_acceleration=(-3, 3)))
    assert best.converged
    assert best.certificate.holds
    t = np.linspace(0.0, float(best.path.duration), 4001)
    table = qt.evaluate(best.path, t, ("position", "speed"))
    x, y, _ = np.asarray(table.position).T
    inside = (x > 5) & (x < 25) & (y > 15) & (y < 25)
    assert np.asarray(table.speed)[inside].max() <= 6.5


@pytest.mark.slow
def test_contradicting_limits_are_infeasible():
    limits = qt.Limits(speed=qt.Along([0.0, 10.0], [6.0, 5.0]))  # the ends are 34 m apart
    best = tuned(limits, starts=1, bounds={"duration": (None, 5.0)})
    assert best.status == "infeasible"
    assert "Raise the limits that are violated" in best.result


@pytest.mark.parametrize(
    ("limits", "options", "text"),
    [
        (qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0])), {"method": "lbfgs"}, "pass method='sqp'"),
        (qt.Limits(tilt=qt.Along([0.0, 9.0], [0.5, 0.4], "linear")), {}, "an angle that changes linearly"),
    ],
)
def test_what_is_not_supported_is_named(limits, options, text):
    with pytest.raises(ValueError, match=text):
        tuned(limits, **options)


def test_derivatives_are_refused():
    limits = qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0]))
    with pytest.raises(ValueError, match="omit the derivatives"):
        jax.grad(lambda t: qt.tune(START, END, limits, motion="hermite", duration=t).objective)(TIME)

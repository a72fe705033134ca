"""Closed circuits: cyclic equations, closed forms on a circle, symmetry, and the state where the lap is repeated."""

from pathlib import Path

import jax
import numpy as np
import pytest
from benchmarks.circuit import centre_line
from tests.design.route_derivatives import compare_with_automatic

import qtraj as qt
from qtraj.design.solve import chain, nonconvex
from qtraj.design.solve.nonconvex import Search
from qtraj.design.tuning_route import rounds, setup
from qtraj.design.tuning_route.program import RouteProgram

ROOT = Path(__file__).parents[2]
LIMITS = {"speed": 40.0, "lateral_acceleration": 8.0, "longitudinal_acceleration": 4.0}
NAMES = tuple(LIMITS)
TUBE, COUNT = 3.0, 30
RADIUS = 50.0
SHORT = 36.0
"""The shorter semi-axis of the ellipse [m]; the longer one is the radius of the circle."""


def ellipse(short=RADIUS, first=0, speed=5.0):
    """An ellipse that is driven slowly, with segments of equal length, from the joint `first` on."""
    u = np.linspace(0, 2 * np.pi, 20001)
    rate = np.hypot(RADIUS * np.sin(u), short * np.cos(u))
    s = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(u)))
    u = np.interp(np.linspace(0, s[-1], COUNT + 1), s, u)
    u = np.append(np.roll(u[:-1], -first), u[first])
    x, y, zero = RADIUS * np.cos(u), short * np.sin(u), 0 * u
    along = np.stack([-RADIUS * np.sin(u), short * np.cos(u), zero], axis=1)
    rate = np.linalg.norm(along, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0], zero], axis=1) / rate
    bent = RADIUS * short / rate**3
    times = np.linspace(0, s[-1] / speed, COUNT + 1)
    return qt.Route(times, np.stack([x, y, zero], axis=1), speed * along / rate, speed**2 * bent * left)


def problem_of(route):
    given = setup.parts(route, closed=True)
    widths, free = np.full((COUNT + 1, 2), TUBE), np.zeros((COUNT + 1, 3), bool)
    bounds = np.array(list(LIMITS.values()))
    return setup.problem_of(given, NAMES, bounds, widths, free, "fastest", False, closed=True)


def fastest(route, lateral=LIMITS["lateral_acceleration"], tube=TUBE):
    limits = qt.Limits(**(LIMITS | {"lateral_acceleration": lateral}))
    return qt.tune_route(route, limits, tube=(tube, 1.0), objective="fastest", closed=True)


@pytest.fixture(scope="module")
def round_lap():
    return fastest(ellipse())


@pytest.fixture(scope="module")
def lap():
    return fastest(ellipse(SHORT))


def test_the_cyclic_chain_is_solved_as_a_dense_matrix():
    rng = np.random.default_rng(0)
    n, b = 6, 4
    blocks = rng.normal(size=(n, b, b))
    dense = np.zeros((n, b, n, b))
    for i in range(n):
        dense[(i + 1) % n, :, i] += blocks[i]
    dense = dense.reshape(n * b, n * b)
    dense = dense + dense.T
    least = np.linalg.eigvalsh(dense)[0]
    right = rng.normal(size=(n, b))
    for shift, positive in ((1 - least, True), (-least - 0.5, False)):
        whole = (dense + shift * np.eye(n * b)).reshape(n, b, n, b)
        diagonal = np.stack([np.eye(b), *(whole[i, :, i] for i in range(1, n))])
        lower = np.stack([np.zeros((b, b)), *(whole[i + 1, :, i] for i in range(1, n - 1))])
        side = np.concatenate([np.zeros((1, b, b)), whole[1:, :, 0]])
        cyclic = chain.Chain(diagonal, lower, chain.Border(whole[0, :, 0], side))
        solver = cyclic.solver()
        assert (solver is not None) == positive
        assert (cyclic.indefinite_block() is None) == positive
        if positive:
            found = solver(right)
            known = np.linalg.solve(whole.reshape(n * b, n * b), right.ravel()).reshape(n, b)
            np.testing.assert_allclose(found, known, rtol=0, atol=1e-12)
            np.testing.assert_allclose(cyclic.product(found), right, rtol=0, atol=1e-12)
            more = cyclic.shifted(np.full((n, b), 0.7))
            np.testing.assert_allclose(more.product(found), right + 0.7 * found, rtol=0, atol=1e-12)


def test_the_indefinite_block_is_the_last_of_a_leading_part_with_a_negative_eigenvalue():
    rng = np.random.default_rng(3)
    n, b, k = 7, 3, 4
    diagonal, lower = np.tile(9.0 * np.eye(b), (n, 1, 1)), rng.uniform(-1, 1, (n - 1, b, b))
    own = chain.Chain(diagonal, lower)
    assert own.indefinite_block() is None
    diagonal[k, 1, 1] = -2.0
    assert own.indefinite_block() == k
    shift = np.zeros((n, b))
    shift[k] = 20.0
    assert own.shifted(shift).indefinite_block() is None
    side = np.zeros((n, b, b))
    diagonal[k, 1, 1], diagonal[0], lower[0] = 9.0, np.eye(b), 0.0
    for corner, expected in ((9.0, None), (-1.0, 0)):
        cyclic = chain.Chain(diagonal, lower, chain.Border(corner * np.eye(b), side))
        assert cyclic.indefinite_block() == expected


def test_derivatives_are_those_of_automatic_differentiation():
    compare_with_automatic(RouteProgram(problem_of(ellipse(SHORT))), np.random.default_rng(1), 0.05)


def test_the_fastest_lap_of_a_circle_is_its_inner_edge(round_lap):
    """With the lateral acceleration A, a lap at the radius r takes 2π√(r/A), so the smallest radius is the fastest."""
    assert round_lap.converged, str(round_lap)
    assert round_lap.certificate.holds
    known = 2 * np.pi * np.sqrt((RADIUS - TUBE) / LIMITS["lateral_acceleration"])
    assert known <= float(round_lap.path.duration) < known * (1 + 1e-4)
    away = np.linalg.norm(np.asarray(round_lap.displacement), axis=1)
    np.testing.assert_allclose(away, TUBE, rtol=0, atol=1e-3)


def test_derivatives_of_the_lap_of_a_circle_are_those_of_the_closed_form(round_lap):
    lateral = LIMITS["lateral_acceleration"]
    found = jax.grad(lambda a, w: fastest(ellipse(), a, w).path.duration, (0, 1))(lateral, TUBE)
    time = float(round_lap.path.duration)
    np.testing.assert_allclose(found, [-time / (2 * lateral), -time / (2 * (RADIUS - TUBE))], rtol=1e-3)


def test_limits_hold_on_a_lap_and_where_it_is_repeated(lap):
    assert lap.converged, str(lap)
    joints = np.asarray(lap.path.joints())
    np.testing.assert_allclose(joints[-1], joints[0], rtol=0, atol=1e-9)
    twice = lap.path + lap.path
    assert np.abs(np.asarray(twice.jumps())).max() < 1e-9
    t = np.linspace(0, float(twice.duration), 200_001)
    values = qt.evaluate(twice, t, NAMES).values
    for name, bound in LIMITS.items():
        assert np.max(values[name]) <= bound * (1 + 1e-12)
    assert np.max(values["lateral_acceleration"]) > 0.999 * LIMITS["lateral_acceleration"]
    assert np.max(values["longitudinal_acceleration"]) > 0.99 * LIMITS["longitudinal_acceleration"]


def test_a_symmetric_circuit_has_a_symmetric_lap(lap):
    """The start is not special: half a lap later the states are the opposite ones."""
    joints = np.asarray(lap.path.joints())[:-1]
    opposite = -np.roll(joints, COUNT // 2, axis=0)
    np.testing.assert_allclose(joints[:, 0], opposite[:, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(joints[:, 1], opposite[:, 1], rtol=0, atol=1e-6)


def test_the_lap_does_not_depend_on_its_start(lap):
    other = fastest(ellipse(SHORT, first=4))
    assert other.converged, str(other)
    assert float(other.path.duration) == pytest.approx(float(lap.path.duration), rel=2e-5)


def test_the_lap_is_faster_than_any_lap_along_the_centre_line(lap):
    """Along the centre line with the curvature κ, the lateral acceleration A alone requires ∫√(κ/A) ds."""
    u = np.linspace(0, 2 * np.pi, 20001)
    rate = np.hypot(RADIUS * np.sin(u), SHORT * np.cos(u))
    bent = RADIUS * SHORT / rate**3
    least = np.trapezoid(np.sqrt(bent / LIMITS["lateral_acceleration"]) * rate, u)
    assert float(lap.path.duration) < 0.97 * least


def test_iterates_keep_the_limits_at_the_nodes():
    program = RouteProgram(problem_of(ellipse(SHORT)))
    first = Search(nonconvex.start(program, np.zeros(program.problem.free.shape), 1.0, rounds.BARRIER), rounds.BARRIER)
    rules = nonconvex.Rules(np.ones_like(program.full), rounds.ROUGH, inside=True)
    worst, times = [], []
    for most in range(1, 26, 2):
        time, values = program.evaluate(nonconvex.solve(program, first, rules, most).at.z)
        worst.append(np.max(values - program.full))
        times.append(time)
    assert max(worst) <= 0
    assert min(times) < 0.4 * times[0]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"route": ellipse().window(0.0, 40.0)}, "must end where it starts"),
        ({"tube": np.append(2.0, np.full(COUNT, 3.0))}, "half-widths .* were given for them"),
    ],
)
def test_wrong_arguments_are_refused(change, match):
    given = {"route": ellipse(), "limits": qt.Limits(**LIMITS), "objective": "fastest", "closed": True}
    with pytest.raises(ValueError, match=match):
        qt.tune_route(**(given | change))


def test_the_example_is_the_circuit_of_the_benchmark():
    stored, drawn = qt.load(ROOT / "examples" / "circuit.json"), centre_line()
    np.testing.assert_allclose(stored.joints(), drawn.joints(), rtol=0, atol=1e-9)
    np.testing.assert_allclose(stored.joints()[-1], stored.joints()[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("cyclic", [False, True])
def test_indefinite_systems_are_solved(cyclic):
    rng = np.random.default_rng(5)
    diagonal, lower = rng.normal(size=(6, 4, 4)), rng.normal(size=(5, 4, 4))
    diagonal, border = diagonal + diagonal.swapaxes(1, 2), None
    if cyclic:
        corner, side = diagonal[0], rng.normal(size=(6, 4, 4))
        diagonal[0], lower[0], side[0] = np.eye(4), 0.0, 0.0
        border = chain.Border(corner, side)
    matrix = chain.Chain(diagonal, lower, border)
    known = rng.normal(size=(6, 4))
    assert matrix.solver() is None
    found = matrix.solver(indefinite=True)(known)
    np.testing.assert_allclose(matrix.product(found), known, rtol=0, atol=1e-10)

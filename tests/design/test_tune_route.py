"""Routes tuned within limits and a tube: derivatives, optima of another solver, proofs against dense samples."""

from fractions import Fraction
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from tests.design.route_derivatives import compare_with_automatic

import qtraj as qt
from qtraj.design.solve import chain, nonconvex
from qtraj.design.solve.nonconvex import RENEWALS, Search
from qtraj.design.tuning_route import constraints, rounds, setup
from qtraj.design.tuning_route.problem import objective, segments
from qtraj.design.tuning_route.program import RouteProgram
from qtraj.design.tuning_route.tube import Displacement, _halves, _positive
from qtraj.path.route import from_segments

NAMES = ("curvature", "speed", "lateral_acceleration")
BOUNDS = (0.0212, 9.5, 1.4)
LIMITS = qt.Limits(**dict(zip(NAMES, BOUNDS, strict=True)))
TUBE = 0.5
ORIGIN = np.array([623425.5, 4848821.0, 153.0])


def position(t):
    s = 8 * t - 6 * np.sin(0.15 * t)
    return np.stack([s, 6 * np.sin(0.06 * s), 0.5 * np.cos(0.02 * s)], axis=-1)


def drive(count=14, start=7.0, h=1e-3):
    """A drive in bends at a changing speed, which is too fast in some of them."""
    t = start + np.arange(count + 1.0)
    before, here, after = position(t - h), position(t), position(t + h)
    return qt.Route(t, here + ORIGIN, (after - before) / (2 * h), (after - 2 * here + before) / h**2)


def problem_of(route, kind="nearest", bounds=BOUNDS):
    given = setup.parts(route)
    joints = len(given.h) + 1
    fixed = np.zeros((joints, 3), bool)
    fixed[[0, -1]] = True
    found = setup.problem_of(
        given, NAMES, np.array(bounds), np.full((joints, 2), TUBE), fixed, kind, kind == "smoothest"
    )
    return given, found


@pytest.fixture(scope="module")
def route():
    return drive()


@pytest.fixture(scope="module")
def tuned(route):
    return qt.tune_route(route, LIMITS, tube=TUBE)


def seen(route, names, count=100_001):
    """The largest values at many instants."""
    t = np.linspace(0, float(route.duration), count)
    return {name: float(np.max(qt.evaluate(route, t, (name,)).values[name])) for name in names}


def test_the_chain_is_solved_as_a_dense_matrix():
    rng = np.random.default_rng(0)
    n, b = 5, 10
    lower = rng.normal(size=(n - 1, b, b))
    dense = np.zeros((n * b, n * b))
    for i in range(n - 1):
        dense[(i + 1) * b : (i + 2) * b, i * b : (i + 1) * b] = lower[i]
    dense = dense + dense.T
    diagonal = np.stack([(m := rng.normal(size=(b, b))) @ m.T + 12 * np.eye(b) for _ in range(n)])
    for i in range(n):
        dense[i * b : (i + 1) * b, i * b : (i + 1) * b] = diagonal[i]
    known = np.linalg.eigvalsh(dense)[0]
    right = rng.normal(size=(n, b))
    for shift, positive in ((1 - known, True), (-known - 0.5, False)):
        whole = chain.Chain(diagonal + shift * np.eye(b), lower)
        solver = whole.solver()
        assert (solver is not None) == positive
        if positive:
            found = solver(right)
            expected = np.linalg.solve(dense + shift * np.eye(n * b), right.ravel()).reshape(n, b)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
            np.testing.assert_allclose(whole.product(found), right, rtol=0, atol=1e-10)
            np.testing.assert_allclose(whole.product(jnp.asarray(found)), right, rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", ["nearest", "smoothest", "fastest"])
def test_derivatives_are_those_of_automatic_differentiation(route, kind):
    _, problem = problem_of(route, kind)
    compare_with_automatic(RouteProgram(problem), np.random.default_rng(1), 0.05)


@pytest.mark.parametrize("kind", ["nearest", "smoothest"])
def test_the_optimum_at_the_nodes_is_that_of_slsqp(kind):
    """The same sampled problem, with constant margins, by SciPy."""
    bounds = (0.0212, 9.5, 1.4 if kind == "nearest" else 1.6)
    given, problem = problem_of(drive(4, 15.0), kind, bounds)
    program = RouteProgram(problem)
    first = Search(nonconvex.start(program, np.zeros(problem.free.shape), 1.0, 0.1), 0.1, renewals=RENEWALS)
    search = nonconvex.solve(program, first, nonconvex.Rules(np.ones_like(program.full), rounds.LEAST), 300)
    assert search.done
    free, rows = np.flatnonzero(problem.free), np.flatnonzero(problem.used)

    def placed(x):
        return segments(problem, jnp.zeros(problem.free.size).at[free].set(x).reshape(problem.free.shape))

    def cost(x):
        return objective(problem, placed(x))

    def slack(x):
        return 1 - constraints.values(problem, placed(x)).ravel()[rows]

    value, jacobian = jax.jit(jax.value_and_grad(cost)), jax.jit(jax.jacfwd(slack))
    slack = jax.jit(slack)
    constraint = {"type": "ineq", "fun": lambda x: np.asarray(slack(x)), "jac": lambda x: np.asarray(jacobian(x))}
    found = minimize(
        lambda x: tuple(map(np.asarray, value(x))),
        np.zeros(free.size),
        jac=True,
        constraints=[constraint],
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success
    ours = float(objective(problem, segments(problem, search.at.z)))
    assert ours == pytest.approx(found.fun, rel=1e-5, abs=1e-6)
    assert np.min(slack(search.at.z.ravel()[free])) > -1e-9
    assert ours > 1e-3
    assert len(given.h) == 4


def test_limits_are_proved_and_hold_at_dense_samples(route, tuned):
    assert not qt.certify(route, LIMITS).met
    assert tuned.converged, str(tuned)
    assert tuned.certificate.holds
    assert np.all(tuned.within)
    assert tuned.result.startswith("every limit is proved to be satisfied on every segment.")
    values = seen(tuned.path, NAMES)
    assert all(values[name] <= bound * (1 + 1e-12) for name, bound in zip(NAMES, BOUNDS, strict=True))
    assert values["lateral_acceleration"] > 0.999 * 1.4, "the nearest route makes use of its limits"


def test_the_tube_holds_at_equal_fractions(route, tuned):
    u = np.linspace(0, 1, 1001)
    times = [np.asarray(r.times) for r in (route, tuned.path)]
    old, new = (
        np.asarray(qt.evaluate(r, (t[:-1, None] + u * np.diff(t)[:, None]).ravel(), ("position",)).position)
        for r, t in zip((route, tuned.path), times, strict=True)
    )
    level = np.linalg.norm((new - old)[:, :2], axis=1).reshape(-1, len(u)).max(axis=1)
    assert level.max() <= TUBE
    np.testing.assert_allclose(level, np.asarray(tuned.distance)[:, 0], rtol=0, atol=1e-3)


def test_the_ends_stay_and_the_joints_have_no_jump(route, tuned):
    old, new = (np.asarray(r.joints()) for r in (route, tuned.path))
    np.testing.assert_allclose(new[[0, -1]], old[[0, -1]], rtol=0, atol=1e-9)
    assert np.abs(np.asarray(tuned.path.jumps())).max() < 1e-9
    np.testing.assert_allclose(new[:, 0] - old[:, 0], tuned.displacement, rtol=0, atol=1e-9)
    assert float(tuned.delay) == pytest.approx(float(tuned.path.duration - route.duration), abs=1e-9)


def test_a_free_end_moves_within_the_limits(route, tuned):
    fixed = np.zeros((route.segments + 1, 3), bool)
    fixed[0] = True
    free = qt.tune_route(route, LIMITS, tube=TUBE, fixed=fixed)
    assert free.converged, str(free)
    assert float(free.objective) < 0.99 * float(tuned.objective)
    change = np.asarray(free.path.joints()) - np.asarray(route.joints())
    assert np.linalg.norm(change[-1, 1]) > 1e-3
    np.testing.assert_allclose(change[0], 0, rtol=0, atol=1e-9)


def test_objectives_differ_as_they_should(route, tuned):
    bound = qt.Limits(curvature=0.0212, speed=9.5, lateral_acceleration=1.6)
    smooth = qt.tune_route(route, bound, tube=(0.8, 0.1), objective="smoothest")
    quick = qt.tune_route(route, LIMITS, objective="fastest")
    assert smooth.converged, str(smooth)
    assert quick.converged, str(quick)
    assert float(smooth.path.duration) == pytest.approx(float(route.duration), abs=1e-9)
    assert np.asarray(smooth.distance).max(axis=0)[1] <= 0.1
    assert float(quick.objective) == pytest.approx(float(quick.path.duration), rel=1e-9)
    assert float(quick.path.duration) < float(tuned.path.duration)
    jerks = [float(x) for x in (_jerk(smooth.path), _jerk(route))]
    assert float(smooth.objective) == pytest.approx(jerks[0], rel=1e-6)


def _jerk(route):
    t = np.asarray(route.times)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    h = np.diff(t)[:, None]
    at = t[:-1, None] + h * (nodes + 1) / 2
    jerk = np.asarray(qt.evaluate(route, at.ravel(), ("jerk_magnitude",)).values["jerk_magnitude"]).reshape(at.shape)
    return np.sum(h / 2 * weights * jerk**2)


def test_a_tuned_window_joins_the_rest(route):
    times = np.asarray(route.times)
    window = route.window(times[6], times[12])
    tuned = qt.tune_route(window, LIMITS)
    assert tuned.converged, str(tuned)
    whole = route.window(0.0, times[6]) + tuned.path + route.window(times[12], times[-1])
    assert whole.segments == route.segments
    assert np.abs(np.asarray(whole.jumps())).max() < 1e-8


def test_segments_at_a_stop_stay_as_they_are():
    x = np.array([0.0, 7, 13, 17, 18.5, 18.5, 18.5, 20, 24, 31, 39])
    v = np.array([7.0, 7, 5, 3, 0, 0, 0, 3, 5.5, 7.5, 8])
    a = np.array([0.0, -1, -2, -2.5, 0, 0, 0, 2, 2, 1, 0])
    zero = 0 * x
    states = [np.stack([c, zero, zero], axis=1) for c in (x, v, a)]
    route = qt.Route(np.arange(11.0), *states)
    tuned = qt.tune_route(route, qt.Limits(curvature=0.1, speed=7.0 + 1.2, lateral_acceleration=2.0))
    kept = np.asarray(tuned.kept)
    np.testing.assert_array_equal(np.flatnonzero(kept), [3, 4, 5, 6])
    assert tuned.code in (qt.ResultCode.undefined_at_stops, qt.ResultCode.successful)
    same = np.asarray(tuned.path.coefficients)[:10][kept] == np.asarray(route.coefficients)[:10][kept]
    assert same.all()


def test_joints_beside_a_kept_segment_take_its_state():
    x = np.array([0.0, 8, 16, 20, 20, 20, 26])
    c = np.zeros((6, 6, 3))
    c[:, 0, 0], c[:, 1, 0] = x[:-1], [8, 8, 4, 0, 0, 6]
    given = setup.parts(from_segments(np.arange(6.0), c, np.asarray(6.0), np.zeros(3)))
    np.testing.assert_array_equal(setup.standing(given.c, given.h), [False, False, False, True, True, False])
    np.testing.assert_array_equal(given.states[:, 1, 0], [8, 8, 6, 0, 0, 0, 6])


def test_tuning_compiles_nothing(route, compiled):
    jax.clear_caches()
    assert qt.tune_route(route, LIMITS).converged
    timed = {"speed": 10.0, "lateral_acceleration": 1.6, "longitudinal_acceleration": 1.5}
    assert qt.tune_route(route, qt.Limits(**timed), objective="fastest").converged
    assert not compiled


def test_a_route_within_its_limits_is_not_changed(route):
    generous = qt.Limits(curvature=1.0, speed=20.0, lateral_acceleration=9.0)
    tuned = qt.tune_route(route, generous)
    assert tuned.converged
    assert int(tuned.iterations) == 0
    assert float(tuned.objective) == 0
    np.testing.assert_array_equal(np.asarray(tuned.distance), 0)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"max_steps": 2}, qt.ResultCode.not_optimal),
        ({"max_steps": 7}, qt.ResultCode.route_not_converged),
    ],
)
def test_a_search_that_stops_early_is_reported(route, tuned, change, code):
    early = qt.tune_route(**({"route": route, "limits": LIMITS} | change))
    assert early.code == code
    assert not early.converged
    assert "Try a larger max_steps" in early.result
    if code == qt.ResultCode.not_optimal:
        assert early.successful
        assert early.certificate.holds
        assert float(early.objective) > 2 * float(tuned.objective)
    else:
        assert "Not proved: " in early.result
        with pytest.raises(RuntimeError, match="stopped before it converged"):
            early.check()


def test_a_search_that_converges_without_a_proof_finds_no_route(route, monkeypatch):
    monkeypatch.setattr(rounds, "ROUNDS", 0)
    monkeypatch.setattr(rounds, "SAFETY", -1e-3)  # limits at the nodes that are too large
    found = qt.tune_route(route, LIMITS, tube=TUBE)
    assert found.code == qt.ResultCode.route_not_found
    assert "cannot prove that no such route exists" in found.result


def test_the_result_is_stored(tuned, tmp_path):
    tuned.save(tmp_path / "tuned.toml")
    again = qt.load(tmp_path / "tuned.toml")
    assert again.result == tuned.result
    for a, b in zip(jax.tree.leaves(tuned), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
    assert "successful, objective" in repr(tuned)


@pytest.mark.parametrize(("peak", "inside"), [(0.4999999, True), (0.5000001, False)])
def test_the_tube_is_proved_or_not_at_a_peak_between_samples(peak, inside):
    """A displacement peak·(4u(1 − u))² sideways is largest at the middle only."""
    bump = peak * np.array([0.0, 0, 16, -32, 16, 0])
    old = np.zeros((3, 6, 3))
    old[:, 1, 0] = 8.0
    new = old.copy()
    new[1, :, 1] += bump
    found = Displacement(new, np.ones(3), old, np.ones(3))
    expected = np.ones((3, 2), bool)
    expected[1, 0] = inside
    np.testing.assert_array_equal(found.within(np.full((4, 2), 0.5)), expected)
    assert found.largest()[1, 0] == pytest.approx(peak, rel=1e-12)


def test_roundings_of_halvings_are_counted():
    """(u − a)² of degree 14 is halved towards a; exact fractions show the roundings, and what they hide is no proof."""
    a = np.random.default_rng(3).uniform(0.1, 0.9, 20)
    k = np.arange(15)
    b = a[:, None] ** 2 - 2 * a[:, None] * k / 14 + k * (k - 1) / (14 * 13)
    row, exact, rounding = b[:1], [Fraction(x) for x in b[0]], 14 * 2.0**-52 * np.abs(b[0]).max()
    for halvings in range(1, 27):
        side = int(a[0] * 2**halvings) % 2
        row, triangle = _halves(row)[side], [exact]
        while len(triangle[-1]) > 1:
            triangle.append([(x + y) / 2 for x, y in pairwise(triangle[-1])])
        exact = [x[-1] for x in reversed(triangle)] if side else [x[0] for x in triangle]
        wrong = max(abs(Fraction(x) - y) for x, y in zip(row[0], exact, strict=True))
        assert wrong <= halvings * rounding
    assert wrong > 0
    zero = np.zeros(len(b))
    assert not _positive(b + 2e-16, zero).any()
    assert _positive(b + 1e-12, zero).all()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"limits": qt.Limits(torsion=0.1)}, "natural trihedral"),
        ({"objective": "best"}, "nearest, smoothest, fastest"),
        ({"objective": "fastest", "limits": qt.Limits(curvature=0.1)}, "bounds the speed"),
        ({"tube": 0.0}, "must be positive"),
        ({"tube": np.ones(3)}, r"shape \(15,\)"),
        ({"fixed": [0, 14]}, "fixed must be a bool array"),
        ({"route": qt.SpiralHelix([10.0], [0.0, 0.4], [0.0], 2.0)}, "Route.from_path"),
    ],
)
def test_wrong_arguments_are_refused(route, change, match):
    with pytest.raises(ValueError, match=match):
        qt.tune_route(**({"route": route, "limits": LIMITS} | change))

"""`tune` keeps a body clear of obstacles: closed forms, both sides, derivatives, and the constraints themselves."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra.jets import Jet
from qtraj.design.obstacles.keep_out import clearances_at
from qtraj.design.tuning import inside
from qtraj.design.tuning.clearances import STRICTER, Clearances
from qtraj.design.tuning.initial import initial_path
from qtraj.design.tuning.motions.registry import MOTIONS
from qtraj.design.tuning.objectives.registry import OBJECTIVES
from qtraj.design.tuning.problem import broadcasting, pose
from qtraj.design.tuning.searches import CurveJets, Curves, searches_of
from qtraj.design.tuning.task import Task, constraint_values

RADIUS, TURN, SPEED = 20.0, 1.2, 6.0
UP = [0.0, 0.0, 1.0]


def state(azimuth, height=0.0):
    """A point of the circle, with the velocity along it."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return qt.BoundaryState([RADIUS * c, RADIUS * s, height], [-SPEED * s, SPEED * c, 0.0])


START, END = state(-TURN / 2), state(TURN / 2)


def displaced(away):
    """The V_ρ or V_h at the start, minus that at the end, and the duration, of the best path that is shifted by `away`
    in its middle.

    With the changes ∓v of one component the shift is vT/4. The cost 2v² + 2(RΔφ/T − V)² is smallest for
    1/T = RΔφV/((RΔφ)² + 16 away²).
    """
    arc = RADIUS * TURN
    duration = (arc**2 + 16 * away**2) / (arc * SPEED)
    return 8 * away / duration, duration


def check(best, component, away):
    """The path is shifted by `away` in its middle, at the cost of the closed form."""
    change, duration = displaced(away)
    first, last = (np.asarray(x.velocity) for x in (best.start, best.end))
    if component == 0:
        both = [v @ [np.cos(a), np.sin(a), 0.0] for v, a in ((first, -TURN / 2), (last, TURN / 2))]
    else:
        both = [first[2], last[2]]
    assert best.status == "converged"
    assert best.certificate.status["keep_out[0]"] == "proved"
    assert both[0] - both[1] == pytest.approx(change, rel=1e-6)
    assert float(best.path.duration) == pytest.approx(duration, rel=1e-7)


@pytest.mark.parametrize("starts", [1, 8])
def test_the_path_touches_a_cylinder_on_its_nearer_side(starts):
    """A mast 0.3 m outside the circle is passed inside, at a touch: the shift is the radius less 0.3 m."""
    limits = qt.Limits(curvature=0.2, keep_out=[qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0)])
    best = qt.tune(START, END, limits, starts=starts)
    check(best, 0, -0.7)
    assert 0 <= best.certificate.worst["keep_out[0]"][1] < 1e-8
    assert "touches keep_out[0]" in best.result


@pytest.mark.parametrize("starts", [1, 8])
def test_the_farther_side_is_tried(starts):
    """A second mast inside makes the inner side longer than the outer one."""
    masts = [qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0), qt.Cylinder([RADIUS - 2.0, 0.0, 0.0], UP, 1.6)]
    best = qt.tune(START, END, qt.Limits(keep_out=masts), starts=starts)
    check(best, 0, 1.3)


@pytest.mark.parametrize(("height", "away"), [(-0.2, 0.8), (0.2, -0.8)])
def test_a_ball_is_passed_above_or_below(height, away):
    best = qt.tune(START, END, qt.Limits(keep_out=[qt.Ball([RADIUS, 0.0, height], 1.0)]), starts=2)
    check(best, 2, away)


def test_a_body_and_walls():
    """The car is clear of a block along the whole path, by dense sampling, too; it touches it with a ball."""
    block = qt.ConvexPolygon([[19.5, -1.0], [21.0, -1.0], [21.0, 1.0], [19.5, 1.0]])
    limits = qt.Limits(curvature=0.2, keep_out=[block], body=[(-1.3, 0.5), (1.3, 0.5)])
    best = qt.tune(START, END, limits, motion="hermite", starts=2)
    assert best.status == "converged"
    assert best.certificate.status == {"curvature": "proved", "keep_out[0]": "proved"}
    t = np.linspace(0.0, float(best.path.duration), 5001)
    smallest = np.asarray(qt.clearance(best.path, t, limits)["keep_out[0]"]).min()
    assert -1e-12 < smallest < 1e-4
    # The same paths without the car are shorter.
    point = qt.tune(START, END, dataclasses.replace(limits, body=None), motion="hermite", starts=2)
    assert point.status == "converged"
    assert point.objective < best.objective


def test_an_obstacle_that_crosses_the_path():
    """A ball that moves inwards through the circle is passed while it moves; at rest there it would be no obstacle."""
    crossing = qt.Ball([[RADIUS + 3.0, 0.0, 0.0], [-1.5, 0.0, 0.0]], 1.0)
    limits = qt.Limits(speed=8.0, keep_out=[crossing])
    initial = initial_path(START, END)
    assert qt.certify(initial, limits).status["keep_out[0]"] == "broken"
    assert qt.certify(initial, qt.Limits(keep_out=[crossing.at_rest()])).status["keep_out[0]"] == "proved"
    best = qt.tune(START, END, limits, starts=2)
    assert best.status == "converged"
    assert best.certificate.status == {"speed": "proved", "keep_out[0]": "proved"}


def test_limits_along_the_way_together_with_obstacles():
    speed = qt.Along([0.0, 10.0], [8.0, 5.0])
    limits = qt.Limits(speed=speed, keep_out=[qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0)])
    best = qt.tune(START, END, limits, starts=2)
    assert best.status == "converged"
    assert set(best.certificate.status.values()) == {"proved"}


def test_what_is_inside_an_obstacle_is_named_at_once():
    around = qt.Ball([RADIUS * np.cos(TURN / 2), RADIUS * np.sin(TURN / 2), 0.3], 1.0)
    with pytest.raises(ValueError, match=r"at the end, .* inside keep_out\[1\], by 0.7 m"):
        qt.tune(START, END, qt.Limits(keep_out=[qt.HalfSpace(UP, -1.0), around]))
    with pytest.raises(ValueError, match=r"at the start, .* inside keep_out\[0\], by 0.5 m"):
        qt.tune(START, END, qt.Limits(keep_out=[qt.HalfSpace(UP, 0.0)], body=[(0.0, 0.5)]))
    # A ball in front may be clear, in another direction.
    mast = qt.Cylinder([RADIUS * np.cos(TURN / 2) - 0.6, RADIUS * np.sin(TURN / 2) + 0.8, 0.0], UP, 0.5)
    assert qt.tune(START, END, qt.Limits(keep_out=[mast], body=[(1.0, 0.2)]), motion="hermite", starts=1).converged


@pytest.mark.parametrize("body", [[(-1.3, 0.4), (1.3, 0.4)], [([-1.0, 0.4, 0.1], 0.6), ([1.0, -0.4, 0.1], 0.6)]])
def test_an_end_behind_a_wall_is_named_for_a_body_on_both_sides_of_it(body):
    """Each ball alone may be clear of the wall, but in no direction both are."""
    x, y = RADIUS * np.cos(TURN / 2), RADIUS * np.sin(TURN / 2)
    walls = qt.ConvexPolygon([[x - 0.15, y - 3], [x + 5, y - 3], [x + 5, y + 3], [x - 0.15, y + 3]])
    with pytest.raises(ValueError, match=r"at the end, .* inside keep_out\[0\], by .* m or more"):
        qt.tune(START, END, qt.Limits(keep_out=[walls], body=body), motion="hermite")


@pytest.mark.parametrize("kind", ["ball", "cylinder", "half space", "polygon"])
def test_the_depth_at_an_end_is_a_lower_bound_in_every_direction(kind):
    """No random direction has less depth, and the bound is exact to the spacing of the directions that are tried."""
    rng = np.random.default_rng(7)
    balls = Clearances([EVERY[kind]], qt.Limits(keep_out=[EVERY[kind]], body=BODY).body)
    body = qt.Limits(keep_out=[EVERY[kind]], body=BODY).body
    positions, directions = NEAR + rng.normal(0, 2.0, (20, 3)), rng.normal(size=(1000, 3))
    found = inside._depth(list(balls.by_name.values()), positions, np)
    for position, depth in zip(positions, found, strict=True):
        centres = body.centres(np.broadcast_to(position, directions.shape), directions)
        each = np.asarray(body.radii)[:, None] - np.asarray(EVERY[kind].distance(centres, 0.0 * centres[..., 0]))
        least = each.max(axis=0).min()
        assert depth <= least + 1e-12
        assert depth > 0 or least < 2 * inside.STEPS * 1.5
    assert (found > 0).any()


def test_an_infeasible_problem_names_the_obstacle_and_the_depth():
    """With fixed velocities the shape of the path is fixed, so a mast on it cannot be avoided."""
    fixed = ("start.V_rho", "end.V_rho", "start.V_h", "end.V_h")
    limits = qt.Limits(speed=9.0, keep_out=[qt.Cylinder([RADIUS + 0.4, 0.0, 0.0], UP, 1.0)])
    best = qt.tune(START, END, limits, fixed=fixed, starts=2)
    assert best.status == "infeasible"
    assert best.certificate.status == {"speed": "proved", "keep_out[0]": "broken"}
    assert best.certificate.worst["keep_out[0]"][1] == pytest.approx(-0.6, abs=1e-6)
    assert "the body enters keep_out[0] by 0.6 m" in best.result
    assert "omit keep_out[0]" in best.result


def objective(x, limits):
    start = qt.BoundaryState(START.position + jnp.array([1.0, 0.2, 0.1]) * x, START.velocity)
    return qt.tune(start, END, limits, starts=1).objective


def test_derivatives_of_the_solution():
    """They agree with finite differences, and the values inside jit with those outside."""
    limits = qt.Limits(keep_out=[qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0)], body=[(0.8, 0.2)])
    step = 1e-4
    expected = float(objective(step, limits) - objective(-step, limits)) / (2 * step)
    assert jax.grad(objective)(0.0, limits) == pytest.approx(expected, rel=1e-6)
    assert jax.jit(lambda x: objective(x, limits))(0.0) == pytest.approx(float(objective(0.0, limits)), rel=1e-9)


def test_a_batch_has_the_results_of_single_problems():
    limits = qt.Limits(keep_out=[qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0)])
    heights = [0.0, 0.5]
    positions = jnp.stack([START.position + jnp.array([0.0, 0.0, h]) for h in heights])
    mast = jnp.array([[RADIUS + 0.3, 0.0, 1.0]])
    starts = jax.vmap(qt.BoundaryState)(jnp.concatenate([positions, mast]), jnp.broadcast_to(START.velocity, (3, 3)))
    ends = jax.tree.map(lambda x: jnp.broadcast_to(x, (3, 3)), END)
    batch = qt.tune(starts, ends, limits, starts=2)
    assert batch.status.tolist() == ["converged", "converged", "ill-posed"]
    assert "inside an obstacle" in batch[2].result
    for k, h in enumerate(heights):
        one = qt.tune(state(-TURN / 2, h), END, limits, starts=2)
        assert batch.objective[k] == pytest.approx(float(one.objective), rel=1e-9)
        assert batch[k].certificate.status == one.certificate.status


def test_traced_obstacles_are_refused():
    with pytest.raises(ValueError, match="obstacles and a body with concrete values"):
        jax.grad(lambda r: objective(0.0, qt.Limits(keep_out=[qt.Ball([RADIUS, 0.0, 0.0], r)])))(1.0)


@pytest.mark.slow
def test_first_steps_of_an_optimiser():
    limits = qt.Limits(keep_out=[qt.Cylinder([RADIUS + 0.3, 0.0, 0.0], UP, 1.0)])
    check(qt.tune(START, END, limits, method="adam", starts=2, inner_steps=100), 0, -0.7)


AXIS = qt.Placement([1.0, -2.0, 0.5], [0.99, 0.02, -0.03, 0.1])
BODY = [(0.0, 0.7), (1.5, 0.4), ([0.5, -0.6, 0.8], 0.3)]
NEAR = [19.0, 0.5, 0.3]
EVERY = {
    "ball": qt.Ball(NEAR, 1.5),
    "cylinder": qt.Cylinder(NEAR, [0.2, -0.1, 1.0], 1.5),
    "ellipsoid": qt.Ellipsoid(NEAR, [2.0, 1.0, 1.5]),
    "half space": qt.HalfSpace([1.0, 0.2, 0.1], 18.0),
    "polygon": qt.ConvexPolygon([[18.0, -1.0], [20.0, -1.0], [20.0, 2.0], [18.5, 2.0]]),
    "moving": qt.Ball([NEAR, [0.3, -0.1, 0.2], [0.0, 0.05, 0.0]], 1.5),
}
COUNT = 40


def searches_around(kind, motion="hermite"):
    """Random paths near one obstacle, about a tilted axis."""
    own = Clearances([EVERY[kind]], qt.Limits(keep_out=[EVERY[kind]], body=BODY).body)
    states = (jax.tree.map(lambda x: np.stack([np.asarray(x)] * COUNT), x) for x in (START, END))
    problem = pose(*states, OBJECTIVES["nearest"], MOTIONS[motion], placement=AXIS, clearances=own)
    limits = {name: np.zeros(COUNT) for name in own.by_name}
    wide = np.full((COUNT, problem.size), 10.0)
    z = 0.3 * np.random.default_rng(11).normal(size=(problem.size, COUNT))
    return searches_of(problem, limits, -wide, wide), z


@pytest.mark.parametrize("kind", EVERY)
def test_the_constraint_has_the_sign_of_the_clearance(kind):
    """It is negative where a ball is clear; for an ellipsoid a ball that is barely clear may count as inside."""
    searches, z = searches_around(kind)
    u = np.linspace(0.05, 0.95, 31)
    names = tuple(searches.limits)
    rows = Curves(searches, z).values(names, u[:, None], 1)
    sides = set()
    for k in range(COUNT):
        path = jax.tree.map(lambda x, k=k: x[k], searches.problem.path(z))
        for name, g in zip(names, rows, strict=True):
            ball = BODY[int(name[-2])]
            body = qt.Limits(keep_out=[EVERY[kind]], body=[ball]).body
            clear = np.asarray(clearances_at([EVERY[kind]], body, path, u * path.duration)["keep_out[0]"])
            own = np.broadcast_to(g, (u.size, COUNT))[:, k]
            decided = np.abs(clear) > 1e-6
            sides |= {True, False} & set((clear[decided] > 0).tolist())
            assert (own[decided & (clear < 0)] > 0).all()
            if kind != "ellipsoid":
                assert (own[decided & (clear > 0)] < 0).all()
            if kind in ("ball", "moving"):
                total = 1.5 + ball[1]
                np.testing.assert_allclose(own, 0.5 * (1 - ((clear + total) / total) ** 2) + STRICTER, atol=1e-11)
    assert sides == {True, False}


@pytest.mark.parametrize("kind", EVERY)
@pytest.mark.parametrize("motion", MOTIONS)
def test_its_derivatives_agree_with_differences(kind, motion):
    """Gradients of values, and Hessians of gradients, in the variables and the time."""
    searches, z = searches_around(kind, motion)
    owner, u, step, n = np.arange(COUNT), np.full(COUNT, 0.47), 1e-5, len(z)
    for name in searches.limits:
        jet: Jet = CurveJets(searches, z).expand(name, owner, u)
        for k in range(n + 1):
            dz, du = step * np.eye(n + 1)[k, :n, None], step * (k == n)
            ends = [CurveJets(searches, z + s * dz).expand(name, owner, u + s * du) for s in (1.0, -1.0)]
            slope, bend = ((a - b) / (2 * step) for a, b in zip(*((x.value, x.gradient) for x in ends), strict=True))
            smooth = np.abs(slope - jet.gradient[k]) < 1e-4 * (1 + np.abs(slope))
            assert smooth.sum() >= COUNT - 1  # the nearest wall may change between the differences
            np.testing.assert_allclose(slope[smooth], jet.gradient[k][smooth], rtol=1e-5, atol=1e-7)
            np.testing.assert_allclose(bend[:, smooth], jet.hessian[k][:, smooth], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("kind", ["cylinder", "polygon", "moving"])
def test_jax_gives_the_same_values(kind):
    searches, z = searches_around(kind)
    names, u = tuple(searches.limits), np.array([0.2, 0.47])
    task = Task(searches.problem, searches.limits, searches.low.T, searches.high.T)
    with broadcasting():
        one = jax.tree.map(lambda x: jnp.asarray(x[0]), task)
        values = constraint_values(one, jnp.asarray(z[:, 0]), jnp.stack([jnp.asarray(u)] * len(names)))
    expected = [g[:, 0] for g in Curves(searches, z).values(names, u[:, None], 1)]
    np.testing.assert_allclose(values, expected, rtol=1e-10, atol=1e-10)


def test_equal_obstacles_are_equal_static_data():
    make = lambda r: Clearances([qt.Ball(NEAR, r)], None)  # noqa: E731
    assert make(1.0) == make(1.0)
    assert hash(make(1.0)) == hash(make(1.0))
    assert make(1.0) != make(1.5)

"""Proofs for all deviations in a box: against sampled paths, at the limit itself, and for what is refused."""

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.box_subdivision import decide
from qtraj.algebra.degrees import Degrees
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.surd import Claim
from qtraj.algebra.tensor_forms import in_floats, in_integers, nodes
from qtraj.design.proof.certificate import BROKEN, UNDECIDED
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.box_problem import BoxProblem
from qtraj.design.robust.family_of_path import family_of_path, paths_of
from qtraj.foundation.document import save

START, END = qt.BoundaryState([20, 0, 0], [0, 6, 0]), qt.BoundaryState([0, 22, 1], [-6, 0, 0.2])
BUS, TRUCK = qt.Vehicle(mass=9000.0), qt.Vehicle(mass=9000.0, drag_area=5.0)
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def path():
    return qt.SpiralHelix.hermite(START, END, 5.5)


def polynomial(u, p, q):
    return (u - p) * (u - p) + 3 * (q * (p * p)) - u * q + 0.3


def values_at_nodes(kind, degrees):
    points = [(float(x), float(y)) for x in nodes(degrees[0]) for y in nodes(degrees[1])]
    if kind is ExactPolynomial:
        u = ExactPolynomial([0, 1])
        return [polynomial(u, ExactPolynomial.of(p), ExactPolynomial.of(q)) for p, q in points]
    p, q = (BoundedPolynomial.constant(np.array(x)) for x in zip(*points, strict=True))
    u = BoundedPolynomial(np.repeat([[0.0], [1.0]], len(points), axis=1))
    return polynomial(u, p, q)


@pytest.mark.parametrize("degrees", [(2, 1), (4, 3)])
def test_forms_are_bernstein_coefficients(degrees):
    """At random points the forms must have the values of the polynomial, and floats and integers must agree."""
    from scipy.stats import binom

    form = in_floats(values_at_nodes(BoundedPolynomial, degrees), degrees)
    exact = in_integers(values_at_nodes(ExactPolynomial, degrees), degrees)
    scale = float(exact.numbers[0, 0, 0]) / form.numbers[0, 0, 0]
    np.testing.assert_allclose(exact.numbers.astype(float) / scale, form.numbers, rtol=0, atol=form.error + ROUNDING)
    for point in np.random.default_rng(0).random((5, 3)):
        value = form.numbers
        for x in point:
            value = np.tensordot(binom.pmf(np.arange(value.shape[0]), value.shape[0] - 1, x), value, axes=(0, 0))
        assert value == pytest.approx(polynomial(*point), abs=1e-10)


@pytest.mark.parametrize("as_rounded", [False, True])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_halves_have_the_values_of_the_whole(axis, as_rounded):
    degrees = (2, 1)
    form = in_integers(values_at_nodes(ExactPolynomial, degrees), degrees)
    form = form.rounded() if as_rounded else form
    left, right = form.halved(axis)
    first, last, of_left, of_right = (f.corners() for f in (form, form, left, right))
    np.testing.assert_array_equal(np.take(of_left, 0, axis), np.take(first, 0, axis))
    np.testing.assert_array_equal(np.take(of_right, 1, axis), np.take(last, 1, axis))
    np.testing.assert_array_equal(np.take(of_left, 1, axis), np.take(of_right, 0, axis))


@pytest.mark.parametrize("add", [-1e-3, 1e-3])
@pytest.mark.parametrize("only_integers", [False, True])
def test_decisions_near_the_smallest_value(add, only_integers):
    """The smallest value of (u − p)² + add is `add`, along the whole diagonal."""
    degrees = (2,)
    u = ExactPolynomial([0, 1])
    exact = [in_integers([(u - float(p)) * (u - float(p)) + add for p in nodes(2)], degrees)]
    p = BoundedPolynomial.constant(np.array(nodes(2), float))
    u = BoundedPolynomial(np.repeat([[0.0], [1.0]], 3, axis=1))
    floats = [in_floats((u - p) * (u - p) + add, degrees)]
    found = decide(Claim(0), exact if only_integers else floats, lambda: exact)
    assert (found.proved, found.refuted) == (add > 0, add < 0)
    if add < 0:
        assert (found.at[0] - found.at[1]) ** 2 + add < 0


def test_floats_prove_nothing_that_is_slightly_violated():
    """Below zero by a few rounding errors, or less than one, along a surface of the box."""
    rng = np.random.default_rng(0)
    for degree in rng.integers(2, 5, 20):
        degrees = 2, int(degree)
        points = np.array([(float(x), float(y)) for x in nodes(degrees[0]) for y in nodes(degrees[1])]).T
        a, b, scale, depth = (float(x) for x in (*rng.random(2), *10.0 ** rng.uniform([-6, -19], [6, -12])))

        def number(x, count=points.shape[1]):
            return BoundedPolynomial.constant(np.full(count, x))

        p, q = (BoundedPolynomial.constant(x) for x in points)
        u = BoundedPolynomial(np.repeat([[0.0], [1.0]], points.shape[1], axis=1))
        w = (u - number(a) * p) - number(b) * (q * q)
        form = in_floats(number(scale) * (w * w) - number(depth * scale), degrees)
        assert not decide(Claim(0), [form], lambda: None).proved


def test_degrees_of_a_product():
    p, q = Degrees((1, 0)), Degrees((0, 1))
    assert (p * p * q - 3.0 * q + 1).exponents == (2, 1)
    assert (-(p + q)).derivative().exponents == (1, 1)
    with pytest.raises(TypeError):
        p * "x"


@pytest.mark.parametrize("name", ["start_speed", "start_radial_speed", "end_axial_speed", "end_axial_position"])
def test_states_of_the_paths(path, name):
    """Only the named component of the state may change."""
    family = family_of_path(path, qt.Box(**{name: 0.5}))
    near = jax.tree.map(lambda x: x[0], paths_of(family, path, np.array([[0.25]])))
    for end, t in (("start", 0.0), ("end", float(path.duration))):
        before, after = (np.asarray(p.rotating_derivatives(t, 1)) for p in (path, near))
        change = after - before
        expected = np.zeros((2, 3))
        if name.startswith(end):
            kind = name.removeprefix(f"{end}_")
            direction = {"radial_speed": [1, 0, 0], "axial_speed": [0, 0, 1], "axial_position": [0, 0, 1]}.get(kind)
            expected[0 if kind == "axial_position" else 1] = 0.25 * np.asarray(
                before[1] / np.linalg.norm(before[1]) if direction is None else direction
            )
        np.testing.assert_allclose(change, expected, atol=ROUNDING)


CASES = [
    (qt.Limits(curvature=0.1), qt.Box(start_speed=0.3)),
    (qt.Limits(lateral_acceleration=3.0), qt.Box(start_speed=0.3, end_radial_speed=0.2)),
    (qt.Limits(slope=0.5), qt.Box(start_axial_speed=0.2, end_axial_position=(-0.1, 0.2), end_speed=0.1)),
    (qt.Limits(longitudinal_acceleration=(None, 2.0)), qt.Box(start_speed=0.3)),
    (qt.Limits(friction=1.0, vehicle=BUS), qt.Box(start_speed=0.2, mass=(-100, 1000))),
    (qt.Limits(power=1e6, vehicle=BUS), qt.Box(end_speed=0.2, mass=(0, 1000))),
    (qt.Limits(power=1e6, vehicle=TRUCK), qt.Box(start_speed=0.2, drag_area=(-2, 8))),
    (qt.Limits(longitudinal_force=(None, 1e6), vehicle=TRUCK), qt.Box(drag_area=3)),
    (qt.Limits(power=1e6, vehicle=TRUCK), qt.Box(start_speed=0.2, mass=(-500, 1000))),
    (qt.Limits(longitudinal_force=1e6, vehicle=TRUCK), qt.Box(mass=(-500, 1000), drag_area=(-2, 8))),
    (qt.Limits(friction=1.0, vehicle=TRUCK), qt.Box(mass=(-500, 1000), drag_area=3)),
    (qt.Limits(height=(None, 3.0)), qt.Box(end_axial_position=0.3)),
    pytest.param(
        qt.Limits(curvature=0.1),
        qt.Box(start_speed=0.1, end_speed=0.1, start_radial_speed=0.1),
        marks=pytest.mark.slow,  # exact polynomials at about 1200 nodes, for each of three decisions
    ),
]


@pytest.mark.parametrize(("limits", "box"), CASES, ids=lambda x: "-".join(x.given()) if hasattr(x, "given") else "")
def test_a_limit_at_the_worst_sample_separates_proofs_from_counterexamples(path, limits, box):
    """No sample may exceed a proved limit, and slightly below the worst sample no limit may be proved."""
    problem = BoxProblem.of(path, limits, box)
    rng = np.random.default_rng(3)
    unit = np.concatenate([rng.random((40, len(box.names))), rng.integers(0, 2, (40, len(box.names)))])
    samples = box.lowest + (box.highest - box.lowest) * unit
    worst = float(problem.values(samples)[1].max())
    (name,) = limits.given()

    def status(factor):
        field = name.removesuffix("_max")
        bound = (None, factor * worst) if name != field else factor * worst
        return qt.certify_box(path, qt.Limits(**{field: bound}, vehicle=limits.vehicle), box)

    assert status(1 - 1e-6).status[name] == "broken"
    proved = status(1.05)
    assert proved.holds
    assert float(proved.values[0]) >= worst * (1 - ROUNDING)
    broken = status(0.9)
    assert broken.status[name] == "broken"
    (_, at, value, limit) = broken.worst[name]
    assert value > limit
    assert float(problem.values(np.array([list(at.values())]))[1][0, 0]) == pytest.approx(value, rel=1e-9)


def test_only_strictest_limits_count(path):
    box = qt.Box(limits={"lateral_acceleration": (-0.2, 0.5)})
    peak = float(qt.certify(path, qt.Limits(lateral_acceleration=9.0)).values[0])
    assert qt.certify_box(path, qt.Limits(lateral_acceleration=peak + 0.21), box).holds
    found = qt.certify_box(path, qt.Limits(lateral_acceleration=peak + 0.19), box)
    assert found.status == {"lateral_acceleration": "broken"}
    assert "strictest limit" in found.result


def test_a_tilted_axis_and_one_that_points_down():
    """Limits on the shape need no vertical axis; with the axis downwards, uphill is still positive."""
    tilted = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 1.0], 3.0, qt.Placement([0, 0, 0], [0.9, 0.1, 0.2, 0.0]))
    box = qt.Box(start_speed=0.2)
    assert qt.certify_box(tilted, qt.Limits(curvature=0.1), box).holds
    with pytest.raises(ValueError, match="slope depends on the vertical"):
        qt.certify_box(tilted, qt.Limits(slope=0.5), box)
    down = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 1.0], 3.0, qt.Placement([0, 0, 5.0], [0, 1, 0, 0]))
    assert qt.certify_box(down, qt.Limits(slope=(None, -0.1), height=(1.5, 5.5)), box).holds
    assert not qt.certify_box(down, qt.Limits(slope=(0.1, None)), box).holds


@pytest.mark.parametrize(
    ("name", "lowest"),
    [
        ("lateral_acceleration", -0.2),
        ("yaw_rate", -0.2),
        pytest.param("yaw_rate", -0.33, marks=pytest.mark.slow),  # floats cannot decide where the speed touches zero
    ],
)
def test_where_the_speed_vanishes_a_quantity_is_undefined(name, lowest):
    """With -0.33 m/s, the speed vanishes at none of the deviations on the grid."""
    path = qt.SpiralHelix([20.0], [0.0, 0.01], [0.0, 0.0], 3.0)
    found = qt.certify_box(path, qt.Limits(**{name: 5.0}), qt.Box(start_speed=(lowest, 0.0)))
    assert found.status == {name: "undefined"}
    with pytest.raises(RuntimeError, match="make the box smaller"):
        found.check()


def test_masses_that_are_added_by_rounding_break_no_limit(path):
    box, vehicle = qt.Box(mass=(-100.3, 200.7)), qt.Vehicle(1500.0)

    def status(limit):
        return qt.certify_box(path, qt.Limits(lateral_force=limit, vehicle=vehicle), box).status["lateral_force"]

    problem = BoxProblem.of(path, qt.Limits(lateral_force=1e9, vehicle=vehicle), box)
    worst = float(problem.values(box.highest[None])[1].item())
    assert [status(worst * (1 + e)) for e in (-1e-9, 1e-12, 1e-9)] == ["broken", "undecided", "proved"]


def test_an_undecided_limit_has_advice_of_its_own(path):
    box = qt.Box(start_speed=0.1)
    found = BoxCertificate(["speed"], box, [UNDECIDED], [1.0], [[0.1]], [6.0], [6.0])
    assert found.status == {"speed": "undecided"}
    assert "divide the box" in found.result
    assert "boxes of any size" not in found.result
    wide = qt.Box(start_speed=0.1, end_speed=0.1)
    long = BoxCertificate(["angular_acceleration"], wide, [UNDECIDED], [1.0], [[0.1, 0.1]], [6.0], [6.0])
    assert "With 2 parameters, proofs of angular_acceleration can take too long in boxes of any size" in long.result
    assert "robust_tune" not in found.result
    broken = BoxCertificate(["speed"], box, [BROKEN], [1.0], [[0.1]], [7.0], [6.0])
    assert "robust_tune" in broken.result
    tuned = qt.tune(START, END, qt.Limits(speed=8.0), motion="hermite", starts=1)
    for each in (found, broken):
        text = BoxTuned(tuned, qt.Limits(speed=8.0), each, 2, 20).result
        assert "not converged after 2 tunings" in text
        assert "robust_tune" not in text


def test_tunings_are_proved_and_at_their_limits():
    limits = qt.Limits(lateral_acceleration=1.5, slope=0.06)
    box = qt.Box(start_speed=0.2, limits={"lateral_acceleration": 0.05})
    found = qt.robust_tune(START, END, limits, box, motion="hermite", starts=2)
    assert found.successful, found.result
    assert qt.certify_box(found.tuned.path, limits, box).holds
    values = BoxProblem.of(found.tuned.path, limits, box).values(np.linspace(-0.2, 0.2, 21)[:, None])[1][:, 0]
    assert 0.999 * 1.45 < values.max() <= 1.45


def test_a_box_that_is_too_large_is_infeasible_with_advice():
    box = qt.Box(limits={"lateral_acceleration": (-1.49, 0.0)}, start_speed=3.0)
    found = qt.robust_tune(START, END, qt.Limits(lateral_acceleration=1.5), box, starts=1)
    assert not found.successful
    assert "make the box smaller" in found.result or "tightened limits" in found.result


def test_results_are_saved(path, tmp_path):
    box = qt.Box(start_speed=(-0.1, 0.2), limits={"speed": 0.1})
    found = qt.certify_box(path, qt.Limits(speed=8.0), box)
    save(box, tmp_path / "box.json")
    found.save(tmp_path / "found.toml")
    loaded = qt.load(tmp_path / "found.toml")
    assert loaded.result == found.result
    for each in (qt.load(tmp_path / "box.json"), found.box, loaded.box):
        assert (each.intervals, each.limits) == (box.intervals, box.limits)
        assert each.intervals["start_speed"] == (-0.1, 0.2)
    assert "start_speed -0.1 m/s to 0.2 m/s" in found.to_xarray().attrs["box"]
    assert "limit on speed -0.1 m/s to 0.1 m/s" in str(loaded)
    assert float(found.to_xarray().worst_start_speed[0]) == pytest.approx(0.2)
    assert "proved" in str(found)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qt.Box(), "every deviation is zero"),
        (lambda: qt.Box(start_speed=-0.1), "a number of 0 or more"),
        (lambda: qt.Box(start_speed=(0.1, np.nan)), "a finite number b"),
        (lambda: qt.Box(start_speed="fast"), "a finite number b"),
        (lambda: qt.Box(start_speed=True), "a finite number b"),
        (lambda: qt.Box(start_speed=(False, True)), "a finite number b"),
        (lambda: qt.Box(limits=0.3), "limits must be a dictionary of deviations"),
        (lambda: qt.Box(intervals=0.3), "intervals must be a dictionary of deviations"),
        (lambda: qt.Box(duration=0.1), "duration is not a parameter of a Box: the duration is fixed"),
        (lambda: qt.Box(friction=0.1), "pass limits="),
        (lambda: qt.Box(start_position=0.1), "only axial positions"),
        (lambda: qt.Box(colour=0.1), "its parameters are start_speed"),
        (lambda: qt.Box(0.1, 0.1, 0.1, 0.1), "at most 3 parameters"),
        (lambda: box_of(limits=qt.Limits(speed=9.0), box=0.1), "box"),
        (lambda: box_of(limits=qt.Limits()), "at least one limit"),
        (lambda: box_of(limits=qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0]))), "supports only limits"),
        (lambda: box_of(limits=qt.Limits(keep_out=[qt.Ball([0, 0, 0], 1.0)])), "omit keep_out"),
        (lambda: box_of(box=qt.Box(limits={"jerk": 1.0})), "no such limit"),
        (lambda: box_of(box=qt.Box(limits={"speed": 9.5})), "it must be positive"),
        (lambda: qt.Box(wind=5.0), r"multiplies the drag by \(1 \+ w/v\)²"),
        (lambda: qt.Box(gain=0.1), "sweep over simulations with random gains"),
        (lambda: box_of(box=qt.Box(start_lateral_speed=0.1)), "only for routes, because a spiral-helix turns"),
        (lambda: qt.robust_tune(START, END, qt.Limits(speed=9.0), qt.Box(end_lateral_position=0.1)), "only for routes"),
        (lambda: box_of(box=qt.Box(mass=10.0)), "limits have no vehicle"),
        (lambda: box_of(box=qt.Box(drag_area=1.0)), "the drag_area deviates, but limits have no vehicle"),
        (lambda: box_of(qt.Limits(power=1e4, vehicle=TRUCK), qt.Box(drag_area=6.0)), "must stay 0 or more"),
        (lambda: box_of(qt.Limits(power=1e4, vehicle=BUS), qt.Box(mass=9e3)), "must stay positive"),
        (lambda: box_of(qt.Limits(power=1e4, vehicle=BUS), qt.Box(mass=(-9e3 + 1e-9, 200.0))), "must stay positive"),
        (lambda: qt.robust_tune(START, END, qt.Limits(speed=9.0), qt.Box(0.1), 0.9), "only for a Spread"),
        (lambda: qt.robust_tune(3, 3, qt.Limits(speed=9.0), qt.Box(0.1)), "start must be a BoundaryState"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


def box_of(limits=None, box=None):
    """A call with defaults."""
    path = qt.SpiralHelix.hermite(START, END, 5.5)
    return qt.certify_box(path, qt.Limits(speed=9.0) if limits is None else limits, qt.Box(0.1) if box is None else box)

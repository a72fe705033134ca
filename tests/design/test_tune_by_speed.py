"""`tune` and `tune_route` with limits that depend on the speed: fixed points by hand, SciPy, and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq, minimize

import qtraj as qt
from qtraj.algebra.jets import coordinates
from qtraj.design.timing.speed_ratio import SpeedEllipse, SpeedLimit
from qtraj.path.frenet import Invariants

CLOSED_FORM, ORACLE, SAME = 2e-5, 1e-4, 1e-5
"""Relative tolerances: against closed forms, against SciPy on samples, and between two forms of one limit."""

ROUNDED, DIFFERENCE = 0.002, 1e-4
"""The largest distance of a rounded curve from the exact one, relative to its values, and of derivatives."""

SPEEDS, VALUES = [0, 15, 30], [9, 8, 4]
GRIP = qt.BySpeed(SPEEDS, magnitude=VALUES)
GGV = qt.Ellipse(qt.BySpeed([0, 40], magnitude=[8, 6]), qt.BySpeed([0, 15, 40], magnitude=[4, 3, 0.5]), GRIP)
MOTOR = qt.BySpeed([0, 12, 30], lower=[-8, -5, -3], upper=[4, 2, 0.5])
ANGLES = np.linspace(0, 2 * np.pi, 33)[:-1]
CIRCLE = qt.Shape.through(50 * np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1), closed=True)
BEND = qt.Shape.through([[-60, 0, 0], [-30, 0, 0], [0, 0, 0], [28, 12, 0], [40, 40, 0], [40, 70, 0], [40, 100, 0]])
START, END = qt.BoundaryState([30.0, 0, 0], [2.0, 14, 0.5]), qt.BoundaryState([0.0, 36, 6], [-13, 1, 0.5])


def fixed_point(radius: float) -> float:
    """The speed at which v²/r is the lateral limit."""
    return brentq(lambda v: v * v / radius - np.interp(v, SPEEDS, VALUES), 1, 40)


@pytest.mark.parametrize(
    "limits",
    [
        qt.Limits(combined_acceleration=qt.Ellipse(8, 3, GRIP)),
        qt.Limits(lateral_acceleration=GRIP, longitudinal_acceleration=(-0.01, 0.01)),
    ],
)
def test_the_fastest_line_on_a_ring_is_the_inner_circle_at_the_fixed_point(limits):
    tuned = qt.tune_route(CIRCLE, limits, tube=(2.0, 0.05))
    assert tuned.certificate.holds, tuned.result
    assert float(tuned.path.duration) == pytest.approx(2 * np.pi * 48 / fixed_point(48.0), rel=CLOSED_FORM)


@pytest.mark.parametrize(
    "limits", [qt.Limits(combined_acceleration=qt.Ellipse(8, 3, GRIP)), qt.Limits(lateral_acceleration=GRIP)]
)
def test_the_fastest_quarter_of_a_circle_is_driven_at_the_fixed_point(limits):
    circle = qt.BoundaryState([50.0, 0, 0], [0, 10.0, 0]), qt.BoundaryState([0, 50.0, 0], [-10.0, 0, 0])
    held = [f"{end}.{name}" for end in ("start", "end") for name in ("V_rho", "V_h")]
    tuned = qt.tune(*circle, limits, objective="fastest", fixed=held)
    assert tuned.certificate.holds, tuned
    assert float(tuned.path.duration) == pytest.approx(25 * np.pi / fixed_point(50.0), rel=CLOSED_FORM)


def driven(speed: float) -> qt.Route:
    """The bend at a constant speed."""
    starts = np.asarray(BEND.route.starts)
    joints = np.asarray(BEND.route.joints(2)) * speed ** np.arange(3.0)[:, None]
    times = np.append(starts[np.isfinite(starts)], float(BEND.route.duration)) / speed
    return qt.Route(times, *np.moveaxis(joints, 1, 0))


def constants_as_curves(by_speed: bool) -> qt.Limits:
    if by_speed:
        motor = qt.BySpeed([0, 10, 30], lower=[-6, -6, -6], upper=[2, 2, 2])
        return qt.Limits(longitudinal_acceleration=motor, lateral_acceleration=qt.BySpeed([5], magnitude=[4]), speed=25)
    return qt.Limits(longitudinal_acceleration=(-6, 2), lateral_acceleration=4, speed=25)


@pytest.mark.parametrize("tune", ["tune", "tune_route"])
def test_curves_that_are_constant_are_ordinary_limits(tune):
    def objective(limits):
        found = (
            qt.tune(START, END, limits, motion="hermite", starts=1)
            if tune == "tune"
            else qt.tune_route(driven(12.0), limits, tube=1.0)
        )
        assert found.certificate.holds, found
        return float(found.objective)

    assert objective(constants_as_curves(True)) == pytest.approx(objective(constants_as_curves(False)), rel=SAME)


def cubic(t, duration, ends):
    """The cubic with the values and slopes `ends` at both ends, and its derivatives."""
    (p, v), (q, w) = ends
    d, h = q - p - v * duration, w - v
    c = np.array([p, v, (3 * d / duration - h) / duration, (h - 2 * d / duration) / duration**2])
    return [np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyder(c, k)) for k in range(4)]


def sampled(x, t, duration):
    """Speed, both accelerations and squared jerk of a path for the velocities `x` in cylindrical components."""
    r, f, z = (
        cubic(t, duration, ((a, v / s), (b, w / e)))
        for (a, s, b, e), v, w in zip([(30, 1, 36, 1), (0, 30, np.pi / 2, 36), (0, 1, 6, 1)], x[:3], x[3:], strict=True)
    )
    a = [r[1] + 1j * r[0] * f[1], r[2] + 1j * (r[1] * f[1] + r[0] * f[2])]
    a.append(r[3] + 1j * (r[2] * f[1] + 2 * r[1] * f[2] + r[0] * f[3]))
    b, b1 = a[1] + 1j * f[1] * a[0], a[2] + 1j * (f[2] * a[0] + f[1] * a[1])
    c = b1 + 1j * f[1] * b
    speed = np.sqrt(abs(a[0]) ** 2 + z[1] ** 2)
    along = ((a[0].conj() * b).real + z[1] * z[2]) / speed
    across = np.sqrt(np.maximum(abs(b) ** 2 + z[2] ** 2 - along**2, 0))
    return speed, along, across, abs(c) ** 2 + z[3] ** 2


@pytest.mark.parametrize("kind", ["lateral", "longitudinal", "combined"])
def test_scipy_finds_the_same_optimum_on_samples(kind):
    """Minimum squared jerk in 4 s; SLSQP varies the six velocities, with the limit at 1001 instants."""
    grip, motor = qt.BySpeed([0, 13, 20], magnitude=[3, 2.2, 1]), qt.BySpeed([0, 13, 20], upper=[1.5, 0.8, 0.1])
    ggv = qt.Ellipse(4, motor, grip)
    limits = {
        "lateral": {"lateral_acceleration": grip},
        "longitudinal": {"longitudinal_acceleration": (None, motor)},
        "combined": {"combined_acceleration": ggv},
    }[kind]
    t = np.linspace(0, 4, 1001)

    def ratio(x):
        speed, along, across, _ = sampled(x, t, 4.0)
        if kind == "combined":
            return np.asarray(ggv.usage(along, across, speed))
        return across / np.asarray(grip.at(speed)) if kind == "lateral" else along / np.asarray(motor.at(speed))

    def jerk(x):
        return simpson(sampled(x, t, 4.0)[3], x=t)

    tuned = qt.tune(START, END, qt.Limits(**limits), "smoothest", motion="hermite", duration=4.0)
    assert tuned.certificate.holds, tuned
    begin = np.array([2.0, 14, 0.5, 1, 13, 0.5])
    constraint = {"type": "ineq", "fun": lambda x: 1 - ratio(x)}
    found = minimize(jerk, begin, method="SLSQP", constraints=constraint, options={"maxiter": 300, "ftol": 1e-12})
    free = minimize(jerk, begin, method="SLSQP", options={"maxiter": 300, "ftol": 1e-12})
    assert found.success, found
    assert found.fun > 1.01 * free.fun, "the limit must be active"
    assert float(tuned.objective) == pytest.approx(found.fun, rel=ORACLE)


def test_rounded_curves_are_nowhere_less_strict_and_near():
    rng = np.random.default_rng(4)
    for _ in range(20):
        speeds = np.cumsum(rng.uniform(0.5, 8, 4))
        limit = qt.BySpeed(speeds, upper=rng.uniform(0.5, 5, 4))
        v = np.concatenate([rng.uniform(0, 40, 4000), *(speeds + x for x in (-1e-3, 0, 1e-3))])
        rounded, exact = SpeedLimit(limit, 1).at(v * v), np.asarray(limit.at(v))
        assert (rounded <= exact * (1 + 1e-12)).all()
        assert (rounded >= exact - ROUNDED * float(limit.size)).all()
        assert (rounded > 0).all()


def test_the_derivatives_of_the_ellipse_agree_with_differences():
    """At points on all lines, at the kinks, for braking and accelerating."""
    rng = np.random.default_rng(5)
    x = np.concatenate([rng.normal([[9.0], [9], [1]], 6.0, (3, 400)), rng.normal(0, 3, (3, 400))])
    x[:3, :40] *= np.repeat([15.0, 30.0, 40.0, 0.05], 10) / np.linalg.norm(x[:3, :40], axis=0)
    ellipse = SpeedEllipse(GGV)

    def square(r):
        i = Invariants([None, tuple(r[:3]), tuple(r[3:])], root=np.sqrt)
        return ellipse.square(i, i.S)

    jet, step = square(coordinates(x)), 1e-6
    for k in range(6):
        shift = np.zeros((6, 1))
        shift[k] = step
        above, below = square(coordinates(x + shift)), square(coordinates(x - shift))
        slope = (above.value - below.value) / (2 * step)
        np.testing.assert_allclose(jet.gradient[k], slope, rtol=DIFFERENCE, atol=DIFFERENCE * abs(slope).max())
    speed, along = np.linalg.norm(x[:3], axis=0), np.sum(x[:3] * x[3:], axis=0) / np.linalg.norm(x[:3], axis=0)
    across = np.sqrt(np.sum(x[3:] ** 2, axis=0) - along**2)
    assert (np.sqrt(jet.value) >= np.asarray(GGV.usage(along, across, speed)) * (1 - 1e-9)).all()


@pytest.mark.parametrize("objective", ["nearest", "smoothest", "fastest"])
def test_routes_are_proved_within_ggv_diagrams(objective):
    tuned = qt.tune_route(driven(17.0), qt.Limits(combined_acceleration=GGV, speed=30), tube=1.0, objective=objective)
    assert not qt.certify(driven(17.0), qt.Limits(combined_acceleration=GGV)).holds
    assert tuned.converged, tuned.result
    assert tuned.certificate.holds


def test_a_batch_of_paths_has_one_curve():
    starts = jax.vmap(lambda v: qt.BoundaryState([30.0, 0, 0], v))(np.array([[2.0, 14, 0.5], [0.0, 18, 0.5]]))
    ends = jax.vmap(lambda v: qt.BoundaryState([0.0, 36, 6], v))(np.array([[-13.0, 1, 0.5], [-16.0, 1, 0.5]]))
    limits = qt.Limits(lateral_acceleration=qt.BySpeed([0, 12, 30], magnitude=[9, 6, 3]))
    both = qt.tune(starts, ends, limits)
    assert np.asarray(both.converged).all()
    alone = qt.tune(jax.tree.map(lambda x: x[1], starts), jax.tree.map(lambda x: x[1], ends), limits)
    assert float(both.objective[1]) == pytest.approx(float(alone.objective), rel=SAME)


def test_limits_that_contradict_each_other_are_reported():
    def slow(size):
        return qt.Limits(lateral_acceleration=qt.BySpeed([0, 30], magnitude=[size, 0.5 * size]), speed=(8, None))

    tuned = qt.tune(START, END, slow(0.02), starts=1)
    assert tuned.status == "infeasible"
    assert "lateral_acceleration" in str(tuned.result)
    found = qt.tune_route(driven(12.0), slow(1.4), tube=0.5)
    assert not found.converged
    assert "lateral_acceleration" in str(found.result)
    assert "relax" in str(found.result)


ALWAYS = qt.BySpeed([0, 20], upper=[2, -1])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qt.tune_route(BEND, qt.Limits(longitudinal_acceleration=(None, ALWAYS), speed=9)), "allow zero"),
        (lambda: qt.tune(START, END, qt.Limits(longitudinal_acceleration=(None, ALWAYS))), "tune needs two-sided"),
        (lambda: qt.tune(START, END, qt.Limits(lateral_acceleration=GRIP), method="adam"), "pass method='sqp'"),
        (
            lambda: jax.grad(
                lambda x: (
                    qt.tune(
                        qt.BoundaryState([x, 0, 0], [0, 6, 0]), END, qt.Limits(lateral_acceleration=GRIP)
                    ).path.duration
                )
            )(20.0),
            "omit the derivatives",
        ),
        (
            lambda: jax.grad(
                lambda x: (
                    qt.tune_route(
                        CIRCLE, qt.Limits(lateral_acceleration=qt.BySpeed([0, 9], upper=jnp.stack([x, x]))), tube=0.1
                    ).path.duration
                )
            )(2.0),
            "must have concrete values",
        ),
    ],
)
def test_what_is_not_supported_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()

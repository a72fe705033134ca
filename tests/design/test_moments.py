"""Limits on the moments about τ, n and b: values against mpmath, proofs against dense sampling, routes, tuning."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.proof.certificate import STATUSES
from qtraj.path.moment_quantities import MOMENTS

BODY = qt.Vehicle(4.0, inertia=[0.03, 0.05, 0.08])
RADIUS, ANGLE, HEIGHT = [20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02, -0.004], [1.0, 2.4, 0.05, -0.01]
PATH = qt.SpiralHelix(RADIUS, ANGLE, HEIGHT, 4.5)
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 2.0])
END = qt.BoundaryState([0.0, 28.0, 9.0], [-9.8, -1.0, 2.5])


def sampled(path, body=BODY, count=20001):
    times = np.linspace(0.0, float(path.duration), count)
    times[-1] = np.nextafter(times[-1], 0.0) if isinstance(path, qt.Route) else times[-1]
    table = qt.evaluate(path, times, MOMENTS, vehicle=body)
    return {name: np.asarray(table.values[name]) for name in MOMENTS}


def axes(t):
    """The columns τ, n, b of the natural trihedral of PATH, with differences of r in 40 digits."""
    rho, phi, h = (lambda t, c=c: sum(x * t**k for k, x in enumerate(c)) for c in (RADIUS, ANGLE, HEIGHT))
    position = [lambda t: rho(t) * mp.cos(phi(t)), lambda t: rho(t) * mp.sin(phi(t)), h]
    first, second = ([mp.diff(x, t, k) for x in position] for k in (1, 2))
    tangent = unit(first)
    binormal = unit(cross(first, second))
    return mp.matrix([*zip(tangent, cross(binormal, tangent), binormal, strict=True)])


def unit(v):
    norm = mp.sqrt(sum(x * x for x in v))
    return [x / norm for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def momentum(t, inertia):
    """The angular momentum in inertial axes, with the rate from differences of the axes."""
    turn = axes(t)
    rates = mp.matrix(3, 3)
    for k in range(3):
        for m in range(3):
            rates[k, m] = mp.diff(lambda s, k=k, m=m: axes(s)[k, m], t)
    spin = turn.T * rates
    rate = mp.matrix([spin[2, 1], spin[0, 2], spin[1, 0]])
    return turn * (mp.diag(inertia) * rate)


@pytest.mark.parametrize("t", [0.7, 3.1])
def test_moments_are_the_change_of_the_angular_momentum(t):
    with mp.workdps(60):
        inertia = [mp.mpf(x) for x in (0.03, 0.05, 0.08)]
        change = mp.matrix(
            [mp.diff(lambda s, k=k: momentum(s, inertia)[k], mp.mpf(t), h=mp.mpf(10) ** -8) for k in range(3)]
        )
        expected = [abs(float(x)) for x in axes(mp.mpf(t)).T * change]
    table = qt.evaluate(PATH, [t], MOMENTS, vehicle=BODY)
    np.testing.assert_allclose([float(table.values[name][0]) for name in MOMENTS], expected, rtol=1e-10)
    values = qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=BODY).values(PATH, t)
    np.testing.assert_allclose([float(x) for x in values.values()], expected, rtol=1e-10)


def test_moments_are_the_components_of_the_moment_of_the_natural_frame():
    times = np.linspace(0.0, 4.5, 50)
    moment = np.asarray(qt.evaluate(PATH, times, ("moment",), qt.Natural(), vehicle=BODY).values["moment"])
    values = qt.evaluate(PATH, times, MOMENTS, vehicle=BODY).values
    np.testing.assert_allclose(np.stack([values[name] for name in MOMENTS], axis=-1), np.abs(moment), rtol=1e-11)


def test_proofs_agree_with_dense_sampling():
    """Proved above the largest sample, broken below it, and the reported values are the largest."""
    peaks = {name: float(x.max()) for name, x in sampled(PATH).items()}
    for factor, status in ((1 + 1e-5, "proved"), (1 - 1e-5, "broken")):
        limits = qt.Limits(**{k: factor * x for k, x in peaks.items()}, vehicle=BODY)
        certificate = qt.certify(PATH, limits)
        assert set(certificate.status.values()) == {status}, str(certificate)
        for name, peak in peaks.items():
            _, found, limit = certificate.worst[name]
            assert found == pytest.approx(peak, rel=1e-7), name
            assert found >= peak * (1 - 1e-12), name
            assert limit == pytest.approx(factor * peak, rel=1e-15), name
            assert float(qt.peak(PATH, name, BODY)[1]) == pytest.approx(peak, rel=1e-7), name


def test_limits_at_the_peak_are_proved_from_a_relative_gap_of_1e_9():
    for name in MOMENTS:
        peak = float(qt.peak(PATH, name, BODY)[1])
        for gap, status in ((1e-9, "proved"), (-1e-9, "broken")):
            assert qt.certify(PATH, qt.Limits(**{name: peak * (1 + gap)}, vehicle=BODY)).status == {name: status}


def test_a_body_with_equal_moments_of_inertia_needs_no_moment_about_n():
    for inertia in ([0.05, 0.02, 0.05], 0.05):
        certificate = qt.certify(PATH, qt.Limits(normal_moment=1e-9, vehicle=qt.Vehicle(4.0, inertia=inertia)))
        assert certificate.status == {"normal_moment": "proved"}
        assert certificate.worst["normal_moment"][1] == 0.0


def test_a_bank_does_not_change_the_moments_of_a_body_that_is_symmetric_about_its_path():
    body = [qt.Vehicle(4.0, inertia=[0.03, 0.05, 0.05], bank=bank) for bank in (0.0, 0.3)]
    level, banked = (qt.certify(PATH, qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=x)) for x in body)
    np.testing.assert_allclose(banked.values, level.values, rtol=1e-13)


def test_a_path_about_a_tilted_axis_is_proved_because_no_moment_depends_on_the_vertical():
    tilted = qt.SpiralHelix(RADIUS, ANGLE, HEIGHT, 4.5, qt.Placement([0.0] * 3, [1.0, 0.3, 0.2, 0.0]))
    limits = qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=BODY)
    upright, found = qt.certify(PATH, limits), qt.certify(tilted, limits)
    assert found.status == upright.status
    assert set(found.status.values()) == {"proved"}
    np.testing.assert_allclose(found.values, upright.values, rtol=1e-12)


def test_a_batch_has_an_inertia_for_each_path_and_values_are_differentiable():
    def largest(x):
        body = qt.Vehicle(4.0, inertia=jnp.stack([x[1], x[1], x[2]]))
        path = qt.SpiralHelix(jnp.asarray(RADIUS) * x[0], ANGLE, HEIGHT, 4.5)
        return qt.certify(path, qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=body)).values

    x, step = jnp.asarray([1.0, 0.03, 0.08]), 1e-5
    jacobian = np.asarray(jax.jit(jax.jacfwd(largest))(x))
    moved = jnp.stack([x + sign * step * jnp.eye(3)[k] for k in range(3) for sign in (1, -1)])
    values = np.asarray(jax.jit(jax.vmap(largest))(moved)).reshape(3, 2, 3)
    differences = (values[:, 0] - values[:, 1]).T / (2 * step)
    np.testing.assert_allclose(jacobian, differences, rtol=1e-6, atol=1e-8)


@pytest.fixture(scope="module")
def routes():
    """A route along PATH, and the same route with one of its joints moved by 20 nm."""
    times = np.sort(np.append(np.linspace(0.0, 4.5, 19), [2.01, 2.02]))
    rows = np.moveaxis(np.stack([PATH.derivatives(t, 3) for t in times]), 1, 0).copy()
    smooth = qt.Route(times, *rows)
    rows[0][10] += [0.0, 0.0, 2e-8]
    return smooth, qt.Route(times, *rows)


def test_a_route_is_proved_and_a_planted_violation_between_samples_is_refuted(routes):
    smooth, kinked = routes
    limits = {name: 1.02 * float(x.max()) for name, x in sampled(smooth).items()}
    assert set(qt.certify(smooth, qt.Limits(**limits, vehicle=BODY)).status.values()) == {"proved"}
    between = sampled(kinked, count=100)
    assert all(between[name].max() <= limits[name] for name in MOMENTS)
    certificate = qt.certify(kinked, qt.Limits(**limits, vehicle=BODY))
    assert certificate.status["tangential_moment"] == "broken"
    for a, b in certificate.intervals("tangential_moment"):
        assert 2.0 - 1e-9 <= a <= b <= 2.02 + 1e-9


@pytest.fixture(scope="module")
def untuned():
    return {name: float(x.max()) for name, x in sampled(qt.SpiralHelix.between(START, END, 5.0)).items()}


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_moments_that_bind_are_tuned_and_proved(untuned, motion):
    limits = qt.Limits(**{name: 0.7 * x for name, x in untuned.items()}, vehicle=BODY)
    tuned = qt.tune(START, END, limits, motion=motion)
    assert tuned.status == "converged", tuned.result
    assert set(tuned.certificate.status.values()) == {"proved"}
    largest = {name: float(x.max()) for name, x in sampled(tuned.path).items()}
    shares = [largest[name] / float(limits.given()[name]) for name in MOMENTS]
    assert max(shares) <= 1 + 1e-12
    assert max(shares) == pytest.approx(1.0, rel=1e-5)
    heavy = dataclasses.replace(BODY, inertia=3 * BODY.inertia)
    same = qt.tune(START, END, qt.Limits(**{k: 3 * x for k, x in limits.given().items()}, vehicle=heavy), motion=motion)
    np.testing.assert_allclose(same.path.radius, tuned.path.radius, rtol=1e-9)


def test_limits_next_to_the_value_are_decided():
    for body in (BODY, qt.Vehicle(4.0, inertia=[0.05 * (1 + 1e-12), 0.05, 0.05])):
        found = qt.certify(PATH, qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=body))
        for factor, status in ((1 + 1e-12, "proved"), (1 - 1e-12, "broken")):
            limits = {name: factor * float(value) for name, (_, value, _) in found.worst.items()}
            again = qt.certify(PATH, qt.Limits(**limits, vehicle=body))
            assert set(again.status.values()) == {status}, str(again)


PRODUCTS = np.array([[0.03, 0.01, 0.0], [0.01, 0.05, 0.0], [0.0, 0.0, 0.06]])


def test_products_of_inertia_in_a_trace_have_no_value_and_nothing_is_proved():
    @jax.jit
    def certified(inertia):
        limits = qt.Limits(**dict.fromkeys(MOMENTS, 1.0), vehicle=qt.Vehicle(4.0, inertia=inertia))
        certificate = qt.certify(PATH, limits)
        return certificate.codes, certificate.values

    codes, values = certified(PRODUCTS)
    assert {STATUSES[k] for k in codes} == {"undecided"}
    assert np.isnan(values).all()
    codes, values = certified(np.diag([0.03, 0.05, 0.08]))
    assert {STATUSES[k] for k in codes} == {"proved"}
    assert np.isfinite(values).all()


def test_known_products_of_inertia_are_refused_inside_a_trace_too():
    body = qt.Vehicle(4.0, inertia=PRODUCTS)
    with pytest.raises(ValueError, match="it has products of inertia"):
        jax.jit(lambda x: qt.certify(PATH, qt.Limits(normal_moment=x, vehicle=body)).values)(1.0)


def test_a_route_has_moments_at_a_stop_but_not_on_a_straight_and_a_parked_body_needs_none():
    times = np.arange(4.0)
    position = np.array([[0.0, 0.0, 0.0], [2.0, 0.2, 0.2], [3.0, 0.8, 0.6], [3.0, 0.8, 0.6]])
    velocity = np.array([[2.0, 0.0, 0.0], [2.0, 0.5, 0.5], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    acceleration = np.array([[0.0, 0.3, 0.1], [0.0, 0.2, 0.3], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    limits = qt.Limits(**dict.fromkeys(MOMENTS, 1e6), vehicle=BODY)
    route = qt.Route(times, position, velocity, acceleration)
    found = qt.certify(route, limits)
    assert set(found.status.values()) == {"proved"}
    moving = {name: float(x.max()) for name, x in sampled(route.window(0.0, 1.99)).items()}
    assert all(found.worst[name][1] >= (1 - 1e-9) * moving[name] > 0 for name in MOMENTS)
    parked = qt.certify(route.window(2.0, 3.0), limits)
    assert set(parked.status.values()) == {"proved"}
    assert not any(value for _, value, _ in parked.worst.values())
    straight = qt.Route([0.0, 1.0], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[2.0, 0.0, 0.0]] * 2, np.zeros((2, 3)))
    assert set(qt.certify(straight, limits).status.values()) == {"undefined"}


def test_advice_states_limits_in_their_units(untuned):
    limit = 1e-4 * untuned["tangential_moment"]
    bounds = {"duration": (4.5, 5.5), "start.V_rho": (-1.0, 1.0), "end.V_rho": (-1.0, 1.0)}
    limits = qt.Limits(tangential_moment=limit, vehicle=BODY)
    tuned = qt.tune(START, END, limits, motion="hermite", starts=1, bounds=bounds)
    assert tuned.status == "infeasible"
    value = tuned.certificate.worst["tangential_moment"][1]
    smallest = float(re.search(r"the smallest maximum found is ([0-9.e+-]+) N·m", tuned.result)[1])
    raised = float(re.search(r"raise tangential_moment to ([0-9.e+-]+) N·m", tuned.result)[1])
    assert limit < smallest <= 1.01 * value
    assert smallest <= raised <= 1.2 * value


def test_a_batch_of_bodies_of_another_size_is_refused():
    bodies = jax.vmap(lambda x: qt.Vehicle(4.0, inertia=x * jnp.ones(3)))(jnp.asarray([0.03, 0.04, 0.05]))
    limits = jax.vmap(lambda body: qt.Limits(normal_moment=1.0, vehicle=body))(bodies)
    states = (jax.tree.map(lambda x: jnp.stack([x, x]), state) for state in (START, END))
    with pytest.raises(ValueError, match="batch shape"):
        qt.tune(*states, limits)


INVALID = {
    "no vehicle": (lambda: qt.Limits(normal_moment=1.0), "needs a vehicle"),
    "no inertia": (lambda: qt.Limits(normal_moment=1.0, vehicle=qt.Vehicle(1.0)), "needs an inertia"),
    "products of inertia": (
        lambda: qt.Limits(
            binormal_moment=1.0, vehicle=qt.Vehicle(1.0, inertia=[[2.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 3.0]])
        ),
        "it has products of inertia",
    ),
    "a bank that rolls the principal axes": (
        lambda: qt.Limits(tangential_moment=1.0, vehicle=qt.Vehicle(1.0, inertia=[1.0, 2.0, 2.5], bank=0.1)),
        "a bank that is not zero rotates its principal axes",
    ),
    "an output": (lambda: qt.evaluate(PATH, [0.0], ("normal_moment",), vehicle=qt.Vehicle(1.0)), "needs an inertia"),
    "a peak": (lambda: qt.peak(PATH, "normal_moment", qt.Vehicle(1.0)), "needs an inertia"),
}


@pytest.mark.parametrize(("make", "fragment"), INVALID.values(), ids=INVALID)
def test_invalid_input_raises_with_a_reason(make, fragment):
    with pytest.raises(ValueError, match=fragment):
        make()


def test_an_inertia_that_is_not_principal_does_not_change_limits_without_moments():
    """A bank rolls the axes of inertia away from n and b, so the moments are undefined; friction and power are not."""

    def limits(inertia, bank):
        vehicle = qt.Vehicle(12e3, inertia, 6.0, 0.007, (0.6, 0.5), bank)
        return qt.Limits(friction=0.9, power=4e5, vehicle=vehicle)

    def load_of_limits(inertia):
        return lambda bank: sum(
            value / limits(None, 0.0).given()[name] for name, value in values(inertia, bank).items()
        )

    def values(inertia, bank):
        return limits(inertia, bank).values(PATH, 2.0)

    inertia = [1e4, 5e4, 6e4]
    assert not np.isfinite(np.asarray(limits(inertia, 0.05).road().inertia_binormal))
    without, certificate = (qt.certify(PATH, limits(each, 0.05)) for each in (None, inertia))
    np.testing.assert_equal(
        [finding.value for finding in certificate.findings()], [finding.value for finding in without.findings()]
    )
    assert np.isfinite([finding.value for finding in certificate.findings()]).all()
    slopes = [float(jax.grad(load_of_limits(each))(0.05)) for each in (None, inertia)]
    assert slopes[0] == slopes[1] != 0.0

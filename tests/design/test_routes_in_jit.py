"""`tune_route` and `certify` of routes inside `jit` and `vmap`: values and derivatives are those outside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.proof.certificate import UNDEFINED
from qtraj.foundation.outcome import ResultCode

TIMES = np.arange(4.0)
STEP, SIDEWAYS = 1e-4, np.array([0.0, 1.0, 0.0])
LIMITS = {"lateral_acceleration": 2.0}


def states(bend=0.12):
    """Joint states of a drive along a sine, which is too curved for its speed."""
    phase = bend * 8 * TIMES + 0.4
    zero, one = np.zeros(TIMES.size), np.ones(TIMES.size)
    position = np.stack([8 * TIMES, 6 * np.sin(phase), zero], axis=1)
    velocity = np.stack([8 * one, 48 * bend * np.cos(phase), zero], axis=1)
    acceleration = np.stack([zero, -384 * bend**2 * np.sin(phase), zero], axis=1)
    return [position, velocity, acceleration]


def route(change=0.0, times=TIMES):
    position, velocity, acceleration = states()
    return qt.Route(times, position + change * (np.sin(times)[:, None] * SIDEWAYS), velocity, acceleration)


def tuned(path, lateral=2.0, tube=1.0, **more):
    return qt.tune_route(path, qt.Limits(lateral_acceleration=lateral), tube, **more)


def numbers(result):
    """The numbers of a result that do not depend on padding."""
    return result.objective, result.delay, result.path.duration, result.path.position(1.3), result.converged


@pytest.fixture(scope="module")
def outside():
    results = [tuned(route(x), 2.0 + x) for x in (0.0, 0.1, 0.2)]
    assert [bool(x.converged) for x in results] == [True] * 3
    assert float(results[0].objective) > 1e-4
    return results


@pytest.fixture(scope="module")
def compiled():
    return jax.jit(tuned)


def stacked(routes):
    return jax.tree.map(lambda *x: jnp.stack([jnp.asarray(y) for y in x]), *routes)


def test_a_route_as_an_argument_of_jit_has_padding(outside, compiled):
    inside, known = compiled(jax.tree.map(jnp.asarray, route())), outside[0]
    for a, b in zip(numbers(inside), numbers(known), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-10)
    assert inside.displacement.shape == (9, 3), "three segments, padded to eight"
    np.testing.assert_allclose(inside.displacement[:4], known.displacement, rtol=0, atol=1e-10)
    assert inside.distance.shape == (8, 2)
    np.testing.assert_allclose(inside.distance[:3], known.distance, rtol=0, atol=1e-10)
    assert np.asarray(inside.within).all()
    assert not np.asarray(inside.kept).any()
    assert inside.certificate.status == known.certificate.status
    times = [*np.asarray(inside.path.starts[:3]).tolist(), 3 + float(inside.delay)]
    np.testing.assert_allclose(inside.path.times, times, rtol=1e-12)
    assert "proved" in inside.result
    assert "lateral_acceleration" in str(inside.certificate)
    with pytest.raises(ValueError, match="outside"):
        inside.certificate.intervals("lateral_acceleration")


def test_known_times_make_the_shapes_known(outside):
    @jax.jit
    def call(x):
        return tuned(route(x), 2.0 + x)

    inside = call(0.1)
    assert inside.distance.shape == outside[1].distance.shape
    for a, b in zip(numbers(inside), numbers(outside[1]), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-10)


def test_a_batch_is_a_loop(outside):
    """Three routes, one of which has fewer segments, with their own limits."""
    position, velocity, acceleration = states()
    short = qt.Route(TIMES[:3], position[:3], velocity[:3], acceleration[:3])
    routes, laterals = stacked([route(0.0), route(0.1), short]), jnp.array([2.0, 2.1, 2.0])
    batch = jax.vmap(lambda path, lateral: tuned(path, lateral))(routes, laterals)
    for k, known in enumerate([*outside[:2], tuned(short)]):
        one = jax.tree.map(lambda x: x[k], batch)  # noqa: B023
        for a, b in zip(numbers(one), numbers(known), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-10)
    assert batch.explain((1,)).startswith("every limit is proved")


def test_a_closed_route_in_jit():
    angle = 2 * np.pi * np.arange(7) / 6
    circle = [np.stack([20 * np.cos(angle + k * np.pi / 2), 16 * np.sin(angle + k * np.pi / 2), 0 * angle], axis=1)
              for k in range(3)]  # fmt: skip
    rate = 2 * np.pi / 18

    def lap(x):
        scaled = [y * rate**k for k, y in enumerate(circle)]
        times = 3.0 * np.arange(7)
        return tuned(qt.Route(times, *(y * (1 + 0 * x) for y in scaled)), 2.3 + x, closed=True)

    known, inside = lap(0.0), jax.jit(lap)(0.0)
    assert float(known.objective) > 1e-4
    for a, b in zip(numbers(inside), numbers(known), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-10)
    with pytest.raises(ValueError, match="concrete times"):
        jax.jit(lambda path: tuned(path, closed=True).objective)(jax.tree.map(jnp.asarray, route()))


def test_derivatives_inside_jit_are_those_outside(compiled):
    """A padded route in jit, in reverse mode, against an unpadded one outside, in forward mode."""

    def number(path, lateral):
        result = tuned(path, lateral)
        return result.objective + result.delay + jnp.sum(result.displacement[:4])

    path = jax.tree.map(jnp.asarray, route())
    of_path, of_lateral = jax.jit(jax.grad(number, (0, 1)))(path, 2.0)
    value, known = jax.jvp(lambda x: number(route(x), 2.0 + 0.3 * x), (0.0,), (1.0,))
    change = jax.jvp(lambda x: route(x).coefficients, (0.0,), (1.0,))[1]
    inside = float(jnp.sum(of_path.coefficients * change) + 0.3 * of_lateral)
    assert inside == pytest.approx(float(known), rel=1e-7)
    assert abs(float(known)) > 0.01
    results = [compiled(path, 2.0 + sign * 1e-3) for sign in (1, 0, -1)]
    above, here, below = (float(x.objective + x.delay + np.sum(x.displacement[:4])) for x in results)
    assert float(value) == pytest.approx(here, rel=1e-10)
    # The margins between the nodes change a little, but derivatives keep them constant.
    assert float(of_lateral) == pytest.approx((above - below) / 2e-3, rel=2e-2)


def test_invalid_numbers_inside_jit_have_a_code(compiled):
    result = compiled(jax.tree.map(jnp.asarray, route()), -1.0)
    assert int(result.code) == ResultCode.route_ill_posed
    assert np.isnan(result.objective)
    assert not bool(result.converged)
    assert not bool(result.certificate.holds)
    assert "Outside jit and vmap" in result.result


def test_what_cannot_be_traced_is_refused():
    limits = qt.Limits(speed=qt.Along([0.0, 10.0], [9.0, 8.0]))
    with pytest.raises(ValueError, match="do not change along the way"):
        jax.jit(lambda x: qt.tune_route(route(x), limits).objective)(0.0)
    with pytest.raises(ValueError, match="call it outside"):
        jax.jit(lambda x: qt.certify(route(x), limits).holds)(0.0)


def certified(change, slower=0.0):
    times = TIMES * (1 + slower * jnp.asarray(change))
    position, velocity, acceleration = (jnp.asarray(x) * (1 + change) for x in states())
    found = qt.certify(
        qt.Route(times, position, velocity, acceleration),
        qt.Limits(curvature=0.3, lateral_acceleration=2.0 - 8 * change),
    )
    return found.whole.values, found.whole.limits, found.whole.codes, found.holds, found.segments.values[:3]


def test_certificates_inside_jit_are_those_outside():
    changes = jnp.array([0.0, 0.1, -0.3])
    known = [certified(np.asarray(x)) for x in changes]
    once, batch = jax.jit(certified)(0.1), jax.vmap(certified)(changes)
    for k, a in enumerate(known):
        inside = [jax.tree.map(lambda x: x[k], batch)] + ([once] if k == 1 else [])  # noqa: B023
        for found in inside:
            for x, y in zip(found, a, strict=True):
                np.testing.assert_allclose(x, y, rtol=0, atol=1e-10)
    assert [bool(x[3]) for x in known] == [False, False, True]


@pytest.mark.parametrize("slower", [0.0, 0.4])
def test_largest_values_of_routes_have_derivatives(slower):
    forward = jax.jacfwd(lambda x: certified(x, slower)[0])(0.0)
    above, below = (certified(sign * STEP, slower) for sign in (1, -1))
    np.testing.assert_allclose(forward, (above[0] - below[0]) / (2 * STEP), rtol=1e-5)
    reverse = jax.jit(jax.jacrev(lambda x: certified(x, slower)[0]))(0.0)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)


@pytest.mark.parametrize("change", ["time", "infinite time", "backwards", "position"])
def test_numbers_that_are_not_finite_are_never_proved(change):
    position, velocity, acceleration = states()
    times, place = TIMES.copy(), position.copy()
    if change == "position":
        place[2, 1] = np.nan
    else:
        times[-1] = {"time": np.nan, "infinite time": np.inf, "backwards": 1.5}[change]
    of = lambda call: lambda t, p: call(qt.Route(t, p, velocity, acceleration))  # noqa: E731
    found = jax.jit(of(lambda route: qt.certify(route, qt.Limits(speed=1e3))))(times, place)
    assert not bool(found.holds)
    assert np.asarray(found.whole.codes).tolist() == [UNDEFINED]
    code = jax.jit(of(lambda route: tuned(route).code))(times, place)
    assert int(code) == ResultCode.route_ill_posed

"""Searches and proofs take float32 arrays as the numbers that they are, and compute in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.namespace import in_float64

START, END = ([30.0, 0, 0], [0.1, 10.0, 1]), ([0.3, 45.0, 8], [-12.0, 2, 0])
LIMITS = {"curvature": 0.04, "lateral_acceleration": 4.0}
TIMED = {"speed": 20.0, "lateral_acceleration": 3.0, "longitudinal_acceleration": 2.5}
JOINTS = (
    [0.0, 3, 6],
    [[-12.1, 0, 0], [0, 0, 0], [12, 1.3, 0.5]],
    [[6.0, 0.3, 0], [6, 0, 0], [6, 0.5, 0.2]],
    np.zeros((3, 3)),
)


@pytest.fixture(params=[True, False], ids=["x64", "x32"])
def mode(request):
    with jax.enable_x64(request.param):
        yield


def narrow(x):
    return jnp.asarray(x, jnp.float32)


def wide(x):
    return np.asarray(np.asarray(x, np.float32), np.float64)


def tuned(array):
    start, end = (qt.BoundaryState(*map(array, state)) for state in (START, END))
    return qt.tune(start, end, qt.Limits(**LIMITS), starts=2)


def retimed(array):
    start, end = (qt.BoundaryState(*map(array, state)) for state in (START, END))
    return qt.retime(qt.SpiralHelix.hermite(start, end, array(6.0)), qt.Limits(**TIMED))


def tuned_route(array):
    return qt.tune_route(qt.Route(*map(array, JOINTS)), qt.Limits(lateral_acceleration=array(0.2)), tube=0.5)


def retimed_route(array):
    return qt.retime(qt.Route(*map(array, JOINTS)), qt.Limits(**TIMED))


def positions(path):
    return qt.evaluate(path, np.linspace(0.0, float(path.duration), 9), ("position",)).position


def test_tuning_gives_the_path_for_the_same_numbers_in_float64(mode):
    """The path is not rounded to float32: a limit that is active would be broken."""
    found, expected = tuned(narrow), tuned(wide)
    assert found.certificate.holds, found.result
    assert "is active" in str(found.result)
    assert found.result == expected.result
    assert np.asarray(found.path.duration).dtype == np.float64
    np.testing.assert_array_equal(positions(found.path), positions(expected.path))


@pytest.mark.parametrize("call", [retimed, tuned_route, retimed_route])
def test_a_path_in_float32_is_converted(call, mode):
    """The coefficients of the path are rounded to float32, so it is not exactly the path of its states."""
    found, expected = call(narrow), call(wide)
    assert found.certificate.holds, found.result
    assert np.asarray(found.path.duration).dtype == np.float64
    np.testing.assert_allclose(positions(found.path), positions(expected.path), rtol=0, atol=5e-5)


def test_a_traced_path_in_float32_is_refused():
    def objective(position):
        start, end = qt.BoundaryState(position, START[1]), qt.BoundaryState(*END)
        return qt.tune(start, end, qt.Limits(**LIMITS)).objective

    with jax.enable_x64(False), pytest.raises(ValueError, match="inside jit, grad and vmap, tuning needs float64"):
        jax.jit(objective)(narrow(START[0]))


def test_only_concrete_floats_are_converted():
    counts, name = np.arange(3), object()
    tree = {"a": narrow([1.1]), "b": np.float32(1.1), "c": counts, "d": 1.5, "e": name, "f": np.array([0.1])}
    found = in_float64(tree)
    assert found["a"].dtype == found["b"].dtype == np.float64
    assert float(found["a"][0]) == float(found["b"]) == float(np.float32(1.1))
    assert all(found[key] is tree[key] for key in "cdef")


ENDS = [qt.BoundaryState(*state) for state in (START, END)]
ROUTE = qt.Route(*map(np.asarray, JOINTS))
TRACED = {
    "tune": lambda x: qt.tune(*ENDS, qt.Limits(curvature=x), starts=1).objective,
    "tune_route": lambda x: qt.tune_route(ROUTE, qt.Limits(lateral_acceleration=x)).objective,
    "certify": lambda x: qt.certify(ROUTE, qt.Limits(speed=x)).segments.values,
    "robust_tune": lambda x: qt.robust_tune(*ENDS, qt.Limits(curvature=x), qt.Spread(0.1), samples=256).tuned.objective,
}


@pytest.mark.parametrize("transform", [jax.jit, jax.vmap])
@pytest.mark.parametrize("name", [*TRACED])
def test_a_trace_without_float64_says_what_to_set(name, transform):
    what_to_set = r"jax_enable_x64 is False.*jax\.config\.update\('jax_enable_x64', True\)"
    with jax.enable_x64(False), pytest.raises(ValueError, match=what_to_set):
        transform(TRACED[name])(jnp.full(2 if transform is jax.vmap else (), 0.2))

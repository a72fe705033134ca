"""Laws by name: the gains of each way against the functions that compute them, and the messages for mistakes."""

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.control import gains
from qtraj.motion.control.feedback_law import BASELINES, LAWS

ACCELERATION = [kind for kind in LAWS if kind != "rate"]
WEIGHTS = {"error": 16.0, "rate": 1.0, "command": 2.0}


def same(a, b):
    """Whether two laws have the same class, the same error and equal gains."""
    return jax.tree.structure(a) == jax.tree.structure(b) and all(map(np.array_equal, *map(jax.tree.leaves, (a, b))))


def with_gains(kind, k1, k2):
    return BASELINES[kind](k1, k2) if kind in BASELINES else qt.AccelerationLaw(k1, k2, kind)


@pytest.mark.parametrize("kind", ACCELERATION)
@pytest.mark.parametrize(
    ("arguments", "pair"),
    [
        ({"settling_time": 3.0}, gains.from_settling_time(3.0)),
        ({"settling_time": 3.0, "residual": 0.1}, gains.from_settling_time(3.0, 0.1)),
        ({"damping": 0.5, "frequency": 3.0}, gains.from_damping(0.5, 3.0)),
        ({"weights": WEIGHTS}, gains.from_weights(16.0, 1.0, 2.0)),
        ({"weights": {"error": 16.0}}, gains.from_weights(16.0, 0.0, 1.0)),
    ],
)
def test_each_way_has_the_gains_of_its_function(kind, arguments, pair):
    assert same(qt.feedback_law(kind, **arguments), with_gains(kind, *pair))


@pytest.mark.parametrize("kind", ACCELERATION)
def test_gains_are_passed_unchanged(kind):
    size = 3 if kind in BASELINES else 4
    rng = np.random.default_rng(size)
    for shape in ((), (size,), (size, size)):
        k1, k2 = rng.normal(size=(2, *shape))
        assert same(qt.feedback_law(kind, k1=k1, k2=k2), with_gains(kind, k1, k2))


def test_the_rate_law_has_one_gain():
    assert same(qt.feedback_law("rate", k=[1.0, 2.0, 3.0, 4.0]), qt.RateLaw([1.0, 2.0, 3.0, 4.0]))
    expected = qt.RateLaw(gains.rate_from_settling_time(2.0, 0.01))
    assert same(qt.feedback_law("rate", settling_time=2.0, residual=0.01), expected)


def test_the_gains_are_differentiable():
    """k1 = 2kt/T and k2 = (kt/T)² of a settling time T, so dk1/dT = −k1/T and dk2/dT = −2 k2/T."""
    law, slope = qt.feedback_law(settling_time=4.0), jax.jacfwd(lambda T: qt.feedback_law(settling_time=T))(4.0)
    assert float(slope.k1) == pytest.approx(-float(law.k1) / 4.0)
    assert float(slope.k2) == pytest.approx(-float(law.k2) / 2.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "linear", "k1": 1.0, "k2": 1.0}, r"one of 'body', .*'logarithmic', but 'linear' was given"),
        ({}, "there are no gains: specify k1 and k2, or settling_time, or damping and frequency, or weights"),
        ({"kind": "rate"}, "there are no gains: specify k, or settling_time"),
        ({"k1": 1.0}, "'k2' is missing: k1 and k2 must be specified together"),
        ({"frequency": 1.0}, "'damping' is missing: damping and frequency must be specified together"),
        (
            {"settling_time": 1.0, "weights": WEIGHTS},
            r"several ways \(settling_time, weights\): specify only one of k1",
        ),
        ({"k": 1.0}, "'k' cannot be used with a law of kind 'body': specify k1 and k2"),
        ({"kind": "rate", "k1": 1.0, "k2": 1.0}, "'k1' cannot be used with a law of kind 'rate': specify k, or"),
        ({"kind": "rate", "damping": 1.0, "frequency": 1.0}, "'damping' cannot be used with a law of kind 'rate'"),
        ({"k1": 1.0, "k2": 1.0, "residual": 0.1}, "'residual' requires 'settling_time', which is missing"),
        ({"weights": {"rate": 1.0}}, "weights must be a table with 'error' and optionally"),
        ({"weights": {"error": 1.0, "jerk": 1.0}}, "but {'error': 1.0, 'jerk': 1.0} was given"),
        ({"weights": {"error": -1.0}}, "the weight of the error must be positive"),
        ({"settling_time": 1.0, "residual": 2.0}, "must be between 0 and 1, but 2.0 was given"),
        (
            {"k1": [[1.0, 2.0], [3.0]], "k2": 1.0},
            r"k1 must be a number, 4 numbers .*, but \[\[1.0, 2.0\], \[3.0\]\] was",
        ),
        ({"kind": "quaternion", "k1": 1.0, "k2": [1.0, 2.0]}, r"k2 must be .* 3 × 3 matrix, but .* with shape \(2,\)"),
    ],
)
def test_mistakes_are_explained(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.feedback_law(**arguments)


def test_any_subset_of_the_gains_is_either_one_way_or_an_error():
    """At random: the law is returned only if exactly one complete way of the law is specified."""
    rng = np.random.default_rng(8)
    names = ("k1", "k2", "k", "settling_time", "damping", "frequency")
    for _ in range(200):
        kind, chosen = str(rng.choice(LAWS)), {name for name in names if rng.random() < 0.3}
        ways = [{"k"}, {"settling_time"}] if kind == "rate" else [{"k1", "k2"}, {"settling_time"}, {*names[4:]}]
        arguments = {name: float(rng.uniform(0.5, 2.0)) for name in chosen}
        if chosen in ways:
            assert isinstance(qt.feedback_law(kind, **arguments), qt.control.AbstractLaw)
        else:
            with pytest.raises(ValueError, match=r"no gains|several ways|is missing|cannot be used"):
                qt.feedback_law(kind, **arguments)

"""Digests of functions and values change with whatever changes the results, and with nothing else."""

import functools
import threading
import types

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.sweeps.digests import digest, name_of

SCALE = 2.0


def doubled(p):
    return {"y": SCALE * p["a"]}


def calls(p):
    return doubled(p)


def of(source, **scope):
    """A function with this source, as if typed at a prompt."""
    scope["f"] = types.FunctionType(compile(source, "<prompt>", "eval").co_consts[0], scope)
    return scope["f"]


def even(n):
    return n == 0 or odd(n - 1)


def odd(n):
    return n != 0 and even(n - 1)


def closure(value):
    return lambda p: value


def default(p, k=1.0):
    return k


class Scaled:
    def __init__(self, k):
        self.k = k

    def __call__(self, p):
        return self.k


EQUAL = [
    lambda: 1.5,
    lambda: np.arange(3.0),
    lambda: {"a": [1, 2, (3.0, None)], "b": {4, 5}},
    lambda: closure(3.0),
    lambda: functools.partial(default, k=2.0),
    lambda: Scaled(2.0),
    lambda: qt.Limits(speed=3.0),
    lambda: qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 2.0),
    lambda: jax.random.key(3),
    lambda: jax.jit(doubled),
    lambda: calls,
    lambda: of("lambda p: p['a'] + 1"),
    lambda: qt.sweeps.evaluate(doubled),
]


@pytest.mark.parametrize("make", EQUAL)
def test_equal_things_have_equal_digests(make):
    assert digest(make()) == digest(make())


DIFFERENT = [
    (1.5, 1.25),
    (1, 1.0),
    ("1", 1),
    (True, 1),
    (np.arange(3.0), np.arange(3)),
    (np.zeros((2, 3)), np.zeros((3, 2))),
    ([1, 2], [[1], 2]),
    (closure(1.0), closure(2.0)),
    (closure(np.zeros(2)), closure(np.ones(2))),
    (functools.partial(default, k=1.0), functools.partial(default, k=2.0)),
    (Scaled(1.0), Scaled(2.0)),
    (Scaled(1.0).__call__, Scaled(2.0).__call__),
    (qt.Limits(speed=3.0), qt.Limits(speed=3.5)),
    (qt.Limits(speed=3.0), qt.Limits(curvature=3.0)),
    (of("lambda p: p['a'] + 1"), of("lambda p: p['a'] + 2")),
    (of("lambda p: p['a'] * k", k=1.0), of("lambda p: p['a'] * k", k=2.0)),
    (qt.sweeps.evaluate(doubled), qt.sweeps.evaluate(doubled, instants=9)),
    (qt.sweeps.evaluate(closure(1.0)), qt.sweeps.evaluate(closure(2.0))),
]


@pytest.mark.parametrize(("one", "other"), DIFFERENT)
def test_different_things_have_different_digests(one, other):
    assert digest(one) != digest(other)


def test_what_a_function_reads_is_part_of_it(monkeypatch):
    before = digest(doubled), digest(calls)
    monkeypatch.setitem(globals(), "SCALE", 3.0)
    assert digest(doubled) != before[0]
    assert digest(calls) != before[1]


def test_functions_that_call_each_other_have_a_digest():
    assert digest(even) == digest(even)
    assert digest(even) != digest(odd)


def test_an_object_with_unknown_content_is_refused():
    with pytest.raises(ValueError, match=r"the function of the sweep reads .*, whose content is unknown"):
        digest(closure(threading.Lock()))


def test_names():
    assert name_of(doubled).endswith("test_digests.doubled")
    assert name_of(functools.partial(doubled)).endswith("test_digests.doubled")
    assert name_of(Scaled(1.0)).endswith("test_digests.Scaled")

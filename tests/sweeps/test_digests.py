"""Digests of functions and values change with whatever changes the results, and with nothing else."""

import functools
import importlib
import math
import re
import sys
import threading
import types
from datetime import timedelta
from decimal import Decimal
from fractions import Fraction

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


ONE, TWO, THREE = [1.0], [2.0], [3.0]
PAIR = (lambda p: {"y": 1}, lambda p: {"y": 2})
GRAY = jax.vmap(lambda x: x), jax.vmap(lambda x: 2 * x)


def state(speed):
    return qt.BoundaryState([10.0, 0.0, 0.0], [0.0, speed, 0.0])


DIFFERENT = [
    ([ONE, TWO, ONE], [ONE, TWO, TWO]),
    ((state(1.0), state(2.0), state(3.0)), (state(1.0), state(2.0), state(4.0))),
    PAIR,
    GRAY,
    tuple(map(jax.jit, GRAY)),
    (range(3), range(4)),
    (slice(1), slice(2)),
    (Fraction(1, 3), Fraction(2, 3)),
    (Decimal("1.0"), Decimal("1.5")),
    (timedelta(seconds=1), timedelta(seconds=2)),
    (re.compile("a"), re.compile("b")),
    (math.sin, math.cos),
    (np.sin, np.cos),
    (..., None),
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


CHANGES = {
    "a global variable of a function inside": (
        "C = 1\ndef f(p):\n    return sum(C for _ in range(3))\n",
        "C = 2\ndef f(p):\n    return sum(C for _ in range(3))\n",
    ),
    "a function that a function inside calls": (
        "def h(x): return x\ndef f(p):\n    def g(x): return h(x)\n    return g(1)\n",
        "def h(x): return -x\ndef f(p):\n    def g(x): return h(x)\n    return g(1)\n",
    ),
    "a decorator": (
        "import functools\ndef d(f):\n    return functools.wraps(f)(lambda p: f(p))\n@d\ndef f(p): return 1\n",
        "import functools\ndef d(f):\n    return functools.wraps(f)(lambda p: -f(p))\n@d\ndef f(p): return 1\n",
    ),
    "a global variable of a method": (
        "K = 1\nclass F:\n    def __call__(self, p): return K\nf = F()\n",
        "K = 2\nclass F:\n    def __call__(self, p): return K\nf = F()\n",
    ),
    "a method of a base class": (
        "class B:\n    def g(self): return 1\nclass F(B):\n    def __call__(self, p): return self.g()\nf = F()\n",
        "class B:\n    def g(self): return 2\nclass F(B):\n    def __call__(self, p): return self.g()\nf = F()\n",
    ),
    "an attribute of a class": (
        "class F: pass\nF.k = 1\ndef f(p): return F.k\n",
        "class F: pass\nF.k = 2\ndef f(p): return F.k\n",
    ),
}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A function that imports a module with a source."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def load(source, name="written"):
        (tmp_path / f"{name}.py").write_text(source)
        sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module(name)

    yield load
    for name in ("written", "helpers", "deeper"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_noticed(module, change):
    before, after = CHANGES[change]
    first = digest(module(before).f)
    assert digest(module(before).f) == first
    assert digest(module(f"# moved\n\n{before}").f) == first
    assert digest(module(after).f) != first


@pytest.mark.parametrize("use", ["import helpers\ndef f(p): return helpers.h(1)\n", "def f(p):\n    import helpers\n"])
def test_the_modules_of_the_user_are_part_of_a_function(module, use):
    module("def h(x): return x\n", "helpers")
    first = digest(module(use).f)
    module("def h(x): return -x\n", "helpers")
    assert digest(module(use).f) != first


def test_the_modules_that_these_import_are_part_of_a_function(module):
    found = []
    for sign in "+-":
        module(f"def h(x): return {sign}x\n", "deeper")
        module("from deeper import h\n", "helpers")
        found.append(digest(module("import helpers\ndef f(p): return helpers.h(1)\n").f))
    assert found[0] != found[1]


def test_the_line_of_a_lambda_is_not_part_of_it(module):
    first = digest(module("def g(f, **options): return f\nf = g(lambda p: 1)\n").f)
    assert digest(module("def g(f, **options): return f\nf = g(lambda p: 1, retries=3)\n").f) == first

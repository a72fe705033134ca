"""Results are put together again from their arrays as they were, by a form that went through JSON."""

import json
from enum import StrEnum
from typing import NamedTuple

import equinox as eqx
import numpy as np
import pytest

from qtraj.foundation.exported.form import filled, form_of


class Pair(NamedTuple):
    first: object
    second: object


class Converted(eqx.Module):
    value: object = eqx.field(converter=lambda x: np.asarray(x) + 1)
    kind: object = eqx.field(static=True)
    none: object = None


KINDS = (Pair, Converted)
ONE, TWO = np.asarray([1.0, 2.0]), np.asarray(3)
MODULE = Converted(ONE, "uniform")


@pytest.mark.parametrize(
    "result",
    [
        ONE,
        None,
        (),
        [ONE, (TWO, None), []],
        {"b": ONE, "a": {"2": TWO, "10": ONE}},
        Pair(Pair(ONE, None), [TWO]),
        MODULE,
        {"of": (MODULE, Pair(MODULE, MODULE))},
    ],
    ids=str,
)
def test_a_result_is_what_it_was(result):
    form, arrays = form_of(result, KINDS)
    same(filled(json.loads(json.dumps(form)), iter(arrays), KINDS), result)


def same(found, expected):
    assert type(found) is type(expected)
    if isinstance(expected, np.ndarray):
        assert found is expected, "neither converted again nor in another place"
    elif isinstance(expected, Converted):
        assert (found.kind, found.none) == ("uniform", None)
        same(found.value, expected.value)
    elif isinstance(expected, dict):
        assert list(found) == list(expected)
        for key in expected:
            same(found[key], expected[key])
    elif expected is not None:
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)


@pytest.mark.parametrize("result", [1.0, "text", {1, 2}, Converted, (ONE, Pair)], ids=str)
def test_what_is_no_result_is_refused(result):
    with pytest.raises(TypeError, match="may return"):
        form_of(result, KINDS)


class Kind(StrEnum):
    uniform = "uniform"


@pytest.mark.parametrize("result", [{1: ONE}, *(Converted(ONE, kind) for kind in (("a", "b"), len, Kind.uniform))])
def test_what_json_would_change_is_refused(result):
    with pytest.raises(TypeError, match="as they were"):
        form_of(result, KINDS)


def test_kinds_must_be_known():
    with pytest.raises(TypeError, match="Pair"):
        form_of(Pair(ONE, ONE), [Converted])

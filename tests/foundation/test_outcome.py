"""Result codes: their texts, which are composed on access, and errors only on request."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Int

from qtraj.foundation.outcome import FAILURES, AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.texts import Texts

composed = []


class Outcome(AbstractOutcome):
    """A result with only its codes, which records the texts that were composed."""

    code: Int[Array, "*batch"]

    def explain(self, at):
        composed.append(at)
        return f"{ResultCode(int(np.asarray(self.code)[at])).text} At {at}."

    def record(self):
        return Record("a line", {"code": Quantity(self.code, "1", "how the solve ended")})


def outcome(codes):
    return Outcome(jnp.asarray(codes, jnp.int32))


CODES = [0, ResultCode.near_zero_error, ResultCode.infeasible, ResultCode.max_steps_reached]


ADVICE = re.compile(
    r"\b(try|look|check|give|take|pass|raise|relax|choose|tune|change|limit|must be|start from)\b", re.IGNORECASE
)


def test_every_code_has_its_own_text_and_every_failure_says_what_to_do():
    assert len({code.text for code in ResultCode}) == len(ResultCode)
    for code in ResultCode:
        assert code.text.endswith(".")
        if code >= FAILURES:
            assert ADVICE.search(code.text), code.name


def test_result_is_a_text_and_for_a_batch_a_sequence_composed_on_access():
    assert outcome(ResultCode.infeasible).result.startswith("no boundary velocities")
    composed.clear()
    texts = outcome(np.tile(CODES, 1000)).result
    assert (len(texts), composed) == (4000, [])
    assert "max_steps" in texts[-1]
    assert composed == [(3999,)]
    assert texts[1:3][1] == texts[2]
    with pytest.raises(IndexError):
        texts[4000]
    assert [text[:8] for text in outcome(CODES).result] == ["the solv", "finished", "no bound", "stopped:"]


def test_texts_have_the_axes_of_the_batch():
    texts = Texts(lambda at: f"{at}", (2, 3))
    assert len(texts) == 2
    assert list(texts[1]) == ["(1, 0)", "(1, 1)", "(1, 2)"]
    np.testing.assert_array_equal(np.asarray(texts)[1], list(texts[1]))
    assert np.asarray(texts).shape == (2, 3)
    assert texts[1, 2] == "(1, 2)"
    assert "2 × 3" in repr(texts)


def test_success_is_an_array_also_inside_a_trace():
    assert outcome(CODES).successful.tolist() == [True, True, False, False]
    successful = jax.jit(jax.vmap(lambda code: Outcome(code).successful))(jnp.asarray(CODES, jnp.int32))
    assert successful.tolist() == [True, True, False, False]
    with pytest.raises(
        ValueError, match="not available inside jit, vmap or grad: use the attribute 'successful' or 'code'"
    ):
        jax.jit(lambda one: len(one.result))(outcome(0))


def test_check_raises_the_text_of_the_first_failure_or_returns_the_result():
    good = outcome(CODES[:2])
    assert good.check() is good
    with pytest.raises(RuntimeError, match=r"^no boundary velocities .* At \(\)\.$"):
        outcome(CODES[2]).check()
    with pytest.raises(RuntimeError, match=r"^element 2 of the batch: no boundary velocities .* At \(2,\)\.$"):
        outcome(CODES).check()


def test_check_in_a_trace_raises_when_the_function_runs():
    checked = eqx.filter_jit(lambda one: one.check().code + 1)
    assert checked(outcome(CODES[:2])).tolist() == [1, 1 + ResultCode.near_zero_error]
    with pytest.raises(RuntimeError, match="no boundary velocities"):
        checked(outcome([CODES[0], CODES[2]]))

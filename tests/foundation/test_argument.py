"""Arguments of a wrong type are described in messages."""

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.argument import described


class Uniform:
    """A class with an initial "U" that is spoken as a consonant."""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "None"),
        ((1, 2), "the tuple (1, 2)"),
        (np.zeros((2, 3)), "an array of shape (2, 3)"),
        (jnp.zeros((2, 3)), "a JAX array of shape (2, 3) and dtype float64"),
        (jnp.zeros(3, jnp.int32), "a JAX array of shape (3,) and dtype int32"),
        (np.uint8(3), "the uint8 3"),
        (np.float64(2.5), "the float64 2.5"),
        (Uniform(), "a Uniform"),
        (qt.Upright(), "an Upright"),
        (qt.Natural(), "a Natural"),
    ],
)
def test_descriptions(value, text):
    assert described(value) == text

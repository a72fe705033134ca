"""Expressions of parameters of sweeps: values against NumPy, and texts that are refused."""

import numpy as np
import pytest

from qtraj.scenario.point_expression import DEEPEST, LONGEST, PointExpression


def test_values_are_those_of_numpy():
    points = {"start.speed": np.array([4, 6]), "limits.friction": np.array([0.2, 0.4])}
    expression = PointExpression("max(sqrt(start.speed), 2.2) ** 2 / -limits.friction + 0.5*cos(pi) - atan2(1, 2)")
    assert expression.names == {"start.speed", "limits.friction"}
    v, mu = points.values()
    expected = np.maximum(np.sqrt(v), 2.2) ** 2 / -mu + 0.5 * np.cos(np.pi) - np.arctan2(1, 2)
    np.testing.assert_array_equal(expression(points), expected)


def test_numbers_that_are_too_large_are_infinite_at_once():
    assert np.isinf(PointExpression("10**10**10 * a")({"a": np.ones(1)})).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("__import__('os')", "may contain only names of other parameters"),
        ("a.b()", "may contain only"),
        ("a[0]", "may contain only"),
        ("(lambda: a)()", "may contain only"),
        ("1 if a else 2", "may contain only"),
        ("a < 1", "may contain only"),
        ("'x'", "may contain only"),
        ("True", "may contain only"),
        ("1if 1else 2", "may contain only"),
        ("sqrt + 1", "may contain only"),
        ("~" * 499 + "1", "may contain only"),
        ("f'{a}'", "may contain only"),
        ("max(a)", "may contain only"),
        ("sqrt(a, where=a)", "may contain only"),
        ("1e999 * a", "may contain only"),
        ("9" * 400, "may contain only"),
        ("a +", "is not valid"),
        ("a\0", "is not valid"),
        ("", "is not valid"),
        ("-" * (DEEPEST + 1) + "a", "nested more than"),
        ("a" * (LONGEST + 1), "may have 500 characters"),
        ("(" * 240 + "a" + ")" * 240, "is not valid"),
    ],
)
def test_other_texts_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        PointExpression(text)

"""Comparison of two paths: values, texts and warnings."""

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

ROUND_OFF = 1e-9


def change(**fields):
    """A change of a path that does not change, but for these fields."""
    path = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 2.0)
    same = {name: getattr(qt.compare_paths(path, path), name) for name in qt.PathChange.__dataclass_fields__}
    return qt.PathChange(**same | {name: jnp.asarray(value) for name, value in fields.items()})


@pytest.mark.parametrize(
    ("length", "duration", "deviation", "words"),
    [
        (29.0, 14.0, 9.0, None),
        (31.0, 14.0, 9.0, "The tuned path is longer by a factor of 3.1 (31 m instead of 10 m)."),
        (29.0, 16.0, 9.0, "The tuned path takes 3.2 times as long (16 s instead of 5 s)."),
        (29.0, 14.0, 11.0, "deviates from the original path by 11 m, more than the size of that path, 10 m."),
        (
            31.0,
            16.0,
            11.0,
            "(31 m instead of 10 m), takes 3.2 times as long (16 s instead of 5 s) and deviates from the original path",
        ),
    ],
)
def test_there_is_a_warning_if_the_paths_differ_much(length, duration, deviation, words):
    warning = change(lengths=[10.0, length], durations=[5.0, duration], deviation=deviation, size=10.0).warning
    assert (warning is None) == (words is None)
    assert words is None or words in warning


def test_changes_of_heading_and_height_in_words():
    text = change(headings=[np.pi / 2, 0.0], lowest=-1.0, highest=0.0).text
    assert text == (
        "The direction of travel changes by 90.0° to the left at A and by 0.0° at B; the minimum height changes by "
        "-1.00 m and the maximum height by +0.00 m."
    )
    assert "by an undefined angle at B" in change(headings=[0.1, np.nan]).text


def test_the_sentences_explain_the_symbols_and_give_the_deviation():
    legend, deviation, text = (found := change(deviation=0.25)).sentences()
    assert legend.startswith("A: start, B: end.")
    assert deviation == "The tuned path deviates from the original path by at most 0.25 m."
    assert text == found.text


def test_the_numbers_follow_from_the_paths():
    """Helices about one axis: before with radius 10 and climb 0.5 m/s, after with radius 12, lower, a quarter later."""
    before = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 2.0)
    after = qt.SpiralHelix([12.0], [np.pi / 2, 0.3], [-1.0, 0.25], 3.0)
    start, end = qt.BoundaryState([10.0, 0, 0], [1.0, 4.0, 0.5]), qt.BoundaryState([0, 10.0, 1], [-4.0, 2.0, 0.5])
    found = qt.compare_paths(before, after, (start, end))
    assert np.asarray(found.velocities[0]) == pytest.approx(np.tile([0.0, 4.0, 0.5], (2, 1)), abs=ROUND_OFF)
    assert np.asarray(found.velocities[1]) == pytest.approx(np.tile([0.0, 3.6, 0.25], (2, 1)), abs=ROUND_OFF)
    assert np.asarray(found.given) == pytest.approx(np.array([[1.0, 4.0, 0.5], [2.0, 4.0, 0.5]]))
    assert np.asarray(found.durations).tolist() == [2.0, 3.0]
    assert np.asarray(found.mean_rates) == pytest.approx([0.4, 0.3])
    assert np.asarray(found.lengths) == pytest.approx([2 * np.hypot(4.0, 0.5), 3 * np.hypot(3.6, 0.25)])
    assert np.asarray(found.headings) == pytest.approx([np.pi / 2, np.pi / 2 + 0.1])
    assert (found.lowest, found.highest) == pytest.approx((-1.0, -1.25))
    assert 2.0 <= found.deviation <= np.hypot(22.0, 2.0)


def test_a_path_that_does_not_change_differs_by_nothing():
    same = change()
    assert (same.warning, float(same.deviation)) == (None, pytest.approx(0.0, abs=ROUND_OFF))
    assert not np.any(same.headings)


def test_a_heading_that_does_not_exist_is_not_a_number():
    straight_up = qt.SpiralHelix([10.0], [0.0, 0.0], [0.0, 1.0], 1.0)
    around = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 1.0], 1.0)
    assert np.isnan(qt.compare_paths(straight_up, around).headings).all()


def test_rows_of_text():
    path = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 2.0)
    slower = qt.SpiralHelix([10.0], [0.0, 0.2], [0.0, 0.25], 4.0)
    states = tuple(qt.BoundaryState(path.position(t), path.velocity(t)) for t in (0.0, 2.0))
    found = qt.compare_paths(path, slower, states)
    velocities, whole = found.rows()
    assert velocities[1] == ("V_φ at A", "4.0000", "2.0000", "-2.0000", "m/s")
    assert whole[0] == ("duration", "2.0000", "4.0000", "+2.0000", "s")
    assert found.given_text is None  # the path has the requested velocities
    assert qt.compare_paths(slower, path, states).given_text.startswith("The specified states have (V_ρ, V_φ, V_h)")

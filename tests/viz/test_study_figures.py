"""The figures of studies draw their input, and mark singular points, limits and closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import (
    limits_figure,
    loops_figure,
    orientation_figure,
    path_figure,
    precision_figure,
    profiles_figure,
    save,
)

DRAWN = 1e-12  # rounding of the conversion to degrees and back

TIMES = np.linspace(0.0, 4.0, 81)


@pytest.fixture(scope="module")
def dataset():
    path = qt.SpiralHelix([10.0, 1.0], [0.0, 0.4], [0.0, 0.5], 4.0)
    return path_dataset({"turn": path}, qt.Limits(speed=9.0), samples=33, attributes={"title": "A spiral"})


@pytest.fixture(scope="module")
def loop():
    """A hand-made loop of three instants: an error of 0.4 rad that halves."""
    angle = jnp.array([0.4, 0.2, 0.1])
    zero = jnp.zeros(3)
    error = jnp.stack([jnp.cos(angle / 2), jnp.sin(angle / 2), zero, zero], axis=1)
    command = jnp.stack([zero, 3 * angle, 4 * angle, zero], axis=1)
    return qt.Solution(jnp.arange(3.0), error, jnp.zeros((3, 4)), 0, command, error, angle)


def labels(axes):
    return axes.get_legend_handles_labels()[1]


def turning(rate, flip=False):
    """A rotation about z; with `flip` the frame jumps by 180° about its x axis at half time."""
    half = 0.5 * rate * TIMES
    zero = np.zeros_like(half)
    quaternions = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)
    if flip:
        other = np.stack([zero, np.cos(half), np.sin(half), zero], axis=1)
        quaternions[TIMES > 2] = other[TIMES > 2]
    return quaternions


def test_the_path_is_drawn_about_its_centre_with_equal_axes(dataset):
    axes = path_figure(dataset).axes[0]
    extent = [np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]
    shape = np.array(axes.get_box_aspect()) / extent
    assert shape == pytest.approx(np.full(3, shape[0]), rel=1e-6)
    assert labels(axes) == ["turn", "τ (tangent)", "n (normal)", "b (binormal)"]


def test_heads_of_arrows_are_visible_from_any_side(dataset):
    """From any direction, some barb of each arrow is off its shaft by nearly a fifth of the barb's length."""
    arrows = path_figure(dataset, velocities=True, reference=True).axes[0].collections
    assert [len(lines._segments3d) for lines in arrows] == [6 * 5] * 3 + [5] * 3 + [5] * 2
    for segments in np.concatenate([np.reshape(lines._segments3d, (-1, 5, 2, 3)) for lines in arrows]):
        shaft, *barbs = segments[:, 1] - segments[:, 0]
        assert np.all(segments[:, 1] == segments[0, 1])  # all end at the tip
        directions = np.random.default_rng(1).normal(size=(200, 3))
        across = np.cross(shaft, directions)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        seen = np.max(np.abs(across @ np.array(barbs).T), axis=1)
        assert seen.min() > 0.19 * np.linalg.norm(barbs[0])


def test_the_reference_is_drawn_at_the_origin(dataset):
    axes = path_figure(dataset, trihedra=0, velocities=True, reference=True, view=(20, 30)).axes[0]
    assert labels(axes) == ["turn", "radius vectors", "velocity"]
    assert axes.get_xlabel() == "x [m]"
    assert (axes.elev, axes.azim) == (20, 30)
    line = np.stack(axes.lines[0].get_data_3d(), axis=1)
    assert np.array_equal(line, dataset["position"].values[0])
    assert [text.get_text() for text in axes.texts] == ["i", "j", "k", "V$_A$", "V$_B$", "  A", "  B"]


def test_a_quantity_is_shown_with_its_limit(dataset):
    curvature, speed, _ = limits_figure(dataset).axes
    assert labels(curvature) == ["turn"]
    assert labels(speed) == ["turn", "limit 9"]
    [torsion] = limits_figure(dataset, ["torsion"]).axes
    assert torsion.get_ylabel() == "torsion [1/m]"
    assert np.array_equal(torsion.lines[0].get_ydata(), dataset["torsion_magnitude"].values[0])


def test_an_unknown_quantity_is_refused(dataset):
    with pytest.raises(ValueError, match="unknown path quantity 'colour'; the known quantities are curvature"):
        limits_figure(dataset, ["colour"])


def marked(axes, label):
    """The times of the vertical lines with this label and their unlabelled successors of the same colour."""
    first = [line for line in axes.lines if line.get_label() == label]
    same = [x for x in axes.lines if first and x.get_color() == first[0].get_color() and len(x.get_xdata()) == 2]
    return [x.get_xdata()[0] for x in same]


def test_instants_of_an_infinite_gibbs_vector_are_marked():
    quaternion, gibbs, angle = orientation_figure(TIMES, turning(2.0)).axes
    assert [x for x in labels(quaternion) if x[0] == "λ"] == ["λ₀", "λ₁", "λ₂", "λ₃"]
    assert marked(gibbs, "Φ = 180°: G infinite") == pytest.approx([np.pi / 2], abs=1e-3)
    assert gibbs.get_ylim() == (-4.0, 4.0)
    assert marked(angle, "attitude jumps") == []
    drawn = gibbs.lines[2]
    assert np.isnan(drawn.get_ydata()).sum() == 1  # the pole is not bridged
    assert angle.lines[0].get_ydata()[20] == pytest.approx(np.degrees(2.0), rel=DRAWN)


def test_signs_are_made_continuous():
    wild = turning(1.0) * np.where(np.arange(len(TIMES)) % 2, -3.0, 3.0)[:, None]
    figures = [orientation_figure(TIMES, q) for q in (turning(1.0), wild)]
    drawn = [np.stack([line.get_ydata() for line in figure.axes[0].lines[:4]]) for figure in figures]
    assert np.allclose(drawn[0], drawn[1], rtol=0, atol=1e-14)


def test_a_flip_is_marked_and_not_bridged():
    quaternion, *_ = orientation_figure(TIMES, turning(0.3, flip=True)).axes
    assert marked(quaternion, "attitude jumps") == pytest.approx([2.025])
    assert all(np.isnan(line.get_ydata()).sum() == 1 for line in quaternion.lines[:4])


def test_an_interval_at_180_degrees_is_shaded_and_has_no_gibbs_vector():
    over = np.stack([0 * TIMES, np.cos(TIMES), np.sin(TIMES), 0 * TIMES], axis=1)
    _, gibbs, _ = orientation_figure(TIMES, over).axes
    assert labels(gibbs)[-1] == "Φ = 180° throughout"
    assert all(np.isnan(line.get_ydata()).all() for line in gibbs.lines[:3])


def test_nothing_is_drawn_where_there_is_no_attitude():
    quaternion, *_ = orientation_figure(TIMES, turning(0.3), TIMES < 1, "half").axes
    assert np.isnan(quaternion.lines[0].get_ydata()).sum() == np.sum(TIMES >= 1)
    assert quaternion.figure.get_suptitle() == "half"


def test_profiles_show_their_limits_over_time_and_in_the_phase_plane():
    profile = qt.TimeOptimal(0.5, 0.25).profile(1.5)
    angle, rate, acceleration, phase = profiles_figure({"fast": profile}, 0.5, 0.25).axes
    assert angle.lines[0].get_ydata().max() == pytest.approx(np.degrees(1.5), rel=DRAWN)
    assert rate.lines[1].get_ydata()[0] == pytest.approx(np.degrees(0.5), rel=DRAWN)
    assert [x.get_ydata()[0] for x in acceleration.lines[1:]] == pytest.approx([np.degrees(0.25), -np.degrees(0.25)])
    assert np.array_equal(phase.lines[0].get_xdata(), angle.lines[0].get_ydata())
    assert labels(phase) == ["fast", "limit"]
    # Full acceleration lasts until the switch itself.
    values = acceleration.lines[0]
    before = values.get_ydata()[values.get_xdata() < 2.0]
    assert before == pytest.approx(np.full(len(before), np.degrees(0.25)), rel=DRAWN)


def test_loops_are_compared_with_their_closed_form(loop):
    exact = np.asarray(loop.error) + 1e-9
    angle, gap, command = loops_figure({"ours": loop, "other": loop}, {"ours": exact}, 0.02, "Two").axes
    assert labels(angle) == ["ours", "other", "closed form", "1.146°"]
    assert angle.lines[0].get_ydata() == pytest.approx(np.degrees([0.4, 0.2, 0.1]), rel=DRAWN)
    assert len(gap.lines) == 1
    assert gap.lines[0].get_ydata() == pytest.approx(np.full(3, 1e-9), rel=1e-6)
    assert command.lines[0].get_ydata() == pytest.approx(np.degrees([2.0, 1.0, 0.5]), rel=DRAWN)
    assert [axes.get_ylabel()[-5:] for axes in (angle, command)] == ["e [°]", "°/s²]"]


def test_loops_without_a_closed_form_have_no_panel_for_it(loop):
    assert len(loops_figure({"ours": loop}).axes) == 2


def test_precision_is_drawn_on_logarithmic_axes_down_to_round_off():
    figure = precision_figure({"A": ([8, 16, 32], [1e-2, 1e-4, 0.0]), "B": ([8, 64], [1e-1, 1e-3])}, round_off=1e-15)
    [axes] = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert list(axes.get_xticks()) == [8, 16, 32, 64]
    assert axes.lines[0].get_ydata()[-1] == 1e-15
    assert labels(axes) == ["A", "B", "round-off"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda loop: profiles_figure({}), "at least one profile"),
        (lambda loop: loops_figure({}), "needs solutions with commands, but there is no solution"),
        (
            lambda loop: loops_figure({"a": loop}, {"b": loop.error}),
            "closed_forms contains 'b', but solutions",
        ),
        (lambda loop: precision_figure({}), "at least one method"),
        (lambda loop: precision_figure({"a": ([1, 2], [1.0, 0.0])}), "must be positive, but the values of 'a'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(loop, make, message):
    with pytest.raises(ValueError, match=message):
        make(loop)


def test_curves_can_be_distinguished_in_grey(loop):
    axes = loops_figure(dict.fromkeys("abcd", loop)).axes[0]
    styles = {(line.get_color(), str(line.get_linestyle()), str(line._dash_pattern)) for line in axes.lines}
    assert len(styles) == 4
    assert len({pattern for *_, pattern in styles}) == 4


def test_vector_files(tmp_path, loop):
    for k, figure in enumerate([loops_figure({"a": loop}), orientation_figure(TIMES, turning(2.0))]):
        for suffix, start in (("svg", b"<?xml"), ("pdf", b"%PDF")):
            save(figure, tmp_path / f"{k}.{suffix}")
            assert (tmp_path / f"{k}.{suffix}").read_bytes().startswith(start)

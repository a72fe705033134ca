"""Figures: labels, units, limits, equal axes; files of every format."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import save, tuning_figure

FAR = 4.8e6  # [m] a northing


def helix(radius, duration):
    place = qt.Placement([600_000.0, FAR, 100.0])
    return qt.SpiralHelix([radius, 0.0], [0.2, 0.4], [1.0, 0.1], duration, place)


@pytest.fixture(scope="module")
def dataset():
    track = qt.Track([0.0, 1.0, 2.0, 3.0], np.array([600_010.0, FAR, 100.0]) + np.eye(4, 3))
    paths = {"before": helix(10.0, 6.0), "after": helix(12.0, 8.0)}
    return path_dataset(paths, qt.Limits(curvature=0.1, slope=0.2), track, samples=65, attributes={"title": "A turn"})


@pytest.fixture(scope="module")
def figure(dataset):
    return tuning_figure(dataset)


def texts(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_every_axis_has_its_unit(figure):
    space, *panels = figure.axes
    assert [space.get_xlabel(), space.get_ylabel(), space.get_zlabel()] == [
        "x − 600000 [m]",
        "y − 4800004 [m]",
        "z − 101 [m]",
    ]
    assert [axes.get_ylabel() for axes in panels] == ["curvature [1/m]", "lateral acceleration [m/s²]", "slope [–]"]
    assert panels[-1].get_xlabel() == "time from the start of the path [s]"
    assert figure.get_suptitle() == "A turn"


def test_large_coordinates_are_relative_to_the_centre(figure):
    space = figure.axes[0]
    assert max(map(abs, (*space.get_xlim(), *space.get_ylim(), *space.get_zlim()))) < 30


def test_axes_in_space_are_equal(figure):
    space = figure.axes[0]
    extent = [np.ptp(limits) for limits in (space.get_xlim(), space.get_ylim(), space.get_zlim())]
    shape = np.array(space.get_box_aspect()) / extent
    assert shape == pytest.approx(np.full(3, shape[0]), rel=1e-6)


def test_paths_recording_and_trihedra_are_named(figure):
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["recorded", "before", "after", "forward", "left", "up"]


def test_panels_show_both_paths_and_their_limit(figure, dataset):
    curvature, lateral, slope = figure.axes[1:]
    assert texts(curvature) == ["before", "after", "limit 0.1"]
    assert texts(lateral) == ["before", "after"]
    assert texts(slope) == ["before", "after", "limit 0.2"]
    before, after, limit = curvature.lines
    assert np.array_equal(before.get_ydata(), dataset["curvature"].sel(path="before").values)
    assert np.array_equal(after.get_xdata(), dataset["time"].sel(path="after").values)
    assert set(limit.get_ydata()) == {0.1}


def test_paths_differ_in_colour_and_line_style(figure):
    before, after, _ = figure.axes[1].lines
    assert before.get_color() != after.get_color()
    assert before.get_linestyle() != after.get_linestyle()


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_files(figure, tmp_path, suffix, start):
    files = [tmp_path / f"{k}.{suffix}" for k in "ab"]
    for file in files:
        save(figure, file)
    first, second = (file.read_bytes() for file in files)
    assert first.startswith(start)
    assert len(first) > 10_000
    assert first == second  # equal figures give equal bytes


def test_a_path_without_a_trihedral_is_drawn_without_one():
    straight = qt.SpiralHelix([1.0, 2.0], [0.3, 0.0], [0.0, 0.5], 3.0, qt.Placement())
    figure = tuning_figure(path_dataset({"before": straight}, samples=65))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["before"]

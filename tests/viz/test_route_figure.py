"""The figure of a route: distances, units, and what is drawn in red."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import route_figure
from qtraj.viz.report.paths import path_report
from qtraj.viz.report.payload import payload
from qtraj.viz.route_figure import distance
from qtraj.viz.style import COLOURS, MARK

from .drives import before_and_after

FAR = np.array([600_000.0, 4.8e6, 100.0])


@pytest.fixture(scope="module")
def dataset():
    """Ten metres straight at 1 m/s, then a quarter of a circle of 5 m, then straight again."""
    t = np.linspace(0.0, 28.0, 57)
    angle = np.clip((t - 10.0) / 5.0, 0.0, np.pi / 2)
    heading = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    points = np.cumsum(np.vstack([FAR, 0.25 * (heading[1:] + heading[:-1])]), axis=0)
    track = qt.Track(t, points)
    route = qt.fit_route(track, knots=1.0).path
    limits = qt.Limits(curvature=0.15, speed=2.0)
    return path_dataset({"route": route}, limits, track, attributes={"title": "A corner"}, frame=qt.Upright())


def test_the_distance_travelled(dataset):
    assert distance(dataset.isel(path=0))[-1] == pytest.approx(28.0, abs=0.05)


def test_every_axis_has_its_unit(dataset):
    plan, bar, *panels = route_figure(dataset).axes
    assert (plan.get_xlabel(), plan.get_ylabel()) == ("x − 600011 [m]", "y − 4800004 [m]")
    assert [axes.get_ylabel() for axes in panels] == ["height\n[m]", "speed\n[m/s]", "curvature\n[1/m]"]
    assert panels[-1].get_xlabel() == "distance travelled [m]"
    assert bar.get_ylabel() == "curvature [1/m]"


def test_the_report_has_the_colour_scale_of_the_figure(dataset):
    """Samples at a stop do not change the scale."""
    stopped = dataset.copy(deep=True)
    stopped["speed"][..., :20] = 1e-3
    stopped["curvature"][..., :20] = 50.0
    for drawn in (dataset, stopped):
        lines = route_figure(drawn).axes[0].collections[0]
        colours = payload(path_report(drawn))["colours"]
        assert lines.get_clim() == (0.0, colours["top"])
        assert colours["top"] < 1.0
        np.testing.assert_allclose(lines.get_array(), colours["values"][:-1], rtol=1e-5, atol=1e-12)


def test_only_violations_are_red(dataset):
    _, _, _, speed, curvature = route_figure(dataset).axes
    red = {
        axes: next(line for line in axes.lines if line.get_color() == MARK).get_data() for axes in (speed, curvature)
    }
    assert np.isnan(red[speed][1]).all()
    way, values = red[curvature]
    drawn = np.isfinite(values)
    assert (values[drawn] > 0.15).all()
    assert way[drawn].min() == pytest.approx(10.0, abs=1.0)
    assert way[drawn].max() == pytest.approx(10.0 + 2.5 * np.pi, abs=1.0)


def test_after_a_tuning_both_routes_are_drawn():
    """Each against its own distance; the last panel shows how far the route has moved to the left."""
    drives = before_and_after(title="Corners")
    plan, _, _, speed, lateral, moved = route_figure(drives).axes
    assert [text.get_text() for text in plan.get_legend().get_texts()] == ["before", "after, coloured by curvature"]
    assert [text.get_text() for text in speed.get_legend().get_texts()] == ["before", "after"]
    for axes, name in ((speed, "speed"), (lateral, "lateral_acceleration")):
        for path in ("before", "after"):
            [line] = [x for x in axes.lines if x.get_label() == path]
            assert line.get_color() == COLOURS[path]
            np.testing.assert_array_equal(line.get_ydata(), drives[name].sel(path=path))
            assert line.get_xdata()[-1] == pytest.approx(distance(drives.sel(path=path))[-1])
    assert moved.get_ylabel() == "to the left\nof before\n[m]"
    [line] = moved.lines
    assert line.get_ydata()[-300] == pytest.approx(3.0, abs=0.1)


def test_outliers_do_not_set_the_axes_of_the_map(dataset):
    limits = [(axes.get_xlim(), axes.get_ylim()) for axes in route_figure(dataset).axes[:1]]
    outlier = dataset.copy(deep=True)
    outlier["recorded_position"].values[5] += np.array([900.0, -700.0, 0.0])
    assert [(axes.get_xlim(), axes.get_ylim()) for axes in route_figure(outlier).axes[:1]] == [
        (pytest.approx(x, abs=1.0), pytest.approx(y, abs=1.0)) for x, y in limits
    ]

"""The figure of a route: distances, units, and what is drawn in red."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.io.route_dataset import route_dataset
from qtraj.viz.figures import route_figure
from qtraj.viz.map_colours import STEPS
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
        of_samples = np.repeat(lines.get_array(), [len(line) - 1 for line in lines.get_segments()])
        expected = np.minimum(colours["values"][:-1], colours["top"])
        np.testing.assert_allclose(of_samples, expected, atol=0.51 * colours["top"] / STEPS)
        assert np.unique(lines.get_array()).size <= STEPS


def test_the_map_shows_every_sample_once(dataset):
    lines = route_figure(dataset).axes[0].collections[0]
    own = lines.get_segments()
    position = dataset["position"].values[-1, :, :2]
    drawn = np.concatenate([own[0][:1], *(x[1:] for x in own)])
    np.testing.assert_allclose(drawn, position - np.round(position.mean(axis=0)))
    assert len(own) < len(position) / 4


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


def test_a_road_that_changes_has_panels():
    t = np.arange(0.0, 10.0, 0.1)
    route = qt.fit_route(qt.Track(t, np.stack([10 * t, 0 * t, 0 * t], axis=1))).path
    road = qt.Road([0.0, 40.0, 60.0], bank=[0.0, 0.1, 0.0], friction=[[0.8, 0.7], [0.3, 0.2], [0.8, 0.7]])
    limits = qt.Limits(friction=0.9, vehicle=qt.Vehicle(1e3, road=road))
    panels = {axes.get_ylabel(): axes for axes in route_figure(path_dataset({"route": route}, limits)).axes}
    way, bank = panels["bank of\nthe road [°]"].lines[0].get_data()
    np.testing.assert_allclose(bank, np.degrees(np.interp(way, road.distance, road.bank)), atol=1e-9)
    along, across = (line.get_data()[1] for line in panels["friction of\nthe road [-]"].lines)
    np.testing.assert_allclose(along - across, 0.1)
    np.testing.assert_allclose(along, np.interp(way, road.distance, [0.8, 0.3, 0.8]), atol=1e-9)
    level = qt.Limits(friction=0.9, vehicle=qt.Vehicle(1e3))
    assert not any("road" in axes.get_ylabel() for axes in route_figure(path_dataset({"r": route}, level)).axes)


def test_the_standard_deviations_of_a_fitted_route_are_columns_and_bands():
    t = np.arange(0.0, 20.0, 0.1)
    noise = np.random.default_rng(0).normal(0.0, 0.03, (len(t), 3))
    fitted = qt.fit_route(qt.Track(t, np.stack([8 * t, 20 * np.sin(0.3 * t), 0 * t], axis=1) + noise))
    limits = qt.Limits(friction=0.9, yaw_rate=0.7, vehicle=qt.Vehicle(1e3))
    tuned = qt.tune_route(fitted.path, qt.Limits(yaw_rate=0.2))
    plain, both = route_dataset(fitted, limits), route_dataset(fitted, limits, tuned=tuned)
    for name in ("position", "speed", "yaw_rate", "friction"):
        expected = qt.uncertainty(fitted, plain["time"].values[0], [name], limits.vehicle).sigma[name]
        np.testing.assert_allclose(plain[f"{name}_sigma"][0], expected, rtol=1e-12)
        assert plain[f"{name}_sigma"].attrs["units"] == plain[name].attrs["units"]
        np.testing.assert_array_equal(both[f"{name}_sigma"][0], plain[f"{name}_sigma"][0])
        assert np.isnan(both[f"{name}_sigma"][1]).all()
    speed = next(axes for axes in route_figure(plain).axes if axes.get_ylabel().startswith("speed"))
    top = speed.collections[0].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx((plain["speed"] + 2 * plain["speed_sigma"]).values.max())

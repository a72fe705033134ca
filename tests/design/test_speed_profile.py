"""Speed profiles of timings with known values: constant acceleration, a circle, a stop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.design.retimed_facts import retimed_fact_rows, retimed_limit_rows
from qtraj.design.whole_certificate import whole_certificate
from qtraj.path.vehicle_data import vehicle_from
from qtraj.viz import figures

RADIUS, CELLS = 20.0, 4
CIRCLE = qt.SpiralHelix([RADIUS], [0.0, 0.1], [0.0], 10.0)  # 2 m/s
NAMES, LIMITS = ("speed", "lateral_acceleration", "longitudinal_acceleration"), [9.0, 1.25, 0.5]


def retimed(path, coefficients, knots, rest, usage, names=NAMES, limits=LIMITS):
    """The result of a retiming with a given timing, without a search."""
    k = len(names)
    certificate = qt.Certificate(names, [0] * k, [0.0] * k, limits, limits)
    timing = qt.Timing(coefficients, knots, rest)
    return qt.Retimed(qt.RetimedPath(path, timing), timing.duration, certificate, usage, [0.0, 1.0], 0, 1)


@pytest.fixture(scope="module")
def timed():
    """u̇² = u/4 on a circle: v² = u from rest, so v̇ = 1/4·2 m/s² and s = 2 u."""
    knots = np.linspace(0.0, 10.0, CELLS + 1)
    step = knots[1]
    coefficients = [[0.25 * u, 0.25 * step, 0.0, 0.0] for u in knots[:-1]]
    usage = [[0.1] * 4, [0.1, 0.2, 0.995, 1.0], [1.0, 1.0, 0.99, 0.5]]
    return retimed(CIRCLE, coefficients, knots, (True, False), usage)


@pytest.fixture(scope="module")
def profile(timed):
    return qt.speed_profile(timed)


def test_the_speed_and_the_accelerations_agree_with_the_closed_form(profile):
    u, v = np.asarray(profile.parameter), np.asarray(profile.speed)
    assert np.asarray(profile.distance) == pytest.approx(2 * u)
    assert v == pytest.approx(np.sqrt(u))
    assert np.asarray(profile.times) == pytest.approx(4 * np.sqrt(u), abs=1e-12)
    assert np.asarray(profile.tangential) == pytest.approx(0.25, rel=1e-9)
    values = dict(zip(profile.names, np.asarray(profile.values), strict=True))
    assert values["lateral_acceleration"] == pytest.approx(v**2 / RADIUS)
    assert values["speed"] == pytest.approx(v)


def test_the_bound_at_constant_speed_is_that_of_the_lateral_acceleration(profile):
    assert np.asarray(profile.speed_bound) == pytest.approx(np.sqrt(1.25 * RADIUS))
    assert float(profile.speed_bound[0]) == pytest.approx(5.0)


def test_shares_are_parts_of_the_distance(profile):
    assert np.asarray(profile.shares) == pytest.approx([0.0, 0.5, 0.75])
    assert profile.share("longitudinal_acceleration") == pytest.approx(0.75)
    assert profile.active.tolist() == [2, 2, 1, 1]
    assert profile.durations == pytest.approx([10.0, 4 * 10**0.5])
    assert "20 m in 12.6491 s instead of 10 s; speed 0 %, lateral_acceleration 50 %" in repr(profile)


def test_the_share_of_an_unknown_limit_names_the_known_ones(profile):
    with pytest.raises(
        ValueError,
        match="without a limit 'jerk': the known limits of this timing are speed, lateral_acceleration, longitudinal",
    ):
        profile.share("jerk")
    with pytest.raises(ValueError, match=r"without a limit 'velocity': did you mean 'speed'\?"):
        profile.share("velocity")


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (CIRCLE, "a SpiralHelix"),
        (np.zeros((5, 3)), r"an array of shape \(5, 3\)"),
        (qt.Track([0.0, 1.0, 2.0, 3.0], np.eye(4, 3)), "a Track"),
        (CubicSpline([0.0, 1.0, 2.0], np.eye(3)), "a CubicSpline"),
        (None, "None"),
    ],
    ids=["path", "array", "track", "spline", "none"],
)
def test_anything_but_the_result_of_retime_is_refused(given, text):
    with pytest.raises(
        ValueError, match=rf"timed must be a Retimed, .*, but {text} was given\. Pass qtraj\.retime\(path, limits\)"
    ):
        qt.speed_profile(given)


def test_the_start_at_rest_is_a_stop_of_no_length(profile):
    assert profile.stops.tolist() == [[0.0, 0.0]]
    assert profile.stop_distance.tolist() == [0.0]


def test_a_limit_on_the_acceleration_bounds_the_speed_in_a_bend(timed):
    only = retimed(
        CIRCLE, timed.timing.coefficients, timed.timing.knots, (True, False), [[1.0] * 4], ["acceleration"], [0.8]
    )
    assert np.asarray(qt.speed_profile(only).speed_bound) == pytest.approx(4.0)


def test_a_stop_of_a_route_is_listed_with_its_duration():
    """At the stop, nothing is undefined; in the drives beside it, values are those of the nearest moment."""
    position = [[-12.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 1, 0.5]]
    velocity = [[6.0, 0.3, 0], [0, 0, 0], [0, 0, 0], [6, 0.5, 0.2]]
    route = qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))
    knots = [0.0, 1.5, 3.0, 8.0, 11.0]
    profile = qt.speed_profile(retimed(route, [[1.0, 0, 0, 0]] * 4, knots, (False, False), np.zeros((3, 4))))
    assert np.asarray(profile.stops) == pytest.approx(np.array([[3.0, 8.0]]))
    assert profile.stop_distance[0] == pytest.approx(float(route.window(0.0, 3.0).length()), rel=1e-6)
    assert profile.active.tolist() == [-1] * 4
    for values in (profile.values, profile.tangential, profile.speed):
        assert np.isfinite(values).all()
    assert np.min(profile.speed_bound) > 0


def test_batches_and_traces_are_refused(timed):
    many = jax.tree.map(lambda x: jnp.stack([x, x]), timed)
    with pytest.raises(ValueError, match=r"a batch of shape \(2,\) was given"):
        qt.speed_profile(many)
    with pytest.raises(ValueError, match="concrete values"):
        jax.jit(lambda x: qt.speed_profile(x).speed)(timed)


def test_the_figure_colours_the_speed_by_its_limits(profile):
    figure = profile.plot("On a circle")
    speed, bars, *panels = figure.axes
    legend = [text.get_text() for text in speed.get_legend().get_texts()]
    assert legend == [
        "lateral acceleration",
        "longitudinal acceleration",
        "excluded at constant speed",
        "no limit reached",
        "at rest",
    ]
    [second] = [line for line in speed.lines if line.get_label() == "lateral acceleration"]
    drawn = np.isfinite(second.get_ydata())
    assert second.get_xdata()[drawn][0] == pytest.approx(10.0)
    assert [text.get_text() for text in bars.get_yticklabels()] == [
        "speed  0 %",
        "lateral acceleration  50 %",
        "longitudinal acceleration  75 %",
    ]
    assert len(panels) == 2
    limits = sorted(float(line.get_ydata()[0]) for line in panels[0].lines[-2:])
    assert limits == [-0.5, 0.5]
    assert panels[-1].get_xlabel() == "distance travelled [m]"
    assert figure.get_suptitle() == "On a circle"


def test_a_road_that_changes_has_panels(timed, tmp_path):
    road = qt.Road([0.0, 8.0, 16.0], bank=[0.0, 0.1, 0.0], friction=[0.8, 0.3, 0.8])
    vehicle = qt.Vehicle(1e3, road=road)
    profile = qt.speed_profile(eqx.tree_at(lambda x: x.vehicle, timed, vehicle, is_leaf=lambda x: x is None))
    panels = {axes.get_ylabel(): axes for axes in profile.plot().axes}
    for label, values in (
        ("bank of\nthe road [°]", np.degrees([0.0, 0.1, 0.0])),
        ("friction of\nthe road [-]", [0.8, 0.3, 0.8]),
    ):
        [line] = panels[label].lines
        np.testing.assert_allclose(line.get_xdata(), profile.distance)
        np.testing.assert_allclose(line.get_ydata(), np.interp(line.get_xdata(), road.distance, values), atol=1e-12)
    qt.save_dataset(profile.to_xarray(), tmp_path / "timing.nc")
    loaded = vehicle_from(qt.load_dataset(tmp_path / "timing.nc").data_vars)
    assert loaded is not None
    assert loaded.road == road


def test_a_retimed_path_has_a_figure_and_a_dataset_of_both_paths(timed):
    from qtraj.viz.drawable import drawable

    assert len(timed.plot().axes) == 4
    dataset = drawable(timed)
    assert dataset["path"].values.tolist() == ["before", "after"]
    assert dataset["reached_share"].sel(limit="lateral_acceleration").item() == pytest.approx(0.5)
    assert dataset["finding_speed"].values.tolist() == ["", "proved"]
    assert "speed_profile_figure" in figures.__all__


def test_facts_as_text(timed, profile):
    rows = dict(retimed_fact_rows(timed, profile))
    assert rows["duration"] == "12.6491 s instead of 10 s"
    assert rows["length"] == "20 m, at 1.581 m/s on average"
    assert "stops" not in rows  # the start at rest has no duration
    limits = retimed_limit_rows(timed.certificate, profile)
    assert [row[4] for row in limits] == [f"{100 * profile.share(name):.1f} %" for name in NAMES]


def test_limits_on_the_shape_are_added_to_the_certificate(timed):
    assert whole_certificate(timed, qt.Limits(speed=9.0)) is timed.certificate
    whole = whole_certificate(timed, qt.Limits(speed=9.0, curvature=0.06, slope=0.1))
    assert whole.names == (*NAMES, "curvature", "slope")
    assert whole.status["curvature"] == "proved"
    assert whole_certificate(timed, qt.Limits(curvature=0.04)).status["curvature"] == "broken"


def test_limits_that_retime_does_not_support_are_checked_by_certify(timed):
    others = qt.Limits(longitudinal_force=1e5, curvature=0.06, vehicle=qt.Vehicle(1500.0))
    whole = whole_certificate(timed, others)
    assert whole.names == (*NAMES, "curvature", "longitudinal_force")
    assert whole.status == timed.certificate.status | qt.certify(timed.path, others).status
    assert whole.status["longitudinal_force"] == "undefined"  # at rest

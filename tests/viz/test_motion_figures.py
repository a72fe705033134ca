"""The figures of a slew and of a closed loop: labels, units, limits, jumps, unfinished simulations."""

import numpy as np
import pytest
from tests.viz.instants import Column, instants_dataset

from qtraj.viz import figures
from qtraj.viz.figures import save
from qtraj.viz.simulation_figure import simulation_figure
from qtraj.viz.slew_figure import slew_figure
from qtraj.viz.style import BAND

TIMES = np.linspace(0.0, 8.0, 65)
N = len(TIMES)


def quaternions(angle):
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), np.sin(angle / 2), zero, zero], axis=1)


@pytest.fixture(scope="module")
def turn():
    """A bang–bang slew: two parabolas."""
    rate = np.minimum(TIMES, 8.0 - TIMES) / 16
    angle = np.where(TIMES < 4, TIMES**2 / 32, 1.0 - (8.0 - TIMES) ** 2 / 32)
    columns = {
        "angle": Column(angle, "rad", "angle"),
        "angle_rate": Column(rate, "rad s-1", "rate"),
        "angle_acceleration": Column(np.where(TIMES < 4, 1 / 16, -1 / 16), "rad s-2", "acceleration"),
        "quaternion": Column(quaternions(angle), "1", "attitude", "component"),
    }
    return instants_dataset(TIMES, columns, {"title": "A slew"})


def loop(closed=True, unit="rad s-2"):
    """A decaying error; the simulation stopped after three quarters."""
    angle = np.where(TIMES < 6, 0.4 * np.exp(-TIMES), np.nan)
    moving, three = np.zeros((N, 3)) + angle[:, None], np.zeros((N, 3))
    columns = {
        "angle": Column(angle, "rad", "angle"),
        "error": Column(quaternions(angle), "1", "error", "component"),
        "norm": Column(1.0 + 1e-12 * np.sin(TIMES), "1", "length"),
        "quaternion": Column(quaternions(angle), "1", "attitude", "component"),
        "rate": Column(moving, "rad s-1", "rate", "body"),
        "command": Column(moving, unit, "command", "body"),
        "virtual_command": Column(angle, unit.removeprefix("rad "), "virtual command"),
        "program_rate": Column(three, "rad s-1", "rate", "body"),
    }
    if closed:
        columns["closed_form_angle"] = Column(0.4 * np.exp(-TIMES), "rad", "angle")
        columns["closed_form_error"] = Column(quaternions(0.4 * np.exp(-TIMES)), "1", "error", "component")
    return instants_dataset(TIMES, columns, {"scenario_file": "loop.toml"})


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_slew_has_units_and_limits_in_degrees(turn):
    figure = slew_figure(turn, {"max_rate": 0.3, "max_acceleration": 1 / 16})
    angle, rate, acceleration, phase, quaternion = figure.axes
    assert [axes.get_ylabel().split()[-1] for axes in figure.axes] == ["[°]", "[°/s]", "[°/s²]", "[°/s]", "[–]"]
    assert [axes.get_xlabel() for axes in (acceleration, quaternion)] == ["time [s]", "time [s]"]
    assert figure.get_suptitle() == "A slew"
    assert np.allclose(angle.lines[0].get_ydata(), np.degrees(turn["angle"].values))
    assert legend(rate) == ["limit 17.19"]
    assert legend(acceleration) == ["limit 3.581"]
    # The limit is drawn below zero as well.
    assert [line.get_ydata()[0] for line in acceleration.lines[1:]] == pytest.approx(np.degrees([1 / 16, -1 / 16]))
    assert rate.get_ylim()[1] > np.degrees(0.3)
    assert np.allclose(phase.lines[0].get_xdata(), np.degrees(turn["angle"].values))
    assert legend(quaternion) == ["λ₀", "λ₁", "λ₂", "λ₃"]


def test_a_slew_without_limits_shows_none(turn):
    figure = slew_figure(turn, {})
    assert [len(axes.lines) for axes in figure.axes[:3]] == [1, 1, 1]


def test_the_loop_has_its_closed_form_and_its_limit():
    figure = simulation_figure(loop(), np.radians(1.0), 0.5)
    angle, error, command, virtual, rate, length = figure.axes
    assert angle.get_yscale() == "log"
    assert legend(angle) == ["simulated", "closed form", "1°"]
    assert legend(error)[-1] == "closed form"
    assert legend(command) == ["ε₁", "ε₂", "ε₃", "norm", "limit 28.65"]
    assert legend(rate) == ["ω₁", "ω₂", "ω₃", "program"]
    assert rate.lines[-1].get_linestyle() == "-"  # dots would be hidden by those of ω₃
    labels = [axes.get_ylabel() for axes in (angle, command, virtual, rate)]
    assert labels == ["error angle [°]", "command [°/s²]", "virtual command [1/s²]", "body rate [°/s]"]
    assert figure.get_suptitle() == "loop.toml"  # the scenario has no name
    assert length.get_ylim() == pytest.approx((0.9, 1.1))  # round-off is not magnified


def test_a_rate_law_without_a_closed_form():
    figure = simulation_figure(loop(closed=False, unit="rad s-1"), np.radians(2.0), None)
    angle, _, command, *_ = figure.axes
    assert legend(angle) == ["simulated", "2°"]
    assert legend(command) == ["ω₁", "ω₂", "ω₃", "norm"]
    assert command.get_ylabel() == "command [°/s]"


def space_above(figure):
    """Inches between the topmost panel, without its legend, and the edge."""
    return (1 - max(axes.get_position().y1 for axes in figure.axes)) * figure.get_figheight()


def test_without_a_title_there_is_no_band_for_it(turn):
    for draw, dataset in ((lambda x: slew_figure(x, {}), turn), (lambda x: simulation_figure(x, 0.01, 3.0), loop())):
        titled, plain = draw(dataset), draw(dataset.drop_attrs(deep=False))
        assert plain.get_suptitle() == ""
        assert titled.get_figheight() - plain.get_figheight() == pytest.approx(BAND)
        assert space_above(titled) - space_above(plain) == pytest.approx(BAND)
        heights = [[axes.get_position().height * f.get_figheight() for axes in f.axes] for f in (titled, plain)]
        assert heights[0] == pytest.approx(heights[1])


def test_files(turn, tmp_path):
    for figure, name in ((slew_figure(turn, {}), "turn"), (simulation_figure(loop(), 0.01, 3.0), "track")):
        save(figure, tmp_path / f"{name}.svg")
        assert (tmp_path / f"{name}.svg").read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(("former", "present"), [("turn_figure", "slew_figure"), ("track_figure", "simulation_figure")])
def test_former_names_warn_and_work(former, present):
    with pytest.warns(DeprecationWarning, match=f"is now called {present}"):
        assert getattr(figures, former) is getattr(figures, present)

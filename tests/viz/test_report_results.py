"""Reports and figures of results of the library."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import limits_figure, path_figure, tuning_figure
from qtraj.viz.report import page, report_page


def results():
    """One result of each type that has a path or attitudes over time."""
    helix = qt.SpiralHelix([10.0, 0.0], [0.2, 0.4], [1.0, 0.5], 6.0, qt.Placement([3.0, 2.0, 1.0]))
    limits = qt.Limits(curvature=0.2, slope=0.1)
    tuned = qt.Tuned(helix, helix.state(0.0), helix.state(6.0), 0.0, qt.certify(helix, limits), 0, 3)
    times = np.linspace(0.0, 6.0, 25)
    turn = qt.EulerTurn([1.0, 0, 0, 0], [0.0, 0, 0, 1], qt.Quintic(duration=5.0))
    loop = qt.simulate(turn, qt.AccelerationLaw(4.0, 4.0), [1.0, 0.1, 0, 0], np.zeros(4), times)
    return {"tuned": tuned, "helix": helix, "table": qt.evaluate(helix, times), "solution": loop}


@pytest.fixture(scope="module")
def made():
    return results()


@pytest.mark.parametrize("name", ["tuned", "helix", "table", "solution"])
def test_a_result_and_its_dataset_are_reported_alike(made, name):
    itself, dataset = page.report_of(made[name]), page.report_of(made[name].to_xarray())
    assert itself.kind == dataset.kind == ("attitude" if name == "solution" else "path")
    for one, other in zip(itself.bodies, dataset.bodies, strict=True):
        np.testing.assert_array_equal(one.axes, other.axes)
    assert [panel.title for panel in itself.panels] == [panel.title for panel in dataset.panels]
    limited = [(p.title, p.limits[0][0]) for p in dataset.panels if p.limits]
    assert limited == ([("curvature", 0.2), ("slope magnitude", 0.1)] if name == "tuned" else [])


def test_the_report_of_a_tuned_truck_has_its_forces_and_its_vehicle():
    path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02, -0.004], [1.0, 0.4, 0.05, -0.01], 4.5)
    vehicle = qt.Vehicle(12e3, None, 6.0, 0.007, (0.6, 0.5), 0.05)
    certificate = qt.certify(path, qt.Limits(friction=0.6, power=3e5, vehicle=vehicle))
    tuned = qt.Tuned(path, path.state(0.0), path.state(4.5), 0.0, certificate, 0, 3, vehicle=vehicle)
    report = page.report_of(tuned)
    panels = {panel.title: panel for panel in report.panels}
    assert panels["power"].limits == [(3e5, "limit 3e+05")]
    assert panels["power"].series[0].values.min() < -1e5  # braking keeps its sign
    tables = {table.title: table.rows for table in report.tables}
    assert [row[-1] for row in tables["Limits"]] == ["broken", "proved"]
    assert ["mass of the vehicle [kg]", "12000"] in tables["Vehicle"]
    assert [panel.title for panel in page.report_of(tuned.to_xarray()).panels] == list(panels)


def test_figures_take_results_and_explain_what_they_cannot_draw(made):
    labels = path_figure(made["tuned"]).axes[0].get_legend_handles_labels()[1]
    assert labels[0] == "after"
    assert len(limits_figure(made["tuned"].to_xarray()).axes) == len(tuning_figure(made["helix"]).axes)
    with pytest.raises(
        ValueError, match=r"a figure of paths needs path, sample, dcm, defined.*to draw a table, call its plot"
    ):
        path_figure(made["table"])
    for wrong in (3, "paths.nc", {"helix": made["helix"]}):
        with pytest.raises(
            ValueError, match=rf"a path, a result, or a dataset .* was expected, but {type(wrong).__name__} was given"
        ):
            path_figure(wrong)
    with pytest.raises(ValueError, match="a report needs position or quaternion over time"):
        report_page(made["tuned"].certificate)


def test_a_peak_between_two_samples_has_its_own_time():
    """With coarse samples the sampled peak differs from the certificate; the page shows the certificate."""
    path = qt.SpiralHelix([10.0, 0.3, -0.2], [0.0, 0.5], [0.0, 0.4], 5.0)
    limits = qt.Limits(lateral_acceleration=2.0)
    found = qt.certify(path, limits)
    dataset = path_dataset({"before": path, "after": path}, limits, samples=8, findings={"before": found})
    table = page.report_of(dataset).tables[0]
    time, value, _ = found.worst["lateral_acceleration"]
    before, after = table.rows
    assert before[2:] == [f"{value:.6g}", "2", f"{2 - value:.3g}", f"{time:.4g}", found.status["lateral_acceleration"]]
    assert after[-1] in ("within", "broken")
    assert after[5] != before[5]

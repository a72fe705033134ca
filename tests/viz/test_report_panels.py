"""The panels of a report: angles, axis ranges, quaternions, closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import limits_figure
from qtraj.viz.report import report_page
from qtraj.viz.report.angles import heading_pitch_roll

from .pages import Page, shown_panels
from .report_data import closed_loop, two_paths

ROUND_OFF = 1e-12
NINE_DIGITS = 1e-8


def test_upright_frames_have_heading_pitch_and_roll():
    """On a climbing helix the heading grows linearly, the pitch is the slope angle and the roll is zero."""
    helix = qt.SpiralHelix([10.0, 0.0], [0.2, 0.4], [1.0, 0.5], 20.0)
    panels = shown_panels(path_dataset({"helix": helix}, samples=65, frame=qt.Upright()))
    heading = np.array(panels["heading, from x towards y"]["series"][0]["values"])
    expected = np.degrees(0.2 + np.pi / 2 + 0.4 * np.linspace(0.0, 20.0, 65))
    assert heading == pytest.approx(expected, abs=1e-6)  # through 360° without a jump
    pitch, roll = panels["pitch (nose up), roll (left side up)"]["series"]
    assert (pitch["name"], roll["name"]) == ("pitch", "roll")
    assert pitch["values"] == pytest.approx([np.degrees(np.arctan2(0.5, 4.0))] * 65)
    assert roll["values"] == pytest.approx([0.0] * 65, abs=1e-9)
    assert not any("heading" in title for title in shown_panels(path_dataset({"helix": helix}, samples=65)))


def test_roll_is_positive_with_the_left_side_up():
    tilted = Rotation.from_euler("ZYX", [30.0, -10.0, 5.0], degrees=True)  # nose up by 10°, then left side up by 5°
    found = heading_pitch_roll(tilted.as_matrix().T[None])
    assert found[0] == pytest.approx([30.0, 10.0, 5.0])
    assert np.isnan(heading_pitch_roll(np.full((1, 3, 3), np.nan))).all()


def test_one_stop_does_not_scale_an_axis():
    dataset = two_paths()
    curvature = np.full((2, 65), 0.05)
    curvature[0, 30] = 1e7
    dataset["curvature"] = (("path", "sample"), curvature, {"units": "m-1", "limit": 0.1})
    panel = shown_panels(dataset)["curvature"]
    assert panel["range"] == pytest.approx([0.0, 0.15])
    assert panel["note"] == "larger values, up to 1e+07, are not shown"
    assert panel["limits"][0]["drawn"]
    assert max(panel["series"][0]["values"]) == 1e7  # the values themselves are unchanged
    assert shown_panels(two_paths())["speed"]["range"] is None
    figure = limits_figure(path_dataset({"stop": STOP}, samples=513), ["curvature"])
    assert figure.axes[0].get_ylim()[1] < 1.0


STOP = qt.Curve(lambda t: jnp.stack([20 * t**3, 0.5 * jnp.sin(t), 0 * t]) - jnp.stack([0.01 * t, 0.5 * t, 0 * t]), 4.0)
"""A path that nearly stops at its start, where the curvature is large."""


def test_a_component_near_one_does_not_flatten_the_others():
    angle = 0.02 * np.sin(np.linspace(0.0, 6.0, 65))
    near = closed_loop()
    half = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
    near["quaternion"] = (("time", "component"), -half)
    panels = shown_panels(near)
    panel = panels["quaternion"]
    assert [line["name"] for line in panel["series"][:4]] == ["λ₀", "λ₁", "λ₂", "λ₃"]
    assert np.array(panel["series"][0]["values"]) == pytest.approx(-np.cos(angle / 2))  # the values themselves
    low, high = panel["range"]
    assert high == -low == pytest.approx(1.05 * np.abs(np.sin(angle / 2)).max())
    assert panel["note"] == "λ₀, between −1 and −0.99995, is outside the axis range"
    assert shown_panels(two_paths())["speed"]["range"] is None


def test_components_that_vary_share_one_axis():
    """Nothing is omitted if no component stays near 1."""
    turning = closed_loop()
    angle = np.linspace(0.0, 3.0, 65)
    half = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
    turning["quaternion"] = (("time", "component"), half)
    panel = shown_panels(turning)["quaternion"]
    assert (panel["range"], panel["note"]) == (None, "")


def test_a_closed_form_that_does_not_apply_is_not_drawn():
    loop = closed_loop().assign_attrs(closed_form="does not apply: a disturbance acts on the body")
    assert [line["name"] for line in shown_panels(loop)["error angle"]["series"]] == ["angle"]
    assert "closed form" in [line["name"] for line in shown_panels(closed_loop())["error angle"]["series"]]
    text = " ".join(Page(report_page(loop)).text)
    assert "The closed form is not drawn, because it does not apply: a disturbance acts on the body." in text

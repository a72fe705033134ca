"""The body of a vehicle in figures."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import route_figure
from qtraj.viz.obstacles import draw_body


def test_the_body_keeps_its_front_in_reverse():
    """A ball 2 m in front of a car is drawn there on the way forth and on the way back."""
    x, zero = [[0.0, 0, 0], [10.0, 0, 0], [0.0, 0, 0]], np.zeros((3, 3))
    route = qt.Route([0.0, 4.0, 8.0], x, zero, zero)
    limits = qt.Limits(keep_out=[qt.Ball([0.0, 50.0, 0.0], 1.0)], body=[(2.0, 0.4)])
    figure, axes = plt.subplots()
    draw_body(axes, limits, route, np.array([2.0, 4.0, 6.0]), np.array([1.0, 0.0]))
    drawn = [patch.center for patch in axes.patches]
    plt.close(figure)
    assert np.ravel(drawn) == pytest.approx([6.0, 0.0, 11.0, 0.0, 6.0, 0.0])


def test_figures_of_routes_show_obstacles_in_space():
    """The wires of a ball are around its centre, relative to the middle of the path; without obstacles, no scene."""
    x = np.array([[0.0, 0, 0], [20.0, 4.0, 2.0], [40.0, 0, 4.0]])
    route = qt.Route([0.0, 4.0, 8.0], x, np.tile([5.0, 0, 0.5], (3, 1)), np.zeros((3, 3)))
    limits = qt.Limits(speed=9.0, keep_out=[qt.Ball([20.0, -2.0, 1.0], 1.5)])
    dataset = path_dataset({"route": route}, limits)
    (scene,) = [axes for axes in route_figure(dataset, limits).axes if axes.name == "3d"]
    path, *wires = (np.stack(line.get_data_3d(), 1) for line in scene.get_lines())
    assert len(wires) == 3
    centre = np.asarray(dataset["position"].values[-1, 0]) - path[0]
    for wire in wires:
        distance = np.linalg.norm(wire + centre - [20.0, -2.0, 1.0], axis=1)
        np.testing.assert_allclose(distance, 1.5, atol=1e-12)
    assert not [axes for axes in route_figure(dataset, qt.Limits(speed=9.0)).axes if axes.name == "3d"]

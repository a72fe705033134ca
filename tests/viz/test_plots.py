"""`plot()` of paths, tables and tuned paths: the figures, and the messages if there is nothing to draw."""

import importlib.util

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation import extras
from qtraj.viz.history import limits_figure

HELIX = qt.SpiralHelix([10.0, 0.0], [0.2, 0.4], [1.0, 0.5], 6.0)
CURVE = qt.Curve(lambda t: jnp.stack([8 * jnp.cos(t), 9 * jnp.sin(t), 0.5 * t]), 4.0)
TIMES = np.linspace(0.0, 6.0, 13)


@pytest.fixture(scope="module")
def tuned():
    """A hand-made result: a plot needs no search."""
    limits = qt.Limits(curvature=0.2, slope=0.2)
    start = end = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.5])
    return qt.Tuned(HELIX, start, end, 0.0, qt.certify(HELIX, limits), 0, 3)


def labels(axes):
    return axes.get_legend_handles_labels()[1]


@pytest.mark.parametrize("path", [HELIX, CURVE], ids=["helix", "curve"])
def test_a_path_is_drawn_with_the_axes_of_its_frame(path):
    natural, upright = path.plot().axes[0], path.plot(frame=qt.Upright(), trihedra=3).axes[0]
    assert labels(natural) == ["path", "τ (tangent)", "n (normal)", "b (binormal)"]
    assert labels(upright) == ["path", "forward", "left", "up"]
    assert len(upright.collections[0]._segments3d) == 3 * 5
    minimizing = path.plot(frame=qt.RotationMinimizing()).axes[0]
    assert labels(minimizing)[1:] == ["τ (tangent)", "u (first)", "v (second)"]


def test_a_tuned_path_is_drawn_with_its_limits(tuned):
    space, *panels = tuned.plot(frame=qt.Upright()).axes
    assert labels(space) == ["after", "forward", "left", "up"]
    limits = [text for axes in panels for text in labels(axes) if text.startswith("limit")]
    assert limits == ["limit 0.2", "limit 0.2"]


@pytest.fixture(scope="module")
def truck():
    """A result with limits on forces, of a path that brakes at its end."""
    path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02, -0.004], [1.0, 0.4, 0.05, -0.01], 4.5)
    vehicle = qt.Vehicle(12e3, (1e4, 2e4, 3e4), 6.0, 0.007, (0.6, 0.5), 0.05)
    limits = qt.Limits(friction=0.9, power=3e5, vehicle=vehicle)
    return qt.Tuned(path, path.state(0.0), path.state(4.5), 0.0, qt.certify(path, limits), 0, 3, vehicle=vehicle)


def test_limited_forces_are_drawn_from_a_result_a_file_and_a_dataset(truck, tmp_path):
    truck.save(tmp_path / "tuned.toml")
    expected = qt.evaluate(truck.path, np.linspace(0.0, 4.5, 513), ("friction", "power"), vehicle=truck.vehicle)
    assert float(expected.power[-1]) < -1e5  # it brakes
    dataset = limits_figure(truck.to_xarray(), ["friction", "power"])
    for figure in (truck.plot(), qt.load(tmp_path / "tuned.toml").plot(), dataset):
        panels = {axes.get_ylabel().split(" ")[0]: axes for axes in figure.axes}
        for name, limit in (("friction", 0.9), ("power", 3e5)):
            line, bound = panels[name].lines
            np.testing.assert_allclose(line.get_ydata(), expected.values[name], rtol=1e-9)
            assert bound.get_ydata()[0] == limit
        low, high = panels["power"].get_ylim()
        assert low < float(expected.power.min())
        assert high > 3e5


def test_a_table_draws_the_named_outputs():
    table = qt.evaluate(HELIX, TIMES, ("position", "curvature", "rate", "dcm", "defined"), frame=qt.Upright())
    axes = table.plot().axes
    assert [a.get_ylabel() for a in axes] == ["position\n[m]", "curvature\n[1/m]", "rate\n[rad/s]"]
    assert [labels(a) for a in axes] == [["x", "y", "z"], [], ["forward", "left", "up"]]
    assert np.array_equal(axes[2].lines[2].get_ydata(), np.asarray(table.rate)[:, 2])
    assert axes[-1].get_xlabel() == "time from the start of the path [s]"
    assert [a.get_ylabel() for a in table.plot("rate").axes] == ["rate\n[rad/s]"]


def test_several_paths_are_drawn_together_also_with_different_times():
    stack = jax.vmap(lambda k: qt.SpiralHelix(jnp.stack([10 + k, 0 * k]), [0.2, 0.4], [1.0, 0.5], 6.0))(jnp.arange(3.0))
    for times in (TIMES, np.linspace(0.0, [4.0, 5.0, 6.0], 9, axis=1)):
        curvature, rate = qt.evaluate(stack, times, ("curvature", "rate")).plot().axes
        assert labels(curvature) == ["path 1", "path 2", "path 3"]
        assert labels(rate) == ["tangent", "normal", "binormal"]
        assert len(rate.lines) == 9
    first = qt.evaluate(stack, TIMES, ("rate",), components="first").plot().axes[0].lines[2].get_ydata()
    assert np.array_equal(first, qt.evaluate(stack, TIMES, ("rate",)).plot().axes[0].lines[2].get_ydata())


def test_undefined_values_are_not_drawn():
    bend = qt.Curve(lambda t: jnp.stack([t, (t - 1) ** 3, 0 * t]), 2.0)  # straight at t = 1
    [axes] = qt.evaluate(bend, [0.0, 0.5, 1.0, 1.5, 2.0], ("rate", "defined")).plot().axes
    assert np.isnan(axes.lines[0].get_ydata()).tolist() == [False, False, True, False, False]


def test_messages_say_why_nothing_can_be_plotted(tuned):
    table = qt.evaluate(HELIX, TIMES, ("curvature",))
    with pytest.raises(ValueError, match="not contain 'rate'; it contains curvature"):
        table.plot("rate")
    with pytest.raises(ValueError, match="no outputs to plot: it contains only dcm"):
        qt.evaluate(HELIX, TIMES, ("dcm",)).plot()
    with pytest.raises(ValueError, match="one path was expected, but a batch of 2 was given"):
        jax.tree.map(lambda x: jnp.stack([x, x]), HELIX).plot()
    many = qt.Tuned(
        *jax.tree.map(lambda x: jnp.stack([x, x]), (HELIX, tuned.start, tuned.end)), 0.0, tuned.certificate, [0, 0], 3
    )
    with pytest.raises(ValueError, match=r"select one path with result\[k\]"):
        many.plot()


@pytest.mark.parametrize(("package", "extra"), [("matplotlib", "viz"), ("xarray", "io")])
def test_a_missing_package_names_its_extra(package, extra, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(extras.importlib.util, "find_spec", lambda name: None if name == package else found(name))
    with pytest.raises(ModuleNotFoundError, match=rf"a plot needs {package}: pip install 'qtraj\[{extra}\]'"):
        HELIX.plot()

"""The figure of an atlas: regions, border, value, limits, and names that are unknown."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.viz.figures import atlas_figure


def found(**values):
    def classes(x, y):
        status = np.where(x + y < 1, "feasible", np.where(x < 0.9, "infeasible", "failed"))
        limit = np.where(x > y, "lateral_acceleration", "curvature")
        return {"status": status, "first_limit": limit, **{name: rule(x, y) for name, rule in values.items()}}

    x, y = qt.AtlasAxis("entry_speed", 0.0, 1.0, 0.05, 8, unit="m/s"), qt.AtlasAxis("y", 0.0, 1.0, 0.05, 8)
    return qt.atlas(classes, x, y)


def test_the_figure_shows_regions_border_and_value():
    atlas = found(duration=lambda x, y: 2 + x, margin=lambda x, y: y)
    axes, bar = atlas.plot().axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("entry speed [m/s]", "y")
    assert bar.get_ylabel() == "duration [s]"
    [border] = axes.lines
    assert abs(border.get_xdata() + border.get_ydata() - 1).max() <= 0.05
    labels = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert labels == ["infeasible: curvature", "infeasible: lateral acceleration", "failed"]
    colours = axes.collections[1].get_array().reshape(400, 400)
    assert np.ma.getmaskarray(colours)[-1, -1]
    assert colours[0, 100] == pytest.approx(2 + 100 / 399, abs=0.05)
    assert atlas.plot("margin").axes[1].get_ylabel() == "margin"


def test_an_atlas_without_values_or_border_is_drawn():
    [axes] = atlas_figure(found(), title="A corner").axes
    assert axes.get_title() == "A corner"
    everywhere = qt.atlas(lambda x, y: x < 2, qt.AtlasAxis("x", 0, 1, 0.1, 2), qt.AtlasAxis("y", 0, 1, 0.1, 2))
    assert list(everywhere.plot().axes[0].lines) == []
    with pytest.raises(ValueError, match=r"no value 'duratio'.*did you mean 'duration'"):
        found(duration=lambda x, y: x).plot("duratio")

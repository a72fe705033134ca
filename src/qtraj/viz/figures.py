"""Figures for documents: each a pure function that returns a matplotlib Figure, without matplotlib's global state.

Equal axes in space, units on every axis, colours and line styles told apart with any colour vision and in grey; `save`
writes png, svg or pdf.
"""

from qtraj.viz.history import limits_figure, tuning_figure
from qtraj.viz.loops_figure import loops_figure
from qtraj.viz.orientation_figure import orientation_figure
from qtraj.viz.precision_figure import precision_figure
from qtraj.viz.profiles_figure import profiles_figure
from qtraj.viz.space import path_figure
from qtraj.viz.style import save
from qtraj.viz.table_figure import table_figure
from qtraj.viz.track_figure import track_figure
from qtraj.viz.turn_figure import turn_figure

__all__ = [
    "limits_figure",
    "loops_figure",
    "orientation_figure",
    "path_figure",
    "precision_figure",
    "profiles_figure",
    "save",
    "table_figure",
    "track_figure",
    "tuning_figure",
    "turn_figure",
]

"""Provide figures for documents: pure functions that return a matplotlib Figure and change no global state.

The axes of 3-D plots have equal scales, and every axis has a unit. Colours can be distinguished with all common forms
of colour blindness, and line styles can be distinguished even in greyscale. `save` writes png, svg or pdf files.
"""

import warnings
from typing import Any

from qtraj.viz.atlas_figure import atlas_figure
from qtraj.viz.history import limits_figure, tuning_figure
from qtraj.viz.loops_figure import loops_figure
from qtraj.viz.orientation_figure import orientation_figure
from qtraj.viz.precision_figure import precision_figure
from qtraj.viz.profiles_figure import profiles_figure
from qtraj.viz.route_figure import route_figure
from qtraj.viz.simulation_figure import simulation_figure
from qtraj.viz.slew_figure import slew_figure
from qtraj.viz.space import path_figure
from qtraj.viz.speed_profile_figure import speed_profile_figure
from qtraj.viz.style import save
from qtraj.viz.table_figure import table_figure

__all__ = [
    "atlas_figure",
    "limits_figure",
    "loops_figure",
    "orientation_figure",
    "path_figure",
    "precision_figure",
    "profiles_figure",
    "route_figure",
    "save",
    "simulation_figure",
    "slew_figure",
    "speed_profile_figure",
    "table_figure",
    "tuning_figure",
]

_RENAMED = {"turn_figure": "slew_figure", "track_figure": "simulation_figure"}
"""Deprecated names and their replacements; the old names issue a warning until version 1.0."""


def __getattr__(name: str) -> Any:
    if name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    present = _RENAMED[name]
    warnings.warn(f"qtraj.viz.figures.{name} is now called {present}", DeprecationWarning, stacklevel=2)
    return globals()[present]

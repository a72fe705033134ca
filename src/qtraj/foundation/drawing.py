"""Give lower layers access to the plotting functions: every `plot()` method calls `draw`.

Results are in lower layers than the plotting functions and must not import them. The root package may import all
layers, so it registers the module of these functions by name.
"""

import importlib
from typing import TYPE_CHECKING, Any

from qtraj.foundation.extras import require_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_plot_modules: list[str] = []


def set_plot_module(module: str) -> None:
    """Register the name of the module that contains the plotting functions."""
    _plot_modules[:] = [module]


def draw(function: str, *arguments: Any, **options: Any) -> "Figure":
    """Draw a figure with the named function of the registered plotting module.

    **Raises:** ModuleNotFoundError with the extra to install, if matplotlib or xarray is missing.
    """
    require_package("matplotlib", "a plot", "viz")
    require_package("xarray", "a plot")
    return getattr(importlib.import_module(_plot_modules[0]), function)(*arguments, **options)

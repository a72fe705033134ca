"""Let lower layers call the plotting functions: every `plot()` method calls `draw`.

Results are in lower layers than the figures and must not import upwards. The root package, which may import all layers,
registers the plotting module by its name.
"""

import importlib
from typing import TYPE_CHECKING, Any

from qtraj.foundation.extras import require_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_plot_modules: list[str] = []


def set_plot_module(module: str) -> None:
    """Register the module with the plotting functions, by its name."""
    _plot_modules[:] = [module]


def draw(function: str, *arguments: Any, **options: Any) -> "Figure":
    """Draw a figure with the named function of the registered plotting module.

    **Raises:** ModuleNotFoundError, naming the extra, if matplotlib or xarray is missing.
    """
    require_package("matplotlib", "a plot", "viz")
    require_package("xarray", "a plot")
    return getattr(importlib.import_module(_plot_modules[0]), function)(*arguments, **options)

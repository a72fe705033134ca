"""The way from a result to its figure: `plot()` asks here, and the root package says which module draws.

Results lie below the figures, and imports go down only. So nothing below knows the module that draws: the root package,
which stands above all others, names it when it is imported.
"""

import importlib
from typing import TYPE_CHECKING, Any

from qtraj.foundation.extras import require_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_drawers: list[str] = []


def set_plot_module(module: str) -> None:
    """Name the module whose functions draw."""
    _drawers[:] = [module]


def draw(kind: str, *given: Any, **options: Any) -> "Figure":
    """The figure that the function `kind` of the module that draws makes.

    **Raises:** ModuleNotFoundError, naming the extra, where matplotlib or xarray is missing.
    """
    require_package("matplotlib", "a plot", "viz")
    require_package("xarray", "a plot")
    return getattr(importlib.import_module(_drawers[0]), kind)(*given, **options)

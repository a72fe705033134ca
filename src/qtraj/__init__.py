"""qtraj: differentiable trajectories and orientation in JAX, for the positions and attitudes of vehicles.

Each public name is imported when it is first used, so that `import qtraj` is fast. `__init__.pyi` lists the names.
"""

import importlib
import warnings
from typing import Any

import lazy_loader

from qtraj._version import __version__ as __version__
from qtraj.foundation import drawing as _drawing

_PACKAGES = ("algebra", "batch", "cli", "design", "foundation", "io", "motion", "path", "scenario", "sweep", "viz")
"""Packages that are available as attributes without an import, for example `qtraj.path.hodograph`."""

_RENAMED = {"CubicSpline": "MultiKnotCubic", "TurnChain": "SlewSequence"}
"""Former public names and the present ones; the former names issue a warning until version 1.0."""

_import, _, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted(["__version__", *_names])  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        now = _RENAMED[name]
        warnings.warn(f"qtraj.{name} is now called qtraj.{now}", DeprecationWarning, stacklevel=2)
        return _import(now)
    if name in _PACKAGES:
        return importlib.import_module(f"qtraj.{name}")
    if name not in _names:
        raise AttributeError(f"module 'qtraj' has no attribute {name!r}")
    return _import(name)


def __dir__() -> list[str]:
    return list(__all__)


# Registered here because `plot()` of results in lower layers needs this module, and those layers must not import it.
_drawing.set_plot_module("qtraj.viz.plots")

"""What computed a dataset, for its attributes."""

import platform

import jax
import numpy as np

from qtraj._version import __version__


def made_with(dtype: np.dtype) -> dict[str, str]:
    """The attributes `versions` and `dtype` of a dataset whose numbers were computed in `dtype`."""
    versions = f"qtraj {__version__}, jax {jax.__version__}, numpy {np.__version__}, Python {platform.python_version()}"
    return {"versions": versions, "dtype": str(dtype)}

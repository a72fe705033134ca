"""Collect the versions of the packages that computed a result, as attributes of its dataset."""

import platform

import jax
import numpy as np

from qtraj._version import __version__


def provenance_attributes(dtype: np.dtype) -> dict[str, str]:
    """Return the attributes `source`, `versions` and `dtype` of a dataset with numbers computed in `dtype`."""
    versions = f"qtraj {__version__}, jax {jax.__version__}, numpy {np.__version__}, Python {platform.python_version()}"
    return {"source": f"qtraj {__version__}", "versions": versions, "dtype": str(dtype)}

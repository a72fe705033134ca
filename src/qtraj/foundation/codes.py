"""Compare the codes of results with those that are good, also inside a trace."""

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.foundation.arrays import concrete


def where_code(codes: Any, good: Callable[[Any], Any]) -> Any:
    """Return whether the `codes` are `good`: a bool, an array for a batch, or a traced array in a trace."""
    known = concrete(codes)
    if known is None:
        return good(codes)
    found = good(known)
    return bool(found) if np.ndim(found) == 0 else found
